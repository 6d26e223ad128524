r"""What a Strehl ratio's error budget says of the other numbers of the same rays.

The budget gives errors of the Strehl ratio S, by cause. A phase error of rms e about its mean changes S by at most
E = 2 sqrt(S) e + e^2 (strehl.py), so that each cause stands for a phase error

    e = sqrt(S + E) - sqrt(S)

and that of all causes but the sampling is their root sum of squares. From it, and from the spread of the replicates
(two standard errors, as in the budget) of what is a mean over rays:

    S               the budget's total
    OPD rms s       s changes by at most e / k: the rms of a sum lies between the difference and the sum of the rms
    Marechal's      the greatest change of exp(-(k s)^2) over s within its error
    boresight       the slope of the plane that fits the OPD best is <x OPD> / <x^2>; by Cauchy and Schwarz an OPD error
                    of rms e / k changes it by at most (e / k) / sqrt(<x^2>), or 2 e / (k a) on a disc of radius a.
                    Traced as a fan, field, pupil and rays are symmetric about the axis: there is no tilt, and no error
"""

import math
from collections.abc import Mapping

import numpy as np

from .quantities import Quantity, root_sum_square
from .tracing.pupil_sums import fit_moments

# What an error mostly comes from, and what to do about it.
REMEDIES = {
    "resampling": "the uniform grid: give it a smaller spacing",
    "interpolation": "the samples of the field itself: give it finer cells",
    "step": "the steps of the rays: ask for a smaller tolerance",
    "precision": "the precision of the kernels: trace in float64",
    "sampling": "the number of rays: take more",
    "truncation": "rays that leave the known air while it is disturbed: give a field that reaches farther",
}


def strehl_error(value: float, phase: float) -> float:
    """The greatest change of a Strehl ratio `value` by a phase error of rms `phase` [rad]."""
    return 2.0 * math.sqrt(max(value, 0.0)) * phase + phase**2


def phase_error(value: float, budget: Mapping[str, float]) -> float:
    """Rms phase error [rad] that the budget of a Strehl ratio stands for, sampling left out; NaN where not known."""
    if "total" not in budget or math.isnan(value):
        return math.nan
    root = math.sqrt(max(value, 0.0))
    causes = (error for cause, error in budget.items() if cause not in ("sampling", "total"))
    return root_sum_square(math.sqrt(value + error) - root for error in causes)


def main_cause(budget: Mapping[str, float]) -> str:
    """What the greatest part of an error comes from and its remedy, in words; empty where the budget is."""
    causes = {cause: error for cause, error in budget.items() if cause != "total"}
    if not causes:
        return ""
    unknown = [cause for cause, error in causes.items() if math.isnan(error)]
    worst = unknown[0] if unknown else max(causes, key=lambda cause: causes[cause])
    words = REMEDIES.get(worst, worst)
    return f"not known is the part of {words}" if unknown else f"most of it comes from {words}"


def estimate_quantities(
    estimate, moments: np.ndarray, *, wavelength: float, remove: tuple[str, ...], symmetric: bool
) -> dict[str, Quantity]:
    """The numbers of a Strehl estimate with their errors, by the names of its attributes; see the formulas above.

    Args:
        estimate: The StrehlEstimate; its error budget is read, for which some of its rays are traced again.
        moments: Sums of the replicates, shape (replicate_count, at least 10), see pupil_sums.py.
        wavelength: Wavelength [m].
        remove: Terms taken off the wavefront.
        symmetric: Whether the rays are a fan, which stands for a wavefront without tilt.

    Returns:
        "value", "marechal", "opd_rms" [m], "boresight_x" and "boresight_y" [rad].
    """
    budget = estimate.error
    wave_number = 2.0 * math.pi / wavelength
    opd_error = phase_error(estimate.value, budget) / wave_number
    fits = [fit_moments(row) for row in moments if row[0] > 0.0]
    rms_error = math.hypot(opd_error, _twice_standard_error([float(fit[3 if "tilt" in remove else 2]) for fit in fits]))
    rms = estimate.opd_rms

    def marechal(opd_rms: float) -> float:
        return math.exp(-((wave_number * opd_rms) ** 2))

    marechal_error = max(
        marechal(max(rms - rms_error, 0.0)) - estimate.marechal, estimate.marechal - marechal(rms + rms_error)
    )
    slopes = [0.0, 0.0]
    if not symmetric:
        slopes = [
            math.hypot(opd_error / extent, _twice_standard_error([float(fit[1][axis]) for fit in fits]))
            if extent > 0.0
            else 0.0
            for axis, extent in enumerate(_extents(moments.sum(axis=0)))
        ]
    return {
        "value": Quantity(estimate.value, budget.get("total", math.nan)),
        "marechal": Quantity(estimate.marechal, math.nan if math.isnan(rms_error) else marechal_error),
        "opd_rms": Quantity(rms, rms_error, "m"),
        "boresight_x": Quantity(float(estimate.boresight[0]), slopes[0], "rad"),
        "boresight_y": Quantity(float(estimate.boresight[1]), slopes[1], "rad"),
    }


def _twice_standard_error(values: list[float]) -> float:
    """Two standard errors of the mean of replicates; NaN for fewer than two."""
    if len(values) < 2:
        return math.nan
    return 2.0 * float(np.std(values, ddof=1)) / math.sqrt(len(values))


def _extents(total: np.ndarray) -> tuple[float, float]:
    """Rms of the pupil's two coordinates about their means [m], from summed moments."""
    count, x, y, _, xx, _, yy = (float(number) for number in total[:7])
    return math.sqrt(max(xx / count - (x / count) ** 2, 0.0)), math.sqrt(max(yy / count - (y / count) ** 2, 0.0))
