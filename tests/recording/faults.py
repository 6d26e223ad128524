"""Parts of the soak test with faults: on the line, of the recorder, of the port."""

import signal
import time
from pathlib import Path
from random import Random

import numpy as np

from aerokernels.hardware.frames import encode
from aerokernels.hardware.simulator import PseudoTerminal
from tests.draws import input_draws

from .line import Outcome, RecorderProcess, counts, damaged_line, is_whole, made_frames, stored, wait_for_reader


def damage(folder: Path, size: float) -> Outcome:
    """Send `size` frames, 5 % of them torn, flipped, glued or behind garbage; the whole ones must be stored."""
    link, path, frames = folder / "port", folder / "echoes.sqlite", made_frames(int(size))
    wire, whole, pieces = damaged_line(frames, 0.0125, seed=1)
    good = {number: frames[number].samples.tobytes() for number in whole}
    with PseudoTerminal(link) as terminal:
        recorder = RecorderProcess(link, path, "--count", len(good))
        wait_for_reader(recorder)
        terminal.write(wire)
        said = recorder.wait(120.0)
    found, (rows, damaged, missing) = stored(path), counts(path)
    expected_missing = len(frames) - len(good) - min(good)
    fine = found == good and (rows, damaged, missing) == (len(good), pieces, expected_missing) and is_whole(path)
    return Outcome(
        fine,
        f"{len(frames)} frames sent, {len(good)} of them whole; {rows} stored, {damaged} damaged pieces "
        f"(expected {pieces}), {missing} missing (expected {expected_missing})" + ("" if fine else f"; {said}"),
    )


def fuzz(folder: Path, size: float) -> Outcome:
    """Feed `size` damaged streams to each decoder, whole and in chunks, as `frame` and `block` of input_draws.py."""
    start, taken = time.perf_counter(), 0
    for seed in range(int(size)):
        for name in ("frame", "block"):
            try:
                taken += input_draws.DRAWS[name](Random(seed), folder)
            except AssertionError as fault:
                return Outcome(False, f"{name}, seed {seed}: {fault}")
    rate = 2.0 * size / (time.perf_counter() - start)
    return Outcome(True, f"2 x {int(size)} streams at {rate:.0f} a second, something whole in {taken} of them")


def kills(folder: Path, size: float) -> Outcome:
    """Send SIGKILL `size` times while frames stream in; all acknowledged frames must be stored; a restart continues."""
    link, path, random = folder / "port", folder / "echoes.sqlite", np.random.default_rng(3)
    acknowledged: set[int] = set()
    before: dict[int, bytes] = {}
    problems = []
    with PseudoTerminal(link) as terminal:
        number = 0
        for kill in range(int(size) + 1):
            last_one = kill == int(size)
            recorder = RecorderProcess(
                link, path, "--commit-interval", 0.02, *(("--count", 500) if last_one else ("--stall", 0))
            )
            wait_for_reader(recorder)
            until = time.monotonic() + 1.2 + random.random()
            while recorder.process.poll() is None:
                if not last_one and time.monotonic() > until and recorder.acknowledged():
                    break
                frames = made_frames(50, first=number)
                number += 50
                terminal.write(b"".join(map(encode, frames)))
                time.sleep(0.01)
            if not last_one:
                recorder.process.send_signal(signal.SIGKILL)
            said = recorder.wait(30.0)
            for count, last in recorder.acknowledged()[-1:]:
                acknowledged |= set(range(last - count + 1, last + 1))
            found = stored(path)
            if not is_whole(path):
                problems.append(f"the file is broken after kill {kill}")
            if not acknowledged <= found.keys() or not before.items() <= found.items():
                problems.append(f"lost after kill {kill}: {sorted(acknowledged - found.keys())[:5]}")
            before = found
    rows = counts(path)[0]
    if rows != len(before) or "done" not in said:
        problems.append(f"{rows} rows for {len(before)} numbers; {said}")
    wrong = [k for k, samples in before.items() if made_frames(1, first=k)[0].samples.tobytes() != samples]
    fine = not problems and not wrong
    text = (
        f"{int(size)} kills, {len(acknowledged)} frames acknowledged, all there; {rows} stored, none twice, file whole"
    )
    return Outcome(fine, text if fine else f"{problems} {wrong[:5]}")


def unplugs(folder: Path, size: float) -> Outcome:
    """Remove the port `size` times in mid-frame and return it with garbage; each whole frame must be stored once."""
    link, path, random = folder / "port", folder / "echoes.sqlite", np.random.default_rng(4)
    pulls, batch = int(size), 200
    frames = made_frames(batch * (pulls + 1))
    with PseudoTerminal(link) as terminal:
        recorder = RecorderProcess(link, path, "--count", len(frames))
        for pull in range(pulls + 1):
            wait_for_reader(recorder, pull + 1)
            if pull:
                terminal.write(b"\x07garbage after the plug went in\x00")
            wire = [encode(frame) for frame in frames[batch * pull : batch * (pull + 1)]]
            terminal.write(b"".join(wire))
            if pull < pulls:
                terminal.write(wire[-1][:30])  # a frame that is never completed
                terminal.drain()
                terminal.close()
                time.sleep(random.random())
                terminal.open()
        said = recorder.wait(60.0)
    found, (rows, damaged, missing) = stored(path), counts(path)
    good = found == {frame.sequence: frame.samples.tobytes() for frame in frames}
    fine = good and rows == len(frames) and damaged == 2 * pulls and missing == 0 and is_whole(path)
    fine &= f"reconnected {pulls}" in said
    return Outcome(
        fine,
        f"{pulls} times unplugged; {rows} of {len(frames)} frames stored, {missing} missing, {damaged} damaged pieces "
        f"(expected {2 * pulls})" + ("" if fine else f"; {said}"),
    )
