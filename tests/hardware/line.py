"""The command line in processes of its own, on a pseudo-terminal, and what the store says afterwards."""

import sqlite3
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from aerokernels.hardware.port import open_port
from aerokernels.hardware.simulator import EchoSource, PseudoTerminal, run_board
from aerokernels.hardware.sources import FrameStream
from aerokernels.hardware.store import EchoStore

needs_pseudo_terminals = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals are not there on Windows")


@contextmanager
def started(*arguments: object, **options: object) -> Iterator[subprocess.Popen[str]]:
    """The command line running in a process of its own; ended at the end if it is still there, as a shell would."""
    command = [sys.executable, "-m", "aerokernels", *map(str, arguments)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", **options
    ) as process:  # type: ignore[call-overload]
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(timeout=20.0)
            except subprocess.TimeoutExpired:
                process.kill()


@contextmanager
def board(link: Path, *options: object) -> Iterator[subprocess.Popen[str]]:
    with started("board", "--link", link, *options) as process:
        assert process.stdout is not None
        assert "board on" in process.stdout.readline()
        yield process


@contextmanager
def board_here(link: Path, rate: float = 500.0) -> Iterator[None]:
    """The same board as a thread of this process."""
    ended = threading.Event()
    source = EchoSource.from_scene()
    with PseudoTerminal(link) as terminal:
        options = {"rate": rate, "stopped": ended.is_set}
        thread = threading.Thread(target=run_board, args=(terminal, source), kwargs=options)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join(30)


def frames_from(link: Path) -> FrameStream:
    return FrameStream(open_port(str(link)))


def sequences(path: Path) -> list[int]:
    with EchoStore(path, read_only=True) as store:
        return [echo.frame.sequence for echo in store.echoes()]


def rows(path: Path, query: str) -> list[tuple]:
    with closing(sqlite3.connect(path)) as connection:
        return connection.execute(query).fetchall()


def integrity(path: Path) -> str:
    return rows(path, "PRAGMA integrity_check")[0][0]
