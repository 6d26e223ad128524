"""A folder for compiled kernels where the usual one cannot be written, for this process alone."""

import atexit
import os
import shutil
import tempfile
import warnings
from pathlib import Path


def why_unwritable(folder: Path) -> str:
    """Why a folder, which is made if it is not there, takes no files; empty where it does."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return error.strerror or type(error).__name__
    return "" if os.access(folder, os.W_OK | os.X_OK) else "no right to write"


def spare_cache(engine: str, why: str) -> str:
    """Path of a new folder beside other temporary files, removed when the process ends; a RuntimeWarning says so.

    Args:
        engine: What builds the kernels.
        why: Why they do not go where they usually do.
    """
    place = tempfile.mkdtemp(prefix=f"aerokernels-{engine}-")
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    warnings.warn(f"{why}: kernels are built in {place} for this process", RuntimeWarning, stacklevel=2)
    return place
