"""Read a finished run from its folder, and match runs to labels of recorded echoes."""

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.jobs.recorded import Label, label_text, load_netcdf
from aerokernels.jobs.store import RESULT_FILE, SUMMARY_FILE
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
    result = load_netcdf(path / RESULT_FILE)
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
