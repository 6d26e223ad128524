"""A simulated digitiser board that sends frames v1 of a noisy echo at a given rate, for trials without hardware."""

import time
from collections.abc import Callable

import numpy as np

from aerokernels.hardware.echo_source import EchoSource
from aerokernels.hardware.faults import FaultPlan
from aerokernels.hardware.frames import DELIMITER, encode
from aerokernels.hardware.pseudo_terminal import PseudoTerminal

_SETTLING_TIME = 0.25  # [s]; opening a serial port discards bytes that arrive before its settings are made


def run_board(
    terminal: PseudoTerminal,
    source: EchoSource,
    *,
    rate: float = 50.0,
    count: int | None = None,
    seed: int = 0,
    faults: FaultPlan | None = None,
    stopped: Callable[[], bool] = lambda: False,
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
            time.sleep(_SETTLING_TIME)
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
