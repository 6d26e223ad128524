"""The Strehl ratio |sum w exp(i k OPD)|^2 (M. Born, E. Wolf, Principles of Optics, 9.1), and its estimate over a pupil.

Marechal's exp(-(k sigma)^2), sigma the rms OPD, fails for shocks, where the OPD is not small.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.tracing.tasks.sums import fit_terms

from ..display.quantities import ErrorBudget, Quantity, Verdict, judge, listed, main_cause
from ..display.shown import shown
from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_wavelength
from ..medium import IndexField
from ..process.clock import clocked, stage
from ..tracing.lines import box_size
from ..tracing.stop import greatest_contrast
from ..wavefronts.terms import (
    check_metres,
    check_terms,
    check_wavefront,
    map_points,
    mean_phasor,
    remove_terms,
    weighted_mean,
)


@checked
def strehl(
    opd: Numbers,
    wavelength: float,
    weights: Numbers | None = None,
    remove: str | Iterable[str] = ("piston",),
    *,
    points: Numbers | None = None,
) -> float:
    """Exact Strehl ratio |<exp(i k OPD)>|^2 of a wavefront.

    Args:
        opd: Optical path difference [m], any shape.
        wavelength: Wavelength [m].
        weights: Weight of each sample, or None for equal weights; samples of weight 0 (outside the pupil) may be NaN.
        remove: Terms removed first: "piston" (which changes nothing), "tilt" and "focus".
        points: Pupil coordinates of the samples [m], shape (n, 2); "tilt" and "focus" need them unless `opd` is a map,
            a two-axis array of equal pixels.

    Raises:
        TypeError: The wavelength is not one number.
        ValueError: A wavelength outside 0.1 to 24 um, numbers that are not finite, an OPD of so many waves that its
            unit cannot be metres, shapes that disagree, an unknown term.

    Examples:
        >>> import numpy as np
        >>> step = 0.5 * 905e-9 * (np.arange(1000) < 500)  # half a wave over half of the pupil
        >>> round(strehl(step, 905e-9), 6)
        0.0
    """
    opd, weights, wavelength = _residual(opd, wavelength, weights, remove, points)
    return abs(mean_phasor(opd, weights, wavelength)) ** 2


@checked
def strehl_marechal(
    opd: Numbers,
    wavelength: float,
    weights: Numbers | None = None,
    remove: str | Iterable[str] = ("piston",),
    *,
    points: Numbers | None = None,
) -> float:
    """Marechal's approximation exp(-(k sigma)^2) of the Strehl ratio; arguments and errors as for `strehl`.

    Examples:
        >>> import numpy as np
        >>> step = 0.5 * 905e-9 * (np.arange(1000) < 500)  # the exact ratio is 0
        >>> round(strehl_marechal(step, 905e-9), 3)
        0.085
    """
    opd, weights, wavelength = _residual(opd, wavelength, weights, (*check_terms(remove), "piston"), points)
    return float(np.exp(-((2.0 * np.pi / wavelength) ** 2) * weighted_mean(weights, opd**2)))


def _residual(opd, wavelength, weights, remove, points) -> tuple[np.ndarray, np.ndarray, float]:
    """Check the arguments; return the OPD [m] without the removed terms, the weights and the wavelength [m]."""
    wavelength = check_wavelength(wavelength)
    points = map_points(opd, points)
    opd, weights = check_wavefront(opd, weights)
    check_metres(opd, weights)
    return remove_terms(opd, remove, points, weights), weights, wavelength


@shown
@dataclass(frozen=True, eq=False, repr=False)
class StrehlEstimate:
    """A Strehl ratio estimated over a pupil, with its errors and its plan.

    Attributes:
        value: Exact Strehl ratio of the rays that arrived.
        standard_error: Standard error of `value` from the spread of independent replicates.
        marechal: Marechal's approximation.
        opd_rms: Rms OPD after removing the terms [m].
        boresight: Deflection of the beam along the pupil's two axes [rad], shape (2,): slopes of the OPD's plane. In
            an ambient medium of index n the beam is turned by 1/n of them.
        ray_count: Rays that the estimate represents: the requested number, rounded up to whole replicates.
        traced_ray_count: Rays actually traced; far fewer if a symmetric set-up was traced by radial quadrature, whose
            sampling error is no greater, or a smooth wavefront on lattices.
        blocked: Fraction of the rays that did not arrive; the mean in `value` does not include them.
        plan: What was chosen, skipped and why.
        seconds: Wall time by stage: see STAGES in clock.py.
        evaluation_count: Total number of field evaluations.
        varied: The rays on which the errors are computed, and how they change by cause (StrehlVariants).
        budgets: Computes the error budgets of all numbers.
    """

    value: float
    standard_error: float
    marechal: float
    opd_rms: float
    boresight: np.ndarray
    ray_count: int
    blocked: float
    plan: Any
    seconds: dict[str, float] = field(default_factory=dict)
    evaluation_count: int = 0
    traced_ray_count: int = 0
    varied: Any = field(default=None, repr=False)
    budgets: Any = field(default=None, repr=False)

    @cached_property
    def errors(self) -> dict[str, ErrorBudget]:
        """Error budgets of all numbers, by the names of `quantities`: see `error`."""
        with clocked() as spent, stage("error"):
            found = {} if self.budgets is None else self.budgets()
        self.seconds["error"] = spent["total"]
        return found

    @property
    def error(self) -> ErrorBudget:
        """The error of `value` by cause, and "total", which covers the truth 95 times of 100.

        Each is the change of the Strehl ratio of some rays where one thing about the run is done another way
        (tracing/variants/causes.py); "sampling" is from the replicates. Computed at the first access, in the time
        seconds["error"].
        """
        return self.errors.get("value", ErrorBudget())

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """The numbers with their errors: "value", "marechal", "opd_rms" [m], "boresight_x", "boresight_y" [rad].

        Computed at the first access, as `error`.
        """
        x, y = (float(angle) for angle in self.boresight)
        numbers = {"value": self.value, "marechal": self.marechal, "opd_rms": self.opd_rms}
        units = {"opd_rms": "m", "boresight_x": "rad", "boresight_y": "rad"}
        return {
            name: Quantity(
                number,
                self.errors[name]["total"] if name in self.errors else math.nan,
                units.get(name, ""),
                is_ratio=name not in units,
            )
            for name, number in (numbers | {"boresight_x": x, "boresight_y": y}).items()
        }

    @property
    def verdict(self) -> Verdict:
        """Whether the value is meaningful given its error, and why: see verdict.py."""
        return judge({"Strehl ratio": self.quantities["value"]}, main_cause(self.error))

    def __repr__(self) -> str:
        """Return the numbers with their errors, and the plan; the first call traces some rays for the errors."""
        found = self.quantities
        boresight = listed([found[f"boresight_{axis}"].scaled(1e6, "urad") for axis in "xy"])
        lines = [
            f"StrehlEstimate {found['value']}",
            f"  Marechal {found['marechal']}, OPD rms {found['opd_rms'].scaled(1e9, 'nm')}",
            f"  boresight x, y {boresight}",
            f"  {self.ray_count} rays, {self.traced_ray_count} traced: {str(self.plan).splitlines()[0]}",
        ]
        verdict = self.verdict
        return "\n".join([*lines, f"  {verdict.level}: {verdict.reason}"] if verdict else lines)


class NoRayArrived(ValueError):
    """A pupil of which no ray arrived beyond the field: it has no Strehl ratio."""


def combined(total: np.ndarray, phasor: np.ndarray, wavelength: float, remove: tuple[str, ...]) -> dict[str, float]:
    """Return ratio, Marechal's approximation and rms OPD from the sum of all replicates' moments and their phasors.

    Raises:
        NoRayArrived: No ray arrived beyond the field.
    """
    if total[0] == 0:
        raise NoRayArrived(
            "no ray of the pupil arrived beyond the field: all met the body or left their path; "
            "move the pupil, or turn its normal toward the flow"
        )
    rms = fit_terms(total, remove)[1]
    value = float(np.abs(np.add.reduce(phasor) / total[0]) ** 2)
    return {
        "value": value,
        "marechal": float(np.exp(-((2.0 * np.pi * rms / wavelength) ** 2))),
        "opd_rms": rms,
    }


def met_nothing(field: IndexField, size: float, wavelength: float, tolerance: float) -> bool:
    """Return whether no ray met the field's contrast although it could matter; `size` is the rays' OPD [m]."""
    # Fraction of the tolerance below which an optical path difference counts as zero.
    if size > 1e-3 * tolerance * wavelength:
        return False
    return greatest_contrast(field) * box_size(field) > tolerance * wavelength
