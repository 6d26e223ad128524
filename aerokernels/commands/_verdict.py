"""The exit status of an answer that is not meaningful, and the line that explains it."""

import typer

from aerokernels.commands._output import warn
from aerokernels.display.quantities import Verdict

WORTHLESS_ANSWER = 3  # beside 1, failed, and 2, bad input (cli.py)


def leave_with(verdict: Verdict) -> None:
    """Print a warning or worthless verdict to stderr; leave with exit status 3 if it is worthless.

    Raises:
        typer.Exit: The answer is not meaningful given its error.
    """
    if verdict:
        warn(f"{'not meaningful' if verdict.worthless else 'warning'}: {verdict.reason}")
    if verdict.worthless:
        raise typer.Exit(WORTHLESS_ANSWER)
