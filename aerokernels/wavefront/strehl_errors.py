r"""Errors of OPD rms, Marechal's ratio and boresight from the error budget of a Strehl ratio of the same rays.

The budget gives errors of the Strehl ratio S = |A|^2, A = <exp(i p)>, by cause. A phase error d of mean 0 and rms e,
however it is correlated with the phase p, changes A by a vector of length at most b, and S by at most

    E = 2 sqrt(S) b + b^2,    b = min(e, sqrt(1 - S) e + sqrt(S) e^2 / 2)

The first bound is that of |exp(i d) - 1| <= |d|. For the second, turn p so that A is real, and write exp(i p) = A + w
with <w> = 0 and <|w|^2> = 1 - S: by Cauchy and Schwarz |<w (exp(i d) - 1)>| <= sqrt(1 - S) e, and |<exp(i d) - 1>| =
|<exp(i d) - 1 - i d>| <= e^2 / 2. The second bound is smaller where the wavefront is nearly flat: small phase errors of
a flat wavefront change S in second order only. So the error E of each cause corresponds to a phase error

    e = max(b, 2 b / (sqrt(1 - S) + sqrt(1 - S + 2 b sqrt(S)))),    b = sqrt(S + E) - sqrt(S)

and all causes but the sampling together to the root sum of squares of these. The errors of the other quantities follow
from this phase error, and, for means over rays, from the spread of the replicates (three standard errors, so that
"+-" covers the truth in at least 95 of 100 cases):

    S               the budget's total
    OPD rms s       s changes by at most e / k: the rms of a sum lies between the difference and the sum of the rms
    Marechal's      the greatest change of exp(-(k s)^2) over s within its error
    boresight       the slope of the plane that fits the OPD best is <x OPD> / <x^2>; by Cauchy and Schwarz an OPD error
                    of rms e / k changes it by at most (e / k) / sqrt(<x^2>), or 2 e / (k a) on a disc of radius a.
                    Radial quadrature is symmetric about the axis: there is no tilt, and no error
"""

import math
from collections.abc import Mapping

import numpy as np

from ..display.quantities import Quantity, root_sum_square
from ..tracing.pupil.fit import fit_moments, rms_about

# The reported error of a mean over replicates is so many standard errors: two would be too few in one estimate of
# sixteen (Student's t of 15 degrees of freedom).
STANDARD_ERRORS = 3.0
# Number of Strehl ratios searched for the one that a phase error changes most.
RATIOS = 201
# Causes of an error in words, each with its remedy.
REMEDIES = {
    "resampling": "the uniform grid: give it a smaller spacing",
    "interpolation": "the samples of the field itself: give it finer cells",
    "step": "the steps of the rays: ask for a smaller tolerance",
    "precision": "the precision of the kernels: trace in float64",
    "sampling": "the number of rays: take more",
    "refractivity": "the refractivity model: take one of a smaller uncertainty, such as 'ciddor' in air",
    "truncation": "rays that leave the field by a cut through disturbed air: resample it on a larger region",
}


def strehl_error(value: float, phase: float) -> float:
    """Return the greatest change of a Strehl ratio `value` by a phase error of rms `phase` [rad]."""
    return float(strehl_errors(np.asarray(value), phase))


def strehl_errors(values: np.ndarray, phase: float) -> np.ndarray:
    """Return `strehl_error` of an array of ratios, of the same shape."""
    clipped = np.clip(values, 0.0, 1.0)
    root, rest = np.sqrt(clipped), np.sqrt(1.0 - clipped)
    change = np.minimum(phase, rest * phase + 0.5 * root * phase**2)
    return np.asarray(2.0 * root * change + change**2)


def greatest_strehl_error(phase: float) -> float:
    """Return the greatest change of any Strehl ratio by a phase error of rms `phase` [rad]."""
    return float(strehl_errors(np.linspace(0.0, 1.0, RATIOS), phase).max())


def phase_of_error(value: float, error: float) -> float:
    """Return the rms phase error [rad] that changes a Strehl ratio `value` by up to `error`: inverts `strehl_error`."""
    if not error > 0.0:
        return error  # zero, or NaN
    value = min(max(value, 0.0), 1.0)  # against rounding
    root, rest = math.sqrt(value), math.sqrt(1.0 - value)
    change = error / (math.sqrt(root**2 + error) + root)
    return max(change, 2.0 * change / (rest + math.sqrt(rest**2 + 2.0 * change * root)))


def phase_error(value: float, budget: Mapping[str, float]) -> float:
    """Return the rms phase error [rad] of a Strehl ratio's budget without sampling; NaN if not known."""
    if "total" not in budget or math.isnan(value):
        return math.nan
    causes = (error for cause, error in budget.items() if cause not in ("sampling", "total"))
    return root_sum_square(phase_of_error(value, error) for error in causes)


def main_cause(budget: Mapping[str, float]) -> str:
    """Return the cause of the greatest part of an error and its remedy, in words; empty for an empty budget."""
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
    """Return the quantities of a Strehl estimate with their errors, by the names of its attributes; formulas above.

    Args:
        estimate: The StrehlEstimate; its error budget is read, for which some of its rays are retraced.
        moments: Sums of the replicates, shape (replicate_count, at least 10), see tracing/pupil/sums.py.
        wavelength: Wavelength [m].
        remove: Terms removed from the wavefront.
        symmetric: Whether the rays are those of radial quadrature, which represents a wavefront without tilt.

    Returns:
        "value", "marechal", "opd_rms" [m], "boresight_x" and "boresight_y" [rad].
    """
    budget = estimate.error
    wave_number = 2.0 * math.pi / wavelength
    opd_error = phase_error(estimate.value, budget) / wave_number
    arrived = [row for row in moments if row[0] > 0.0]
    fits = [fit_moments(row) for row in arrived]
    rms_error = math.hypot(opd_error, _likely_error([rms_about(row, remove) for row in arrived]))
    rms = estimate.opd_rms

    def marechal(opd_rms: float) -> float:
        return math.exp(-((wave_number * opd_rms) ** 2))

    marechal_error = max(
        marechal(max(rms - rms_error, 0.0)) - estimate.marechal, estimate.marechal - marechal(rms + rms_error)
    )
    slopes = [0.0, 0.0]
    if not symmetric:
        slopes = [
            math.hypot(opd_error / extent, _likely_error([float(fit[1][axis]) for fit in fits]))
            if extent > 0.0
            else 0.0
            for axis, extent in enumerate(_extents(moments.sum(axis=0)))
        ]
    return {
        "value": Quantity(estimate.value, budget.get("total", math.nan), is_ratio=True),
        "marechal": Quantity(estimate.marechal, math.nan if math.isnan(rms_error) else marechal_error, is_ratio=True),
        "opd_rms": Quantity(rms, rms_error, "m"),
        "boresight_x": Quantity(float(estimate.boresight[0]), slopes[0], "rad"),
        "boresight_y": Quantity(float(estimate.boresight[1]), slopes[1], "rad"),
    }


def _likely_error(values: list[float]) -> float:
    """Return STANDARD_ERRORS standard errors of the mean of replicates; NaN for fewer than two."""
    if len(values) < 2:
        return math.nan
    return STANDARD_ERRORS * float(np.std(values, ddof=1)) / math.sqrt(len(values))


def _extents(total: np.ndarray) -> tuple[float, float]:
    """Return the rms of the pupil's two coordinates about their means [m], from summed moments."""
    count, x, y, _, xx, _, yy = (float(number) for number in total[:7])
    return math.sqrt(max(xx / count - (x / count) ** 2, 0.0)), math.sqrt(max(yy / count - (y / count) ** 2, 0.0))
