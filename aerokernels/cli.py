"""The command line: finds the commands, and turns what goes wrong into one line and an exit status.

Exit status: 0 done; 1 failed; 2 bad input (the line names the file, the key and the remedy); 3 an answer that is worth
nothing, because its error is greater than the number; 130 interrupted.
`--debug`, anywhere on the line, shows where it failed as well.
"""

import atexit
import gc
import importlib
import pkgutil
import signal
import sys
import traceback
from types import FrameType
from typing import Annotated, NoReturn

import typer

from aerokernels import __version__, commands

FAILED, BAD_INPUT, INTERRUPTED = 1, 2, 130
# New objects between two searches for cycles. What the libraries make when they are imported is there to stay: looked
# through at Python's own pace, it takes a tenth of a whole run.
COLLECT_AFTER = (50_000, 20, 50)

app = typer.Typer(
    name="aerokernels",
    help="Aero-optics of supersonic flow: from a density field to wavefront, Strehl ratio, laser echo and range.",
    epilog="Exit status: 0 done; 1 failed; 2 bad input; 3 the answer is worth nothing: its error is greater than the "
    "number itself; 130 interrupted.",
    add_completion=False,
    pretty_exceptions_enable=False,
)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"aerokernels {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version and leave.")
    ] = False,
    debug: Annotated[bool, typer.Option("--debug", help="Show the traceback of a failure.")] = False,
) -> None:
    """Name the options of every command for --help; `main` takes --debug before the parser sees it."""


for _module in pkgutil.iter_modules(commands.__path__):
    if not _module.name.startswith("_"):
        app.command(_module.name)(getattr(importlib.import_module(f"{commands.__name__}.{_module.name}"), _module.name))


def exit_status(error: BaseException) -> int:
    """The exit status for a failure: 2 for what the caller can mend, 130 for an interrupt, else 1."""
    if isinstance(error, (KeyboardInterrupt, typer.Abort)):
        return INTERRUPTED
    if isinstance(error, (ValueError, TypeError)) or hasattr(error, "format_message"):
        return BAD_INPUT
    return FAILED


def one_line(error: BaseException) -> str:
    """What went wrong, on one line."""
    if isinstance(error, (KeyboardInterrupt, typer.Abort)):
        return "interrupted"
    format_message = getattr(error, "format_message", None)  # the command line parser's own errors
    text = " ".join(str(format_message() if format_message else error).split())
    if format_message or (isinstance(error, (ValueError, RuntimeError, OSError)) and text):
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def _stop(number: int, frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def main() -> NoReturn:
    """Run the command line and leave the process."""
    gc.set_threshold(*COLLECT_AFTER)
    atexit.register(gc.freeze)  # and when all is done, what is left need not be looked through once more
    # A polite kill ends like Ctrl-C does: what was half-written is cleared away.
    signal.signal(signal.SIGTERM, _stop)
    arguments = [argument for argument in sys.argv[1:] if argument != "--debug"]
    try:
        status = app(args=arguments or ["--help"], prog_name="aerokernels", standalone_mode=False)
    except BrokenPipeError:  # `aerokernels fields | head`
        sys.stderr.close()
        raise SystemExit(FAILED) from None
    except (Exception, KeyboardInterrupt) as error:
        if len(arguments) < len(sys.argv) - 1:
            traceback.print_exc()
        else:
            print(f"error: {one_line(error)}", file=sys.stderr)
        raise SystemExit(exit_status(error)) from None
    if status == INTERRUPTED:  # the parser turns an interrupt of its own accord into this status
        print("interrupted", file=sys.stderr)
    raise SystemExit(status if isinstance(status, int) else 0)
