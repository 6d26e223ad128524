"""Make a temporary folder for compiled kernels, for this process alone, if the usual folder cannot be written."""

import atexit
import os
import shutil
import tempfile
import warnings
from pathlib import Path


def why_unwritable(folder: Path) -> str:
    """Return why no files can be written to a folder, which is made if missing; empty if they can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return error.strerror or type(error).__name__
    return "" if os.access(folder, os.W_OK | os.X_OK) else "no right to write"


def spare_cache(engine: str, why: str) -> str:
    """Make a new temporary folder, removed when the process ends, warn by a RuntimeWarning, and return its path.

    Args:
        engine: The engine that builds the kernels.
        why: Why the usual folder is not used.
    """
    place = tempfile.mkdtemp(prefix=f"aerokernels-{engine}-")
    atexit.register(shutil.rmtree, place, ignore_errors=True)
    warnings.warn(f"{why}: kernels are built in {place} for this process", RuntimeWarning, stacklevel=2)
    return place
