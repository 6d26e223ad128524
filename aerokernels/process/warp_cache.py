"""Remove damaged modules from Warp's kernel cache, so that they are compiled again, and lend the others.

Warp does not check the files in its cache. A machine that loses power can leave empty files, at which every later run
would fail.
"""

import json
import re
import shutil
from contextlib import suppress
from pathlib import Path

from .compiled_files import ELF, is_whole

BEING_MADE = re.compile(r"_p\d+_t\d+$")  # folder in which a process is compiling; it is renamed at the end


def remove_damaged(cache: Path) -> list[Path]:
    """Remove the modules of a cache that have an empty file, code that is cut, or a description that is not JSON.

    Returns:
        The folders that were removed.
    """
    removed = []
    with suppress(OSError):  # no cache yet, or another process is removing modules too
        for folder in cache.glob("wp_*"):
            if folder.is_dir() and not BEING_MADE.search(folder.name) and not _is_whole(folder):
                shutil.rmtree(folder, ignore_errors=True)
                removed.append(folder)
    return removed


def lend_modules(cache: Path, place: Path) -> None:
    """Link the modules of a cache that takes no files into a new one, so that only others are compiled."""
    with suppress(OSError, NotImplementedError):  # not on this system: all are compiled
        for folder in cache.glob("wp_*"):
            if folder.is_dir() and not BEING_MADE.search(folder.name):
                (place / folder.name).mkdir()
                for file in folder.iterdir():
                    (place / folder.name / file.name).symlink_to(file)


def _is_whole(folder: Path) -> bool:
    try:
        for file in folder.iterdir():
            size = file.stat().st_size
            if not size:
                return False
            if file.suffix == ".o":
                with open(file, "rb") as code:
                    if code.read(len(ELF)) == ELF and not is_whole(code, size):  # other systems have other formats
                        return False
            if file.suffix == ".meta" and not isinstance(json.loads(file.read_bytes()), dict):
                return False
    except (ValueError, RecursionError):
        return False
    return True
