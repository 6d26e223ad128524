"""What the recorder says of a line on which something comes, but no frames, and of a store that is locked."""

import signal
import sqlite3
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware import recorder as module
from aerokernels.hardware.frames import EchoFrame, encode
from aerokernels.hardware.recorder import NO_GOOD_FRAME, Recorder, RecordingStatus
from aerokernels.hardware.simulator import PseudoTerminal
from aerokernels.hardware.store import EchoStore, StoreError

from .line import frames_from, needs_pseudo_terminals, sequences, started


@needs_pseudo_terminals
@pytest.mark.parametrize("line", [b"$GPGGA,no digitiser\r\n", b"\x80\xfe\x00\x07"], ids=["text", "damage"])
def test_a_line_without_frames_is_said_to_be_that(tmp_path: Path, monkeypatch, line: bytes):
    """An instrument that sends text, or damage as at a wrong rate; then good frames, from which on the port is open."""
    monkeypatch.setattr(module, "_NO_FRAME_TIME", 0.0)
    monkeypatch.setattr(module, "_REPORT_INTERVAL", 0.05)
    link, seen = tmp_path / "port", []
    with PseudoTerminal(link) as terminal, EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording(str(link), "frames", {})
        connect = partial(frames_from, link)
        stream, is_said, ended = connect(), threading.Event(), threading.Event()

        def talk() -> None:
            while not is_said.wait(0.02):
                terminal.write(line)
            terminal.write(b"\0" + encode(EchoFrame(1, 1, 250, 1e-3, 0.0, np.arange(20))))

        def report(status: RecordingStatus) -> None:
            seen.append(status)
            if status.port_state == NO_GOOD_FRAME:
                is_said.set()
            if status.stored_count:
                ended.set()

        thread = threading.Thread(target=talk)
        thread.start()
        status = Recorder(stream, store, connect, commit_interval=0.05, stopped=ended.is_set, report=report).run()
        thread.join(10)
    assert is_said.is_set() and all(one.port_open for one in seen)
    assert status.stored_count == 1 and status.port_state == "open"


@needs_pseudo_terminals
def test_a_lock_that_stays_ends_a_recording_with_a_sentence(tmp_path: Path, monkeypatch):
    link, path = tmp_path / "port", tmp_path / "s.sqlite"
    monkeypatch.setattr("aerokernels.hardware.store._BUSY_TIME", 0.1)
    with PseudoTerminal(link) as terminal, EchoStore(path) as store:
        store.begin_recording(str(link), "frames", {})
        stream = frames_from(link)
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        terminal.write(b"".join(encode(EchoFrame(k, k, 250, 1e-3, 0.0, np.arange(20))) for k in range(3)))
        with pytest.raises(StoreError, match="another program keeps it locked"):
            Recorder(stream, store, lambda: stream, count=9, commit_interval=0.0).run()
        other.close()


@needs_pseudo_terminals
@pytest.mark.parametrize(
    "name", ["SIGTERM", *(pytest.param(one, marks=pytest.mark.slow) for one in ("SIGINT", "SIGHUP"))]
)
def test_an_interrupt_during_the_search_for_an_instrument(tmp_path: Path, name: str):
    """A silent line: the search ends at once with the status of the signal, 128 + its number, and leaves no store.

    All three ended with 130 before.
    """
    link, number = tmp_path / "port", getattr(signal, name)
    if signal.getsignal(number) is signal.SIG_IGN:
        pytest.skip(f"{name} is ignored here, as by nohup, and so it is in children")
    with PseudoTerminal(link) as terminal:
        with started("record", "--port", link, "--protocol", "scpi", "--store", tmp_path / "s.sqlite") as recorder:
            while b"HEADER ON" not in terminal.read(0.1):
                assert recorder.poll() is None
            recorder.send_signal(number)
            output = recorder.communicate(timeout=30)[0]
    assert recorder.returncode == 128 + number and output.strip() == "interrupted"
    assert not (tmp_path / "s.sqlite").exists()


@needs_pseudo_terminals
def test_a_full_disk_leaves_what_was_committed(tmp_path: Path, full_disk):
    """Files that may grow to 150 kB."""
    wire = b"".join(encode(EchoFrame(k, k, 250, 1e-3, 0.0, np.arange(100))) for k in range(160))
    with PseudoTerminal(tmp_path / "port") as terminal, EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("port", "frames", {"mach": "3"})
        stream, ended = frames_from(tmp_path / "port"), threading.Event()
        threading.Thread(target=terminal.write, args=(wire, ended.is_set), daemon=True).start()
        full_disk(150_000)
        with pytest.raises(StoreError, match="what was committed is safe"):
            Recorder(stream, store, lambda: stream, count=160, commit_interval=0.0, batch_size=20).run()
        ended.set()
        full_disk(None)
    committed = sequences(tmp_path / "s.sqlite")
    assert committed == list(range(len(committed))) and len(committed) >= 20
