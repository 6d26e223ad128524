"""Oscilloscopes on a serial line: each acquisition once, in volts, whatever happens on the way."""

import threading
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware.frames import DamagedPiece
from aerokernels.hardware.port import PortError, open_port
from aerokernels.hardware.preamble import ScopeCurve
from aerokernels.hardware.simulator import EchoSource, PseudoTerminal, SimulatedScope, run_scope
from aerokernels.hardware.sources import CurveStream
from aerokernels.hardware.store import EchoStore

from .line import needs_pseudo_terminals, rows

pytestmark = needs_pseudo_terminals


def record_into(path: Path, link: Path) -> tuple:
    return "record", "--port", link, "--protocol", "scpi", "--store", path


def recorded(path: Path) -> list:
    with EchoStore(path, read_only=True) as store:
        return list(store.echoes())


SOURCE = EchoSource(2.0 * np.exp(-(((np.arange(128) * 0.25 - 10.0) / 6.0) ** 2)), 250, noise=0.0)


def pieces_of(folder: Path, scope: SimulatedScope, curve_count: int) -> tuple[list[ScopeCurve], list[str]]:
    """Read that many curves of a simulated oscilloscope; also return the reasons of damaged pieces on the way."""
    ended = threading.Event()
    with PseudoTerminal(folder / "port") as terminal:
        thread = threading.Thread(target=run_scope, args=(terminal, scope), kwargs={"stopped": ended.is_set})
        thread.start()
        stream = CurveStream(open_port(str(folder / "port")), timeout=0.3)
        curves, reasons = [], []
        try:
            while len(curves) < curve_count:
                for piece, _ in stream.poll():
                    curves += [piece] if isinstance(piece, ScopeCurve) else []
                    reasons += [piece.reason] if isinstance(piece, DamagedPiece) else []
        finally:
            stream.close()
            ended.set()
            thread.join(10)
    return curves, reasons


@pytest.mark.parametrize("dialect", ["tektronix", "rigol"])
def test_each_acquisition_once_in_volts(tmp_path: Path, dialect: str):
    """40 curves of an instrument that acquires 100 times a second, slower than it is asked.

    Formula: a Gaussian of 2 V; a curve is off by the noise (20 mV) and half a count of 8 bits (2.12 V / 440 = 5 mV),
    the mean of 40 by 20 mV / sqrt(40) = 3.2 mV rms, of which 6 bound each sample, and at most half a count.
    Expected: no two curves alike, as noise never is; the Tektronix counts.
    """
    source = EchoSource(SOURCE.voltage, 250, noise=0.02)
    curves, reasons = pieces_of(tmp_path, SimulatedScope(source, dialect=dialect, rate=100.0), 40)
    assert not reasons and len({curve.samples.tobytes() for curve in curves}) == 40
    numbers = [curve.sequence for curve in curves]
    assert numbers == ([None] * 40 if dialect == "rigol" else sorted(set(numbers)))
    assert (curves[0].device_time_us, curves[0].sample_period_ps, curves[0].first_sample_time) == (None, 250, 0.0)
    np.testing.assert_allclose(curves[0].time, np.arange(128) * 250e-12, rtol=1e-12)
    half_count = 0.5 * source.full_scale / 220
    mean = np.mean([curve.voltage for curve in curves], axis=0)
    assert np.abs(mean - source.voltage).max() < 6 * 0.02 / np.sqrt(40) + half_count
    assert abs(curves[0].scale - 2 * half_count) < 1e-9


def test_faults_on_the_line_are_kept_apart_and_the_rest_is_right(tmp_path: Path):
    """Every second curve is torn, has a damaged length, comes twice or behind garbage.

    Expected: every curve that is taken is the board's echo, half a count off at most, and none is taken twice. The
    protocol has no check sum: what changes single samples cannot be seen, and is not sent here.
    """

    class Spoilt(SimulatedScope):
        def answer(self, command: str) -> bytes:
            answer, k = super().answer(command), self.curve_count
            if not command.startswith("CURVE") or k % 2:
                return answer
            cut_length = answer.replace(b"#3128", b"#3028")
            return (answer[:60], cut_length, answer + answer, b"\x80\x81\n" + answer)[k // 2 % 4]

    curves, reasons = pieces_of(tmp_path, Spoilt(SOURCE, rate=500.0), 8)
    numbers = [curve.sequence for curve in curves]
    assert numbers == sorted(set(numbers))
    for curve in curves:
        assert np.abs(curve.voltage - SOURCE.voltage).max() <= 0.5 * SOURCE.full_scale / 220 + 1e-9
    assert all(any(word in reason for reason in reasons) for word in ("cut off", "answers to", "no ASCII"))


def test_a_scale_that_is_changed_while_a_curve_is_read_is_not_believed(tmp_path: Path):
    """Set-up: at every third curve the operator turns the knob: between the preamble and the curve, the scale doubles.

    Expected: volts of every stored curve are the echo's; before, those of every third were half of it. The trigger's
    jitter, by which the first sample's time changes each time, is no change.
    """

    class Turned(SimulatedScope):
        def answer(self, command: str) -> bytes:
            if command.startswith("CURVE") and self.curve_count % 3 == 2:
                self._step *= 2.0 if self._step < 0.02 else 0.5
            answer = super().answer(command)
            jitter = f"XZERO {1e-11 * np.random.default_rng(self.acquisition).random():.3E}".encode()
            return answer.replace(b"XZERO 0.0E0", jitter)

    curves, reasons = pieces_of(tmp_path, Turned(SOURCE, rate=500.0), 5)
    assert len({curve.first_sample_time for curve in curves}) > 1
    assert reasons and set(reasons) == {"preamble: the scale changed while the curve was read"}
    for curve in curves:
        np.testing.assert_allclose(curve.voltage, SOURCE.voltage, atol=0.03)


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


def test_an_instrument_that_knows_two_questions(tmp_path: Path, command_line):
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
            done = command_line(*record_into(path, link), "--count", 3)
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


def test_a_dialect_that_is_given_counts_where_the_maker_is_not_told(tmp_path: Path, command_line):
    """Expected: Rigol's rule, (y - yorigin - yreference) yincrement; another maker's name is refused even then."""
    link, path = tmp_path / "port", tmp_path / "echoes.sqlite"
    command = (*record_into(path, link), "--dialect", "rigol", "--count", 1, "--timeout", 0.3)
    with plain_instrument(link, TEN_NUMBERS):
        done = command_line(*command)
    assert done.returncode == 0, done.stderr
    ((echo,),) = (recorded(path),)
    np.testing.assert_allclose(echo.frame.voltage, 0.0157 * (np.array([47, 47, 148, 47]) - 1.27 - 128.0), rtol=1e-12)
    with plain_instrument(link, {b"*IDN?": b"KEYSIGHT TECHNOLOGIES,DSO-X 3024T,MY0,07.20\n", **TEN_NUMBERS}):
        done = command_line(*command)
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
def test_what_is_no_oscilloscope_is_said(tmp_path: Path, answers: dict, match: str):
    with plain_instrument(tmp_path / "port", answers), pytest.raises(PortError, match=match):
        CurveStream(open_port(str(tmp_path / "port")), timeout=0.3)
