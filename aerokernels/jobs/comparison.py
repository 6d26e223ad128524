"""Compare recorded echoes with simulated runs, label by label: peaks, relative errors, correlation, range errors.

The trigger offset is the time by which the recorded time axis is late: 0, given, or measured, on one label for all
labels (differences between labels are then real) or on each label separately (only shapes are compared then).
"""

import contextlib
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__
from aerokernels.compare import WaveformComparison, compare_waveforms, pearson_correlation
from aerokernels.inputs.checks import check_count, check_path, check_positive
from aerokernels.inputs.kinds import is_number
from aerokernels.jobs.echo_statistics import (
    AverageEcho,
    MeanErrors,
    RecordFaults,
    average,
    covering,
    mean_errors,
    record_faults,
)
from aerokernels.jobs.recorded import Label, RecordedEcho, label_text, random_subset, recorded_echoes, recorded_labels
from aerokernels.jobs.run_folder import (
    RangeErrors,
    RunFolder,
    match_runs,
    measured_offset,
    overlap,
    range_errors,
    simulated_on,
)
from aerokernels.process.foreign_files import FileFault

if TYPE_CHECKING:
    import xarray
NO_ALIGNMENT, EACH = "none", "each"


@dataclass(frozen=True)
class CompareOptions:
    """Options of a comparison."""

    align: str = NO_ALIGNMENT  # "none", "each", or the label on which the trigger offset is measured, such as "mach=0"
    trigger_offset: float = 0.0  # time by which the recorded time axis is late, where it is known [s]
    voltage_offset: float = 0.0  # voltage of the recorded echoes without light, where it is known [V]; it is subtracted
    threshold: float | None = None  # level of the leading edge [V]; None takes the run's threshold
    ranged_count: int = 300  # greatest number of randomly chosen echoes of a label that are ranged one by one
    seed: int = 0  # seed of that random choice

    def __post_init__(self) -> None:
        """Check."""
        if not isinstance(self.align, str):
            raise TypeError(f"align must be none, each, or a label such as mach=0, got {self.align!r}")
        if self.align not in (NO_ALIGNMENT, EACH) and "=" not in self.align:
            raise ValueError(f"align {self.align!r}: give none, each, or a label such as mach=0")
        for name, unit in (("trigger_offset", "a time in seconds"), ("voltage_offset", "a voltage in volts")):
            if not is_number(number := getattr(self, name)):
                raise TypeError(f"{name} must be {unit}, got {number!r}")
            if not np.isfinite(number):
                raise ValueError(f"{name} = {number}: give {unit}")
        if self.trigger_offset and self.align != NO_ALIGNMENT:
            raise ValueError(f"trigger_offset and align {self.align}: give the offset, or have it measured, not both")
        if self.threshold is not None:
            check_positive(self.threshold, "threshold", "V")
        check_count(self.ranged_count, "ranged_count", least=2)  # a spread needs two echoes
        check_count(self.seed, "seed", 0, 2**63 - 1)


@dataclass(frozen=True, eq=False)
class LabelComparison:
    """Comparison of one label with its run."""

    label: Label
    run: RunFolder
    # mean and spread of the recorded echoes where both waveforms are known, times less the trigger offset
    recorded: AverageEcho
    simulated: np.ndarray  # simulated voltage at its times [V], shape (n,)
    unfit_count: int  # echoes with too few samples, which were skipped
    waveform: WaveformComparison
    echo_correlation: float  # mean r at zero lag of the single echoes that were ranged
    trigger_offset: float  # time subtracted from the recorded times [s]
    trigger_offset_error: float  # its error where it was measured [s], else 0
    ranges: dict[str, RangeErrors]
    faults: RecordFaults  # what the digitiser did to the echoes: cut-off peaks, an offset
    errors: MeanErrors  # errors of what is read from the mean

    @property
    def covering(self) -> float:
        """What the mean echo's errors are multiplied by to cover the truth in 95 of 100 cases; NaN for one echo."""
        return covering(self.recorded.count)

    @property
    def warnings(self) -> list[str]:
        """Reasons why the comparison's numbers may mislead, in words."""
        wave, sentences = self.waveform, list(self.faults.sentences)
        if self.run.detector.get("noise"):
            sentences.insert(
                0,
                f"the simulated echo of run {self.run.path} has noise, which adds to every difference: compare with a "
                "run whose detector.noise is false",
            )
        if wave.same_pulse is None and not self.faults.is_distorted:
            sentences.append(
                "the record shows too little of the pulse, or too much noise, to compare the pulse's width with the "
                "simulated one: record more echoes, from before the pulse to after it"
            )
        if wave.same_pulse is False and not self.faults.is_distorted:
            moved = f" ({1e3 * abs(wave.width_range):.0f} mm by the width alone)" * math.isfinite(wave.width_range)
            sentences.append(
                f"the recorded pulse is not the simulated one ({1e9 * wave.recorded_width:.3f} ns wide at half height, "
                f"the simulated {1e9 * wave.simulated_width:.3f} ns): the differences of leading edge and constant "
                f"fraction come from the pulses' shapes{moved} and are no range differences, and a high correlation is "
                "not meaningful; put the recorded pulse into the scene (beam.pulse_tau, or beam.pulse = "
                '"sampled"), or compare with the run of a scene that has this pulse'
            )
        return [f"{label_text(self.label)}: {sentence}" for sentence in sentences]

    def row(self) -> dict[str, Any]:
        """Return the comparison's numbers by name, in SI units: one row of compare.csv."""
        wave = self.waveform
        numbers: dict[str, Any] = {
            "label": label_text(self.label),
            "run": self.run.name,
            "run_folder": str(self.run.path),
            "echo_count": self.recorded.count,
            "recorded_peak_v": wave.recorded_peak,
            "recorded_peak_standard_error_v": self.errors.peak,
            "single_peak_mean_v": self.recorded.peak_mean,
            "single_peak_spread_v": self.recorded.peak_spread,
            "simulated_peak_v": wave.simulated_peak,
            "peak_error": wave.peak_error,
            "peak_error_of_recorded": wave.peak_error_of_recorded,
            "correlation": wave.correlation,
            "degree": wave.degree,
            "greatest_correlation": wave.best_correlation,
            "lag_s": wave.lag,
            "lag_standard_error_s": self.errors.lag,
            "greatest_degree": wave.best_degree,
            "single_correlation_mean": self.echo_correlation,
            "edge_level_v": wave.edge_level,
            "edge_shift_s": wave.edge_shift,
            "edge_shift_standard_error_s": self.errors.edge_shift,
            "range_difference_m": wave.range_difference,
            "recorded_width_s": wave.recorded_width,
            "simulated_width_s": wave.simulated_width,
            "same_pulse": wave.same_pulse,
            "trigger_offset_s": self.trigger_offset,
            "trigger_offset_standard_error_s": self.trigger_offset_error,
            "offset_v": self.faults.offset,
            "offset_standard_error_v": self.faults.offset_error,
            "cut_off_share": self.faults.cut_off_share,
            "without_pulse_count": self.recorded.without_pulse_count,
            "resampled_count": self.recorded.resampled_count,
            "unfit_count": self.unfit_count,
        }
        for method, errors in self.ranges.items():
            numbers |= {f"{method.replace('-', '_')}_{name}": value for name, value in asdict(errors).items()}
        return numbers


@dataclass(frozen=True, eq=False)
class BenchComparison:
    """Comparison of all labels of a recording with runs."""

    source: Path  # the recording's file
    options: CompareOptions
    labels: tuple[LabelComparison, ...]  # one comparison for each label that has a run
    left_out: tuple[Label, ...]  # labels without a run

    @property
    def warnings(self) -> list[str]:
        """Warnings of all labels."""
        return [text for one in self.labels for text in one.warnings]

    def to_xarray(self) -> "xarray.Dataset":
        """Return a dataset of waveforms over (label, sample), padded with NaN, and of every number over label."""
        import xarray

        size = max(one.simulated.size for one in self.labels)
        variables: dict[str, Any] = {}
        for name, unit, words in (
            ("time", "s", "time after the pulse's peak left"),
            ("mean", "V", "mean recorded voltage"),
            ("spread", "V", "standard deviation of one recorded echo"),
            ("simulated", "V", "simulated voltage"),
        ):
            values = np.full((len(self.labels), size), np.nan)
            for row, one in zip(values, self.labels, strict=True):
                row[: one.simulated.size] = one.simulated if name == "simulated" else getattr(one.recorded, name)
            variables[name] = (("label", "sample"), values, {"units": unit, "long_name": words})
        rows = [one.row() for one in self.labels]
        for name in rows[0]:
            column = [row.get(name) for row in rows]
            if name != "label" and not any(isinstance(value, str) for value in column):
                numbers = [np.nan if value is None else value for value in column]
                unit = {"_v": "V", "_s": "s", "_m": "m"}.get(name[-2:], "1")
                variables[name] = ("label", np.array(numbers, dtype=np.float64), {"units": unit})
        coordinates = {"label": ("label", [row["label"] for row in rows], {"units": "1"})}
        attributes = {
            "source": f"aerokernels {__version__}",
            "recording": str(self.source),
            "align": self.options.align,
        }
        return xarray.Dataset(variables, coordinates, attributes)


def compare_recording(
    source: str | Path,
    runs: Sequence[RunFolder],
    options: CompareOptions | None = None,
    progress: Callable[[str, float], None] = lambda stage, fraction: None,
) -> BenchComparison:
    """Compare every label of a recording that has a run.

    Args:
        source: the recorder's store, a CSV or a NetCDF file (see `recorded.py`).
        runs: finished runs; `match_runs` decides which label belongs to which run.
        options: options of the comparison.
        progress: called with the name of each stage and the share of the job done before it.
    """
    source, options = check_path(source, "source"), options or CompareOptions()
    if not isinstance(runs, Sequence) or not runs or not all(isinstance(run, RunFolder) for run in runs):
        raise TypeError(f"runs must be a list of runs, as read_run returns them, got {runs!r}")
    labels = recorded_labels(source)
    matched = match_runs(labels, runs)
    averages: dict[Label, AverageEcho] = {}
    unfit: Counter[Label] = Counter()
    for number, label in enumerate(matched):
        progress(f"averaging {label_text(label)}", 0.5 * number / len(matched))
        with _naming_label(source, label):
            averages[label] = average(_echoes(source, label, options, unfit))
    offset = options.trigger_offset, 0.0
    if options.align not in (NO_ALIGNMENT, EACH):
        reference = _reference(options.align, matched)
        with _naming_label(source, reference):
            offset = measured_offset(averages[reference], matched[reference])
    compared = []
    for number, (label, run) in enumerate(matched.items()):
        progress(f"comparing {label_text(label)}", 0.5 + 0.5 * number / len(matched))
        with _naming_label(source, label):
            own = measured_offset(averages[label], run) if options.align == EACH else offset
            echoes = random_subset(_echoes(source, label, options), options.ranged_count, options.seed)
            compared.append(_compare_label(label, run, averages[label], unfit[label], echoes, *own, options.threshold))
    return BenchComparison(source, options, tuple(compared), tuple(label for label in labels if label not in matched))


def _compare_label(
    label: Label,
    run: RunFolder,
    recorded: AverageEcho,
    unfit_count: int,
    echoes: Sequence[RecordedEcho],
    offset: float,
    offset_error: float,
    threshold: float | None,
) -> LabelComparison:
    """Compare the mean of a label, and some of its echoes, with its run."""
    level = threshold or float(run.detector.get("threshold", 0.0)) or None
    part, simulated = overlap(recorded, run, offset)
    waveform = compare_waveforms(part.time, part.mean, simulated, threshold=level, rounding=recorded.rounding)
    shifted = [(echo.time - offset, echo.voltage) for echo in echoes]
    correlations = [_correlation(volts, simulated_on(run, time)) for time, volts in shifted]
    return LabelComparison(
        label=label,
        run=run,
        recorded=part,
        simulated=simulated,
        unfit_count=unfit_count,
        waveform=waveform,
        echo_correlation=float(np.nanmean(correlations)) if np.isfinite(correlations).any() else math.nan,
        trigger_offset=offset,
        trigger_offset_error=offset_error,
        ranges=range_errors(shifted, run, part, simulated, waveform.edge_level, offset_error),
        faults=record_faults(part, simulated),
        errors=mean_errors(part, simulated, waveform.edge_level, offset_error),
    )


def _echoes(
    source: Path, label: Label, options: CompareOptions, unfit: Counter[Label] | None = None
) -> Iterator[RecordedEcho]:
    """Yield the echoes of a label without the known offset of their voltage."""
    for echo in recorded_echoes(source, label, unfit):
        yield replace(echo, voltage=echo.voltage - options.voltage_offset) if options.voltage_offset else echo


def _correlation(recorded: np.ndarray, simulated: np.ndarray) -> float:
    """Return Pearson's r where both are known; NaN if one of them is constant."""
    there = np.isfinite(simulated)
    try:
        return pearson_correlation(recorded[there], simulated[there])
    except ValueError:
        return float("nan")


def _reference(text: str, matched: dict[Label, RunFolder]) -> Label:
    key, _, value = (part.strip() for part in text.partition("="))
    fitting = [label for label in matched if (key, value) in label]
    if len(fitting) != 1:
        raise ValueError(
            f"align {text}: {len(fitting)} labels with a run have it; give one of {', '.join(map(label_text, matched))}"
        )
    return fitting[0]


@contextlib.contextmanager
def _naming_label(source: Path, label: Label) -> Iterator[None]:
    """Prefix file and label to the message of a ValueError."""
    try:
        yield
    except FileFault:
        raise
    except ValueError as error:
        raise ValueError(f"{source}, label {label_text(label)}: {error}") from error
