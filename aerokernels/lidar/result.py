"""Hold the result of an echo simulation."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from aerokernels.display.quantities import TOTAL, ErrorBudget, Quantity
from aerokernels.display.shown import drawn_on, shown
from aerokernels.files.netcdf_reading import errors_naming
from aerokernels.inputs.checks import as_waveform
from aerokernels.lidar.pulse_curve import peak_height
from aerokernels.lidar.range_error import RangeStatistics

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes


@shown
@dataclass(frozen=True, eq=False, repr=False)
class EchoResult:
    """The echo of a scene. Arrays are float64.

    Attributes:
        time: Sample times after the pulse's peak left [s], shape (n,).
        power: Power on the receiver's pupil [W], shape (n,).
        voltage: Recorded voltage [V], shape (n,): with noise and digitiser if the scene has them.
        clean_voltage: Voltage without noise and digitiser [V], shape (n,).
        noise_rms: Standard deviation of the noise between echoes [V]; 0 if the scene has no noise.
        target_point: Where each ray of the beam meets the target [m], shape (m, 3); NaN for rays that do not.
        path: Optical path R_L of each ray from the exit aperture to the target [m], shape (m,).
        group_path: Group path of each ray, by which the pulse travels [m], shape (m,).
        deflection: Deflection of each ray by the flow, toward x and y [rad], shape (m, 2).
        incidence: Angle between each ray and the target's normal [rad], shape (m,).
        strehl: Strehl ratio of each point's return path over the receiver's pupil, shape (m,); NaN if the scene's
            return factor is "none".
        return_factor: Fraction of each point's light that the flow transmits on the return path, 0 to 1, shape (m,).
        beam_share: Fraction of the beam's power that each ray represents, shape (m,).
        point_power: Peak of each point's own pulse at the receiver [W], shape (m,); `power` is the sum of the pulses.
        distance: True distance of the target [m].
        still_air: Part of `range_error` that the air at rest causes [m], with its error: n_g - 1 of the ambient air
            times the distance. The flow has no part in it.
        ranging: The scene's ranging method.
        ranges: Range by method [m], calibrated; NaN if a method finds no echo, or cannot be calibrated.
        reasons: The reason for each method whose range is NaN.
        calibration: Offset that is subtracted from each method's reading [m]: its error on the same scene's echo in
            vacuum; methods that cannot read that echo are absent.
        statistics: Systematic and random error by method, over the scene's `detector.trial_count` noisy records.
        vacuum_peak_power: Peak power of the echo in vacuum [W].
        vacuum_peak_voltage: Peak voltage of the echo in vacuum [V].
        vacuum_voltage: Voltage of the echo in vacuum, without noise [V], shape (sample_count,).
        information: Numbers about the computation: "beam_share" (fraction of the beam's power that arrives on the
            target), "lost_share" (fraction aimed at the target, in rays that failed) and "lost_share_error",
            "pair_count" (pairs of target and pupil points that the return rays represent), "ray_count" (traced),
            "evaluation_count", "trace_seconds".
        budget: Computes the errors of the numbers; called by `error`.
    """

    time: np.ndarray
    power: np.ndarray
    voltage: np.ndarray
    clean_voltage: np.ndarray
    noise_rms: float
    target_point: np.ndarray
    path: np.ndarray
    group_path: np.ndarray
    deflection: np.ndarray
    incidence: np.ndarray
    strehl: np.ndarray
    return_factor: np.ndarray
    beam_share: np.ndarray
    point_power: np.ndarray
    distance: float
    still_air: Quantity
    ranging: str
    ranges: Mapping[str, float]
    reasons: Mapping[str, str]
    calibration: Mapping[str, float]
    statistics: Mapping[str, RangeStatistics]
    vacuum_peak_power: float
    vacuum_peak_voltage: float
    vacuum_voltage: np.ndarray
    information: Mapping[str, float] = field(default_factory=dict)
    budget: "Callable[[EchoResult], dict[str, ErrorBudget]] | None" = None

    @cached_property
    def error(self) -> dict[str, ErrorBudget]:
        """Error budgets of "strehl", "peak_power", "peak_voltage", "group_path" and, by its method, of each range.

        Each entry is the number computed again where one thing about the run is done another way (echo_errors.py), and
        covers the truth 95 times of 100; "sampling" has the noise too. Some rays are traced at the first access.
        """
        return {} if self.budget is None else self.budget(self)

    @cached_property
    def quantities(self) -> dict[str, Quantity]:
        """Numbers with errors.

        They are "strehl", "peak_power" [W], "peak_voltage" [V], and "group_path" (mean over the beam), "range",
        "range_error" and "still_air" [m].
        """
        return self._quantities({name: budget[TOTAL] for name, budget in self.error.items()})

    def _quantities(self, error: Mapping[str, float] | None) -> dict[str, Quantity]:
        """Return the numbers with these errors; None: without errors."""

        def quantity(value: float, name: str, unit: str = "") -> Quantity:
            return Quantity(value, None if error is None else error.get(name, math.nan), unit, is_ratio=not unit)

        return {
            "strehl": quantity(self.mean_strehl, "strehl"),
            "peak_power": quantity(self.peak_power, "peak_power", "W"),
            "peak_voltage": quantity(self.peak_voltage, "peak_voltage", "V"),
            "group_path": quantity(self.beam_mean(self.group_path), "group_path", "m"),
            "range": quantity(self.range, self.ranging, "m"),
            "range_error": quantity(self.range_error, self.ranging, "m"),
            "still_air": self.still_air,
        }

    def plot(self, axes: "Axes | None" = None) -> "Axes":
        """Plot the recorded and the noise-free voltage [V] over time [ns] on matplotlib axes; returns the axes."""
        axes = drawn_on(axes)
        axes.plot(1e9 * self.time, self.voltage, label="recorded")
        if self.noise_rms > 0.0:
            axes.plot(1e9 * self.time, self.clean_voltage, label="without noise")
            axes.legend()
        axes.set(xlabel="time after the pulse's peak left [ns]", ylabel="voltage [V]")
        return axes

    def __repr__(self) -> str:
        """Return the numbers as text, with their errors if these have been computed: `quantities` computes them."""
        numbers = self.quantities if "error" in self.__dict__ else self._quantities(None)
        lines = [
            f"EchoResult, target at {self.distance:g} m, {len(self.beam_share)} points, {len(self.time)} samples",
            f"  peak {numbers['peak_power'].scaled(1e6, 'uW')}, {numbers['peak_voltage']}, "
            f"Strehl ratio {numbers['strehl']}",
            f"  range by {self.ranging} {numbers['range']}, "
            f"error {numbers['range_error'].scaled(1e3, 'mm').text(True)}",
            f"  of the error the air at rest, without flow: {self.still_air.scaled(1e3, 'mm').text(True)}",
        ]
        return "\n".join([*lines, f"  no range: {self.reason}"] if self.reason else lines)

    @property
    def peak_power(self) -> float:
        """Peak of the received power [W], between the samples."""
        return self._peaks[0]

    @property
    def peak_voltage(self) -> float:
        """Peak of the voltage [V], between the samples."""
        return self._peaks[1]

    @cached_property
    def _peaks(self) -> list[float]:
        """Peaks of power and voltage."""
        return [peak_height(record) for record in (self.power, self.voltage)]

    @property
    def range(self) -> float:
        """Range by the scene's own method [m]; NaN if it finds no echo."""
        return self.ranges[self.ranging]

    @property
    def reason(self) -> str | None:
        """Why the scene's own method gives no range; None if it gives one."""
        return self.reasons.get(self.ranging) if math.isnan(self.range) else None

    @property
    def range_error(self) -> float:
        """`range` minus the true distance [m]."""
        return self.range - self.distance

    @property
    def mean_strehl(self) -> float:
        """Mean Strehl ratio over the target points, weighted with their fractions of the beam's power."""
        return self.beam_mean(self.strehl)

    def beam_mean(self, values: np.ndarray) -> float:
        """Return the mean of finite values over the target points, weighted with their fractions of the power."""
        good = np.isfinite(values) & (self.beam_share > 0.0)
        share = self.beam_share[good]
        return float(share @ values[good] / share.sum()) if good.any() else math.nan

    def to_xarray(self) -> "xarray.Dataset":
        """Return the echo as a dataset with units: `echo_power`, `echo_voltage` over "time", the rest over "point"."""
        import xarray

        def variable(dims, values, units: str, words: str) -> tuple:
            return dims, values, {"units": units, "long_name": words}

        point, methods = partial(variable, "point"), partial(variable, "ranging_method")
        offsets = [self.calibration.get(name, math.nan) for name in self.ranges]
        variables = {
            "echo_power": variable("time", self.power, "W", "received power"),
            "echo_voltage": variable("time", self.voltage, "V", "detector voltage"),
            "echo_voltage_clean": variable("time", self.clean_voltage, "V", "voltage without noise"),
            "echo_voltage_vacuum": variable("time", self.vacuum_voltage, "V", "voltage without flow and noise"),
            "target_point": variable(
                ("point", "axis"), self.target_point, "m", "where the beam's rays land on the target"
            ),
            "path": point(self.path, "m", "optical path from the exit aperture to the target"),
            "group_path": point(self.group_path, "m", "group path from the exit aperture to the target"),
            "deflection": variable(
                ("point", "transverse"), self.deflection, "rad", "deflection by the flow on the way out"
            ),
            "incidence": point(self.incidence, "rad", "angle between ray and target normal"),
            "point_strehl": point(self.strehl, "1", "Strehl ratio of the return path"),
            "return_factor": point(self.return_factor, "1", "what the flow leaves of the light on its way back"),
            "beam_share": point(self.beam_share, "1", "share of the beam's power"),
            "point_power": point(self.point_power, "W", "peak of the point's own pulse at the receiver"),
            "method_range": methods(list(self.ranges.values()), "m", "range"),
            "range_offset": methods(offsets, "m", "calibration subtracted from the reading"),
        }
        for name, words in (
            ("systematic_error", "mean range less the true one"),
            ("random_error", "standard deviation of the range"),
            ("cramer_rao_bound", "least random error of any unbiased range"),
        ):
            if self.statistics:
                values = [getattr(self.statistics.get(method), name, math.nan) for method in self.ranges]
                variables[f"range_{name}"] = methods(values, "m", words)
        coordinates = {
            "time": variable("time", self.time, "s", "time after the pulse's peak left"),
            "axis": ["x", "y", "z"],
            "transverse": ["x", "y"],
            "ranging_method": list(self.ranges),
        }
        attributes = {
            "ranging": self.ranging,
            "range_m": self.range,
            **({"range_reason": self.reason} if self.reason else {}),
            "true_range_m": self.distance,
            "echo_peak_w": self.peak_power,
            "echo_peak_v": self.peak_voltage,
            "noise_rms_v": self.noise_rms,
            "vacuum_peak_w": self.vacuum_peak_power,
            "vacuum_peak_v": self.vacuum_peak_voltage,
            **{f"echo_{name}": value for name, value in self.information.items()},
        }
        return xarray.Dataset(variables, coords=coordinates, attrs=attributes)


def echo_of_result(path: Path, result: "xarray.Dataset") -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and voltages [V], (n,) each, of the echo in a result; a ValueError names the file `path`."""
    if not {"time", "echo_voltage"} <= set(result.variables):
        raise ValueError(f"result {path}: holds no 'echo_voltage' over 'time'; give the result.nc of a run")
    with errors_naming(path):
        values = result["time"].values, result["echo_voltage"].values
    try:
        time, voltage, _ = as_waveform(*values, least_count=2)
    except (ValueError, TypeError) as fault:
        raise ValueError(f"result {path}: its echo cannot be used ({fault}); run it again") from None
    return time, voltage
