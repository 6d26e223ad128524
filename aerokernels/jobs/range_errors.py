"""Systematic and random range errors of recorded echoes, by ranging method, next to the simulation's error.

A method's reading is calibrated by its reading of the simulation, interpolated at the recorded times, which corresponds
to the range that the run reports by that method (free of the method's own offset, see `echo`):

    range = reading - reading of the simulation + range of the run

A pulse that is truncated by the ends of the record shifts both readings alike. If the run has no range by a method, the
systematic error is unknown, but the random error is known.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from aerokernels.echo import RANGING_METHODS
from aerokernels.echo.ranging import Reading, template_curve
from aerokernels.inputs.checks import as_waveform
from aerokernels.jobs.run_folder import RunFolder


@dataclass(frozen=True)
class RangeErrors:
    """Errors of the ranges of recorded echoes by one method.

    Attributes:
        systematic_error_m: mean range minus the true distance [m].
        systematic_standard_error_m: standard error of that mean [m].
        random_error_m: standard deviation of the range of one echo [m].
        random_standard_error_m: standard error of that, for normally distributed ranges [m].
        simulated_error_m: the run's range minus the true distance [m]; NaN if the run has no range by the method.
        ranged_count: number of echoes with a range.
        missed_count: number of echoes without a range.
    """

    systematic_error_m: float
    systematic_standard_error_m: float
    random_error_m: float
    random_standard_error_m: float
    simulated_error_m: float
    ranged_count: int
    missed_count: int

    def as_dict(self) -> dict[str, float]:
        """Return the errors by name."""
        return asdict(self)


def range_errors(
    echoes: Sequence[tuple[np.ndarray, np.ndarray]],
    run: RunFolder,
    time: np.ndarray,
    simulated: np.ndarray,
    threshold: float,
) -> dict[str, RangeErrors]:
    """Compute the range errors of echoes by method; a method that cannot read the simulation is left out.

    Args:
        echoes: times [s] and voltages [V] of each echo.
        run: the run to compare with.
        time: times at which the simulation was interpolated [s], shape (n,).
        simulated: the simulation at these times [V], shape (n,).
        threshold: level of the leading edge [V].
    """
    shape = template_curve(run.voltage, as_waveform(run.time, run.voltage)[2])
    reported = run.summary.get("ranges_m") or {}
    found = {}
    for method in RANGING_METHODS:
        template = shape if method == "matched-filter" else None
        read = Reading(method, threshold, template, float(run.detector.get("fraction", 0.5)), shape).range
        try:
            own = read(time, simulated)
        except ValueError:
            continue
        distance = reported.get(method)
        # If the run has no range by this method, for example below its own threshold, only the spread is known.
        simulated_error = math.nan if distance is None else float(distance) - run.distance
        errors = []
        for times, volts in echoes:
            try:
                errors.append(read(times, volts) - own)
            except ValueError:  # the threshold is never crossed, or the record truncates the pulse
                continue
        found[method] = _statistics(errors, len(echoes), simulated_error)
    return found


def _statistics(errors: Sequence[float], count: int, simulated_error: float) -> RangeErrors:
    number = len(errors)
    spread = float(np.std(errors, ddof=1)) if number > 1 else math.nan
    return RangeErrors(
        systematic_error_m=float(np.mean(errors)) + simulated_error if number else math.nan,
        systematic_standard_error_m=spread / math.sqrt(number) if number else math.nan,
        random_error_m=spread,
        random_standard_error_m=spread / math.sqrt(2.0 * (number - 1)) if number > 1 else math.nan,
        simulated_error_m=simulated_error,
        ranged_count=number,
        missed_count=count - number,
    )
