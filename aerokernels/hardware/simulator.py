"""Simulated instruments for trials without hardware: a digitiser board and an oscilloscope on a pseudo-terminal.

The board sends frames v1 of a noisy echo at a given rate. The oscilloscope acquires at a given rate and answers as a
Tektronix or a Rigol does.
"""

import os
import re
import select
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerokernels.files.netcdf_reading import open_netcdf
from aerokernels.hardware import DIALECT_NAMES
from aerokernels.hardware.frames import DELIMITER, GREATEST_SAMPLE_COUNT, EchoFrame, encode
from aerokernels.inputs.checks import (
    as_finite_array,
    as_waveform,
    check_at_least,
    check_choice,
    check_count,
    check_path,
)
from aerokernels.lidar.result import echo_of_result


def never() -> bool:
    """Never stop."""
    return False


class PseudoTerminal:
    """The board's end of a pseudo-terminal, whose other end is reached through a symbolic link.

    A link left over from an earlier terminal is replaced; any other file or link there is a ValueError.
    """

    def __init__(self, link: str | Path) -> None:
        """Make the terminal and the link."""
        self.link = check_path(link, "link")
        if self.link.exists() and not self.link.is_symlink():
            raise ValueError(f"link {self.link} is a file or a folder: give a path that is free")
        if not self.link.parent.is_dir():
            raise ValueError(f"link {self.link}: folder {self.link.parent} does not exist; make it first")
        held = os.readlink(self.link) if self.link.is_symlink() else "/dev/pts/0"
        if re.sub(r"\d", "", held) not in ("/dev/pts/", "/dev/ttys"):  # of Linux, of macOS
            raise ValueError(f"link {self.link} leads to {held}, which is no terminal: give a path that is free")
        if not hasattr(os, "openpty"):
            raise ValueError("this system has no pseudo-terminals: run the simulated board on Linux or macOS")
        self._master = -1
        self.open()

    def open(self) -> None:
        """Plug in: make a new terminal under the same link."""
        import tty

        self.close()
        self._master, slave = os.openpty()
        tty.setraw(slave)  # bytes pass unchanged, nothing is echoed
        self.name = os.ttyname(slave)
        # Closed here, so that the hang-up condition shows whether a reader has the other end open.
        os.close(slave)
        os.set_blocking(self._master, False)
        self._poll = select.poll()
        self._poll.register(self._master, select.POLLOUT)
        try:
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(self.name)
        except OSError as fault:
            self.close()
            raise ValueError(
                f"link {self.link}: none can be made there ({fault.strerror}); give another path"
            ) from None

    def has_reader(self) -> bool:
        """Whether someone has the port open."""
        return not any(event & select.POLLHUP for _, event in self._poll.poll(0))

    def read(self, timeout: float = 0.1) -> bytes:
        """Return the bytes that the reader sent; wait up to `timeout` [s], empty when none came."""
        readable, _, _ = select.select([self._master], [], [], timeout)
        if not readable:
            return b""
        try:
            return os.read(self._master, 65536)
        except BlockingIOError:
            return b""
        except OSError:  # no reader has the port open
            time.sleep(min(timeout, 0.02))
            return b""

    def write(self, data: bytes, stopped: Callable[[], bool] = never) -> bool:
        """Write all of `data`, waiting for a slow reader; False when the reader left or `stopped()` was True first."""
        left = memoryview(data)
        while left:
            if stopped() or not self.has_reader():
                return False
            try:
                left = left[os.write(self._master, left) :]
            except BlockingIOError:
                self._poll.poll(50)
        return True

    def drain(self, stopped: Callable[[], bool] = never) -> None:
        """Wait until the reader has read everything or has left: closing the terminal would discard the rest."""
        import fcntl
        import struct
        import termios

        try:
            slave = os.open(self.name, os.O_RDWR | os.O_NOCTTY)
        except OSError:
            return
        try:
            before, unread = -1, 1
            while unread and unread != before and not stopped():
                before = unread
                time.sleep(0.5)  # a reader that reads nothing in this time has stopped reading
                (unread,) = struct.unpack("i", fcntl.ioctl(slave, termios.FIONREAD, b"\0\0\0\0"))
        finally:
            os.close(slave)

    def close(self) -> None:
        """Unplug: remove the link; reads at the reader's end fail from then on."""
        if self._master < 0:
            return
        os.close(self._master)
        self._master = -1
        if self.link.is_symlink() and os.readlink(self.link) == self.name:
            self.link.unlink()

    def __enter__(self) -> "PseudoTerminal":
        """Use as a context, at whose end the terminal is unplugged."""
        return self

    def __exit__(self, *_: object) -> None:
        """Unplug."""
        self.close()


# The scene whose echo the simulated instruments send by default.
DEFAULT_SCENE = "wind-tunnel-static"


@dataclass(frozen=True, eq=False)
class EchoSource:
    """Makes noisy frames of one echo: voltage [V], shape (sample_count,), and the noise's standard deviation [V].

    The first sample is at the peak of the outgoing pulse (t = 0), so that range = c t / 2 holds for its time axis.
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
    def from_scene(
        cls, scene: str | Path = DEFAULT_SCENE, *, sample_count: int = 128, sample_period_ps: int = 250, noise=0.02
    ) -> "EchoSource":
        """Make the echo that a scene has in vacuum, with the pulse, target and detector that a run simulates."""
        from aerokernels.lidar.rangefinder import vacuum_echo
        from aerokernels.scene import Scene

        echo = vacuum_echo(Scene.load(scene))
        return cls(_interpolated(_sample_times(sample_count, sample_period_ps), *echo), sample_period_ps, noise)

    @classmethod
    def from_result(
        cls, path: str | Path, *, sample_count: int = 128, sample_period_ps: int = 250, noise: float = 0.02
    ) -> "EchoSource":
        """Make the echo of a finished run (result.nc or its folder), without the run's noise; 0 V outside its times."""
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


def run_board(
    terminal: PseudoTerminal,
    source: EchoSource,
    *,
    rate: float = 50.0,
    count: int | None = None,
    seed: int = 0,
    stopped: Callable[[], bool] = never,
) -> int:
    """Send frames while a reader has the port open; return the number of frames measured.

    Measuring pauses while no reader has the port open, so that a recording does not miss the first frame. A frame that
    was interrupted by a leaving reader is lost together with its number, as on a real board.
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
            time.sleep(0.25)  # opening a serial port discards bytes that arrive before its settings are made
            terminal.write(DELIMITER, stopped)  # ends a frame that an earlier reader left unfinished
            heard, due = True, time.monotonic()
        wait = due - time.monotonic()
        if wait > 0.0:
            time.sleep(min(wait, 0.1))
            continue
        due = max(due, time.monotonic() - 1.0) + 1.0 / rate  # catch up at most one second of delay
        frame = source.frame(sent, time.monotonic_ns() // 1000, random)
        sent += 1
        terminal.write(encode(frame), stopped)
    if count is not None:
        terminal.drain(stopped)
    return sent


class SimulatedScope:
    """An oscilloscope of a dialect, without its serial line, that acquires an echo `rate` times a second."""

    _ZERO = -100  # count of 0 V, so that the echo uses most of the 8 bits

    def __init__(self, source: EchoSource, *, dialect: str = "tektronix", rate: float = 50.0, seed: int = 0) -> None:
        """Start acquiring."""
        check_choice(dialect, "dialect", DIALECT_NAMES)
        if not rate > 0.0:
            raise ValueError(f"rate = {rate} acquisitions per second: give a positive one")
        self._source, self._dialect, self._rate, self._seed = source, dialect, rate, seed
        self._started = time.monotonic()
        self._stop_at: int | None = None  # the acquisition at which a single acquisition stops
        self._step = source.full_scale / 220
        self.curve_count = 0  # number of curves sent

    @property
    def acquisition(self) -> int:
        """Number of the current acquisition, from 1."""
        return 1 + int((time.monotonic() - self._started) * self._rate)

    def answer(self, command: str) -> bytes:
        """Return the answer to a question; empty for a command or an unknown question."""
        word = (command.strip().lstrip(":").upper().split() or [""])[0]
        if word == "*IDN?":
            maker = "TEKTRONIX" if self._dialect == "tektronix" else "RIGOL TECHNOLOGIES"
            return f"{maker},SIM1,0,aerokernels\n".encode("ascii")
        return self._tektronix(word) if self._dialect == "tektronix" else self._rigol(word)

    def _tektronix(self, word: str) -> bytes:
        if word == "ACQUIRE:NUMACQ?":
            return f":ACQUIRE:NUMACQ {self.acquisition}\n".encode("ascii")
        if word == "WFMOUTPRE?":
            count, period = self._source.voltage.size, self._source.sample_period_ps * 1e-12
            return (
                f':WFMOUTPRE:BYT_NR 1;BIT_NR 8;ENCDG BINARY;BN_FMT RI;BYT_OR MSB;WFID "Ch1, DC coupling; {count} '
                f'points, Sample mode";NR_PT {count};PT_FMT Y;XUNIT "s";XINCR {period:.9E};XZERO 0.0E0;PT_OFF 0;'
                f'YUNIT "V";YMULT {self._step:.12E};YOFF {self._ZERO:.4E};YZERO 0.0E0\n'
            ).encode("ascii")
        if word == "CURVE?":
            data = self._counts().astype("i1").tobytes()
            return b":CURVE " + self._block(data, len(str(len(data))))
        return b""

    def _rigol(self, word: str) -> bytes:
        if word == "SINGLE":
            self._stop_at = self.acquisition + 1
        elif word == "RUN":
            self._stop_at = None
        elif word == "TRIGGER:STATUS?":
            return b"TD\n" if self._stop_at is None else b"STOP\n" if self.acquisition >= self._stop_at else b"WAIT\n"
        elif word == "WAVEFORM:PREAMBLE?":
            count, period = self._source.voltage.size, self._source.sample_period_ps * 1e-12
            return f"0,0,{count},1,{period:.9e},0.0e+00,0,{self._step:.12e},{self._ZERO},127\n".encode("ascii")
        elif word == "WAVEFORM:DATA?":
            return self._block((self._counts() + 127).clip(0, 255).astype(np.uint8).tobytes(), 9)
        return b""

    def _block(self, data: bytes, digits: int) -> bytes:
        self.curve_count += 1
        return f"#{digits}{len(data):0{digits}d}".encode("ascii") + data + b"\n"

    def _counts(self) -> np.ndarray:
        """Return the counts of the current acquisition; they stay the same until the next one."""
        number = self.acquisition if self._stop_at is None else min(self._stop_at, self.acquisition)
        voltage = self._source.noisy(np.random.default_rng((self._seed, number)))
        return np.clip(np.rint(voltage / self._step) + self._ZERO, -128, 127)


def run_scope(
    terminal: PseudoTerminal,
    scope: SimulatedScope,
    *,
    count: int | None = None,
    stopped: Callable[[], bool] = never,
) -> int:
    """Answer questions until `count` curves were sent or `stopped`; return the number of curves sent."""
    pending = b""
    while not stopped() and (count is None or scope.curve_count < count):
        pending += terminal.read(0.05)
        *commands, pending = pending[-1024:].replace(b"\r", b"\n").split(b"\n")
        for command in commands:
            terminal.write(scope.answer(command.decode("ascii", "replace")), stopped)
    if count is not None:
        terminal.drain(stopped)
    return scope.curve_count
