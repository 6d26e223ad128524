"""Board to store through a real pseudo-terminal, in processes of their own: nothing is lost that was acknowledged."""

import json
import os
import re
import signal
import sqlite3
import subprocess
import sys
import threading
from contextlib import closing
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from aerokernels import Scene, compare_waveforms, estimate_range
from aerokernels.hardware.frames import EchoFrame, encode
from aerokernels.hardware.port import PortError, open_port
from aerokernels.hardware.recorder import Recorder, RecordingStatus
from aerokernels.hardware.simulator import EchoSource, PseudoTerminal
from aerokernels.hardware.store import EchoStore
from aerokernels.lidar import fwhm_from_pulse_tau
from aerokernels.lidar.parts import Setup

from .line import board, board_here, frames_from, integrity, needs_pseudo_terminals, sequences, started

pytestmark = needs_pseudo_terminals


def test_board_to_store(tmp_path: Path, command_line):
    """`record --count 60` ends by itself with exactly 60 rows, numbered without a gap, that show the board's echo.

    Formula: that of the static scene in vacuum, 1.994 V exp(-(t - t0)^2 / tau^2) with tau = 6 ns (10 ns wide at half
    height) and t0 = 2 x 1.5 m / c = 10.007 ns, and 1 ps more for the spot's outer parts (below 1 mV on the edges, as is
    the peak's rounding). The mean of 60 frames with 20 mV of noise is off by 20 mV / sqrt(60) = 2.6 mV rms; 6 of those,
    those 2 mV, and half a count of quantisation (33 uV) bound each of the 128 samples.
    """
    link, path = tmp_path / "port", tmp_path / "echoes.sqlite"
    with board(link, "--rate", 500) as process:
        done = command_line("record", "--port", link, "--store", path, "--count", 60, "--label", "mach=3", "--json")
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["stored_count"] == 60  # one object, and no lines of progress about it
        process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0
    assert not link.is_symlink()
    with EchoStore(path, read_only=True) as store:
        echoes = list(store.echoes({"mach": "3"}))
        assert (len(echoes), store.echo_count, store.damaged_count) == (60, 60, 0)
    first = echoes[0].frame.sequence
    assert [echo.frame.sequence for echo in echoes] == list(range(first, first + 60))
    assert all(encode(echo.frame) == echo.frame.raw + b"\x00" for echo in echoes)
    times = [echo.frame.device_time_us for echo in echoes]
    assert times == sorted(times)
    time = echoes[0].frame.time
    expected = 1.994 * np.exp(-(((time - 3.0 / 299_792_458.0) / 6e-9) ** 2))
    mean = np.mean([echo.frame.voltage for echo in echoes], axis=0)
    assert np.abs(mean - expected).max() < 6 * 0.02 / np.sqrt(60) + 2e-3 + 4e-5


def test_an_interrupt_ends_a_recording_cleanly(tmp_path: Path):
    link, path = tmp_path / "port", tmp_path / "echoes.sqlite"
    with board_here(link), started("record", "--port", link, "--store", path) as recorder:
        assert recorder.stdout is not None
        while "stored" not in recorder.stdout.readline():
            assert recorder.poll() is None
        recorder.send_signal(signal.SIGTERM)
        output = recorder.communicate(timeout=30)[0]
        assert recorder.returncode == 0
    (count,) = map(int, re.findall(r"done: stored (\d+)", output))
    found = sequences(path)
    assert len(found) == count > 0
    assert found == list(range(found[0], found[0] + count))
    assert integrity(path) == "ok"


@pytest.mark.slow
def test_a_terminal_sees_how_it_goes(tmp_path: Path):
    """On a terminal: what is stored, the rate, the last peak, what was lost, and the state of the port."""
    link, ours, theirs = tmp_path / "port", *os.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "160"}
    with board(link, "--rate", 40):
        command = [sys.executable, "-m", "aerokernels", "record", "--port", link, "--store", tmp_path / "s.sqlite"]
        process = subprocess.Popen(
            [*map(str, command), "--count", "80"], stdout=theirs, stderr=theirs, stdin=theirs, env=environment
        )
        os.close(theirs)
        shown = b""
        try:
            while chunk := os.read(ours, 4096):
                shown += chunk
        except OSError:  # Linux says so when the last writer has left
            pass
        os.close(ours)
        assert process.wait(30) == 0, shown
    text = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown.decode())
    line = r"stored (\d+), last sequence \d+, [\d.]+/s, last peak [\d.]+ V, damaged \d+, missing \d+, port open"
    counts = [int(count) for count in re.findall(line, text)]
    assert len(set(counts)) > 1 and counts == sorted(counts) and counts[-1] == 80
    assert "done: stored 80" in text


@pytest.mark.slow
def test_a_killed_recorder_keeps_what_it_acknowledged_and_goes_on(tmp_path: Path):
    """SIGKILL while frames come in: what the recorder said it stored is there, the file whole, a restart goes on."""
    link, path = tmp_path / "port", tmp_path / "echoes.sqlite"
    record = ("record", "--port", link, "--store", path, "--commit-interval", 0.05)
    with board(link, "--rate", 500):
        with started(*record) as recorder:
            assert recorder.stdout is not None
            said: list[tuple[int, int]] = []
            while len(said) < 2:
                line = recorder.stdout.readline()
                assert line, "the recorder ended by itself"
                said += [
                    (int(count), int(last))
                    for count, last in re.findall(r"stored (\d+), last sequence (\d+)", line)
                ]  # fmt: skip
            recorder.kill()
            recorder.wait(30)
        assert integrity(path) == "ok"
        acknowledged, last = said[-1]
        found = sequences(path)
        assert len(found) >= acknowledged
        assert set(range(last - acknowledged + 1, last + 1)) <= set(found)
        with started(*record, "--count", 20) as recorder:
            output = recorder.communicate(timeout=60)[0]
            assert recorder.returncode == 0, output
    after = sequences(path)
    assert after[: len(found)] == found
    assert len(after) == len(set(after)) == len(found) + 20
    assert integrity(path) == "ok"


def test_a_port_unplugged_and_back(tmp_path: Path):
    """Frames 0-29 and half of frame 30, unplug; a new terminal at the same link sends 28-59: each good one once."""
    link, path = tmp_path / "port", tmp_path / "echoes.sqlite"
    frames = [EchoFrame(k, 1000 * k, 1000, 0.001, 0.0, np.full(50, k)) for k in range(60)]
    away, seen = threading.Event(), []

    def report(status: RecordingStatus) -> None:
        seen.append(status)
        if not status.port_open:
            away.set()

    results: list[RecordingStatus] = []
    first = PseudoTerminal(link)
    connect = partial(frames_from, link)
    stream = connect()

    def record() -> None:
        with EchoStore(path) as store:
            store.begin_recording(str(link), "frames", {})
            results.append(Recorder(stream, store, connect, count=60, report=report).run())

    thread = threading.Thread(target=record, daemon=True)
    thread.start()
    assert first.write(b"".join(map(encode, frames[:30])) + encode(frames[30])[:40])
    first.drain()
    first.close()
    assert away.wait(30)
    with PseudoTerminal(link) as second:
        while not second.has_reader():
            assert thread.is_alive()
        # Opening a port throws away what was sent before: keep sending until the recorder has all it asked for.
        while thread.is_alive():
            second.write(b"\x00" + b"".join(map(encode, frames[28:])))
            thread.join(0.2)
    (status,) = results
    assert (status.stored_count, status.reconnect_count, status.missing_count) == (60, 1, 0)
    assert [one.port_open for one in seen].count(False) == 1
    assert sequences(path) == list(range(60))
    with closing(sqlite3.connect(path)) as connection:
        ((reason, raw),) = connection.execute("SELECT reason, raw FROM damaged ORDER BY id LIMIT 1").fetchall()
    assert "port was lost" in reason and raw == encode(frames[30])[:40]
    assert integrity(path) == "ok"


def test_a_port_in_use_is_refused(tmp_path: Path, command_line):
    link = tmp_path / "port"
    with PseudoTerminal(link), closing(open_port(str(link))):
        with pytest.raises(PortError, match="in use by another process"):
            open_port(str(link))
        done = command_line("record", "--port", link, "--store", tmp_path / "echoes.sqlite", "--count", 1)
    assert done.returncode == 2
    assert "in use" in done.stderr and len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "echoes.sqlite").exists()


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (("record", "--port", "absent", "--store", "s.sqlite"), "no such port"),
        (("record", "--port", "nonsense://x", "--store", "s.sqlite"), "nonsense"),
        (("record", "--port", "loop://", "--store", "no/s.sqlite"), "does not exist"),
        (("record", "--port", "loop://", "--store", "s.sqlite", "--protocol", "x"), "frames, scpi"),
        (("record", "--port", "loop://", "--store", "s.sqlite", "--label", "mach"), "key=value"),
        (("record", "--port", "loop://", "--store", "s.sqlite", "--label", "mach=\udcfe"), "bytes that are not UTF-8"),
        (("record", "--port", "loop://", "--store", "s.sqlite", "--baud", "99999999999"), "line rate"),
        (("record", "--port", "loop://", "--store", "s.sqlite", "--count", "0"), "count"),
        (("board", "--link", "b", "--protocol", "x"), "frames, scpi"),
        (("board", "--link", "b", "--rate", "0"), "rate"),
        (("board", "--link", "b", "--echo", "absent.nc"), "absent.nc"),
        (("board", "--link", "b", "--echo", __file__), "cannot be read"),
        (("board", "--link", "no/b"), "does not exist"),
    ],
)
def test_bad_input_ends_with_status_2_and_one_line(tmp_path: Path, command_line, arguments: tuple, match: str):
    done = command_line(*arguments)
    assert done.returncode == 2, done
    assert match in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
    assert list(tmp_path.iterdir()) == []


def test_the_board_sends_the_echo_of_a_run(tmp_path: Path):
    """A result file with a noisy Gaussian echo at 1 GHz, sampled by the board at 10 GHz, without the run's noise.

    Tolerance: half a count of the frame's scale, 2 V / 32767 / 2 = 31 uV, and the quintic spline's error, 6 uV; linear
    interpolation is off by period^2 / 4 tau^2 of the peak, 14 mV.
    """
    import xarray

    def echo(time: np.ndarray) -> np.ndarray:
        return 2.0 * np.exp(-(((time - 10.3e-9) / 6e-9) ** 2))

    time = np.arange(40) * 1e-9
    noisy = echo(time) + 0.1 * np.random.default_rng(0).standard_normal(time.size)
    xarray.Dataset(
        {"echo_voltage": ("time", noisy), "echo_voltage_clean": ("time", echo(time))}, coords={"time": time}
    ).to_netcdf(tmp_path / "result.nc", engine="h5netcdf")
    source = EchoSource.from_result(tmp_path / "result.nc", noise=0.0, sample_count=450, sample_period_ps=100)
    frame = source.frame(0, 0, np.random.default_rng(0))
    expected = np.where(frame.time <= time[-1], echo(frame.time), 0.0)
    assert np.abs(frame.voltage - expected).max() < 2.0 / 32767 / 2 + 7e-6


@pytest.mark.parametrize("name", ["wind-tunnel-static", "sea-level-mach3"])
def test_the_board_and_a_scenes_runs_have_one_definition_of_the_pulse(name):
    """The plain board's echo is the one that the scene's rangefinder is calibrated on: it reads the true distance.

    Set-up: the scene's echo in vacuum on the board's 250 ps, without noise. Expected: by the matched filter with the
    scene's own pulse the target's distance, 0.15 mm more for the spot's outer parts (mean of r^2 / 2 R); the width at
    half height 2 sqrt(ln 2) tau. Tolerance: 0.3 mm and a thousandth.
    """
    scene = Scene.load(name)
    source = EchoSource.from_scene(name, noise=0.0)
    time = np.arange(source.voltage.size) * 250e-12
    found = estimate_range(time, source.voltage, "matched-filter", template=Setup.of_scene(scene).laser.shape)
    assert abs(found - scene.target.distance - 0.15e-3) < 0.3e-3
    own = np.exp(-(((time - 2.0 * found / 299_792_458.0) / scene.beam.pulse_tau) ** 2))
    wave = compare_waveforms(time, source.voltage, own * source.voltage.max())
    assert wave.recorded_width == pytest.approx(fwhm_from_pulse_tau(scene.beam.pulse_tau), rel=1e-3)
    assert wave.same_pulse is True


def test_a_link_never_replaces_a_file(tmp_path: Path):
    (tmp_path / "data").write_text("mine")
    with pytest.raises(ValueError, match="is a file"):
        PseudoTerminal(tmp_path / "data")
    assert (tmp_path / "data").read_text() == "mine"
    (tmp_path / "other").symlink_to("data")
    (tmp_path / "round").symlink_to("round")
    for name, told in (
        ("other", "leads to data, which is no terminal"),
        ("round", "leads to round, which is no terminal"),
    ):
        with pytest.raises(ValueError, match=told):
            PseudoTerminal(tmp_path / name)
    with pytest.raises(ValueError, match=r"link /proc/board: none can be made there .*; give another path"):
        PseudoTerminal("/proc/board")
    (tmp_path / "stale").symlink_to("/dev/pts/999999")
    with PseudoTerminal(tmp_path / "stale") as terminal:
        assert str((tmp_path / "stale").readlink()) == terminal.name
