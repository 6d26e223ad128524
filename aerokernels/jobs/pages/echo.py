"""The echo in the report of a run: the pulse, the crossing of the threshold, and the errors of the ranging methods."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.figures import Axis, Line, Lines
from aerokernels.display.quantities import Quantity
from aerokernels.jobs.numbers import quantity_of
from aerokernels.jobs.pages.page import Bar, Panel, shown
from aerokernels.jobs.store import number_or_nan
from aerokernels.lidar.pulses import SPEED_OF_LIGHT

if TYPE_CHECKING:
    import xarray

METHODS = {
    "leading-edge": "Leading edge",
    "constant-fraction": "Constant fraction",
    "centroid": "Centroid",
    "matched-filter": "Matched filter",
}


class Echo:
    """The echo of a run's dataset, in ns, V and mm."""

    def __init__(self, dataset: "xarray.Dataset", summary: Mapping[str, Any]) -> None:
        """Take the echo of result.nc and the content of summary.json."""
        self.dataset, self.summary = dataset, summary
        self.time, self.voltage = 1e9 * dataset["time"].values, dataset["echo_voltage"].values
        self.clean = dataset["echo_voltage_clean"].values if "echo_voltage_clean" in dataset else self.voltage
        self.free = dataset["echo_voltage_vacuum"].values if "echo_voltage_vacuum" in dataset else None
        level = number_or_nan(dataset.attrs.get("threshold_v"))
        self.threshold = level if math.isfinite(level) else None
        self.crossed = None if self.threshold is None else _crossing(self.time, self.clean, self.threshold)
        self.crossed_free = None
        if self.threshold is not None and self.free is not None:
            self.crossed_free = _crossing(self.time, self.free, self.threshold)

    @property
    def late(self) -> float | None:
        """How much later the pulse crosses the threshold than it would without flow [ns]."""
        return None if self.crossed is None or self.crossed_free is None else self.crossed - self.crossed_free

    @property
    def reason(self) -> str:
        """Why the range has an error, in words."""
        height = number_or_nan(self.summary.get("echo_peak_v")) / number_or_nan(self.dataset.attrs.get("vacuum_peak_v"))
        still = quantity_of(self.summary, "still_air_m")
        words = f" The air at rest alone adds {shown(still, 1e3, 'mm', True)}." if still.value else ""
        if self.late is None or self.late <= 0.0 or not height < 1.0:
            return words.strip()
        return (
            f"The flow takes {100.0 * (1.0 - height):.2g} % off the pulse, and a lower pulse crosses the fixed "
            f"threshold of {self.threshold:g} V {_duration(self.late)} later.{words}"
        )

    def panels(self) -> list[Panel]:
        """Return the panels: the pulse, the crossing of the threshold, and the errors of all ranging methods."""
        panels = [self._pulse()]
        if self.late is not None and self.late > 0.0:
            panels.append(self._near())
        return [*panels, *self._methods()]

    def _lines(self) -> list[Line]:
        lines = []
        if not np.array_equal(self.clean, self.voltage):
            lines.append(Line(self.time, self.voltage, "recorded, with noise", "plain"))
        lines.append(Line(self.time, self.clean, "with flow", "one"))
        if self.free is not None:
            lines.append(Line(self.time, self.free, "without flow", "free"))
        return lines

    def _pulse(self) -> Panel:
        top = max(float(one.y.max()) for one in self._lines())
        low = min(0.0, float(self.voltage.min()))
        above = np.flatnonzero(np.maximum(self.clean, self.free if self.free is not None else self.clean) > 1e-3 * top)
        ends = (0, -1) if above.size == 0 else (max(above[0] - 2, 0), min(above[-1] + 2, self.time.size - 1))
        limits = [] if self.threshold is None else [("y", self.threshold, f"threshold {self.threshold:.4g} V")]
        limits.append(("x", 2e9 * float(self.dataset.attrs["true_range_m"]) / SPEED_OF_LIGHT, "target"))
        marks = [] if self.crossed is None or self.threshold is None else [(self.crossed, self.threshold)]
        x = Axis("time since the pulse left [ns]", (float(self.time[ends[0]]), float(self.time[ends[1]])), "ns")
        y = Axis("voltage [V]", (1.08 * low, 1.08 * top), "V")
        return Panel(
            "echo",
            "Laser echo",
            "The pulse that comes back from the target.",
            "Detector voltage against time, with and without flow, and the threshold.",
            Lines(x, y, self._lines(), limits=limits, marks=marks),
            "The dot marks where the threshold is crossed." if marks else "",
        )

    def _near(self) -> Panel:
        assert self.crossed is not None and self.crossed_free is not None and self.late is not None
        assert self.threshold is not None and self.free is not None
        middle, half = 0.5 * (self.crossed + self.crossed_free), max(2.2 * self.late, 0.05)
        around = np.linspace(middle - half, middle + half, 41)
        lines = [
            Line(around, np.interp(around, self.time, self.clean), "with flow", "one"),
            Line(around, np.interp(around, self.time, self.free), "without flow", "free"),
        ]
        marks = [(self.crossed_free, self.threshold), (self.crossed, self.threshold)]
        error = number_or_nan(self.summary.get("range_error_m"))
        words = [f"{_duration(self.late)} later", *([f"{1e3 * error:+.1f} mm"] if math.isfinite(error) else [])]
        x = Axis("time since the pulse left [ns]", (float(around[0]), float(around[-1])), "ns")
        return Panel(
            "crossing",
            "Where the threshold is crossed",
            f"The pulse crosses {_duration(self.late)} later than without flow.",
            "The rising edges with and without flow near the threshold.",
            Lines(
                x,
                Axis("voltage [V]", unit="V"),
                lines,
                limits=[("y", self.threshold, f"threshold {self.threshold:.4g} V")],
                marks=marks,
                gap=(self.crossed_free, self.crossed, words),
            ),
            "The range is read at this crossing, on a scale that is right without flow.",
        )

    def _methods(self) -> list[Panel]:
        summary = self.summary
        errors = (summary.get("errors") or {}).get("ranges_m") or {}
        true = float(summary["true_range_m"])
        read = {
            method: Quantity(number_or_nan(value) - true, number_or_nan(errors.get(method)))
            for method, value in (summary.get("ranges_m") or {}).items()
            if value is not None
        }
        if not read:
            return []
        ends = [end for one in read.values() for end in (*one.interval, 0.0) if math.isfinite(end)]
        low, high = min(ends), max(ends)
        low, high = low - 0.04 * (high - low), high + 0.04 * (high - low) or 1e-6

        def place(length: float) -> float:
            return min(max(100.0 * (length - low) / (high - low), 0.0), 100.0)

        used = str(self.dataset.attrs.get("ranging", ""))
        rows = [
            Bar(
                METHODS.get(method, method) + (", used" if method == used else ""),
                shown(one, 1e3, "mm", True),
                dot=(place(one.interval[0]), place(one.value), place(one.interval[1])),
            )
            for method, one in read.items()
        ]
        says = "Read minus true range. Only a fixed threshold depends on the height of the pulse."
        return [Panel("methods", "Range error by method", says, rows=rows, mark=place(0.0))]


def _crossing(time: np.ndarray, voltage: np.ndarray, level: float) -> float | None:
    """Return the time at which a voltage first rises through a level; None if it does not."""
    rises = np.flatnonzero((voltage[:-1] < level) & (voltage[1:] >= level))
    if rises.size == 0:
        return None
    k = int(rises[0])
    return float(time[k] + (level - voltage[k]) / (voltage[k + 1] - voltage[k]) * (time[k + 1] - time[k]))


def _duration(nanoseconds: float) -> str:
    return f"{1e3 * nanoseconds:.0f} ps" if nanoseconds < 1.0 else f"{nanoseconds:.2f} ns"
