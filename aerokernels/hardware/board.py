"""A simulated digitiser board: it sends frames v1 of a noisy echo at a given rate, to try and test without hardware."""

import time
from collections.abc import Callable

import numpy as np

from aerokernels.hardware.echo_source import EchoSource
from aerokernels.hardware.faults import FaultPlan
from aerokernels.hardware.frames import DELIMITER, encode
from aerokernels.hardware.pseudo_terminal import PseudoTerminal

_SETTLING_TIME = 0.25  # [s]; opening a serial port throws away what came before its settings were made


def run_board(
    terminal: PseudoTerminal,
    source: EchoSource,
    *,
    rate: float = 50.0,
    count: int | None = None,
    first_sequence: int = 0,
    seed: int = 0,
    faults: FaultPlan | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> int:
    """Send frames while someone reads; returns how many were measured.

    Measuring pauses while nobody has the port open, so that the first frame of a recording is not lost in the void. A
    frame that a leaving reader cut off is gone, and its number with it, as on a real board.

    Args:
        terminal: where to send.
        source: what to send.
        rate: echoes per second.
        count: frames to measure before returning; None goes on until `stopped`.
        first_sequence: number of the first frame.
        seed: of the noise.
        faults: what goes wrong on the way, counted there.
        stopped: asked between frames; True ends it.
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
            terminal.write(DELIMITER, stopped)  # ends what an earlier reader left unread
            heard, due = True, time.monotonic()
        wait = due - time.monotonic()
        if wait > 0.0:
            time.sleep(min(wait, 0.1))
            continue
        due = max(due, time.monotonic() - 1.0) + 1.0 / rate  # at most a second of delay is made up for
        frame = source.frame(first_sequence + sent, time.monotonic_ns() // 1000, random)
        sent += 1
        fault = faults.draw(last=sent == count)
        terminal.write(faults.on_the_line(fault, encode(frame)), stopped)
        faults.interrupt(fault, terminal, stopped)
    if count is not None:
        terminal.drain(stopped)
    return sent
