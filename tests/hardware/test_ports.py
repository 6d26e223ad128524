"""Ports of every kind, and ports in trouble: silent ones, TCP ones, settings that no port has."""

import contextlib
import errno
import socket
import threading
import time
from collections.abc import Callable
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import serial
import serial.rfc2217

from aerokernels.hardware.frames import EchoFrame, encode
from aerokernels.hardware.port import open_port
from aerokernels.hardware.recorder import Recorder, RecordingStatus
from aerokernels.hardware.simulator import PseudoTerminal
from aerokernels.hardware.sources import FrameStream
from aerokernels.hardware.store import EchoStore

from .line import frames_from, needs_pseudo_terminals, sequences

FRAMES = [EchoFrame(k, 1000 * k, 1000, 0.001, 0.0, np.full(40, k)) for k in range(60)]


@contextmanager
def served(talk: Callable[[socket.socket], None]):
    """A TCP server on a free port of this machine; `talk` has each of two clients in turn."""

    def run() -> None:
        for _ in range(2):
            client, _ = server.accept()
            with client:
                talk(client)

    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(30)
        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        yield server.getsockname()[1]
        thread.join(30)


def test_a_socket_that_breaks_off_and_comes_back(tmp_path: Path):
    """socket://: 30 frames and a piece, the connection ends, the rest on the next one; each good frame once."""
    turns = iter([FRAMES[:30], FRAMES[28:]])

    def talk(client: socket.socket) -> None:
        time.sleep(0.3)  # opening throws away what came before
        client.sendall(b"".join(map(encode, next(turns))) + encode(FRAMES[30])[:20])

    with served(talk) as number, EchoStore(tmp_path / "s.sqlite") as store:
        connect = partial(stream_of, f"socket://127.0.0.1:{number}")
        store.begin_recording("socket", "frames", {})
        status = Recorder(connect(), store, connect, count=60, stopped=patience()).run()
        assert (status.stored_count, status.reconnect_count, status.duplicate_count) == (60, 1, 2)
        assert status.damaged_count == 1 and store.gaps() == []
    assert sequences(tmp_path / "s.sqlite") == list(range(60))


def patience() -> Callable[[], bool]:
    """A recording that does not come to its end stops after half a minute."""
    until = time.monotonic() + 30.0
    return lambda: time.monotonic() > until


def stream_of(url: str) -> FrameStream:
    return FrameStream(open_port(url))


class ClientWriter:
    """What pyserial's server writes its negotiation to."""

    def __init__(self, client: socket.socket) -> None:
        self.write = client.sendall


def test_a_port_on_another_machine(tmp_path: Path):
    """rfc2217://: pyserial's own server passes a port on, here one that is looped back and fed with frames."""
    ended = threading.Event()

    def talk() -> None:
        client, _ = server.accept()
        with client, closing(serial.serial_for_url("loop://", timeout=0.02)) as port:
            manager = serial.rfc2217.PortManager(port, ClientWriter(client))
            client.settimeout(0.02)
            negotiated = time.monotonic() + 1.0
            left = b"".join(map(encode, FRAMES))
            while not ended.is_set():
                with contextlib.suppress(TimeoutError):
                    b"".join(manager.filter(client.recv(4096)))
                if time.monotonic() > negotiated:
                    port.write(left[:500])
                    left = left[500:]
                client.sendall(b"".join(manager.escape(port.read(port.in_waiting or 1))))

    with socket.create_server(("127.0.0.1", 0)) as server, EchoStore(tmp_path / "s.sqlite") as store:
        server.settimeout(30)
        thread = threading.Thread(target=talk, daemon=True)
        thread.start()
        connect = partial(stream_of, f"rfc2217://127.0.0.1:{server.getsockname()[1]}")
        store.begin_recording("rfc2217", "frames", {})
        status = Recorder(connect(), store, connect, count=60, stopped=patience()).run()
        ended.set()
        thread.join(30)
    assert (status.stored_count, status.damaged_count) == (60, 0)
    assert sequences(tmp_path / "s.sqlite") == list(range(60))


@needs_pseudo_terminals
def test_a_silent_port_is_opened_anew(tmp_path: Path):
    """A board that hangs in mid-frame with its port open: after the stall time the port is closed and opened again.

    Expected: the piece is kept with that reason, the status says why the port is away, and the frames that come
    after are stored, each once.
    """
    link, path = tmp_path / "port", tmp_path / "s.sqlite"
    seen: list[RecordingStatus] = []
    with PseudoTerminal(link) as terminal, EchoStore(path) as store:
        store.begin_recording(str(link), "frames", {})
        connect = partial(frames_from, link)
        stream = connect()
        terminal.write(b"".join(map(encode, FRAMES[:20])) + encode(FRAMES[20])[:25])

        def go_on() -> None:
            while not any(status.reconnect_count for status in seen):
                time.sleep(0.01)
            time.sleep(0.3)
            terminal.write(b"\x00" + b"".join(map(encode, FRAMES[20:])))

        thread = threading.Thread(target=go_on)
        thread.start()
        status = Recorder(
            stream, store, connect, count=60, stopped=patience(), stall_time=0.5, report=seen.append
        ).run()
        thread.join(30)
        assert (status.stored_count, status.missing_count, status.damaged_count) == (60, 0, 1)
        assert status.reconnect_count >= 1
    assert any("nothing came for 0.5 s" in one.port_state and not one.port_open for one in seen)
    assert sequences(path) == list(range(60))


class FailingPort:
    """A serial port whose driver gives up after some bytes, as a pulled USB plug does."""

    port, in_waiting, is_open = "failing", 0, True

    def __init__(self, data: bytes, error: Exception) -> None:
        self._data, self._error = data, error

    def read(self, size: int) -> bytes:
        if not self._data:
            raise self._error
        chunk, self._data = self._data[:100], self._data[100:]
        return chunk

    def close(self) -> None:
        raise self._error


@needs_pseudo_terminals
@pytest.mark.parametrize("kind", ["SerialException", "OSError", "termios.error"])
def test_every_error_of_a_driver_means_that_the_port_is_lost(tmp_path: Path, kind: str):
    """What was read before the error is stored; the error is the reason that is shown; the recording goes on."""
    import termios

    error = {
        "SerialException": serial.SerialException("read failed"),
        "OSError": OSError(errno.EIO, "Input/output error"),
        "termios.error": termios.error(errno.EIO, "Input/output error"),
    }[kind]
    ports = iter([FailingPort(b"".join(map(encode, FRAMES[30:])), error)])
    seen: list[RecordingStatus] = []
    with EchoStore(tmp_path / "s.sqlite") as store:
        store.begin_recording("failing", "frames", {})
        first = FrameStream(FailingPort(b"".join(map(encode, FRAMES[:30])), error))  # type: ignore[arg-type]
        status = Recorder(
            first,
            store,
            lambda: FrameStream(next(ports)),
            count=60,
            stopped=patience(),
            report=seen.append,  # type: ignore[arg-type]
        ).run()
    assert (status.stored_count, status.reconnect_count) == (60, 1)
    (away,) = [one for one in seen if not one.port_open]
    assert away.stored_count == 30 and "port was lost" in away.port_state
    assert sequences(tmp_path / "s.sqlite") == list(range(60))
