r"""The Strehl ratio: exact, by Marechal's approximation, and estimated over millions of rays on the device.

    exact       |sum w exp(i k OPD)|^2                   (M. Born, E. Wolf, Principles of Optics, 9.1)
    Marechal    exp(-(k sigma)^2), sigma the rms OPD     fails for shocks, where the OPD is not small

`estimate_strehl` launches scrambled Sobol points over the pupil in independent replicates, traces and reduces them
where the rays are; the spread of the replicates gives the standard error. A symmetric set-up is traced as a fan of far
fewer rays (tracing/pupil_fan.py).
"""

import math
import time
import warnings
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any

import numpy as np

from .callable_module import make_callable
from .medium import IndexField
from .quantities import Quantity, Verdict, judge_strehl, listed
from .rays import Disc, as_unit_vector
from .strehl_budget import StrehlBudget
from .strehl_errors import estimate_quantities, main_cause, phase_error
from .tracing.lines import box_size
from .tracing.meeting import greatest_contrast
from .tracing.plan import TracePlan
from .tracing.pupil_fan import SETTLED
from .tracing.pupil_job import REPLICATES, find_job, make_job
from .tracing.pupil_sums import fit_moments
from .tracing.retrace import told_of_rejected
from .wavefront import check_metres, check_terms, check_wavefront, map_points, remove_terms
from .wavelength import check_wavelength

# The share of the tolerance below which an optical path difference is none.
UNSEEN = 1e-3


def strehl(opd, wavelength: float, weights=None, remove=("piston",), *, points=None) -> float:
    """Exact Strehl ratio |<exp(i k OPD)>|^2 of a wavefront.

    Args:
        opd: Optical path difference [m], any shape.
        wavelength: Wavelength [m].
        weights: Share of each sample, or None for equal shares; samples of weight 0 (outside the pupil) may be NaN.
        remove: Terms taken out before: "piston" (which changes nothing) and "tilt".
        points: Pupil coordinates of the samples [m], shape (n, 2); "tilt" needs them unless `opd` is a map, a
            two-axis array of equal pixels.

    Raises:
        TypeError: The wavelength is not one number.
        ValueError: A wavelength outside 0.1 to 20 um, numbers that are not finite, an OPD of so many waves that its
            unit must be another one, shapes that disagree, an unknown term.
    """
    wavelength = check_wavelength(wavelength)
    points = map_points(opd, points)
    opd, weights = check_wavefront(opd, weights)
    check_metres(opd, weights)
    opd = remove_terms(opd, remove, points, weights)
    return float(np.abs(weights @ np.exp(2j * np.pi / wavelength * opd)) ** 2)


def strehl_marechal(opd, wavelength: float, weights=None, remove=("piston",), *, points=None) -> float:
    """Marechal's approximation exp(-(k sigma)^2) of the Strehl ratio; arguments and errors as for `strehl`."""
    wavelength = check_wavelength(wavelength)
    points = map_points(opd, points)
    opd, weights = check_wavefront(opd, weights)
    check_metres(opd, weights)
    opd = remove_terms(opd, (*check_terms(remove), "piston"), points, weights)
    return float(np.exp(-((2.0 * np.pi / wavelength) ** 2) * (weights @ opd**2)))


@dataclass(frozen=True, eq=False, repr=False)
class StrehlEstimate:
    """A Strehl ratio and what belongs to it.

    Attributes:
        value: Exact Strehl ratio of the rays that arrived.
        standard_error: Standard error of `value` from the spread of independent replicates.
        marechal: Marechal's approximation.
        opd_rms: Rms OPD after the terms removed [m].
        boresight: Deflection of the beam along the pupil's two axes [rad], shape (2,): slopes of the OPD's plane.
        ray_count: Rays that the estimate stands for: those asked for, rounded up to whole replicates.
        traced_ray_count: Rays really traced; far fewer where a symmetric set-up was traced as a fan, whose sampling
            error is no greater.
        blocked: Share of the rays that did not arrive; they carry no light into `value`'s mean.
        plan: What was chosen, skipped and why.
        seconds: Time spent: "compile", "kernel", "total".
        evaluation_count: Field evaluations in all.
        budget: Makes the error budget from the estimate; `error` calls it.
        spread: Makes the numbers with their errors from the estimate; `quantities` calls it.
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
    def error(self) -> dict[str, float]:
        """Error budget, each entry an error of `value`; computed when first read.

        "step", "interpolation", "resampling" and "precision" from rays traced again, see tracing/budget.py, "sampling"
        from the replicates, "truncation" from what rays may have lost where the known air ends (known_air.py), and
        "total", their root sum of squares.
        """
        return self.budget(self) if self.budget is not None else {}

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """The numbers with their errors: "value", "marechal", "opd_rms" [m], "boresight_x", "boresight_y" [rad].

        What each error consists of: see strehl_errors.py. Computed when first read, from `error`.
        """
        if self.spread is not None:
            return self.spread(self)
        x, y = (float(angle) for angle in self.boresight)
        bare = {"value": self.value, "marechal": self.marechal}
        return {name: Quantity(number) for name, number in bare.items()} | {
            "opd_rms": Quantity(self.opd_rms, unit="m"),
            "boresight_x": Quantity(x, unit="rad"),
            "boresight_y": Quantity(y, unit="rad"),
        }

    @cached_property
    def phase_error(self) -> float:
        """Rms phase error of the rays [rad] that the budget stands for, but for the sampling; NaN if not known."""
        return phase_error(self.value, self.error)

    @property
    def verdict(self) -> Verdict:
        """What the error makes of the value: fine, a warning or worthless, and why; see quantities.py."""
        return judge_strehl(self.quantities["value"], main_cause(self.error))

    def __repr__(self) -> str:
        """The numbers with their errors and the plan. Some rays are traced for the errors, when first asked for."""
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


def estimate_strehl(
    field: IndexField,
    pupil: Disc,
    *,
    wavelength: float | None = None,
    ray_count: int = 1_000_000,
    tolerance: float = 1e-3,
    remove=("piston",),
    backend: str = "auto",
    device: str | None = None,
    precision: str = "float32",
    method: str = "auto",
    step: float | None = None,
    max_steps: int | None = None,
    direction=None,
    seed: int = 0,
    symmetry: str | bool = "auto",
    allow_truncation: bool = False,
) -> StrehlEstimate:
    """Strehl ratio of a plane wave seen through a field by a pupil.

    Rays leave the pupil along its normal (or `direction`): by the reversibility of light that is the wavefront a
    distant point on that line sends in. They stop on a plane across the line, beyond the field's box.

    Args:
        field: The refractive index.
        pupil: The pupil; it looks along its normal.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm where it has none.
        ray_count: Rays over the disc, in 16 replicates. A fan traces fewer, for at least the same accuracy.
        tolerance: OPD error asked for [waves].
        remove: Terms taken out of the wavefront: "piston", "tilt".
        backend: See `trace`; likewise device, precision, method, step and max_steps.
        device: Device of the backend.
        precision: "float32" or "float64".
        method: Tracing method.
        step: Step of method "fixed" [m].
        max_steps: Steps after which a ray is given up.
        direction: Look direction, if not along the pupil's normal.
        seed: Seed of the scrambling.
        symmetry: "auto" traces a fan of rays instead of the disc where field, pupil and rays are symmetric about the z
            axis; "off" or False never does; True refuses a set-up that is not symmetric.
        allow_truncation: Whether more than a thousandth of the pupil may look through disturbed air that ends at the
            field's box, or pass beside it there; a warning is issued then, and error["truncation"] says what it may
            cost.

    Raises:
        TypeError: `field` or `pupil` of the wrong kind.
        ValueError: A name or number that makes no sense; another wavelength than the field's; no ray that meets the
            field, or that arrives; symmetry=True without symmetry; a truncated view without `allow_truncation`.
    """
    start = time.perf_counter()
    if not isinstance(field, IndexField):
        raise TypeError(f"field must be an IndexField, got {type(field).__name__}")
    if not isinstance(pupil, Disc):
        raise TypeError(f"pupil must be a Disc, got {type(pupil).__name__}")
    wavelength = field.wavelength_for(wavelength)
    remove = check_terms(remove)
    if not isinstance(ray_count, (int, np.integer)) or ray_count < REPLICATES:
        raise ValueError(f"ray_count must be a whole number of at least {REPLICATES}, got {ray_count!r}")
    look = pupil.normal if direction is None else as_unit_vector(direction, "direction")
    job = find_job(
        field,
        pupil,
        look,
        wavelength,
        int(ray_count),
        seed,
        "tilt" in remove,
        symmetry,
        method=method,
        backend=backend,
        device=device,
        precision=precision,
        step=step,
        tolerance=tolerance,
        max_steps=max_steps,
    )
    job.air.check(allow_truncation)
    if job.air.is_truncated:
        warnings.warn(f"{job.air.described}: the Strehl ratio is that of the known air only", stacklevel=2)
    sums = job.run()
    traced, plan = job.traced_ray_count, job.plan
    evaluations, seconds = sums.evaluation_count, dict(sums.seconds)
    standard_error = _standard_error(sums.moments, sums.phasors)
    if job.may_be_refined and not standard_error <= SETTLED:
        sums = job.refined()
        standard_error = _standard_error(sums.moments, sums.phasors)
        traced += job.per_replicate * REPLICATES
        more = f"standard error of that fan above {SETTLED:g}, as at an edge: one of {REPLICATES} x {job.per_replicate}"
        plan = replace(plan, reasons=(*plan.reasons, more))
        evaluations += sums.evaluation_count
        seconds = {stage: spent + sums.seconds.get(stage, 0.0) for stage, spent in seconds.items()}
    plan = told_of_rejected(plan, sums.rejected_count, sums.ray_count, sums.greatest_error, wavelength)
    estimate = _combine(sums.moments, sums.phasors, wavelength, remove)
    if _met_nothing(field, sums.moments, wavelength, tolerance):
        warnings.warn(
            "every ray of the pupil passes through undisturbed air only, though the field holds other: the Strehl "
            "ratio is 1; check the units (metres are expected), the direction and the position of the pupil",
            stacklevel=2,
        )

    spread = partial(
        estimate_quantities,
        moments=sums.moments,
        wavelength=wavelength,
        remove=remove,
        symmetric=job.is_fan,
    )
    seconds["total"] = time.perf_counter() - start
    return StrehlEstimate(
        ray_count=job.per_replicate * REPLICATES,
        traced_ray_count=traced,
        blocked=float(1.0 - sums.moments[:, 0].sum() / (sums.ray_count)),
        plan=plan,
        budget=StrehlBudget(field, pupil, look, seed, job.until, wavelength, job.air),
        spread=spread,
        seconds=seconds,
        standard_error=standard_error,
        evaluation_count=evaluations,
        **estimate,
    )


def plan_strehl(field: IndexField, pupil: Disc, **options) -> tuple[TracePlan, int]:
    """The plan that `estimate_strehl` would follow with these options, and how many rays it would start with.

    Rays of a pilot bundle are traced for it, some hundred, but nothing else.

    Raises:
        ValueError: As for `estimate_strehl`.
    """
    asked = {"wavelength": None, "ray_count": 1_000_000, "direction": None, "seed": 0, "symmetry": "auto"}
    given = {**asked, **options}
    given.pop("remove", None)
    allowed = given.pop("allow_truncation", False)
    direction = given.pop("direction")
    look = pupil.normal if direction is None else as_unit_vector(direction, "direction")
    wavelength = field.wavelength_for(given.pop("wavelength"))
    task = (wavelength, int(given.pop("ray_count")), given.pop("seed"), False, given.pop("symmetry"))
    defaults = {"method": "auto", "backend": "auto", "device": None, "precision": "float32"}
    choices = {**defaults, "step": None, "tolerance": 1e-3, "max_steps": None, **given}
    job = make_job(field, pupil, look, *task, choices)
    job.air.check(allowed)
    return job.plan, job.traced_ray_count


def _combine(moments, phasor, wavelength, remove) -> dict:
    """Values from replicate sums."""
    total = moments.sum(axis=0)
    if total[0] == 0:
        raise ValueError(
            "no ray of the pupil arrived beyond the field: all met the body or left the way; "
            "move the pupil, or turn its normal toward the flow"
        )
    _, tilt, about_piston, about_plane = fit_moments(total)
    rms = about_plane if "tilt" in remove else about_piston
    value = float(np.abs(phasor.sum() / total[0]) ** 2)
    return {
        "value": value,
        "marechal": float(np.exp(-((2.0 * np.pi * rms / wavelength) ** 2))),
        "opd_rms": rms,
        "boresight": tilt,
    }


def _met_nothing(field: IndexField, moments, wavelength: float, tolerance: float) -> bool:
    """Whether no ray saw any of the field's contrast, though that could count."""
    mean, _, rms, _ = fit_moments(moments.sum(axis=0))
    if max(abs(mean), rms) > UNSEEN * tolerance * wavelength:
        return False
    return greatest_contrast(field) * box_size(field) > tolerance * wavelength


def _standard_error(moments: np.ndarray, phasor: np.ndarray) -> float:
    """Standard error of the Strehl ratio from the spread of the replicates; nan where no ray arrived."""
    counts = moments[:, 0].tolist()
    if not any(counts):
        return float("nan")
    ratios = [abs(sum_ / count) ** 2 if count else 0.0 for sum_, count in zip(phasor.tolist(), counts, strict=True)]
    mean = sum(ratios) / len(ratios)
    return math.sqrt(sum((ratio - mean) ** 2 for ratio in ratios) / (len(ratios) - 1) / len(ratios))


make_callable(__name__)
