"""What the recorder says of a line on which something comes, but no frames."""

import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from aerokernels.hardware import recorder as module
from aerokernels.hardware.frames import EchoFrame, encode
from aerokernels.hardware.pseudo_terminal import PseudoTerminal
from aerokernels.hardware.recorder import NO_GOOD_FRAME, Recorder, RecordingStatus
from aerokernels.hardware.store import EchoStore

from .line import frames_from, needs_pseudo_terminals, started


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
def test_the_command_says_at_its_end_what_to_check(tmp_path: Path):
    """Before: "stored 0, damaged 0, missing 0, port open" for as long as one waited, and "done" with status 0."""
    link = tmp_path / "port"
    with PseudoTerminal(link) as terminal:
        with started("record", "--port", link, "--store", tmp_path / "s.sqlite", "--commit-interval", 0.05) as recorder:
            assert recorder.stdout is not None
            assert "recording frames" in recorder.stdout.readline()
            while "damaged 0" in (line := recorder.stdout.readline()) or not line.strip():
                terminal.write(b"\1\2\0")
            while "damaged" not in line:
                terminal.write(b"\1\2\0")
                line = recorder.stdout.readline()
            recorder.terminate()
            output = recorder.communicate(timeout=30)[0]
    assert "but no good frame: check that the instrument sends at --baud 115200 and in --protocol frames" in output
    assert recorder.returncode == 0
