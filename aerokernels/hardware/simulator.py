"""Simulated instruments on a pseudo-terminal, for trials without hardware: a digitiser board, an oscilloscope, faults.

The board sends frames v1 of a noisy echo at a given rate. The oscilloscope acquires at a given rate and answers as a
Tektronix or a Rigol does. Random faults of the line are counted, so that a recording can be checked against them.
"""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from aerokernels.hardware import DIALECT_NAMES
from aerokernels.hardware.echo_source import EchoSource
from aerokernels.hardware.frames import DELIMITER, encode
from aerokernels.hardware.pseudo_terminal import PseudoTerminal, never
from aerokernels.inputs.checks import check_choice

# Kinds of faults. Of n frames, n - torn - flipped - 2 glued - gap arrive undamaged, if no stall or unplug interrupts;
# torn + flipped + glued + garbage damaged pieces arrive.
FAULTS = {
    "torn": "the end of a frame is missing",
    "flipped": "one bit is wrong",
    "glued": "the delimiter is missing, and the next frame follows at once",
    "garbage": "other bytes come before a frame",
    "gap": "a frame was measured and not sent",
    "repeat": "a frame is sent twice",
    "stall": "nothing is sent for a while",
    "unplug": "the port goes away for a while",
}


@dataclass
class FaultPlan:
    """Draws at most one fault for each frame.

    Attributes:
        rates: probability per frame of each kind.
        pause: duration of a stall or of an unplugged port [s].
        seed: seed of the random choices.
        counts: how often each kind happened.

    Raises:
        ValueError: an unknown kind, or a probability outside 0 to 1.
    """

    rates: Mapping[str, float] = field(default_factory=dict)
    pause: float = 1.0
    seed: int = 0
    counts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        """Check."""
        for kind, rate in self.rates.items():
            if kind not in FAULTS:
                raise ValueError(f"fault {kind!r}: give one of {', '.join(FAULTS)}")
            if not 0.0 <= rate <= 1.0:
                raise ValueError(f"fault {kind} = {rate}: give a probability per frame, 0 to 1")
        if sum(self.rates.values()) > 1.0:
            raise ValueError(f"faults add up to {sum(self.rates.values())} per frame: give 1 at most")
        if not self.pause >= 0.0:
            raise ValueError(f"pause = {self.pause} s: give 0 or more")
        self.random = np.random.default_rng(self.seed)
        self._after_glued = False

    @classmethod
    def parse(cls, pairs: list[str], pause: float = 1.0, seed: int = 0) -> "FaultPlan":
        """Make a plan from "kind=probability" texts; a text of another form or a kind given twice is a ValueError."""
        rates: dict[str, float] = {}
        for pair in pairs:
            kind, _, text = (part.strip() for part in pair.partition("="))
            try:
                rate = float(text)
            except ValueError:
                raise ValueError(f"fault {pair!r}: give KIND=PROBABILITY, for example flipped=0.01") from None
            if kind in rates:
                raise ValueError(f"fault {pair!r}: {kind!r} is given twice; give each kind once")
            rates[kind] = rate
        return cls(rates, pause, seed)

    def draw(self, last: bool = False) -> str | None:
        """Choose the next frame's fault; None after a glued frame, and instead of "glued" for the last frame."""
        place, chosen = self.random.random() if self.rates else 1.0, None
        for kind, rate in self.rates.items():
            if 0.0 <= place < rate:
                chosen = kind
            place -= rate
        if self._after_glued or (last and chosen == "glued"):
            chosen = None
        self._after_glued = chosen == "glued"
        if chosen:
            self.counts[chosen] += 1
        return chosen

    def on_the_line(self, fault: str | None, wire: bytes) -> bytes:
        """Return the bytes that a fault makes of a frame and its delimiter."""
        if fault == "torn":
            return wire[: self.random.integers(1, len(wire) - 1)] + DELIMITER
        if fault == "flipped":
            while True:
                place, bit = self.random.integers(len(wire) - 1), 1 << int(self.random.integers(8))
                if wire[place] != bit:  # flipping this bit would make a zero, which splits the frame in two
                    return wire[:place] + bytes([wire[place] ^ bit]) + wire[place + 1 :]
        if fault == "glued":
            return wire[:-1]
        if fault == "garbage":
            return self.random.integers(1, 256, 50).astype(np.uint8).tobytes() + DELIMITER + wire
        if fault == "gap":
            return b""
        return wire + wire if fault == "repeat" else wire

    def in_answer(self, fault: str | None, answer: bytes) -> bytes:
        """Return the bytes that a fault makes of an oscilloscope's answer: "flipped" is a bit of the block's length."""
        if fault == "torn":
            return answer[: self.random.integers(1, len(answer) - 1)]
        if fault == "flipped":
            place = answer.index(b"#") + 2
            return answer[:place] + bytes([answer[place] ^ (1 << int(self.random.integers(8)))]) + answer[place + 1 :]
        if fault in ("glued", "repeat"):
            return answer + answer
        if fault == "garbage":
            return self.random.integers(128, 256, 25).astype(np.uint8).tobytes() + answer
        return b"" if fault == "stall" else answer

    def interrupt(self, fault: str | None, terminal: PseudoTerminal, stopped: Callable[[], bool]) -> None:
        """Stall, or unplug the terminal for a while."""
        if fault not in ("stall", "unplug"):
            return
        if fault == "unplug":
            terminal.close()
        until = time.monotonic() + self.pause
        while time.monotonic() < until and not stopped():
            time.sleep(0.01)
        if fault == "unplug":
            terminal.open()

    def __str__(self) -> str:
        """Return the counts of the faults that happened: "3 torn, 1 gap"."""
        return ", ".join(f"{self.counts[kind]} {kind}" for kind in FAULTS if self.counts[kind])


def run_board(
    terminal: PseudoTerminal,
    source: EchoSource,
    *,
    rate: float = 50.0,
    count: int | None = None,
    seed: int = 0,
    faults: FaultPlan | None = None,
    stopped: Callable[[], bool] = never,
) -> int:
    """Send frames while a reader has the port open; return the number of frames measured.

    Measuring pauses while no reader has the port open, so that a recording does not miss the first frame. A frame that
    was interrupted by a leaving reader is lost together with its number, as on a real board.

    Args:
        terminal: pseudo-terminal to send on.
        source: echoes to send.
        rate: echoes per second.
        count: frames to measure before returning; None goes on until `stopped`.
        seed: seed of the noise.
        faults: faults of the line, which also counts them.
        stopped: called between frames; True ends the board.
    """
    if not rate > 0.0:
        raise ValueError(f"rate = {rate} echoes per second: give a positive one")
    random, faults = np.random.default_rng(seed), faults or FaultPlan()
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
        fault = faults.draw(last=sent == count)
        terminal.write(faults.on_the_line(fault, encode(frame)), stopped)
        faults.interrupt(fault, terminal, stopped)
    if count is not None:
        terminal.drain(stopped)
    return sent


class SimulatedScope:
    """An oscilloscope, without its serial line.

    Args:
        source: the echo that it measures.
        dialect: "tektronix" or "rigol".
        rate: acquisitions per second.
        seed: seed of the noise.
    """

    _ZERO = -100  # count of 0 V, so that the echo uses most of the 8 bits

    def __init__(self, source: EchoSource, *, dialect: str = "tektronix", rate: float = 50.0, seed: int = 0) -> None:
        """Start acquiring."""
        check_choice(dialect, "dialect", DIALECT_NAMES)
        if not rate > 0.0:
            raise ValueError(f"rate = {rate} acquisitions per second: give a positive one")
        self._source, self._dialect, self._rate, self._seed = source, dialect, rate, seed
        self._started = time.monotonic()
        self._skipped = 0
        self._stop_at: int | None = None  # the acquisition at which a single acquisition stops
        self._step = source.full_scale / 220
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
    faults: FaultPlan | None = None,
    stopped: Callable[[], bool] = never,
) -> int:
    """Answer questions until `count` curves were sent or `stopped`; return the number of curves sent.

    Faults affect only the answers that hold a curve: see `FaultPlan.in_answer`; "gap" skips an acquisition.
    """
    faults, pending = faults or FaultPlan(), b""
    while not stopped() and (count is None or scope.curve_count < count):
        pending += terminal.read(0.05)
        *commands, pending = pending[-1024:].replace(b"\r", b"\n").split(b"\n")
        for command in commands:
            before = scope.curve_count
            answer = scope.answer(command.decode("ascii", "replace"))
            fault = faults.draw() if scope.curve_count > before else None
            if fault == "gap":
                scope.skip()
            terminal.write(faults.in_answer(fault, answer), stopped)
            faults.interrupt(fault, terminal, stopped)
            if fault == "unplug":
                pending = b""
    if count is not None:
        terminal.drain(stopped)
    return scope.curve_count
