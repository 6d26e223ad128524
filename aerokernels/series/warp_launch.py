"""Launch Warp kernels: once on a GPU; on the processor in chunks over host threads, since a launch uses one thread."""

from typing import Any

from ..process.machine import core_count
from ..process.threads import in_threads

CHUNKS = 4  # for each thread


def launch(kernel: Any, count: int, before: list, after: list, device: str) -> None:
    """Run a kernel for `count` items; its arguments: `before`, the number of the launch's first item, `after`."""
    from ..device_arrays.launching import launch as warp_launch

    if device != "cpu":
        warp_launch(kernel, count, [*before, 0, *after], device)
        return
    chunk = max(1, -(-count // (CHUNKS * core_count())))

    def run(first: int) -> None:
        warp_launch(kernel, min(chunk, count - first), [*before, first, *after], "cpu")

    in_threads(run, range(0, count, chunk))
