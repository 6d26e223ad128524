"""A simulated oscilloscope that acquires at a given rate and answers as a Tektronix or a Rigol does."""

import time
from collections.abc import Callable

import numpy as np

from aerokernels.hardware.echo_source import EchoSource
from aerokernels.hardware.faults import FaultPlan
from aerokernels.hardware.protocols import DIALECT_NAMES
from aerokernels.hardware.pseudo_terminal import PseudoTerminal
from aerokernels.inputs.checks import check_choice

_ZERO = -100  # count of 0 V, so that the echo uses most of the 8 bits
_USED_COUNTS = 220
_GREATEST_COMMAND = 1024


class SimulatedScope:
    """The instrument, without its serial line.

    Args:
        source: the echo that it measures.
        dialect: "tektronix" or "rigol".
        rate: acquisitions per second.
        seed: seed of the noise.
    """

    def __init__(self, source: EchoSource, *, dialect: str = "tektronix", rate: float = 50.0, seed: int = 0) -> None:
        """Start acquiring."""
        check_choice(dialect, "dialect", DIALECT_NAMES)
        if not rate > 0.0:
            raise ValueError(f"rate = {rate} acquisitions per second: give a positive one")
        self._source, self._dialect, self._rate, self._seed = source, dialect, rate, seed
        self._started = time.monotonic()
        self._skipped = 0
        self._stop_at: int | None = None  # the acquisition at which a single acquisition stops
        self._header = self._width = 1
        self._says_curve = False
        self._step = source.full_scale / _USED_COUNTS
        self.curve_count = 0  # number of curves sent

    @property
    def acquisition(self) -> int:
        """Number of the current acquisition, from 1."""
        return 1 + self._skipped + int((time.monotonic() - self._started) * self._rate)

    def skip(self) -> None:
        """Skip an acquisition, as if it had come and gone between two questions."""
        self._skipped += 1

    def answer(self, command: str) -> bytes:
        """Return the answer to a question; empty for a command or an unknown question."""
        words = command.strip().lstrip(":").upper().split()
        if not words:
            return b""
        if words[0] == "*IDN?":
            maker = "TEKTRONIX,SIM1" if self._dialect == "tektronix" else "RIGOL TECHNOLOGIES,SIM1"
            return f"{maker},0,aerokernels\n".encode("ascii")
        if words[0] == "*OPC?":
            return b"1\n"
        return self._tektronix(words) if self._dialect == "tektronix" else self._rigol(words)

    def _tektronix(self, words: list[str]) -> bytes:
        if words[0] in ("HEADER", "HEAD") and len(words) > 1:
            self._header = int(words[1] in ("ON", "1"))
            self._says_curve = bool(self._header)
        elif words[0] in ("DATA:WIDTH", "DAT:WID") and words[-1] in ("1", "2"):
            self._width = int(words[1])
        elif words[0] in ("ACQUIRE:NUMACQ?", "ACQ:NUMAC?"):
            return f"{':ACQUIRE:NUMACQ ' if self._header else ''}{self.acquisition}\n".encode("ascii")
        elif words[0] in ("WFMOUTPRE?", "WFMO?"):
            fields = self._tektronix_fields()
            named = [f"{name} {value}" if self._header else value for name, value in fields.items()]
            return f"{':WFMOUTPRE:' if self._header else ''}{';'.join(named)}\n".encode("ascii")
        elif words[0].startswith("WFMOUTPRE:") and words[0].endswith("?"):
            name = words[0][len("WFMOUTPRE:") : -1]
            value = self._tektronix_fields().get(name)
            header = f":WFMOUTPRE:{name} " if self._header else ""
            return b"" if value is None else f"{header}{value}\n".encode("ascii")
        elif words[0] in ("CURVE?", "CURV?"):
            data = self._counts().astype(np.int16)
            block = data.astype("i1").tobytes() if self._width == 1 else (256 * data).astype(">i2").tobytes()
            self.curve_count += 1
            return (b":CURVE " if self._says_curve else b"") + _block(block, digits=len(str(len(block))))
        return b""

    def _tektronix_fields(self) -> dict[str, str]:
        count, unit = self._source.voltage.size, 256 ** (self._width - 1)
        return {
            "BYT_NR": f"{self._width}", "BIT_NR": f"{8 * self._width}", "ENCDG": "BINARY", "BN_FMT": "RI",
            "BYT_OR": "MSB", "WFID": f'"Ch1, DC coupling; {count} points, Sample mode"', "NR_PT": f"{count}",
            "PT_FMT": "Y", "XUNIT": '"s"', "XINCR": f"{self._source.sample_period_ps * 1e-12:.9E}", "XZERO": "0.0E0",
            "PT_OFF": "0", "YUNIT": '"V"', "YMULT": f"{self._step / unit:.12E}", "YOFF": f"{_ZERO * unit:.4E}",
            "YZERO": "0.0E0",
        }  # fmt: skip

    def _rigol(self, words: list[str]) -> bytes:
        if words[0] in ("SINGLE", "SING"):
            self._stop_at = self.acquisition + 1
        elif words[0] == "RUN":
            self._stop_at = None
        elif words[0] in ("TRIGGER:STATUS?", "TRIG:STAT?"):
            return b"TD\n" if self._stop_at is None else b"STOP\n" if self.acquisition >= self._stop_at else b"WAIT\n"
        if words[0] in ("WAVEFORM:PREAMBLE?", "WAV:PRE?"):
            period = self._source.sample_period_ps * 1e-12
            return (f"0,0,{self._source.voltage.size},1,{period:.9e},0.0e+00,0,{self._step:.12e},{_ZERO},127\n").encode(
                "ascii"
            )
        if words[0] in ("WAVEFORM:DATA?", "WAV:DATA?"):
            self.curve_count += 1
            return _block((self._counts() + 127).clip(0, 255).astype(np.uint8).tobytes(), digits=9)
        return b""

    def _counts(self) -> np.ndarray:
        """Return the counts of the current acquisition; they stay the same until the next one."""
        number = self.acquisition if self._stop_at is None else min(self._stop_at, self.acquisition)
        voltage = self._source.noisy(np.random.default_rng((self._seed, number)))
        return np.clip(np.rint(voltage / self._step) + _ZERO, -128, 127)


def run_scope(
    terminal: PseudoTerminal,
    scope: SimulatedScope,
    *,
    count: int | None = None,
    faults: FaultPlan | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> int:
    """Answer questions until `count` curves were sent or `stopped`; return the number of curves sent.

    Faults affect only the answers that hold a curve: torn, its end is missing; flipped, a bit of the block's length is
    wrong; glued or repeat, it comes twice; garbage, other bytes come first; gap, an acquisition is skipped; stall, no
    answer comes.
    """
    faults, pending = faults or FaultPlan(), b""
    while not stopped() and (count is None or scope.curve_count < count):
        pending += terminal.read(0.05)
        *commands, pending = pending[-_GREATEST_COMMAND:].replace(b"\r", b"\n").split(b"\n")
        for command in commands:
            before = scope.curve_count
            answer = scope.answer(command.decode("ascii", "replace"))
            fault = faults.draw() if scope.curve_count > before else None
            if fault == "gap":
                scope.skip()
            terminal.write(_on_the_line(fault, answer, faults.random), stopped)
            faults.interrupt(fault, terminal, stopped)
            if fault == "unplug":
                pending = b""
    if count is not None:
        terminal.drain(stopped)
    return scope.curve_count


def _block(data: bytes, digits: int) -> bytes:
    return f"#{digits}{len(data):0{digits}d}".encode("ascii") + data + b"\n"


def _on_the_line(fault: str | None, answer: bytes, random: np.random.Generator) -> bytes:
    if fault == "torn":
        return answer[: random.integers(1, len(answer) - 1)]
    if fault == "flipped":
        place = answer.index(b"#") + 2
        return answer[:place] + bytes([answer[place] ^ (1 << int(random.integers(8)))]) + answer[place + 1 :]
    if fault in ("glued", "repeat"):
        return answer + answer
    if fault == "garbage":
        return random.integers(128, 256, random.integers(1, 50)).astype(np.uint8).tobytes() + answer
    return b"" if fault == "stall" else answer
