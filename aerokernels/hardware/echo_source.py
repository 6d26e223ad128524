"""The noisy echo that a simulated instrument measures: a Gaussian, or the echo of a scene or of a finished run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.constants import speed_of_light

from aerokernels.echo.stored import echo_of_result
from aerokernels.files.netcdf_reading import open_netcdf
from aerokernels.hardware.frames import GREATEST_SAMPLE_COUNT, EchoFrame
from aerokernels.inputs.checks import check_path

# What the simulated instruments play if nothing else is asked for.
DEFAULT_SCENE = "wind-tunnel-static"


@dataclass(frozen=True, eq=False)
class EchoSource:
    """Makes noisy frames of one echo.

    The first sample lies where the outgoing pulse peaks (t = 0), so that range = c t / 2 holds for its time axis.

    Attributes:
        voltage: echo without noise [V], shape (sample_count,).
        sample_period_ps: time between two samples [ps].
        noise: standard deviation of the noise [V].
    """

    voltage: np.ndarray
    sample_period_ps: int = 1000
    noise: float = 0.02

    def __post_init__(self) -> None:
        """Check.

        Raises:
            ValueError: no finite echo, more samples than a frame holds, or a negative noise.
        """
        voltage = np.asarray(self.voltage, dtype=np.float64)
        if voltage.ndim != 1 or not 1 <= voltage.size <= GREATEST_SAMPLE_COUNT:
            raise ValueError(f"an echo of shape {voltage.shape}: give one row of 1 to {GREATEST_SAMPLE_COUNT} samples")
        if not np.all(np.isfinite(voltage)):
            raise ValueError(f"the echo has {np.sum(~np.isfinite(voltage))} samples that are not finite: repair them")
        if not (np.isfinite(self.noise) and self.noise >= 0.0):
            raise ValueError(f"noise = {self.noise} V: give 0 or more")
        object.__setattr__(self, "voltage", voltage)

    @classmethod
    def gaussian(
        cls,
        *,
        distance: float = 1.5,
        peak: float = 2.0,
        pulse_width: float = 10e-9,
        sample_count: int = 128,
        sample_period_ps: int = 250,
        noise: float = 0.02,
    ) -> "EchoSource":
        """A Gaussian echo of a target at `distance` [m]: `peak` [V], full width at half maximum `pulse_width` [s]."""
        time_ = _sample_times(sample_count, sample_period_ps)
        delay = 2.0 * distance / speed_of_light
        voltage = peak * np.exp(-4.0 * np.log(2.0) * ((time_ - delay) / pulse_width) ** 2)
        return cls(voltage, sample_period_ps, noise)

    @classmethod
    def from_scene(
        cls,
        scene: str | Path = DEFAULT_SCENE,
        *,
        sample_count: int = 128,
        sample_period_ps: int = 250,
        noise: float = 0.02,
    ) -> "EchoSource":
        """The echo that a scene has in vacuum: its pulse, target and detector, as a run of it simulates them.

        Args:
            scene: a TOML file or the name of a shipped scene.
            sample_count: samples of a frame.
            sample_period_ps: time between two samples [ps].
            noise: standard deviation of the noise [V].

        Raises:
            ValueError: a scene that cannot be used.
        """
        from aerokernels.echo.vacuum import vacuum_echo
        from aerokernels.scene import Scene

        found = vacuum_echo(Scene.load(scene))
        return cls(_drawn_on(_sample_times(sample_count, sample_period_ps), *found), sample_period_ps, noise)

    @classmethod
    def from_result(
        cls,
        path: str | Path,
        *,
        sample_count: int = 128,
        sample_period_ps: int = 250,
        noise: float = 0.02,
    ) -> "EchoSource":
        """The echo of a finished run, sampled as a board would; 0 V outside its time axis.

        Args:
            path: result.nc of the run, or the folder that holds it.
            sample_count: samples of a frame.
            sample_period_ps: time between two samples [ps].
            noise: standard deviation of the noise [V].

        Raises:
            ValueError: there is no such file, it cannot be read, or there is no echo in it.
        """
        path = check_path(path, "path")
        if path.is_dir():
            path = path / "result.nc"
        if not path.is_file():
            raise ValueError(f"result {path}: no such file; make one with `aerokernels run SCENE --out DIR`")
        echo_time, voltage = echo_of_result(path, open_netcdf(path, f"result {path}", decode_times=False))
        sample_time = _sample_times(sample_count, sample_period_ps)
        return cls(np.interp(sample_time, echo_time, voltage, left=0.0, right=0.0), sample_period_ps, noise)

    @property
    def full_scale(self) -> float:
        """Voltage that leaves room for six standard deviations of noise on the echo [V]."""
        return float(np.abs(self.voltage).max() + 6.0 * self.noise) or 1.0

    def noisy(self, random: np.random.Generator) -> np.ndarray:
        """One measurement of the echo [V], shape (sample_count,)."""
        return self.voltage + self.noise * random.standard_normal(self.voltage.size)

    def frame(self, sequence: int, device_time_us: int, random: np.random.Generator) -> EchoFrame:
        """The next frame of a digitiser board."""
        voltage = self.noisy(random)
        scale = float(np.float32(self.full_scale / 32767))
        counts = np.clip(np.rint(voltage / scale), -32768, 32767).astype(np.int16)
        return EchoFrame(sequence % 2**32, device_time_us, self.sample_period_ps, scale, 0.0, counts)


def _sample_times(sample_count: int, sample_period_ps: int) -> np.ndarray:
    """Times of a frame's samples [s]."""
    return np.arange(sample_count) * (sample_period_ps * 1e-12)


def _drawn_on(time: np.ndarray, echo_time: np.ndarray, voltage: np.ndarray) -> np.ndarray:
    """An echo's voltage at other times [s], by the quintic spline; 0 V outside its record."""
    from aerokernels.echo.pulse_curve import PulseCurve
    from aerokernels.inputs.checks import as_waveform

    echo_time, voltage, period = as_waveform(echo_time, voltage)
    peak = int(np.argmax(voltage))
    return PulseCurve(voltage).at((time - echo_time[peak]) / period + peak)
