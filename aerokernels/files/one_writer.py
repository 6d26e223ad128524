"""Let one process at a time write to a place, by a lock beside it that ends with its process."""

import errno
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path

from ..process.opened import OPENED

WRITING = "writing"
# Errors of a place where no file can ever be made; a file system such as /proc raises the first.
NO_FILES = (errno.ENOENT, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR,
            errno.EISDIR, errno.ENXIO)  # fmt: skip


@contextmanager
def only_writer(path: Path) -> Iterator[None]:
    """Lock a place against other processes and threads that would write there.

    The holder may lock it again. Missing parent folders are made; they and the lock are removed at the end, unless the
    folders contain something else. A killed process leaves an empty hidden file, which locks nobody out. A file system
    without locks, and Windows, lock nobody out either.

    Args:
        path: The file or folder that is written; it need not exist.

    Raises:
        ValueError: Another process is writing there.
    """
    place = Path(os.path.realpath(path))
    key = WRITING, place, os.getpid(), threading.get_ident()
    if key in OPENED.held(WRITING):
        yield
        return
    new_folders = [parent for parent in place.parents if not parent.exists()]
    try:
        lock = _locked(place, f"out={path}")
        OPENED.once(key, lambda: True)
        try:
            yield
        finally:
            OPENED.take_out(key)
            if lock is not None:
                Path(lock.name).unlink(missing_ok=True)
                lock.close()
    finally:
        for parent in new_folders:
            with suppress(OSError):
                parent.rmdir()


def _locked(place: Path, label: str) -> TextIOWrapper | None:
    """Return the lock of a place; None if the system has no locks."""
    try:
        import fcntl
    except ImportError:
        return None
    while True:
        place.parent.mkdir(parents=True, exist_ok=True)
        beside = os.access(place.parent, os.W_OK | os.X_OK) or not place.is_dir()
        path = place.with_name(f".{place.name}.lock") if beside else place / ".lock"
        try:
            file = path.open("w")
        except OSError as fault:
            if fault.errno == errno.ENOENT and not place.parent.exists():
                continue  # another process has just removed the folder that it had made
            if fault.errno in NO_FILES:
                raise ValueError(f"{label}: no file can be made there ({fault.strerror}); take another") from None
            raise
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            # If the last holder removed the file before it was locked here, it is no lock.
            if path.exists() and path.stat().st_ino == os.fstat(file.fileno()).st_ino:
                return file
        except FileNotFoundError:
            pass
        except OSError as fault:
            file.close()
            if fault.errno in (errno.EWOULDBLOCK, errno.EACCES):
                raise ValueError(f"{label}: another process is at work there; wait for it, or take another") from None
            path.unlink(missing_ok=True)
            return None
        file.close()
