"""The command line: load the commands, run one, and turn a failure into one line of text and an exit status.

Exit status: 0 done; 1 failed; 2 bad input (the line names the file, the key and the remedy); 3 all files are
written, but the answer is not meaningful (display/quantities.py); 130 interrupted (143 by SIGTERM, 129 by a terminal
that closed). `--debug`, anywhere on the line, also shows the traceback; `--json` prints results as JSON, and `--quiet`
silences notes and progress. Results go to stdout, everything else to stderr.
"""

import atexit
import gc
import importlib
import os
import pkgutil
import sys
import traceback
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from aerokernels import __version__, commands
from aerokernels.commands._output import output, say, silence, warn
from aerokernels.display.plain_text import plain
from aerokernels.files.writing import NO_FILES
from aerokernels.process.interrupt import open_closed_streams, raise_interrupts

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
SWITCHES = ("--debug", "--json", "--quiet")

app = typer.Typer(
    name="aerokernels",
    help="Aero-optics of supersonic flow: from a density field to wavefront, Strehl ratio, laser echo and range.",
    epilog="Exit status: 0 done; 1 failed; 2 bad input; 3 all files are written, but the answer is not meaningful: "
    "its error allows any Strehl ratio, or is above the echo's peak; 130 interrupted (143 by SIGTERM, 129 by "
    "a terminal that closed).",
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode=None,  # rich would take "[ps]" and "[default: ...]" in a help text for markup and drop them
    pretty_exceptions_enable=False,
)


def _print_version(requested: bool) -> None:
    if requested:
        typer.echo(f"aerokernels {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and exit.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of a failure.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print results as JSON.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="Print no notes and no progress.")] = False,
) -> None:
    """Declare the global options for --help; `main` accepts them anywhere and removes them before parsing."""


_modules = [one.name for one in pkgutil.iter_modules(commands.__path__) if not one.name.startswith("_")]
_commands = {n: c for m in _modules for n, c in importlib.import_module(f"{commands.__name__}.{m}").COMMANDS.items()}
for _name, _command in sorted(_commands.items()):
    if isinstance(_command, typer.Typer):
        app.add_typer(_command)
    else:
        app.command(_name)(_command)


def exit_status(error: BaseException, line: Sequence[str] = ()) -> int:
    """Return a failure's exit status: 2 where the user can correct the command `line`, 130 for an interrupt, else 1."""
    if isinstance(error, (KeyboardInterrupt, typer.Abort)):
        return INTERRUPTED
    mended = isinstance(error, (ValueError, TypeError)) or hasattr(error, "format_message")
    if mended or (isinstance(error, OSError) and error.errno in NO_FILES and _is_named(error.filename, line)):
        return BAD_INPUT
    return FAILED


def one_line(error: BaseException) -> str:
    """Describe a failure on one line."""
    if isinstance(error, (KeyboardInterrupt, typer.Abort)):
        return "interrupted"
    format_message = getattr(error, "format_message", None)  # the command line parser's own errors
    text = " ".join(str(format_message() if format_message else error).split())
    if format_message:
        return text + _remedy(error, text)
    if isinstance(error, OSError) and error.errno in NO_FILES and error.filename:
        return f"{error.filename}: {error.strerror}; give another path, or check its permissions"
    if isinstance(error, (ValueError, RuntimeError, OSError)) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _is_named(file: object, line: Sequence[str]) -> bool:
    """Whether the command line names a file or one of its folders: a fault of any other file is not bad input."""
    if not isinstance(file, (str, bytes, os.PathLike)) or not file:
        return False
    place = Path(os.path.abspath(os.fsdecode(file)))
    values = (argument.rpartition("=")[2] for argument in line if "=" in argument or not argument.startswith("-"))
    named = [Path(os.path.abspath(value)) for value in values if value]
    return any(place.is_relative_to(one) or one.is_relative_to(place) for one in named)


def _remedy(error: BaseException, text: str) -> str:
    """Return the remedy for a mistake on the command line, to append to its message."""
    context = getattr(error, "ctx", None)
    if context is None or text.endswith("?"):
        return ""
    known = getattr(context.command, "commands", None)
    if known and text.startswith("No such command"):
        return f" There are: {', '.join(known)}."
    return f"{'' if text.endswith('.') else '.'} See: {context.command_path} --help"


def check_values(line: list[str]) -> None:
    """Refuse an option with an empty value, which most often comes from an unset shell variable."""
    for before, argument in zip(["", *line], line, strict=False):
        option, equals, value = argument.partition("=")
        if (before.startswith("--") and not argument) or (option in ("--out", "--store") and equals and not value):
            raise ValueError(f"{before if not argument else option} has an empty value: write a value after it")


def split_switches(line: list[str]) -> tuple[list[str], set[str]]:
    """Split the arguments into those without the global switches and the set of switches; stop at a bare "--"."""
    end = line.index("--") if "--" in line else len(line)
    switches = {argument for argument in line[:end] if argument in SWITCHES}
    return [argument for argument in line[:end] if argument not in SWITCHES] + line[end:], switches


def _show_warning(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
    warn(f"warning: {message}")


def main() -> NoReturn:
    """Run the command line and end the process."""
    open_closed_streams()
    # No command opens a window. A notebook sets a backend that another environment may not have.
    os.environ["MPLBACKEND"] = "agg"
    # The objects that libraries create on import live until the end: scanning them again and again, as by Python's
    # default thresholds, takes a tenth of a whole run.
    gc.set_threshold(50_000, 20, 50)
    atexit.register(gc.freeze)  # at exit the remaining objects need no further scan
    # SIGTERM and a closed terminal are handled like Ctrl-C, so that half-written files are removed.
    stopped = raise_interrupts()
    interrupted: list[int] = []
    atexit.register(_leave_at_once, interrupted)  # registered first, so it is called last
    arguments, switches = split_switches(sys.argv[1:])
    output.as_json, output.quiet = "--json" in switches, "--quiet" in switches
    if output.quiet:
        os.environ["AEROKERNELS_PROGRESS"] = "off"
    warnings.showwarning = _show_warning
    try:
        check_values(arguments)
        status = app(args=arguments or ["--help"], prog_name="aerokernels", standalone_mode=False)
    except BrokenPipeError:  # `aerokernels fields | head`
        silence(sys.stdout)
        raise SystemExit(FAILED) from None
    except (Exception, KeyboardInterrupt) as error:
        if "--debug" in switches:
            traceback.print_exc()
        else:
            say(plain(f"error: {one_line(error)}"), err=True)
        status = exit_status(error, arguments)
    else:
        if status == INTERRUPTED:  # typer itself turns an interrupt into this status
            warn("interrupted")
    if output.lost:
        warn(f"error: the results could not be written to stdout ({output.lost}): make room and run it again")
        status = status or FAILED
    if status == INTERRUPTED:
        status = 128 + stopped[0] if stopped else status
        interrupted.append(status)
    raise SystemExit(status if isinstance(status, int) else 0)


def _leave_at_once(interrupted: list[int]) -> None:
    """End an interrupted process after Python's own clean-up and before that of the libraries.

    LLVM, within PoCL, aborts in its clean-up where it could not write to a closed terminal.
    """
    if interrupted:
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError, ValueError):
                stream.flush()
        os._exit(interrupted[0])
