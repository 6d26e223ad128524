"""Progress display of jobs with thousands of steps."""

import sys
from collections.abc import Callable

Progress = Callable[[str, float], None]
LINE_EVERY = 0.1  # share of the steps between two lines, where no terminal shows a bar


def thinned(shown: Progress) -> Progress:
    """Return a progress function that shows every step on a terminal's bar, elsewhere one line for each tenth."""
    if sys.stderr.isatty():
        return shown
    last = [-LINE_EVERY]

    def line(text: str, share: float) -> None:
        if share >= last[0] + LINE_EVERY or share >= 1.0:
            last[0] = share
            shown(text, share)

    return line
