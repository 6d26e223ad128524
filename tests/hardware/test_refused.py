"""What recorders, simulated instruments and stores refuse, and faults that interrupt a line."""

import errno
import math
import sqlite3

import numpy as np
import pytest

from aerokernels.hardware.board import run_board
from aerokernels.hardware.echo_source import EchoSource
from aerokernels.hardware.faults import FaultPlan
from aerokernels.hardware.port import _remedy
from aerokernels.hardware.preamble import Preamble, PreambleError
from aerokernels.hardware.pseudo_terminal import PseudoTerminal
from aerokernels.hardware.recorder import Recorder
from aerokernels.hardware.scope_board import SimulatedScope
from aerokernels.hardware.store import EchoStore
from aerokernels.hardware.transaction import transaction

from .line import needs_pseudo_terminals

SOURCE = EchoSource.gaussian(noise=0.0)


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: SimulatedScope(SOURCE, rate=0.0), "acquisitions per second: give a positive one"),
        (lambda: run_board(None, SOURCE, rate=-1.0), "echoes per second: give a positive one"),
        (lambda: FaultPlan({}, pause=-1.0), r"pause = -1\.0 s: give 0 or more"),
        (lambda: EchoSource(np.ones((2, 2))), r"an echo of shape \(2, 2\): give one row"),
        (lambda: EchoSource(np.array([1.0, math.nan])), "the echo: 1 of 2 values are not finite"),
        (lambda: EchoSource(np.ones(3), noise=-1.0), r"noise = -1\.0 V: give 0 or more"),
        (lambda: Recorder(None, None, None, count=0), "count = 0: give 1 or more"),
        (lambda: Recorder(None, None, None, commit_interval=float("nan")), r"commit interval = nan s: give 0 or more"),
        (lambda: Recorder(None, None, None, stall_time=-1.0), r"stall time = -1\.0 s: give 0 or more"),
    ],
)
def test_numbers_that_no_instrument_has(made, told):
    with pytest.raises(ValueError, match=told):
        made()


@pytest.mark.parametrize(
    ("name", "value"),
    [("offset", math.nan), ("scale", 1e305), ("sample_period", 1e300), ("first_sample_time", math.inf)],
)
def test_preambles_out_of_range(name, value):
    sound = {"sample_count": 3, "sample_period": 1e-9, "first_sample_time": 0.0, "scale": 0.01, "offset": 0.0}
    kinds = {field: sound.get(field) for field in Preamble.__dataclass_fields__}
    with pytest.raises(PreambleError, match=r"preamble: (offset|first_sample_time) = |is out of range"):
        Preamble(**{**kinds, name: value})


def test_a_result_without_an_echo_is_no_source(tmp_path):
    import xarray

    xarray.Dataset({"time": ("time", [0.0, 1.0])}).to_netcdf(tmp_path / "result.nc")
    for path in (tmp_path, tmp_path / "result.nc"):
        with pytest.raises(ValueError, match="holds no 'echo_voltage' over 'time'"):
            EchoSource.from_result(path)


def test_a_rigol_waits_for_the_next_acquisition():
    """SINGLE: it stops at the next one and shows it as long as it is not set to run; a curve has 8 bits."""
    scope = SimulatedScope(SOURCE, dialect="rigol", rate=1e-3)
    assert scope.answer(":TRIG:STAT?") == b"TD\n"
    assert scope.answer(":SINGLE") == b"" and scope.answer(":TRIG:STAT?") == b"WAIT\n"
    scope.skip()
    assert scope.answer(":TRIG:STAT?") == b"STOP\n"
    fields = scope.answer(":WAV:PRE?").decode().split(",")
    assert int(fields[2]) == SOURCE.voltage.size and float(fields[4]) == pytest.approx(250e-12, rel=1e-9)
    block = scope.answer(":WAVEFORM:DATA?")
    assert block[:11] == f"#9{SOURCE.voltage.size:09d}".encode() and block[-1:] == b"\n"
    step, zero, reference = float(fields[7]), float(fields[8]), float(fields[9])
    volts = (np.frombuffer(block[11:-1], np.uint8) - zero - reference) * step
    assert volts == pytest.approx(SOURCE.voltage, abs=0.5 * step * 1.001)
    scope.skip()
    assert scope.answer(":WAV:DATA?") == block and scope.curve_count == 2  # what it holds
    assert scope.answer(":RUN") == b"" and scope.answer(":TRIG:STAT?") == b"TD\n"
    assert scope.answer("") == scope.answer(":UNKNOWN") == b""


@needs_pseudo_terminals
def test_a_plug_that_is_pulled_and_put_back(tmp_path):
    """Expected: the link is gone while the plug is out, and leads to a terminal again when it is in."""
    link = tmp_path / "port"
    plan, seen = FaultPlan({}, pause=0.02), []
    with PseudoTerminal(link) as terminal:
        plan.interrupt("gap", terminal, lambda: pytest.fail("a gap does not wait"))
        plan.interrupt("stall", terminal, lambda: seen.append(link.exists()))
        plan.interrupt("unplug", terminal, lambda: seen.append(link.exists()))
        assert link.exists() and True in seen and False in seen
    with pytest.raises(ValueError, match=r"folder .* does not exist"):
        PseudoTerminal(tmp_path / "none" / "port")


@pytest.mark.parametrize(
    ("port", "error", "told"),
    [
        ("/dev/ttyS0", OSError(errno.EACCES, "no"), "permission denied: add your user to the group"),
        ("/dev/ttyS0", OSError(errno.EBUSY, "busy"), "in use by another process"),
        ("/dev/null", OSError(errno.ENOTTY, "no"), "not a serial port"),
        ("socket://x", OSError(0, "bad"), "check the pyserial URL"),
        ("/dev/x", OSError(0, "strange"), "strange"),
        ("/dev/x", OSError(errno.ENOENT, "none"), "no such port: plug the board in"),
    ],
)
def test_why_a_port_does_not_open(port, error, told):
    assert told in _remedy(port, error)


def test_a_fault_of_the_program_is_not_told_as_one_of_the_file(tmp_path):
    """A constraint that is broken inside a transaction: the error is SQLite's own, and nothing is kept."""
    with sqlite3.connect(tmp_path / "a", isolation_level=None) as connection:
        connection.execute("CREATE TABLE t (x UNIQUE)")
        with pytest.raises(sqlite3.IntegrityError), transaction(connection, "BEGIN IMMEDIATE", tmp_path / "a"):
            connection.execute("INSERT INTO t VALUES (1), (2)")
            connection.execute("INSERT INTO t VALUES (1)")
        assert connection.execute("SELECT count(*) FROM t").fetchone() == (0,)


def test_a_store_is_no_folder(tmp_path):
    with pytest.raises(ValueError, match="a folder or a device, not a file; give the file that `record` wrote"):
        EchoStore(tmp_path, read_only=True)
