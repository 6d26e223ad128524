"""Kernels loaded from Warp's cache, and built again where what it holds is damaged."""

import shutil
import warnings
from contextlib import suppress
from pathlib import Path

import warp as wp


def load_module(module, device: str, block_size: int | None) -> None:
    """Compile a Warp module for a device, or load what was compiled.

    What the cache holds of it is removed where it does not load, with a RuntimeWarning, and compiled again, once.

    Args:
        module: A warp.Module.
        device: Warp's name of the device.
        block_size: Threads to a block; None takes Warp's own.

    Raises:
        Exception: Warp's own, where it does not compile.
    """
    try:
        module.load(device, block_size)
    except Exception as error:  # Warp raises bare Exceptions, and JSON's and NumPy's of damaged files
        folder = _cached(module, block_size)
        if folder is None:
            raise
        shutil.rmtree(folder, ignore_errors=True)
        why = " ".join(str(error).split())
        warnings.warn(
            f"Warp's kernel cache in {folder} does not load ({why}): built anew", RuntimeWarning, stacklevel=2
        )
        module.load(device, block_size)


def _cached(module, block_size: int | None) -> Path | None:
    """The folder of Warp's cache with this module; None where there is none, so that nothing in it is at fault."""
    with suppress(Exception):  # names that another version of Warp may not have
        folder = Path(wp.config.kernel_cache_dir) / module.get_module_identifier(block_size)
        if folder.name.startswith("wp_") and folder.is_dir():
            return folder
    return None
