r"""Compute the Strehl ratio, exactly and by Marechal's approximation, and hold the estimate over a pupil.

    exact       |sum w exp(i k OPD)|^2                   (M. Born, E. Wolf, Principles of Optics, 9.1)
    Marechal    exp(-(k sigma)^2), sigma the rms OPD     fails for shocks, where the OPD is not small

`estimate_strehl` (estimate.py) launches scrambled Sobol points over the pupil in independent replicates, and traces and
reduces them on the device; the spread of the replicates gives the standard error. A symmetric set-up is traced by
radial quadrature, with far fewer rays (tracing/pupil/radial_quadrature.py).
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..display.error_budget import ErrorBudget
from ..display.quantities import Quantity, listed
from ..display.shown import shown
from ..display.verdict import Verdict, judge
from ..inputs.arguments import Numbers, checked
from ..inputs.wavelength import check_wavelength
from ..process.clock import clocked, stage
from ..wavefront import check_metres, check_terms, check_wavefront, map_points, mean_phasor, remove_terms, weighted_mean
from ..wavefront.strehl_errors import main_cause, phase_error


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
        ValueError: A wavelength outside 0.1 to 20 um, numbers that are not finite, an OPD of so many waves that its
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
        budget: Computes the error budget from the estimate; called by `error`.
        spread: Computes the numbers with their errors from the estimate; called by `quantities`.
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
    budget: Any = field(default=None, repr=False)
    spread: Any = field(default=None, repr=False)

    @cached_property
    def error(self) -> ErrorBudget:
        """Error budget, each entry an error of `value`; computed at the first access, in the time seconds["error"].

        "+-" covers the truth in at least 95 of 100 cases. The causes: display/error_budget.py; "sampling" is from the
        replicates.
        """
        with clocked() as spent, stage("error"):
            found = self.budget(self) if self.budget is not None else ErrorBudget()
        self.seconds["error"] = spent["total"]
        return found

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """The numbers with their errors: "value", "marechal", "opd_rms" [m], "boresight_x", "boresight_y" [rad].

        The parts of each error: see strehl_errors.py. Computed at the first access, from `error`.
        """
        if self.spread is not None:
            return self.spread(self)
        x, y = (float(angle) for angle in self.boresight)
        bare = {"value": self.value, "marechal": self.marechal}
        return {name: Quantity(number, is_ratio=True) for name, number in bare.items()} | {
            "opd_rms": Quantity(self.opd_rms, unit="m"),
            "boresight_x": Quantity(x, unit="rad"),
            "boresight_y": Quantity(y, unit="rad"),
        }

    @cached_property
    def phase_error(self) -> float:
        """Rms phase error of the rays [rad] according to the budget without the sampling error; NaN if not known."""
        return phase_error(self.value, self.error)

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
