"""Warp's kept kernels: what a crash of the machine left of them is removed, and they are compiled again.

Warp takes what lies in its folder for whole. A machine that loses its power leaves files without a byte, at which every
later run would end.
"""

import json
import re
import shutil
from contextlib import suppress
from pathlib import Path

BEING_MADE = re.compile(r"_p\d+_t\d+$")  # by a process that compiles now, which gives it its name at the end


def remove_damaged(cache: Path) -> list[Path]:
    """Remove the modules of a cache that are not whole: a file of them is empty, or their description is no JSON.

    Returns:
        The folders that were removed.
    """
    removed = []
    with suppress(OSError):  # no cache yet, or another process cleans up as well
        for folder in cache.glob("wp_*"):
            if folder.is_dir() and not BEING_MADE.search(folder.name) and not _is_whole(folder):
                shutil.rmtree(folder, ignore_errors=True)
                removed.append(folder)
    return removed


def _is_whole(folder: Path) -> bool:
    try:
        for file in folder.iterdir():
            if not file.stat().st_size:
                return False
            if file.suffix == ".meta" and not isinstance(json.loads(file.read_bytes()), dict):
                return False
    except (ValueError, RecursionError):
        return False
    return True
