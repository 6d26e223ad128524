"""Write files and folders whole or not at all, by one process at a time; NetCDF files and grey pictures among them.

What is written is a draft first, a hidden name beside what it replaces, which a rename puts in place. A process that is
killed leaves its draft, and the next one that writes to the same place removes it.
"""

import errno
import io
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
# Errors of a place where no file can ever be made; a file system such as /proc raises the first.
NO_FILES = (errno.ENOENT, errno.EACCES, errno.EPERM, errno.EROFS, errno.ENAMETOOLONG, errno.ELOOP, errno.ENOTDIR,
            errno.EISDIR, errno.ENXIO)  # fmt: skip
FORMATS = {".tif": "TIFF", ".tiff": "TIFF", ".png": "PNG"}  # of grey pictures, by the ending of the file


class OutputError(OSError):
    """There is no space for results; the message names the place, after `name`, and the remedy."""

    def __init__(self, place: Path, fault: OSError, name: str = "out="):
        """Make a message of one line of what the system said."""
        super().__init__(f"{name}{place}: {os.strerror(fault.errno or 0)}: make room, or choose another place")
        self.errno = fault.errno


@contextmanager
def in_room(place: Path, name: str = "out=") -> Iterator[None]:
    """Convert errors of a full disk to an OutputError that names the place; the outermost place is named."""
    try:
        yield
    except OSError as fault:
        if fault.errno in FULL:
            raise OutputError(place, fault, name) from fault
        raise


@contextmanager
def only_writer(path: Path, name: str = "out=") -> Iterator[None]:
    """Lock a file or folder, which need not exist, against other processes and threads that would write there.

    The thread that holds the lock may take it again. Missing parent folders are made; they and the lock are removed at
    the end, unless the folders contain something else. A killed process leaves an empty hidden file, which locks nobody
    out. A file system without locks locks nobody out either.

    Raises:
        ValueError: Another process is writing there, or no file can be made there; `name` precedes the place.
    """
    from filelock import FileLock, Timeout

    place = Path(os.path.realpath(path))
    new_folders = [parent for parent in place.parents if not parent.exists()]
    with ExitStack() as held:
        for parent in reversed(new_folders):
            held.callback(_quietly, parent.rmdir)  # if it is empty
        try:
            place.parent.mkdir(parents=True, exist_ok=True)
            beside = os.access(place.parent, os.W_OK | os.X_OK) or not place.is_dir()
            file = place.with_name(f".{place.name}.lock") if beside else place / ".lock"
            file.touch()  # an error of the place, which the lock would take for that of another process
        except OSError as fault:
            if fault.errno in NO_FILES:
                raise ValueError(f"{name}{path}: no file can be made there ({fault.strerror}); take another") from None
            raise
        lock = FileLock(file, timeout=0, is_singleton=True)
        try:
            held.enter_context(lock)
        except Timeout:
            text = "another process is at work there; wait for it, or take another"
            raise ValueError(f"{name}{path}: {text}") from None
        except (NotImplementedError, OSError):
            pass
        if lock.lock_counter <= 1:
            held.callback(_quietly, file.unlink)
        yield


def _quietly(remove: Callable[[], None]) -> None:
    with suppress(OSError):
        remove()


def draft_of(path: Path) -> Path:
    """Return, to the only writer of `path`, its draft, a hidden name beside it, without what a killed process left."""
    draft = path.with_name(f".{path.name}.partial")
    if draft.is_dir() and not draft.is_symlink():
        shutil.rmtree(draft, ignore_errors=True)
    else:
        _quietly(draft.unlink)
    return draft


@contextmanager
def replacing(*paths: Path, name: str = "") -> Iterator[tuple[Path, ...]]:
    """Yield drafts that replace files on success and are removed on failure: readers find old files or new ones.

    Each draft has its file's own name, in a hidden folder beside it. A link is followed; what is no regular file, such
    as /dev/stdout, is written as it is. `name`, such as "out=", precedes a path in messages.

    Raises:
        ValueError: A path is a folder, its folder does not exist, or another process is writing there.
        OutputError: The disk is full.
    """
    with ExitStack() as stack:
        yield tuple([stack.enter_context(_draft(path, name)) for path in paths])


@contextmanager
def _draft(path: Path, name: str) -> Iterator[Path]:
    if path.is_dir():
        raise ValueError(f"{name}{path}: is a folder: give the name of a file in it")
    if not path.parent.is_dir():
        raise ValueError(f"{name}{path}: folder {path.parent} does not exist: make it, or choose another one")
    target = path.resolve()
    if target.exists() and not target.is_file():
        yield path
        return
    with in_room(path, name), only_writer(target, name):
        folder = draft_of(target)
        try:
            folder.mkdir()
            yield folder / target.name
            if (folder / target.name).exists():
                (folder / target.name).replace(target)
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def write_netcdf(path: Path, dataset: "xarray.Dataset", encoding: Mapping[str, Any] | None = None) -> None:
    """Write a dataset as NetCDF-4; `encoding` by variable, as in xarray. After an OSError the file is incomplete."""
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    memory = io.BytesIO()  # HDF5 ends the process if it cannot close a file, see RetryingFile
    with h5netcdf.File(memory, "w") as file:
        dataset.dump_to_store(H5NetCDFStore(file, autoclose=False), encoding=encoding or {})
    path.write_bytes(memory.getbuffer())


class RetryingFile(io.FileIO):
    """A new or emptied file that accepts every byte, drops those that cannot be written, and keeps the first error.

    HDF5 cannot close a file to which it cannot write: it prints many errors and ends the process with a segmentation
    fault. With this file it can close, and the caller raises `failure` instead.
    """

    def __init__(self, path: Path) -> None:
        """Create or empty the file."""
        super().__init__(path, "w+")
        self.failure: OSError | None = None

    def write(self, data: Any) -> int:
        """Write all of `data`, or drop it."""
        left = memoryview(data).cast("B")
        size = len(left)
        try:
            while left:
                left = left[super().write(left) :]
        except OSError as error:
            self.failure = self.failure or error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Shorten or lengthen the file, if there is space."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0

    def readinto(self, buffer: Any) -> int:
        """Read what was written, with zeros for dropped bytes."""
        room = memoryview(buffer).cast("B")
        count = super().readinto(room)
        room[count:] = bytes(len(room) - count)
        return len(room)


def write_grey(path: str | Path, brightness, format: str | None = None) -> None:
    """Write brightness 0 to 1, shape (rows, columns), with rows from the lowest up, as a 16-bit grey picture.

    NaN is black. `format` is "PNG" or "TIFF", by default that of the file's ending.

    Raises:
        ValueError: Another ending, a folder that does not exist, or an array that has not two axes.
        OutputError: The disk is full; an earlier file is as it was.
    """
    import numpy as np
    from PIL import Image

    path, brightness = Path(path), np.asarray(brightness)
    format = format or FORMATS.get(path.suffix.lower())
    if format is None:
        raise ValueError(f"picture {path}: the ending must be one of {', '.join(FORMATS)}")
    if brightness.ndim != 2:
        raise ValueError(f"a picture must have two axes [y, x], got shape {brightness.shape}")
    levels = np.rint(np.clip(np.nan_to_num(brightness), 0.0, 1.0) * 65535.0).astype(np.uint16)
    picture = io.BytesIO()  # Pillow does not notice that a full disk takes a part of the last block only
    Image.fromarray(np.ascontiguousarray(levels[::-1])).save(picture, format=format)
    with replacing(path) as (draft,):
        draft.write_bytes(picture.getbuffer())
