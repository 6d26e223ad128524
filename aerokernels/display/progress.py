"""Progress of long work: one bar in a terminal or a notebook, once the work has taken a second.

Functions with an argument `progress` take a `Progress`; where the caller gives none, `@shows_progress` gives them a
bar, and `tracked` shows one for a loop. There is one bar at a time, of the outermost work; none in other threads and in
child processes, where stderr is neither a terminal nor a notebook's, or where AEROKERNELS_PROGRESS is "off".
"""

import functools
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from typing import Any, TypeVar, cast

from .plain_text import plain

# What the work is doing -> the share of it that is done.
Progress = Callable[[str, float], None]
F = TypeVar("F", bound=Callable)
T = TypeVar("T")
WAIT, APART = 1.0, 0.1  # time before a bar is shown, and between two pictures of it in a notebook [s]
SHOWN = ContextVar("SHOWN", default=False)  # whether a bar is shown, or the caller shows the progress of the work


def in_notebook() -> bool:
    """Return whether this process is the kernel of a notebook."""
    return "ipykernel" in sys.modules and hasattr(sys.modules["__main__"], "get_ipython")


def is_watched() -> bool:
    """Return whether a bar may be shown: see this module's docstring."""
    if SHOWN.get() or os.environ.get("AEROKERNELS_PROGRESS") == "off":
        return False
    processes = sys.modules.get("multiprocessing.process")
    if processes is not None and processes.parent_process() is not None:
        return False
    return threading.current_thread() is threading.main_thread() and (sys.stderr.isatty() or in_notebook())


@contextmanager
def alone() -> Iterator[None]:
    """Show no other bar within; the caller shows the progress of this work."""
    before = SHOWN.set(True)
    try:
        yield
    finally:
        SHOWN.reset(before)


@contextmanager
def progress_bar(title: str, stream: Any = None, *, wait: float | None = None) -> Iterator[Progress]:
    """Yield a function that shows progress as a bar on a stream, stderr if None, or in a notebook's cell.

    The bar is shown by its first call after `wait` seconds, WAIT if None.
    """
    begin, bars = time.monotonic(), list[Progress]()
    with alone(), ExitStack() as stack:

        def report(text: str, share: float) -> None:
            if not bars and time.monotonic() - begin >= (WAIT if wait is None else wait):
                bars.append(stack.enter_context((_in_cell if in_notebook() else _on_terminal)(title, begin, stream)))
            if bars:
                bars[0](text, min(max(share, 0.0), 1.0))

        yield report


@contextmanager
def _on_terminal(title: str, begin: float, stream: Any) -> Iterator[Progress]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.fields[title]}", markup=False),
        BarColumn(),
        TextColumn("{task.description}", markup=False),
        TimeElapsedColumn(),
    )
    with Bar(*columns, console=Console(file=stream or sys.stderr), transient=True) as bar:
        task = bar.add_task("", total=1.0, title=plain(title))
        yield lambda text, share: bar.update(task, description=plain(text), completed=share)


@contextmanager
def _in_cell(title: str, begin: float, stream: Any) -> Iterator[Progress]:
    from IPython.display import display

    last, handle = 0.0, display({"text/plain": plain(title)}, raw=True, display_id=True)

    def update(text: str, share: float) -> None:
        nonlocal last
        now, full = time.monotonic(), round(40 * share)
        if now - last > APART or share >= 1.0:
            last = now
            bar = f"{'━' * full}{'─' * (40 - full)} {100 * share:.0f} %"
            handle.update({"text/plain": f"{plain(title)} {bar} {plain(text)} {now - begin:.0f} s"}, raw=True)

    yield update


def shows_progress(title: str, *, wait: float | None = None) -> Callable[[F], F]:
    """Return a decorator for a function with an argument `progress`: a bar where the caller gives None."""

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def call(*given: Any, **named: Any) -> Any:
            if named.get("progress") is not None or not is_watched():
                return function(*given, **named)
            with progress_bar(title, wait=wait) as progress:
                return function(*given, **{**named, "progress": progress})

        return cast(F, call)

    return decorate


def tracked(title: str, parts: Sequence[T]) -> Iterator[T]:
    """Yield the parts of a loop, with a bar where there are several."""
    if len(parts) < 2 or not is_watched():
        yield from parts
        return
    with progress_bar(title) as progress:
        for number, part in enumerate(parts):
            yield part
            progress(f"{number + 1} of {len(parts)}", (number + 1) / len(parts))
