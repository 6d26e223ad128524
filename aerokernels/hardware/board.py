"""A simulated digitiser board: frames v1 of an echo with noise, at a rate, for trying and testing without hardware."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.constants import speed_of_light

from aerokernels.hardware.frames import DELIMITER, GREATEST_SAMPLE_COUNT, EchoFrame, encode
from aerokernels.hardware.pseudo_terminal import PseudoTerminal

_SETTLING_TIME = 0.1  # [s]; opening a serial port throws away what came before its settings were made


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
        pulse_width: float = 6e-9,
        sample_count: int = 128,
        sample_period_ps: int = 250,
        noise: float = 0.02,
    ) -> "EchoSource":
        """A Gaussian echo of a target at `distance` [m]: `peak` [V], full width at half maximum `pulse_width` [s]."""
        time_ = np.arange(sample_count) * (sample_period_ps * 1e-12)
        delay = 2.0 * distance / speed_of_light
        voltage = peak * np.exp(-4.0 * np.log(2.0) * ((time_ - delay) / pulse_width) ** 2)
        return cls(voltage, sample_period_ps, noise)

    @classmethod
    def from_result(
        cls,
        path: str | Path,
        *,
        sample_count: int = 128,
        sample_period_ps: int = 250,
        noise: float = 0.02,
    ) -> "EchoSource":
        """The echo of a finished run, from its result.nc, sampled as a board would; 0 V outside its time axis."""
        import xarray

        path = Path(path)
        if not path.is_file():
            raise ValueError(f"result {path}: no such file; make one with `aerokernels run SCENE --out DIR`")
        with xarray.open_dataset(path, engine="h5netcdf") as result:
            if (
                not {"time", "echo_voltage"} <= set(result.variables)
                or result["echo_voltage"].dims != result["time"].dims
            ):
                raise ValueError(f"result {path}: holds no 'echo_voltage' over 'time'; give the result.nc of a run")
            echo_time, voltage = result["time"].values, result["echo_voltage"].values
        sample_time = np.arange(sample_count) * (sample_period_ps * 1e-12)
        return cls(np.interp(sample_time, echo_time, voltage, left=0.0, right=0.0), sample_period_ps, noise)

    def frame(self, sequence: int, device_time_us: int, random: np.random.Generator) -> EchoFrame:
        """The next frame; its scale leaves room for six standard deviations of noise."""
        voltage = self.voltage + self.noise * random.standard_normal(self.voltage.size)
        scale = float(np.float32((np.abs(self.voltage).max() + 6.0 * self.noise or 1.0) / 32767))
        counts = np.clip(np.rint(voltage / scale), -32768, 32767).astype(np.int16)
        return EchoFrame(sequence % 2**32, device_time_us, self.sample_period_ps, scale, 0.0, counts)


def run_board(
    terminal: PseudoTerminal,
    source: EchoSource,
    *,
    rate: float = 50.0,
    count: int | None = None,
    first_sequence: int = 0,
    seed: int = 0,
    stopped: Callable[[], bool] = lambda: False,
) -> int:
    """Send frames while someone reads; returns how many were sent.

    Measuring pauses while nobody has the port open, so that the first frame of a recording is not lost in the void. A
    frame that a leaving reader cut off is gone, and its number with it, as on a real board.

    Args:
        terminal: where to send.
        source: what to send.
        rate: echoes per second.
        count: frames to send before returning; None sends until `stopped`.
        first_sequence: number of the first frame.
        seed: of the noise.
        stopped: asked between frames; True ends it.
    """
    if not rate > 0.0:
        raise ValueError(f"rate = {rate} echoes per second: give a positive one")
    random = np.random.default_rng(seed)
    sent, due, heard = 0, 0.0, False
    while not stopped() and (count is None or sent < count):
        if not terminal.has_reader():
            heard = False
            time.sleep(0.02)
            continue
        if not heard:
            time.sleep(_SETTLING_TIME)
            terminal.write(DELIMITER, stopped)  # ends what an earlier reader left unread
            heard, due = True, time.monotonic()
        wait = due - time.monotonic()
        if wait > 0.0:
            time.sleep(min(wait, 0.1))
            continue
        due = max(due, time.monotonic() - 1.0) + 1.0 / rate  # at most a second of delay is made up for
        frame = source.frame(first_sequence + sent, time.monotonic_ns() // 1000, random)
        terminal.write(encode(frame), stopped)
        sent += 1
    if count is not None:
        terminal.drain(stopped)
    return sent
