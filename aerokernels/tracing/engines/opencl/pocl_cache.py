"""Check PoCL's kernel cache before PoCL reads it: an incomplete file there would end the process at every start.

PoCL keeps for every program a folder with LLVM bitcode (`program.bc`) and a library for each kernel (`*.so`). After a
full disk or a power failure these may be cut or partly zero, which ends in a signal that no `except` can catch.
"""

import os
import shutil
import time
import warnings
from contextlib import suppress
from pathlib import Path

from aerokernels.process.quiet_warp import is_whole, spare_cache, why_unusable

VARIABLE = "POCL_CACHE_DIR"
CHECKED = "aerokernels-checked"  # an empty file, whose time is that of the last check
SETTLED = 5.0  # [s] without a change after which an incomplete file is no longer being written


def cache_folder() -> Path:
    """Return the folder that PoCL will use, by PoCL's rules; `make_safe` names it to PoCL if a variable is empty."""
    if named := os.environ.get(VARIABLE):
        return Path(named)
    if caches := os.environ.get("XDG_CACHE_HOME"):
        return Path(caches) / "pocl" / "kcache"
    if home := os.environ.get("HOME"):
        return Path(home) / ".cache" / "pocl" / "kcache"
    return Path("/tmp/pocl/kcache")


def make_safe() -> None:
    """Remove damaged programs from the cache, once per process and before its driver is opened.

    If that is impossible, if the folder cannot be written or if the disk is full, this process gets its own cache in
    the folder for temporary files. All cases are reported as a RuntimeWarning.

    Raises:
        NoCacheError: No folder for temporary files can take kernels either.
    """
    folder = cache_folder()
    why = why_unusable(folder)
    damaged = [] if why else remove_damaged(folder)
    if left := [path for path in damaged if path.exists()]:
        why = f"{left[0]} is damaged and cannot be removed"
    if why:
        os.environ[VARIABLE] = spare_cache("pocl", why)
        return
    if "" in map(os.environ.get, (VARIABLE, "XDG_CACHE_HOME", "HOME")):  # PoCL takes an empty one for a folder's name
        os.environ[VARIABLE] = str(folder)
    if damaged:
        count = f"{len(damaged)} programs" if len(damaged) > 1 else "a program"
        warnings.warn(
            f"PoCL's kernel cache in {folder} had {count} with damaged files: they are removed and built again",
            RuntimeWarning,
            stacklevel=2,
        )


def remove_damaged(folder: Path) -> list[Path]:
    """Remove the folders of programs with an incomplete file written since the last check; return them."""
    begun, checked = time.time(), folder / CHECKED
    last = checked.stat().st_mtime - SETTLED if checked.exists() else 0.0
    damaged: dict[Path, None] = {}
    for path in [*folder.glob("??/**/*.bc"), *folder.glob("??/**/*.so")]:
        with suppress(FileNotFoundError):  # another process removed it
            if path.stat().st_mtime >= last and not _is_whole(path):
                damaged[folder.joinpath(*path.relative_to(folder).parts[:2])] = None
    for program in damaged:
        shutil.rmtree(program, ignore_errors=True)
    with suppress(OSError):
        checked.touch()
        os.utime(checked, (begun, begun))
    return list(damaged)


def _is_whole(path: Path) -> bool:
    """Whether a file is complete; another process may be writing it now."""
    while True:
        state = path.stat()
        with open(path, "rb") as file:
            if is_whole(file, state.st_size):
                return True
        if not 0.0 <= time.time() - state.st_mtime < SETTLED:
            return False
        time.sleep(0.05)
