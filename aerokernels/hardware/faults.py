"""Random faults of a simulated line, counted so that a recording can be checked against them."""

import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from aerokernels.hardware.frames import DELIMITER
from aerokernels.hardware.pseudo_terminal import PseudoTerminal

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
    """

    rates: Mapping[str, float] = field(default_factory=dict)
    pause: float = 1.0
    seed: int = 0
    counts: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        """Check.

        Raises:
            ValueError: an unknown kind, or a probability outside 0 to 1.
            TypeError: rates that are not probabilities by their kinds.
        """
        if not isinstance(self.rates, Mapping):
            raise TypeError(f'rates must be probabilities by their kinds, such as {{"torn": 0.01}}, got {self.rates!r}')
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

    def draw(self, last: bool = False) -> str | None:
        """Choose the next frame's fault; None after a glued frame, and instead of "glued" for the last frame."""
        chosen = None
        if self.rates:
            place = self.random.random()
            for kind, rate in self.rates.items():
                place -= rate
                if place < 0.0:
                    chosen = kind
                    break
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
            return (
                self.random.integers(1, 256, self.random.integers(1, 100)).astype(np.uint8).tobytes() + DELIMITER + wire
            )
        if fault == "gap":
            return b""
        return wire + wire if fault == "repeat" else wire

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


def parse_faults(pairs: list[str]) -> dict[str, float]:
    """Parse rates from "kind=probability" texts.

    Raises:
        ValueError: a text that is not of this form, or a kind given twice.
    """
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
    return rates
