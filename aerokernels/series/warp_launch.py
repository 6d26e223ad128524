"""Launch Warp kernels: once on a GPU; on the processor in chunks over host threads, since a launch uses one thread."""

from typing import Any

from ..process.machine import core_count
from ..process.threads import in_threads

CHUNKS = 4  # for each thread


def launch(kernel: Any, count: int, before: list, after: list, device: str) -> None:
    """Run a kernel for `count` items; its arguments: `before`, the number of the launch's first item, `after`."""
    import warp as wp

    if device != "cpu":
        wp.launch(kernel, dim=count, inputs=[*before, 0, *after], device=device)
        return
    chunk = max(1, -(-count // (CHUNKS * core_count())))

    def run(first: int) -> None:
        wp.launch(kernel, dim=min(chunk, count - first), inputs=[*before, first, *after], device="cpu")

    wp.load_module(kernel.module, device="cpu", block_dim=1)  # once, not in every thread
    in_threads(run, range(0, count, chunk))
