"""Oscilloscopes on a serial line: each acquisition once, in volts, whatever happens on the way."""

import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.echo_source import EchoSource
from aerokernels.hardware.frames import DamagedPiece
from aerokernels.hardware.port import open_port
from aerokernels.hardware.preamble import ScopeCurve
from aerokernels.hardware.simulator import PseudoTerminal, SimulatedScope, run_scope
from aerokernels.hardware.sources import CurveStream
from aerokernels.hardware.store import EchoStore

from .line import board, integrity, needs_pseudo_terminals, rows

pytestmark = needs_pseudo_terminals


def record_into(path: Path, link: Path) -> tuple:
    return "record", "--port", link, "--protocol", "scpi", "--store", path


def recorded(path: Path) -> list:
    with EchoStore(path, read_only=True) as store:
        return list(store.echoes())


@pytest.mark.parametrize("dialect", ["tektronix", "rigol"])
def test_each_acquisition_once_in_volts(tmp_path: Path, aerokernels, dialect: str):
    """40 curves of an instrument that acquires 20 times a second, slower than it is asked.

    Formula: a Gaussian of 2 V; a curve is off by the noise (20 mV) and half a count of 8 bits (2.12 V / 440 = 5 mV),
    the mean of 40 by 20 mV / sqrt(40) = 3.2 mV rms, of which 6 bound each sample, and at most half a count.
    Expected: no two curves alike, as noise never is; the Tektronix counts, so that its numbers say what was missed.
    """
    link, path = tmp_path / "port", tmp_path / "echoes.sqlite"
    with board(link, "--protocol", "scpi", "--dialect", dialect, "--rate", 20):
        done = aerokernels(*record_into(path, link), "--count", 40, "--label", "mach=0", "--timeout", 1, timeout=60)
        assert done.returncode == 0, done.stderr
    echoes = recorded(path)
    assert len({echo.frame.samples.tobytes() for echo in echoes}) == len(echoes) == 40
    numbers = [echo.frame.sequence for echo in echoes]
    assert numbers == sorted(set(numbers))
    ((missing,),) = rows(path, "SELECT coalesce(sum(missing_count), 0) FROM gaps")
    assert numbers[-1] - numbers[0] == 39 + missing
    frame = echoes[0].frame
    assert (frame.device_time_us, frame.sample_period_ps, frame.first_sample_time) == (None, 250, 0.0)
    source = EchoSource.from_scene()
    np.testing.assert_allclose(frame.time, np.arange(128) * 250e-12, rtol=1e-12)
    half_count = 0.5 * source.full_scale / 220
    mean = np.mean([echo.frame.voltage for echo in echoes], axis=0)
    assert np.abs(mean - source.voltage).max() < 6 * 0.02 / np.sqrt(40) + half_count
    assert abs(frame.scale - 2 * half_count) < 1e-9


def test_faults_on_the_line_are_kept_apart_and_the_rest_is_right(tmp_path: Path, aerokernels):
    """Torn, garbled and doubled answers, silences and two pulled plugs on the way to 60 curves without noise.

    Expected: every stored curve is the board's echo, half a count off at most, and nothing was stored twice. The
    protocol has no check sum: what changes single samples cannot be seen, and is not sent here.
    """
    link, path = tmp_path / "port", tmp_path / "echoes.sqlite"
    faults = [f"--fault={kind}={rate}" for kind, rate in (
        ("torn", 0.04), ("flipped", 0.04), ("glued", 0.04), ("garbage", 0.04), ("gap", 0.1), ("unplug", 0.02),
    )]  # fmt: skip
    with board(
        link, "--protocol", "scpi", "--rate", 200, "--noise", 0, "--pause", 0.2, "--seed", 3, *faults
    ) as process:
        done = aerokernels(*record_into(path, link), "--count", 60, "--timeout", 0.3, timeout=100)
        assert done.returncode == 0, done.stderr
        process.terminate()
        said = process.communicate(timeout=30)[0]
    assert all(f" {kind}" in said for kind in ("torn", "flipped", "glued", "garbage", "gap")), said
    echoes, source = recorded(path), EchoSource.from_scene(noise=0.0)
    numbers = [(echo.session, echo.frame.sequence) for echo in echoes]
    assert len(set(numbers)) == len(numbers) == 60
    for echo in echoes:
        assert np.abs(echo.frame.voltage - source.voltage).max() <= 0.5 * source.full_scale / 220 + 1e-9
    reasons = " ".join(reason for (reason,) in rows(path, "SELECT reason FROM damaged"))
    assert "cut off" in reasons and "before a block" in reasons and "answers to" in reasons
    assert integrity(path) == "ok"


def test_a_scale_that_is_changed_while_a_curve_is_read_is_not_believed(tmp_path: Path):
    """Set-up: at every third curve the operator turns the knob: between the preamble and the curve, the scale doubles.

    Expected: volts of every stored curve are the echo's; before, those of every third were half of it. The trigger's
    jitter, by which the first sample's time changes each time, is no change.
    """
    source = EchoSource.gaussian(noise=0.0)

    class Turned(SimulatedScope):
        def answer(self, command: str) -> bytes:
            if command.startswith("CURVE") and self.curve_count % 3 == 2:
                self._step *= 2.0 if self._step < 0.02 else 0.5
            found = super().answer(command)
            jitter = f"XZERO {1e-11 * np.random.default_rng(self.acquisition).random():.3E}".encode()
            return found.replace(b"XZERO 0.0E0", jitter)

    ended = threading.Event()
    with PseudoTerminal(tmp_path / "port") as terminal:
        scope = Turned(source, rate=500.0)
        thread = threading.Thread(target=run_scope, args=(terminal, scope), kwargs={"stopped": ended.is_set})
        thread.start()
        stream = CurveStream(open_port(str(tmp_path / "port")), dialect="tektronix", timeout=2.0)
        try:
            found = []
            while len(found) < 9:
                found += [piece for piece, _ in stream.poll()]
        finally:
            stream.close()
            ended.set()
            thread.join(10)
    reasons = [piece.reason for piece in found if isinstance(piece, DamagedPiece)]
    curves = [piece for piece in found if isinstance(piece, ScopeCurve)]
    assert len(curves) >= 5 and len({curve.first_sample_time for curve in curves}) > 1
    assert reasons and set(reasons) == {"preamble: the scale changed while the curve was read"}
    for curve in curves:
        np.testing.assert_allclose(curve.voltage, source.voltage, atol=0.03)


@contextmanager
def plain_instrument(link: Path, answers: dict[bytes, bytes]):
    """An instrument that knows a few questions and is silent at everything else."""
    ended = threading.Event()

    def run(terminal: PseudoTerminal) -> None:
        pending = b""
        while not ended.is_set():
            *questions, pending = (pending + terminal.read(0.05)).split(b"\n")
            for question in questions:
                terminal.write(answers.get(question, b""), ended.is_set)

    with PseudoTerminal(link) as terminal:
        thread = threading.Thread(target=run, args=(terminal,))
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join(30)


def test_an_instrument_that_knows_two_questions(tmp_path: Path, aerokernels):
    """No count of acquisitions, no terminator after the block, line feeds and # in the data, the fewest fields.

    Expected: one echo an answer, numbered here, and on from there when recorded again; volts by the formula.
    """
    counts = np.array([10, 35, 10, 13, -128, 127, 0, 35, 49, 53], np.int8)  # "\n#\n\r", then "#15"
    answers = {
        b"WFMOUTPRE?": b"YMULT 0.01;YOFF 10;YZERO 1.5;XINCR 4.0E-10;XZERO -2.0E-9\n",
        b"CURVE?": b"#210" + counts.tobytes(),
        b"ACQUIRE:NUMACQ?": b"ERROR: unknown\n",
    }
    link, path = tmp_path / "port", tmp_path / "echoes.sqlite"
    with plain_instrument(link, answers):
        for _ in range(2):
            done = aerokernels(
                "record", "--port", link, "--protocol", "scpi", "--store", path, "--count", 3, timeout=60
            )
            assert done.returncode == 0, done.stderr
    echoes = recorded(path)
    assert [echo.frame.sequence for echo in echoes] == [0, 1, 2, 3, 4, 5]
    for echo in echoes:
        np.testing.assert_allclose(echo.frame.voltage, 1.5 + 0.01 * (counts - 10.0), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(echo.frame.time, -2e-9 + 4e-10 * np.arange(10), rtol=1e-12, atol=1e-21)
        assert echo.frame.raw == answers[b"CURVE?"]
    assert rows(path, "SELECT count(*) FROM damaged") == [(0,)]


# By Keysight's rule, (y - yreference) yincrement + yorigin, 1.584 V; by Rigol's 0.294 V.
TEN_NUMBERS = {b":WAVEFORM:PREAMBLE?": b"+0,+0,+4,+1,1E-9,-2E-7,+0,0.0157,1.27,+128\n",
               b":WAVEFORM:DATA?": b"#14" + bytes([47, 47, 148, 47])}  # fmt: skip


def test_a_dialect_that_is_given_counts_where_the_maker_is_not_told(tmp_path: Path, aerokernels):
    """Expected: Rigol's rule, (y - yorigin - yreference) yincrement; another maker's name is refused even then."""
    link, path = tmp_path / "port", tmp_path / "echoes.sqlite"
    command = (*record_into(path, link), "--dialect", "rigol", "--count", 1, "--timeout", 0.3)
    with plain_instrument(link, TEN_NUMBERS):
        done = aerokernels(*command, timeout=60)
    assert done.returncode == 0, done.stderr
    ((echo,),) = (recorded(path),)
    np.testing.assert_allclose(echo.frame.voltage, 0.0157 * (np.array([47, 47, 148, 47]) - 1.27 - 128.0), rtol=1e-12)
    with plain_instrument(link, {b"*IDN?": b"KEYSIGHT TECHNOLOGIES,DSO-X 3024T,MY0,07.20\n", **TEN_NUMBERS}):
        done = aerokernels(*command, timeout=60)
    assert done.returncode == 2 and "maker whose scale of volts is not known" in done.stderr


@pytest.mark.parametrize(
    ("answers", "match"),
    [
        ({}, "no answer"),
        ({b"WFMOUTPRE?": b"YMULT 1;XINCR 1E-9;ENCDG ASCII\n"}, "DATA:ENCDG RIBINARY"),
        ({b"WFMOUTPRE?": b"\xff\xfe\n"}, "damaged answer"),
        ({b"*IDN?": b"KEYSIGHT TECHNOLOGIES,DSO-X 3024T,MY0,07.20\n", **TEN_NUMBERS}, "'KEYSIGHT TECHNOLOGIES,DSO-X"),
        (
            {b"*IDN?": b"AGILENT TECHNOLOGIES,DSO1012A,CN0,1\n", **TEN_NUMBERS},
            "maker whose scale of volts is not known",
        ),
        (TEN_NUMBERS, "and dialect as it has"),
    ],
)
def test_what_is_no_oscilloscope_is_said(tmp_path: Path, aerokernels, answers: dict, match: str):
    link = tmp_path / "port"
    with plain_instrument(link, answers):
        done = aerokernels(*record_into(tmp_path / "s.sqlite", link), "--timeout", 0.3, timeout=60)
    assert done.returncode == 2 and match in done.stderr and len(done.stderr.splitlines()) == 1, done
    assert not (tmp_path / "s.sqlite").exists()
