"""The noisy echo that a simulated instrument measures: a Gaussian, a scene's echo, or the echo of a finished run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.constants import speed_of_light

from aerokernels.files.netcdf_reading import open_netcdf
from aerokernels.hardware.frames import GREATEST_SAMPLE_COUNT, EchoFrame
from aerokernels.inputs.checks import as_finite_array, as_waveform, check_at_least, check_count, check_path
from aerokernels.lidar.result import echo_of_result

# The scene whose echo the simulated instruments send by default.
DEFAULT_SCENE = "wind-tunnel-static"


@dataclass(frozen=True, eq=False)
class EchoSource:
    """Makes noisy frames of one echo.

    The first sample is at the peak of the outgoing pulse (t = 0), so that range = c t / 2 holds for its time axis.

    Attributes:
        voltage: echo without noise [V], shape (sample_count,).
        sample_period_ps: time between two samples [ps].
        noise: standard deviation of the noise [V].

    Raises:
        ValueError: an echo that is not finite, more samples than a frame holds, a sample period that a frame does not
            hold, or a negative noise.
        TypeError: an echo or a noise that is no number.
    """

    voltage: np.ndarray
    sample_period_ps: int = 1000
    noise: float = 0.02

    def __post_init__(self) -> None:
        """Check."""
        voltage = as_finite_array(self.voltage, "the echo")
        check_count(self.sample_period_ps, "sample_period_ps", most=2**32 - 1)
        if voltage.ndim != 1 or not 1 <= voltage.size <= GREATEST_SAMPLE_COUNT:
            raise ValueError(f"an echo of shape {voltage.shape}: give one row of 1 to {GREATEST_SAMPLE_COUNT} samples")
        check_at_least(self.noise, "noise", 0.0)
        object.__setattr__(self, "voltage", voltage)

    @classmethod
    def gaussian(
        cls, *, distance: float = 1.5, peak: float = 2.0, pulse_width: float = 10e-9, noise: float = 0.02
    ) -> "EchoSource":
        """Make a Gaussian echo of a target at `distance` [m]: `peak` [V], `pulse_width` [s] wide at half maximum."""
        late = _sample_times(128, 250) - 2.0 * distance / speed_of_light
        return cls(peak * np.exp(-4.0 * np.log(2.0) * (late / pulse_width) ** 2), 250, noise)

    @classmethod
    def from_scene(
        cls, scene: str | Path = DEFAULT_SCENE, *, sample_count: int = 128, sample_period_ps: int = 250, noise=0.02
    ) -> "EchoSource":
        """Make the echo that a scene has in vacuum, with the pulse, target and detector that a run simulates.

        Args:
            scene: a TOML file or the name of a shipped scene.
            sample_count: samples of a frame.
            sample_period_ps: time between two samples [ps].
            noise: standard deviation of the noise [V].

        Raises:
            ValueError: a scene that cannot be used.
        """
        from aerokernels.lidar.rangefinder import vacuum_echo
        from aerokernels.scene import Scene

        echo = vacuum_echo(Scene.load(scene))
        return cls(_interpolated(_sample_times(sample_count, sample_period_ps), *echo), sample_period_ps, noise)

    @classmethod
    def from_result(
        cls, path: str | Path, *, sample_count: int = 128, sample_period_ps: int = 250, noise: float = 0.02
    ) -> "EchoSource":
        """Make the echo of a finished run, without the run's noise, sampled as a board would; 0 V outside its times.

        Args:
            path: result.nc of the run, or its folder.
            sample_count: samples of a frame.
            sample_period_ps: time between two samples [ps].
            noise: standard deviation of the noise [V].

        Raises:
            ValueError: the file does not exist, cannot be read, or holds no echo.
        """
        path = check_path(path, "path")
        path = path / "result.nc" if path.is_dir() else path
        if not path.is_file():
            raise ValueError(f"result {path}: no such file; make one with `aerokernels run SCENE --out DIR`")
        result = open_netcdf(path, f"result {path}", decode_times=False)
        if "echo_voltage_clean" in result.variables:  # the instrument adds its own noise and digitises by itself
            result = result.assign(echo_voltage=result["echo_voltage_clean"])
        echo = echo_of_result(path, result)
        try:
            voltage = _interpolated(_sample_times(sample_count, sample_period_ps), *echo)
        except ValueError as error:
            raise ValueError(f"result {path}: {error}") from None
        return cls(voltage, sample_period_ps, noise)

    @property
    def full_scale(self) -> float:
        """The echo's greatest voltage plus six standard deviations of the noise [V]."""
        return float(np.abs(self.voltage).max() + 6.0 * self.noise) or 1.0

    def noisy(self, random: np.random.Generator) -> np.ndarray:
        """Return one measurement of the echo [V], shape (sample_count,)."""
        return self.voltage + self.noise * random.standard_normal(self.voltage.size)

    def frame(self, sequence: int, device_time_us: int, random: np.random.Generator) -> EchoFrame:
        """Return one measurement as a digitiser board's frame."""
        scale = float(np.float32(self.full_scale / 32767))
        counts = np.clip(np.rint(self.noisy(random) / scale), -32768, 32767).astype(np.int16)
        return EchoFrame(sequence % 2**32, device_time_us, self.sample_period_ps, scale, 0.0, counts)


def _sample_times(sample_count: int, sample_period_ps: int) -> np.ndarray:
    """Return the times of a frame's samples [s]."""
    check_count(sample_count, "sample_count", most=GREATEST_SAMPLE_COUNT)
    return np.arange(sample_count) * (sample_period_ps * 1e-12)


def _interpolated(time: np.ndarray, echo_time: np.ndarray, voltage: np.ndarray) -> np.ndarray:
    """Interpolate an echo's voltage at other times [s] by the quintic spline; 0 V outside its record."""
    from aerokernels.lidar.pulse_curve import PulseCurve

    echo_time, voltage, period = as_waveform(echo_time, voltage)
    peak = int(np.argmax(voltage))
    return PulseCurve(voltage).at((time - echo_time[peak]) / period + peak)
