"""Write drafts of files and folders beside those they will replace, and remove abandoned drafts.

A process that is killed leaves its draft, and the next process to write to the same place removes it. A draft's name
contains the machine and the process that writes it; a draft whose process has ended is abandoned.
"""

import errno
import os
import re
import shutil
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class OutputError(OSError):
    """There is no space for results; the message names the place and the remedy."""

    def __init__(self, place: Path, fault: OSError, name: str = "out=", kept: Path | None = None):
        """Make a message of one line.

        Args:
            place: Where there is no space.
            fault: What the system said.
            name: Precedes the place in the message.
            kept: The folder in which the results are instead.
        """
        remedy = "make room, or choose another place"
        if kept is not None:
            remedy = f"the results are in {kept} instead: move them to where there is room"
        super().__init__(f"{name}{place}: {os.strerror(fault.errno or 0)}: {remedy}")
        self.errno = fault.errno


def draft_of(path: Path) -> Path:
    """Return this process's draft of `path`, a hidden name beside it, after removing abandoned drafts of `path`."""
    here = _machine()
    pattern = re.compile(rf"{re.escape(f'.{path.name}.partial-{here}-')}(\d+)")
    with suppress(OSError):  # a folder that does not exist or cannot be listed has no drafts
        for other in path.parent.iterdir():
            found = pattern.fullmatch(other.name)
            if found and not _lives(int(found[1])):
                _remove(other)
    return path.with_name(f".{path.name}.partial-{here}-{os.getpid()}")


@contextmanager
def replacing(*paths: Path, name: str = "") -> Iterator[tuple[Path, ...]]:
    """Yield drafts that replace files on success and are removed on failure: readers find old files or new ones.

    Each draft has its file's own name, in a hidden folder beside it. A link is followed; what is no regular file, such
    as /dev/stdout, is written as it is.

    Args:
        *paths: The files.
        name: Precedes a path in messages, such as "out=".

    Raises:
        ValueError: A path is a folder, or its folder does not exist.
        OutputError: The disk is full.
    """
    with ExitStack() as stack:
        drafts = [stack.enter_context(_draft(path, name)) for path in paths]
        yield tuple(drafts)


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
    folder = draft_of(target)
    draft = folder / target.name
    try:
        folder.mkdir(exist_ok=True)  # of a process of this number, before a restart
        yield draft
        if draft.exists():
            draft.replace(target)
    except OSError as fault:
        raise (OutputError(path, fault, name) if fault.errno in FULL else fault) from fault
    finally:
        _remove(folder)


def _machine() -> str:
    """Return this machine's name as a part of a file name."""
    return re.sub(r"[^A-Za-z0-9.]", "_", socket.gethostname())[:40]


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # another user's process, or not a process number: keep the draft
        return True
    return True


def _remove(draft: Path) -> None:
    if draft.is_dir() and not draft.is_symlink():
        shutil.rmtree(draft, ignore_errors=True)
    else:
        with suppress(OSError):
            draft.unlink()
