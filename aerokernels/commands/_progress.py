"""Progress on stderr: a bar on a terminal, a line for each stage elsewhere, nothing with --quiet."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Any

from aerokernels.commands._output import Screen, note, output
from aerokernels.display.plain_text import plain

Progress = Callable[[str, float], None]
LINE_EVERY = 0.1  # share of the steps between two lines, where no terminal shows a bar


@contextlib.contextmanager
def shown_progress(title: str) -> Iterator[Progress]:
    """Yield a function to call with the name of each stage as it begins and the fraction of the job done before it."""
    if output.quiet or not sys.stderr.isatty():
        yield lambda stage, fraction: note(f"{title}: {stage}")
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.fields[title]}", markup=False),
        BarColumn(),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
    )
    screen: Any = Screen(sys.stderr)
    with Bar(*columns, console=Console(file=screen), transient=True) as bar:
        task = bar.add_task("", total=1.0, title=plain(title))
        yield lambda stage, fraction: bar.update(task, description=plain(stage), completed=fraction)


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
