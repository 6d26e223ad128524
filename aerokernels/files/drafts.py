"""Name the drafts of files and folders, written beside those they will replace, and remove abandoned drafts.

A process that is killed leaves its draft, and the next process to write to the same place removes it. A draft's name
contains the machine and the process that writes it; a draft whose process has ended is abandoned.
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
    """There is no space for results; the message names the place and the remedy."""

    def __init__(self, place: Path, fault: OSError, name: str = "--out "):
        """Make a message of one line; `name` precedes the place in it."""
        super().__init__(f"{name}{place}: {os.strerror(fault.errno or 0)}: make room, or choose another place")
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
