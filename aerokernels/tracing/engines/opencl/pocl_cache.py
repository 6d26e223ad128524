"""Check PoCL's kernel cache before PoCL reads it: a damaged file there would end the process at every start.

PoCL keeps for every program a folder with LLVM bitcode (`program.bc`) and a library for each kernel (`*.so`), and reads
them without checks: a file cut short by a full disk or a power failure ends in SIGABRT or SIGBUS inside the driver,
which no `except` can catch. So before the driver is opened, each file is compared with a record of its size and time,
and of its checksum if these differ. If a file is not in the record yet, its structure is checked, which detects a file
that is cut or partly zero. The folder of a program with a damaged file is removed, and PoCL builds it again; so it does
all programs where there is no record, or a damaged one.
"""

import io
import json
import os
import shutil
import time
import warnings
import zlib
from contextlib import suppress
from pathlib import Path

from aerokernels.process.kernel_cache import is_whole, spare_cache, why_unusable

VARIABLE = "POCL_CACHE_DIR"
RECORD = "aerokernels-checked.json"  # beside PoCL's folders, which have names of two letters
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
            f"PoCL's kernel cache in {folder} had {count} with damaged files, or without a record of whole ones: they "
            "are removed and built again",
            RuntimeWarning,
            stacklevel=2,
        )


def remove_damaged(folder: Path) -> list[Path]:
    """Remove the folders of programs with damaged files, and record the intact files; return the folders removed.

    Without a record all are removed that were written before now: what another process builds now is checked.
    """
    begun = time.time()
    record = _read_record(folder)
    known = record or {}
    added = [path.relative_to(folder).as_posix() for kind in ("bc", "so") for path in folder.glob(f"??/**/*.{kind}")]
    seen: dict[str, list[int]] = {}
    damaged: dict[Path, None] = {}
    for path in dict.fromkeys([*known, *added]):
        place, recorded = folder / path, known.get(path)
        try:
            state = place.stat()
            if recorded is not None and recorded[:2] == [state.st_size, state.st_mtime_ns]:
                seen[path] = recorded
                continue
            if record is None and state.st_mtime < begun:
                raise OSError("not recorded")
            content = place.read_bytes()
            whole = is_whole(io.BytesIO(content), len(content))
            # Another process may be writing it now.
            while not whole and recorded is None and 0.0 <= time.time() - state.st_mtime < SETTLED:
                time.sleep(0.05)
                state, content = place.stat(), place.read_bytes()
                whole = is_whole(io.BytesIO(content), len(content))
            stamp = [state.st_size, state.st_mtime_ns, zlib.crc32(content)]
            if whole and (recorded is None or recorded[2] == stamp[2]):
                seen[path] = stamp
                continue
        except FileNotFoundError:  # another process removed it
            continue
        except OSError:  # a folder in its place, no right to read it, or no record
            pass
        damaged[folder.joinpath(*Path(path).parts[:2])] = None
    for program in damaged:
        shutil.rmtree(program, ignore_errors=True)
    if seen != record:
        _write_record(folder, seen)
    return list(damaged)


def _read_record(folder: Path) -> dict[str, list[int]] | None:
    """Return size, time and checksum of files by path; None without a record, or where it is damaged."""
    try:
        record = json.loads((folder / RECORD).read_bytes())
        for path, stamp in record.items():
            if path.startswith("/") or ".." in path or [type(part) for part in stamp] != [int, int, int]:
                return None
        return dict(record)
    except (OSError, ValueError, TypeError, AttributeError, RecursionError):
        return None


def _write_record(folder: Path, record: dict[str, list[int]]) -> None:
    beside = folder / f"{RECORD}.{os.getpid()}"
    with suppress(OSError):  # no right to write, or no space: the next start checks structures again
        try:
            beside.write_text(json.dumps(record))
            beside.replace(folder / RECORD)
        finally:
            beside.unlink(missing_ok=True)
