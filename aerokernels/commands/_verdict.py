"""The exit status of an answer that is worth nothing, and the line that says why."""

import typer

from aerokernels.commands._output import warn
from aerokernels.display.quantities import Verdict

WORTHLESS_ANSWER = 3  # beside 1, failed, and 2, bad input (cli.py)


def leave_with(verdict: Verdict) -> None:
    """Say on standard error what the verdict is, if there is something to say; leave with status 3 if it is worthless.

    Raises:
        typer.Exit: The answer is worth nothing.
    """
    if verdict:
        warn(f"{'worth nothing' if verdict.worthless else 'warning'}: {verdict.reason}")
    if verdict.worthless:
        raise typer.Exit(WORTHLESS_ANSWER)
