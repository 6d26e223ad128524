"""Faults on demand: what the simulated board did to the line is what the recording says."""

import re
import signal
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.frames import EchoFrame, FrameDecoder, encode
from aerokernels.hardware.simulator import FaultPlan

from .line import board, integrity, needs_pseudo_terminals, rows, started


def test_twenty_thousand_frames_with_five_per_cent_of_damage():
    """Torn, flipped, glued and garbage pieces, 1.25 % each: counts exact, no damaged piece taken as good.

    Expected, from what was done to each frame: all others come out in order, none of these do; one damaged piece for
    each fault (a glued pair is one piece), and the byte sums agree.
    """
    plan = FaultPlan(dict.fromkeys(("torn", "flipped", "glued", "garbage"), 0.0125), seed=5)
    random = np.random.default_rng(6)
    samples = random.integers(-32768, 32768, (64, 24)).astype(np.int16)
    decoder, expected, found, damaged = FrameDecoder(), [], [], 0
    glued = False
    for k in range(20_000):
        fault = plan.draw(last=k == 19_999)
        wire = plan.on_the_line(fault, encode(EchoFrame(k, k, 1000, 1.0, 0.0, samples[k % 64])))
        if fault in (None, "garbage") and not glued:
            expected.append(k)
        glued = fault == "glued"
        for one in decoder.feed(wire):
            if isinstance(one, EchoFrame):
                assert one.samples.tobytes() == samples[one.sequence % 64].tobytes()
                found.append(one.sequence)
            else:
                damaged += 1
    assert decoder.pending_length == 0
    assert found == expected
    assert damaged == plan.counts.total() and 900 < damaged < 1100


@needs_pseudo_terminals
def test_board_and_recording_agree_on_every_fault(tmp_path: Path):
    """1500 frames with every fault that leaves the port alone; what `board` says it did is what `record` counted.

    Expected: n - torn - flipped - 2 glued - gap echoes, one damaged piece for each torn, flipped, glued or garbage.
    """
    link, path, count = tmp_path / "port", tmp_path / "s.sqlite", 1500
    options = [f"--fault={kind}=0.03" for kind in ("torn", "flipped", "glued", "garbage", "gap", "repeat")]
    with (
        board(link, "--rate", 3000, "--count", count, "--seed", 1, *options) as process,
        started("record", "--port", link, "--store", path) as recorder,
    ):
        report = process.communicate(timeout=60)[0]
        recorder.send_signal(signal.SIGINT)
        said = recorder.communicate(timeout=30)[0]
        assert recorder.returncode == 0, said
    did = {kind: int(number) for number, kind in re.findall(r"(\d+) (\w+)", report.partition("faults:")[2])}
    assert len(did) == 6 and min(did.values()) > 20
    good = count - did["torn"] - did["flipped"] - 2 * did["glued"] - did["gap"]
    pieces = did["torn"] + did["flipped"] + did["glued"] + did["garbage"]
    assert f"done: stored {good}, " in said and f"damaged {pieces}, " in said and f"sent twice {did['repeat']}" in said
    numbers = [number for (number,) in rows(path, "SELECT sequence FROM echoes ORDER BY id")]
    assert numbers == sorted(set(numbers)) and len(numbers) == good
    assert rows(path, "SELECT count(*) FROM damaged") == [(pieces,)]
    assert rows(path, "SELECT sum(duplicate_count) FROM recordings") == [(did["repeat"],)]
    assert rows(path, "SELECT sum(missing_count) FROM gaps") == [(numbers[-1] - numbers[0] + 1 - good,)]
    assert integrity(path) == "ok"


@pytest.mark.parametrize(
    ("pairs", "match"),
    [
        (["torn"], "KIND=PROBABILITY"),
        (["torn=x"], "KIND=PROBABILITY"),
        (["torn=0.1", "torn=0.2"], "twice"),
        (["lost=0.1"], "give one of torn"),
        (["torn=1.5"], "0 to 1"),
        (["torn=0.7", "gap=0.7"], "1 at most"),
    ],
)
def test_bad_faults_are_refused(pairs: list[str], match: str):
    with pytest.raises(ValueError, match=match):
        FaultPlan.parse(pairs)
