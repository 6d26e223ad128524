"""A finished run, read back from its folder, and which run a label of recorded echoes belongs to."""

import contextlib
import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.jobs.recorded import Label, label_text, load_netcdf
from aerokernels.jobs.store import RESULT_FILE, SUMMARY_FILE, finish_moving

_NONE: Label = ()


@dataclass(frozen=True, eq=False)
class RunFolder:
    """What a comparison needs of a run.

    Attributes:
        path: the folder.
        summary: its summary.json.
        time: sample times of the simulated echo [s], shape (n,).
        voltage: the simulated echo [V], shape (n,).
        distance: true distance of the target [m].
        detector: the scene's [detector] table, SI.
        label: the label that the caller gave the run, if any.
    """

    path: Path
    summary: Mapping[str, Any]
    time: np.ndarray
    voltage: np.ndarray
    distance: float
    detector: Mapping[str, Any]
    label: Label = _NONE

    @property
    def name(self) -> str:
        """The scene's name, else the folder's."""
        return str(self.summary.get("scene") or self.path.name)

    def error_of(self, key: str, method: str | None = None) -> float:
        """What a number of the summary may be off by; NaN where that is not known."""
        found = (self.summary.get("errors") or {}).get(key)
        if method is not None:
            found = (found or {}).get(method)
        return math.nan if found is None else float(found)


class RunWithoutEcho(ValueError):
    """A finished run of which no light returned."""


def read_run(text: str) -> RunFolder:
    """Read a run from "DIR", or from "KEY=VALUE=DIR", which says what label it is for.

    Raises:
        ValueError: no such folder, one without a finished run, or a run without an echo.
    """
    path, label = Path(text), _NONE
    if not path.exists() and text.count("=") >= 2:
        key, value, place = text.split("=", 2)
        path, label = Path(place), ((key.strip(), value.strip()),)
    if path.name == RESULT_FILE:
        path = path.parent
    with contextlib.suppress(OSError, ValueError):
        finish_moving(path)  # what a killed process had begun
    for name in (RESULT_FILE, SUMMARY_FILE):
        if not (path / name).is_file():
            raise ValueError(
                f"run {path}: {'holds no ' + name if path.is_dir() else 'no such folder'}; "
                "make one with `aerokernels run SCENE --out DIR`"
            )
    try:
        summary = json.loads((path / SUMMARY_FILE).read_text(encoding="utf-8"))
        lost = (summary.get("failures") or {}).get("echo")
        if lost:
            raise RunWithoutEcho(f"run {path}: it has no echo to compare with: {lost}")
        result = load_netcdf(path / RESULT_FILE)
        time, voltage = (result[name].values.astype(np.float64) for name in ("time", "echo_voltage"))
        detector = tomllib.loads(str(result.attrs.get("scene", ""))).get("detector", {})
        distance = float(summary["true_range_m"])
    except RunWithoutEcho:
        raise
    except (ValueError, KeyError, OSError, TypeError) as error:
        raise ValueError(
            f"run {path}: its files cannot be read ({type(error).__name__}: {error}); run it again"
        ) from None
    return RunFolder(path, summary, time, voltage, distance, detector, label)


def match_runs(labels: Sequence[Label], runs: Sequence[RunFolder]) -> dict[Label, RunFolder]:
    """The run for each label that has one.

    A run that was given a label takes the labels that hold it. Any other takes the labels that its summary agrees with
    in every key that both have, such as mach=3; where there is one run only, a label that shares no key with it too.

    Raises:
        ValueError: two runs for one label, or no run for any.
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
        raise ValueError(
            f"no run fits a label: the recording has {', '.join(map(label_text, labels))}; the runs are "
            f"{', '.join(_described(run) for run in runs)}; give KEY=VALUE=DIR to say which is for which"
        )
    return matched


def _agrees(label: Label, run: RunFolder, *, alone: bool) -> bool:
    shared = [(value, run.summary[key]) for key, value in label if run.summary.get(key) is not None]
    return all(_same(value, own) for value, own in shared) if shared else alone


def _same(text: str, value: Any) -> bool:
    try:
        return math.isclose(float(text), float(value), rel_tol=1e-6, abs_tol=1e-9)
    except (TypeError, ValueError):
        return text == str(value)


def _described(run: RunFolder) -> str:
    if run.label:
        return f"{run.path} ({label_text(run.label)})"
    return f"{run.path} (mach={run.summary['mach']:g})" if "mach" in run.summary else str(run.path)
