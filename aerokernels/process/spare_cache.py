"""Make a temporary folder for compiled kernels, for this process alone, if the usual folder cannot take them."""

import atexit
import os
import shutil
import stat
import tempfile
import warnings
from contextlib import suppress
from pathlib import Path

LEAST_SPACE = 8 << 20  # [bytes] needed to build kernels; compilers may end the process if they cannot write them
TEMPORARY = ("/tmp", "/var/tmp", "/dev/shm")  # tried if the usual folder for temporary files takes no kernels


class NoCacheError(OSError):
    """No folder takes compiled kernels; the message says why and what to do."""


def why_unusable(folder: Path) -> str:
    """Return why no kernels can be built in a folder, which is made if missing; empty if they can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        return f"{folder} cannot be written ({error.strerror or type(error).__name__})"
    if not os.access(folder, os.W_OK | os.X_OK):
        return f"{folder} cannot be written (no right to write)"
    return f"the disk of {folder} is full" if _free_space(folder) < LEAST_SPACE else ""


def why_untrusted(folder: Path) -> str:
    """Return why another user could have put code into a folder; empty if none could.

    It, its links and the folders that contain it belong to this user or to root; others may write in none of them, but
    in those above it that keep each user's files from the others, as /tmp does.
    """
    if not hasattr(os, "geteuid"):  # Windows gives each user folders of his own
        return ""
    trusted = {os.geteuid(), 0, os.stat("/").st_uid}
    whole, real = Path(os.path.abspath(folder)), Path(os.path.realpath(folder))
    for place in dict.fromkeys((real, *real.parents, whole, *whole.parents)):
        try:
            state = os.lstat(place)
        except OSError as error:
            return f"{place} cannot be examined ({error.strerror or type(error).__name__})"
        if state.st_uid not in trusted:
            return f"{place} belongs to another user"
        others = stat.S_IWOTH | (stat.S_IWGRP if place == real and state.st_gid != os.getegid() else 0)
        if state.st_mode & others and not stat.S_ISLNK(state.st_mode):
            if place == real or not state.st_mode & stat.S_ISVTX:
                return f"{place} may be written by other users"
    return ""


def why_misread(folder: Path) -> str:
    """Return why a compiler that takes file names in UTF-8 would not find a folder; empty if it would.

    Where the locale has another encoding, Python decodes the name's bytes by that one.
    """
    same = os.fsencode(folder) == os.fspath(folder).encode("utf-8", "replace")
    return "" if same else f"the name of {folder} is not readable in this locale (set LC_ALL=C.UTF-8)"


def spare_cache(engine: str, why: str) -> str:
    """Make a new temporary folder, removed when the process ends, warn by a RuntimeWarning, and return its path.

    Args:
        engine: The engine that builds the kernels.
        why: Why the usual folder is not used.

    Raises:
        NoCacheError: No folder for temporary files can take kernels.
    """
    reasons = [why]
    folders = [temporary_folder(), *(Path(place) for place in TEMPORARY if os.path.isdir(place))]
    for folder in dict.fromkeys(filter(None, folders)):
        if reason := why_unusable(folder) or why_misread(folder):
            reasons.append(reason)
            continue
        place = tempfile.mkdtemp(prefix=f"aerokernels-{engine}-", dir=folder)
        atexit.register(shutil.rmtree, place, ignore_errors=True)
        warnings.warn(f"{why}: kernels are built in {place} for this process", RuntimeWarning, stacklevel=2)
        return place
    raise NoCacheError(
        f"{'; '.join(reasons)}: no folder takes the kernels that {engine} builds; set TMPDIR to a folder that can be "
        f"written and has {LEAST_SPACE >> 20} MiB of space"
    )


def temporary_folder() -> Path | None:
    """Return Python's folder for temporary files; None if it finds none that can be written."""
    with suppress(FileNotFoundError):
        return Path(tempfile.gettempdir())
    return None


def _free_space(folder: Path) -> float:
    """Return the free space in a folder [bytes]; infinite if unknown."""
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return float("inf")
