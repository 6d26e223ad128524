"""Launches of Warp's kernels: one on a GPU; on the processor chunks, over host threads, since a launch takes one."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

from ..machine import core_count

CHUNKS = 4  # for each thread


def launch(kernel: Any, count: int, before: list, after: list, device: str) -> None:
    """Run a kernel `count` times; it takes `before`, the number of the first one of the launch, and `after`."""
    import warp as wp

    if device != "cpu":
        wp.launch(kernel, dim=count, inputs=[*before, 0, *after], device=device)
        return
    threads = core_count()
    chunk = max(1, -(-count // (CHUNKS * threads)))

    def run(first: int) -> None:
        wp.launch(kernel, dim=min(chunk, count - first), inputs=[*before, first, *after], device="cpu")

    starts = range(0, count, chunk)
    if len(starts) == 1:
        run(0)
        return
    wp.load_module(kernel.module, device="cpu", block_dim=1)  # once, and not by every thread
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(run, starts))
