"""Progress: a bar on a terminal (stderr), a line for each stage elsewhere (stdout: stderr is for what goes wrong)."""

import contextlib
import sys
from collections.abc import Callable, Iterator

Progress = Callable[[str, float], None]


@contextlib.contextmanager
def shown_progress(title: str) -> Iterator[Progress]:
    """Give a function that takes the name of the stage that begins and the fraction of the job done before it."""
    if not sys.stderr.isatty():

        def line(stage: str, fraction: float) -> None:
            print(f"{title}: {stage}", flush=True)

        yield line
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.fields[title]}"), BarColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
    with Bar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0, title=title)
        yield lambda stage, fraction: bar.update(task, description=stage, completed=fraction)
