"""Output of the command line: results to stdout, as text or JSON; notes and progress to stderr, unless --quiet.

`cli.main` reads --json and --quiet anywhere on the line and stores them here before a command begins.
"""

import contextlib
import importlib
import io
import json
import os
import re
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import typer

from aerokernels.display.plain_text import plain, plain_json
from aerokernels.display.progress import Progress, alone, progress_bar
from aerokernels.display.quantities import Verdict
from aerokernels.files.writing import FULL


@dataclass
class OutputOptions:
    """The output options of the command line."""

    as_json: bool = False  # print results as one JSON object on stdout
    quiet: bool = False  # print no notes and no progress; warnings and errors are still printed
    lost: str = ""  # why results could not be written to stdout, though its reader is still there; empty if they could


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


LINE_EVERY = 0.1  # share of the steps between two lines, where no terminal shows a bar


@contextlib.contextmanager
def shown_progress(title: str) -> Iterator[Progress]:
    """Yield a function to call with the name of each stage as it begins and the fraction of the job done before it."""
    if output.quiet or not sys.stderr.isatty():
        with alone():
            yield lambda stage, fraction: note(f"{title}: {stage}")
        return
    with progress_bar(title, Screen(sys.stderr), wait=0.0) as bar:
        yield bar


def every_tenth(progress: Progress) -> Progress:
    """Return a progress function that shows every step on a terminal's bar, elsewhere one line for each tenth."""
    if sys.stderr.isatty():
        return progress
    last = -LINE_EVERY

    def shown(text: str, share: float) -> None:
        nonlocal last
        if share >= last + LINE_EVERY or share >= 1.0:
            last = share
            progress(text, share)

    return shown


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], data: Any = None) -> None:
    """Print rows of texts: a drawn table on a terminal, lines with tabs between the columns otherwise.

    With --json, print `data` instead; without `data`, print the table as a title and a list of objects.
    """
    if output.as_json:
        listed = {"title": title, "rows": [dict(zip(columns, row, strict=True)) for row in rows]}
        say(json_text(listed if data is None else data))
        return
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    if not console.is_terminal:
        for row in (columns, *rows):
            say("\t".join(re.sub(r"[\t\n]+", " ", plain(cell)) for cell in row))
        return
    from rich import box

    table = Table(box=box.SIMPLE_HEAD, title=Text(plain(title)), title_justify="left")
    for column in columns:
        table.add_column(Text(column), overflow="fold")
    for row in rows:
        table.add_row(*(Text(plain(cell)) for cell in row))
    drawn = io.StringIO()
    Console(file=drawn, force_terminal=True, width=console.width, color_system=console.color_system).print(table)  # type: ignore[arg-type]
    say(drawn.getvalue().rstrip("\n"))


WORTHLESS_ANSWER = 3  # beside 1, failed, and 2, bad input (cli.py)


def leave_with(verdict: Verdict) -> None:
    """Print a warning or worthless verdict to stderr; leave with exit status 3 if it is worthless."""
    if verdict:
        warn(f"{'not meaningful' if verdict.worthless else 'warning'}: {verdict.reason}")
    if verdict.worthless:
        raise typer.Exit(WORTHLESS_ANSWER)


# Libraries that write and draw a run's results. None of them imports a module that the tracer imports: two threads
# that import each other's modules would wait for each other.
REPORT = ("matplotlib.figure", "matplotlib.backends.backend_agg", "xarray", "h5netcdf")


def import_ahead(names: Iterable[str]) -> threading.Thread:
    """Start a thread that imports modules; the error of one that cannot be imported shows where it is used.

    At exit the process waits for the current module and imports no further one: a thread that Python ends inside a
    library's code ends the process by SIGABRT.
    """
    alive = threading.main_thread().is_alive

    def bring() -> None:
        for name in names:
            if not alive():
                return
            with suppress(Exception):
                importlib.import_module(name)

    thread = threading.Thread(target=bring, name="imports ahead")
    thread.start()
    return thread
