"""Load kernels from Warp's cache, and build them again if their files are damaged."""

import errno
import shutil
import warnings
from contextlib import suppress
from pathlib import Path

import warp as wp

from ....files.drafts import FULL
from ....process.spare_cache import NoCacheError

NO_WRITING = (*FULL, errno.EACCES, errno.EPERM, errno.EROFS)


def load_module(module, device: str, block_size: int | None) -> None:
    """Load a Warp module for a device from the cache, or compile it.

    If the cached files do not load, they are removed, with a RuntimeWarning, and the module is compiled again, once.

    Args:
        module: A warp.Module.
        device: Warp's name of the device.
        block_size: Threads per block; None for Warp's default.

    Raises:
        NoCacheError: The module is not in the cache and cannot be written there.
        Exception: Warp's own, if the module does not compile.
    """
    try:
        module.load(device, block_size)
    except Exception as error:  # Warp raises bare Exceptions, and for damaged files those of JSON and NumPy
        if isinstance(error, OSError) and error.errno in NO_WRITING:
            raise NoCacheError(
                f"Warp cannot write a kernel to {wp.config.kernel_cache_dir} ({error.strerror}): make room there, "
                "raise the limit of files (ulimit -f), or set WARP_CACHE_PATH to another folder"
            ) from error
        folder = _cached(module, block_size)
        if folder is None:
            raise
        shutil.rmtree(folder, ignore_errors=True)
        why = " ".join(str(error).split())
        warnings.warn(
            f"Warp's kernel cache in {folder} does not load ({why}): it is built again", RuntimeWarning, stacklevel=2
        )
        module.load(device, block_size)


def _cached(module, block_size: int | None) -> Path | None:
    """Return the folder of this module in Warp's cache; None if there is none, so that the cache is not the cause."""
    with suppress(Exception):  # another version of Warp may not have these names
        folder = Path(wp.config.kernel_cache_dir) / module.get_module_identifier(block_size)
        if folder.name.startswith("wp_") and folder.is_dir():
            return folder
    return None
