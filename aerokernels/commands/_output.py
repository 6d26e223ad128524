"""Where the command line writes: results to stdout, as text or JSON; notes and progress to stderr, or nowhere.

`cli.main` takes --json and --quiet anywhere on the line and sets them here before a command begins.
"""

import json
import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import typer

from aerokernels.display.plain_text import plain, plain_json


@dataclass
class Asked:
    """What the command line asked of all output.

    Attributes:
        as_json: Results as one JSON object on stdout.
        quiet: No notes and no progress; what goes wrong is still said.
    """

    as_json: bool = False
    quiet: bool = False


asked = Asked()


def note(text: str) -> None:
    """Say on stderr what is no result: which files were written, say."""
    if not asked.quiet:
        say(plain(text), err=True)


def warn(text: str) -> None:
    """Say on stderr what is to be known about a result; --quiet does not silence it."""
    say(plain(text), err=True)


def result(text: str, data: Any) -> None:
    """Give a result to stdout: the text, or its data with --json."""
    say(json_text(data) if asked.as_json else plain(text))


def say(text: str, err: bool = False) -> None:
    """Write a line; where its reader has gone away, nothing more is written there, and the work goes on."""
    try:
        typer.echo(text, err=err)
    except OSError:  # `aerokernels run ... | head`, or the log's disk is full
        silence(sys.stderr if err else sys.stdout)


def silence(stream: Any) -> None:
    """Send what is still to be written to a stream nowhere, so that leaving the process does not fail either."""
    with suppress(OSError, ValueError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)


class Screen:
    """A terminal for what is drawn on it all the while: one that has closed does not end the work."""

    def __init__(self, stream: Any):
        """Draw on `stream`."""
        self._stream = stream

    def __getattr__(self, name: str) -> Any:
        """Whatever else the stream has."""
        return getattr(self._stream, name)

    def write(self, text: str) -> int:
        """Write a text, if there is still a terminal."""
        try:
            return int(self._stream.write(text))
        except OSError:
            silence(self._stream)
            return len(text)

    def flush(self) -> None:
        """Send what was written, if there is still a terminal."""
        try:
            self._stream.flush()
        except OSError:
            silence(self._stream)


def json_text(data: Any) -> str:
    """JSON that every reader takes: NaN and infinity are null."""
    from aerokernels.jobs.store import to_json

    return plain_json(json.dumps(to_json(data), indent=2, allow_nan=False, ensure_ascii=False))
