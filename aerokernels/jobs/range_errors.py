"""Place a simulated echo on the times of recorded ones, and compute the errors of the ranges read from these."""

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aerokernels.compare import compare_waveforms
from aerokernels.inputs.checks import as_waveform
from aerokernels.jobs.echo_statistics import LEAST_PULSE, AverageEcho, mean_factor, spread_factor
from aerokernels.jobs.run_folder import RunFolder
from aerokernels.lidar import RANGING_METHODS
from aerokernels.lidar.pulses import SPEED_OF_LIGHT
from aerokernels.lidar.ranging import Reading, template_curve


@dataclass(frozen=True)
class RangeErrors:
    """Errors of the ranges of recorded echoes by one method."""

    systematic_error_m: float  # mean range minus the true distance [m]
    # error of that mean [m]: the standard error times Student's factor for few echoes, what noise leaves of the
    # digitiser's rounding, and the error of a measured trigger offset
    systematic_standard_error_m: float
    random_error_m: float  # standard deviation of the range of one echo [m]
    random_standard_error_m: float  # error of that, for normally distributed ranges [m]
    simulated_error_m: float  # the run's range minus the true distance [m]; NaN if the run has no range by the method
    ranged_count: int  # number of echoes with a range
    missed_count: int  # number of echoes without a range


def simulated_on(run: RunFolder, time: np.ndarray) -> np.ndarray:
    """Return the simulated voltage [V] at other times [s]; NaN beyond an end of the record that has not decayed."""
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(run.time - run.time[0], run.voltage, k=5)
    inside = (time >= run.time[0]) & (time <= run.time[-1])
    peak = float(np.abs(run.voltage).max())
    before, after = (0.0 if abs(end) <= 1e-3 * peak else np.nan for end in (run.voltage[0], run.voltage[-1]))
    volts = np.where(time < run.time[0], before, after)
    volts[inside] = spline(time[inside] - run.time[0])
    return volts


def overlap(recorded: AverageEcho, run: RunFolder, offset: float) -> tuple[AverageEcho, np.ndarray]:
    """Return the samples of a mean that a simulation overlaps, times less the offset [s], and the simulation [V]."""
    time = recorded.time - offset
    simulated = simulated_on(run, time)
    there, peak_time = np.isfinite(simulated), float(run.time[np.argmax(run.voltage)])
    met = there.any() and time[there][0] <= peak_time <= time[there][-1]  # the peak may fall between coarse samples
    greatest = simulated[there].max() if there.any() else 0.0
    if greatest < (0.25 if met else 0.9) * run.voltage.max():
        raise ValueError(
            f"the simulated echo peaks at {1e9 * peak_time:.3f} ns, the recorded times go from "
            f"{1e9 * time[0]:.3f} to {1e9 * time[-1]:.3f} ns"
            + (
                f" in steps of {1e9 * (time[1] - time[0]):.3f} ns, too wide for its pulse: record with more samples"
                if met
                else ": give the trigger offset, or have it measured (align)"
            )
        )
    parts = {name: getattr(recorded, name)[there] for name in ("mean", "spread", "standard_error")}
    return replace(recorded, time=time[there], **parts), simulated[there]


def measured_offset(recorded: AverageEcho, run: RunFolder) -> float:
    """Measure by how much [s] the recorded mean is later than the simulation: the lag of the greatest correlation.

    The peaks are aligned first, so that the records need not overlap; then the lag is found to a fraction of a sample.
    """
    offset = float(recorded.time[np.argmax(recorded.mean)] - run.time[np.argmax(run.voltage)])
    for _ in range(2):  # the second time near lag 0, where the parabola through three lags is most accurate
        part, simulated = overlap(recorded, run, offset)
        offset += compare_waveforms(part.time, part.mean, simulated).lag
    return offset


def range_errors(
    echoes: Sequence[tuple[np.ndarray, np.ndarray]],
    run: RunFolder,
    recorded: AverageEcho,
    simulated: np.ndarray,
    threshold: float,
    offset_error: float = 0.0,
) -> dict[str, RangeErrors]:
    """Compute the range errors of echoes by method; a method that cannot read the simulation is left out.

    Args:
        echoes: times [s] and voltages [V] of each echo.
        run: the run to compare with.
        recorded: the mean of the echoes.
        simulated: the simulation at its times [V], shape (n,).
        threshold: level of the leading edge [V].
        offset_error: error of the trigger offset that was subtracted from the times [s].
    """
    time, step, least_peak = recorded.time, recorded.step, LEAST_PULSE * float(recorded.mean.max())
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
            if volts.max() < least_peak:  # constant fraction and centroid would find a pulse in its noise
                continue
            try:
                errors.append(read(times, volts) - own)
            except ValueError:  # the threshold is never crossed, or the record truncates the pulse
                continue
        share = 2.0 * recorded.rounding / step if step > 0.0 else 0.0
        left = share * _rounding_error(read, time, simulated, own, step) if share > 1e-3 else 0.0
        common = math.hypot(left, 0.5 * SPEED_OF_LIGHT * offset_error)
        found[method] = _statistics(errors, len(echoes), simulated_error, common)
    return found


def _rounding_error(
    read: Callable[[np.ndarray, np.ndarray], float], time: np.ndarray, simulated: np.ndarray, own: float, step: float
) -> float:
    """Return the greatest change of a reading [m] where the simulation is rounded to steps, with any offset of them."""
    changes = []
    for shift in step * np.arange(8) / 8.0:
        with contextlib.suppress(ValueError):  # rounding may leave no rise through the threshold
            changes.append(abs(read(time, step * np.rint((simulated + shift) / step) - shift) - own))
    return max(changes, default=math.nan)


def _statistics(errors: Sequence[float], count: int, simulated_error: float, common: float) -> RangeErrors:
    number = len(errors)
    spread = float(np.std(errors, ddof=1)) if number > 1 else math.nan
    return RangeErrors(
        systematic_error_m=float(np.mean(errors)) + simulated_error if number else math.nan,
        systematic_standard_error_m=(
            math.hypot(mean_factor(number) * spread / math.sqrt(number), common) if number else math.nan
        ),
        random_error_m=spread,
        random_standard_error_m=spread * spread_factor(number) if number > 1 else math.nan,
        simulated_error_m=simulated_error,
        ranged_count=number,
        missed_count=count - number,
    )
