"""Load and launch Warp's kernels from any thread.

Warp does not guard what it does at the first launch of a kernel. Two threads that load one module at once both load it,
and the copy that is replaced is unloaded while its kernels may run; the table of CUDA functions has no lock either. So
one thread at a time does these things. Later launches take no lock.
"""

import errno
import weakref
from collections.abc import Sequence
from typing import Any

import warp as wp

from aerokernels.files.writing import FULL
from aerokernels.process.quiet_warp import NoCacheError

from ..process.opened import OPENED, Locked

NO_WRITING = (*FULL, errno.EACCES, errno.EPERM, errno.EROFS)


class _Turn(Locked):
    """The lock of what one thread does at a time, and what is done.

    Attributes:
        done: The modules that were loaded and the kernels that were launched, each with its device and threads per
            block.
        streams: Streams that are not in use, by device. None is destroyed, for the table of streams has no lock.
    """

    def __init__(self) -> None:
        super().__init__()
        self.done: set[tuple] = set()
        self.streams: dict[str, list] = {}


def _turn() -> _Turn:
    turn: _Turn = OPENED.get("turn at Warp") or OPENED.once("turn at Warp", _Turn)
    return turn


def launch(kernel: Any, dim: Any, inputs: Sequence[Any], device: Any, block_size: int | None = None) -> None:
    """Launch a kernel as `wp.launch` does, in any thread.

    Args:
        kernel: A wp.Kernel.
        dim: Number of threads, or several for an array of threads.
        inputs: The kernel's arguments.
        device: A wp.Device, or its name.
        block_size: Threads per block; None for Warp's default, which is 1 on a CPU.
    """
    turn, key = _turn(), (kernel, str(device), block_size)
    options: dict[str, Any] = {} if block_size is None else {"block_dim": block_size}
    if key in turn.done:
        wp.launch(kernel, dim=dim, inputs=inputs, device=device, **options)
        return
    with turn.lock:
        load_module(kernel.module, str(device), 1 if str(device) == "cpu" else block_size)
        wp.launch(kernel, dim=dim, inputs=inputs, device=device, **options)
    turn.done.add(key)


def lent_stream(owner: Any, device: Any) -> Any:
    """Return a stream of a GPU that nothing else uses as long as `owner` lives."""
    turn = _turn()
    with turn.lock:
        free = turn.streams.setdefault(str(device), [])
        stream = free.pop() if free else wp.Stream(device)
    weakref.finalize(owner, free.append, stream).atexit = False
    return stream


def load_module(module: Any, device: str, block_size: int | None) -> None:
    """Load a Warp module for a device from the cache, or compile it, once.

    Args:
        module: A warp.Module.
        device: Warp's name of the device.
        block_size: Threads per block; None for Warp's default.

    Raises:
        NoCacheError: The module is not in the cache and cannot be written there.
        Exception: Warp's own, if the module does not compile.
    """
    turn, key = _turn(), (module, device, block_size)
    if key in turn.done:
        return
    with turn.lock:
        if key not in turn.done:
            try:
                module.load(device, block_size)
            except OSError as error:
                if error.errno not in NO_WRITING:
                    raise
                raise NoCacheError(
                    f"Warp cannot write a kernel to {wp.config.kernel_cache_dir} ({error.strerror}): make room there, "
                    "raise the limit of files (ulimit -f), or set WARP_CACHE_PATH to another folder"
                ) from error
            turn.done.add(key)
