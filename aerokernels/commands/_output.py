"""Output of the command line: results to stdout, as text or JSON; notes and progress to stderr, unless --quiet.

`cli.main` reads --json and --quiet anywhere on the line and stores them here before a command begins.
"""

import json
import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import typer

from aerokernels.display.plain_text import plain, plain_json
from aerokernels.files.writing import FULL


@dataclass
class OutputOptions:
    """The output options of the command line.

    Attributes:
        as_json: Print results as one JSON object on stdout.
        quiet: Print no notes and no progress; warnings and errors are still printed.
        lost: Why results could not be written to stdout, though its reader is still there; empty if they could.
    """

    as_json: bool = False
    quiet: bool = False
    lost: str = ""


output = OutputOptions()


def note(text: str) -> None:
    """Print a note to stderr that is not a result, such as which files were written; --quiet silences it."""
    if not output.quiet:
        say(plain(text), err=True)


def warn(text: str) -> None:
    """Print a warning about a result to stderr; --quiet does not silence it."""
    say(plain(text), err=True)


def result(text: str, data: Any) -> None:
    """Print a result to stdout: its text, or its data with --json."""
    say(json_text(data) if output.as_json else plain(text))


def say(text: str, err: bool = False) -> None:
    """Write a line; if its reader has gone away, discard all further output to that stream and go on.

    Work also goes on where a disk is full; if it is that of stdout, `output.lost` says so, and the command fails in
    the end.
    """
    try:
        typer.echo(text, err=err)
    except OSError as error:  # `aerokernels run ... | head`, a closed terminal, or the disk of a log or of results
        if not err and error.errno in FULL:
            output.lost = error.strerror or type(error).__name__
        silence(sys.stderr if err else sys.stdout)


def silence(stream: Any) -> None:
    """Redirect a stream to the null device, so that flushing it when the process ends does not fail either."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


class Screen:
    """A terminal stream for live displays that goes on silently when the terminal has closed."""

    def __init__(self, stream: Any):
        """Wrap `stream`."""
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        """Return any other attribute of the stream."""
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text, if the terminal is still open."""
        try:
            return int(self._stream.write(text))
        except OSError:
            silence(self._stream)
            return len(text)

    def flush(self) -> None:
        """Flush the stream, if the terminal is still open."""
        try:
            self._stream.flush()
        except OSError:
            silence(self._stream)


def json_text(data: Any) -> str:
    """Return data as strict JSON text: NaN and infinity become null."""
    from aerokernels.jobs.store import to_json

    return plain_json(json.dumps(to_json(data), indent=2, allow_nan=False, ensure_ascii=False))
