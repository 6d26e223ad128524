"""Names of files and folders that are being written beside those that they replace, and what becomes of abandoned ones.

A process that is killed leaves its draft. Whoever writes to the same place next removes it: a draft names the machine
and the process that make it, and one whose process is no more is nobody's.
"""

import errno
import os
import re
import shutil
import socket
from contextlib import suppress
from pathlib import Path

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


class OutputError(OSError):
    """There is no room for results; the message names the place and the remedy."""

    def __init__(self, place: Path, fault: OSError, name: str = "--out "):
        """Say it in one line; `name` is what the place is called."""
        super().__init__(f"{name}{place}: {os.strerror(fault.errno or 0)}: make room, or choose another place")
        self.errno = fault.errno


def draft_of(path: Path) -> Path:
    """Where this process writes what `path` is to become: hidden, beside it. Abandoned drafts of it are removed."""
    here = _machine()
    pattern = re.compile(rf"{re.escape(f'.{path.name}.partial-{here}-')}(\d+)")
    with suppress(OSError):  # a folder that is not there yet, or cannot be looked into, has none
        for other in path.parent.iterdir():
            found = pattern.fullmatch(other.name)
            if found and not _lives(int(found[1])):
                _remove(other)
    return path.with_name(f".{path.name}.partial-{here}-{os.getpid()}")


def _machine() -> str:
    """This machine, as a part of a file's name."""
    return re.sub(r"[^A-Za-z0-9.]", "_", socket.gethostname())[:40]


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):  # somebody else's, or no number of a process: left alone
        return True
    return True


def _remove(draft: Path) -> None:
    if draft.is_dir() and not draft.is_symlink():
        shutil.rmtree(draft, ignore_errors=True)
    else:
        with suppress(OSError):
            draft.unlink()
