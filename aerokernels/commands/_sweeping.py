"""Progress of jobs of thousands of steps."""

import sys
from collections.abc import Callable

Progress = Callable[[str, float], None]
LINE_EVERY = 0.1  # of the steps, where no terminal shows a bar


def thinned(shown: Progress) -> Progress:
    """Every step for the bar of a terminal; elsewhere a line for each tenth."""
    if sys.stderr.isatty():
        return shown
    last = [-LINE_EVERY]

    def line(text: str, share: float) -> None:
        if share >= last[0] + LINE_EVERY or share >= 1.0:
            last[0] = share
            shown(text, share)

    return line
