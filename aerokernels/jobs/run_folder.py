"""Read finished runs, match them to labels of recorded echoes, and compute the errors of the ranges of these."""

import contextlib
import json
import math
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.compare import compare_waveforms
from aerokernels.files.netcdf_reading import open_netcdf
from aerokernels.inputs.checks import as_waveform
from aerokernels.jobs.echo_statistics import LEAST_PULSE, AverageEcho, mean_errors, mean_factor, spread_factor
from aerokernels.jobs.recorded import Label, label_text
from aerokernels.jobs.store import RESULT_FILE, SUMMARY_FILE
from aerokernels.lidar import RANGING_METHODS
from aerokernels.lidar.pulses import SPEED_OF_LIGHT
from aerokernels.lidar.ranging import Reading, template_curve
from aerokernels.lidar.result import echo_of_result


@dataclass(frozen=True, eq=False)
class RunFolder:
    """The data of a run that a comparison needs."""

    path: Path
    summary: Mapping[str, Any]
    time: np.ndarray  # sample times of the simulated echo [s], shape (n,)
    voltage: np.ndarray  # the simulated echo [V], shape (n,)
    distance: float  # true distance of the target [m]
    detector: Mapping[str, Any]  # the scene's [detector] table, SI
    label: Label = ()  # the label that the caller assigned to the run, if any

    @property
    def name(self) -> str:
        """The scene's name, else the folder's."""
        return str(self.summary.get("scene") or self.path.name)

    def error_of(self, key: str, method: str | None = None) -> float:
        """Return the error of a number of the summary; NaN if it is not known."""
        error = (self.summary.get("errors") or {}).get(key)
        error = error.get(method) if isinstance(error, dict) else error
        return float(error) if isinstance(error, (int, float)) else math.nan


def read_run(text: str) -> RunFolder:
    """Read a run from "DIR", or from "KEY=VALUE=DIR", which assigns the run to a label."""
    path = Path(text)
    label: Label = ()
    if not path.exists() and text.count("=") >= 2:
        key, value, place = text.split("=", 2)
        path, label = Path(place), ((key.strip(), value.strip()),)
    if path.name == RESULT_FILE:
        path = path.parent
    for name in (RESULT_FILE, SUMMARY_FILE):
        if not (path / name).is_file():
            raise ValueError(
                f"run {path}: {'holds no ' + name if path.is_dir() else 'no such folder'}; "
                "make one with `aerokernels run SCENE --out DIR`"
            )
    try:
        summary = json.loads((path / SUMMARY_FILE).read_text(encoding="utf-8"))
        lost = dict(summary.get("failures") or {}).get("echo")
    except (ValueError, OSError, RecursionError, AttributeError, TypeError) as error:
        raise _unreadable(path, f"{SUMMARY_FILE} is not that of a run: {error}") from None
    if lost:
        raise ValueError(f"run {path}: it has no echo to compare with: {lost}")
    result = open_netcdf(path / RESULT_FILE, str(path / RESULT_FILE), decode_times=False, whole=True)
    time, voltage = echo_of_result(path, result)
    try:
        detector = tomllib.loads(str(result.attrs.get("scene", ""))).get("detector", {})
        distance = float(summary["true_range_m"])
        numbers = [
            *(summary.get("ranges_m") or {}).values(),
            *(detector.get(key, 0.0) for key in ("threshold", "fraction")),
        ]
        if not (0.0 < distance < math.inf and all(value is None or math.isfinite(value) for value in numbers)):
            raise ValueError("it holds numbers that are not finite")
    except (ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError) as error:
        raise _unreadable(path, str(error)) from None
    return RunFolder(path, summary, time, voltage, distance, detector, label)


def _unreadable(path: Path, what: str) -> ValueError:
    return ValueError(f"run {path}: its files cannot be read ({' '.join(what.split())}); run it again")


def match_runs(labels: Sequence[Label], runs: Sequence[RunFolder]) -> dict[Label, RunFolder]:
    """Find the run that belongs to each label.

    A run with an assigned label matches the labels that contain it. Any other run matches the labels that agree with
    its summary in every shared key, such as mach=3. A single run also matches labels that share no key with it.
    """
    matched = {}
    for label in labels:
        fitting = [run for run in runs if run.label and set(run.label) <= set(label)]
        fitting = fitting or [run for run in runs if not run.label and _agrees(label, run, alone=len(runs) == 1)]
        if len(fitting) > 1:
            raise ValueError(
                f"label {label_text(label)}: runs {', '.join(str(run.path) for run in fitting)} all fit; "
                f"say which with {label_text(label[:1] or (('key', 'value'),))}=DIR"
            )
        if fitting:
            matched[label] = fitting[0]
    if not matched:
        known = ", ".join(f"{run.path} (mach={run.summary.get('mach')})" for run in runs)
        raise ValueError(
            f"no run fits a label: the recording has {', '.join(map(label_text, labels))}; the runs are {known}; give "
            "KEY=VALUE=DIR to say which is for which"
        )
    return matched


def _agrees(label: Label, run: RunFolder, *, alone: bool) -> bool:
    shared = [(value, run.summary[key]) for key, value in label if run.summary.get(key) is not None]
    return all(_same(value, own) for value, own in shared) if shared else alone


def _same(text: str, value: Any) -> bool:
    try:
        return math.isclose(float(text), float(value), rel_tol=1e-6, abs_tol=1e-9)
    except (TypeError, ValueError, OverflowError):
        return text == str(value)


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


def measured_offset(recorded: AverageEcho, run: RunFolder) -> tuple[float, float]:
    """Measure by how much [s] the recorded mean is later than the simulation, and the error of that [s].

    It is the lag of the greatest correlation. The peaks are aligned first, so that the records need not overlap; then
    the lag is found to a fraction of a sample.
    """
    offset = float(recorded.time[np.argmax(recorded.mean)] - run.time[np.argmax(run.voltage)])
    for _ in range(2):  # the second time near lag 0, where the parabola through three lags is most accurate
        part, simulated = overlap(recorded, run, offset)
        offset += compare_waveforms(part.time, part.mean, simulated).lag
    part, simulated = overlap(recorded, run, offset)
    return offset, mean_errors(part, simulated, 0.5 * float(simulated.max())).lag


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
    result = {}
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
        result[method] = _statistics(errors, len(echoes), simulated_error, common)
    return result


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
