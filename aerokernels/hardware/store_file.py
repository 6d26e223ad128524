"""The SQLite address of a store's file, after checking how it may be opened."""

import os
from pathlib import Path


def store_address(path: Path, *, read_only: bool) -> str:
    """Return the address by which SQLite opens a store.

    A finished store in a read-only folder (an archive) is opened without the log that SQLite otherwise creates beside
    it: nobody can be writing there.

    Args:
        path: the file.
        read_only: open for reading only; otherwise the file is created if it does not exist.

    Raises:
        ValueError: the file or its folder does not exist, is not a file, or may not be written.
    """
    if not path.parent.is_dir():
        raise ValueError(f"store {path}: folder {path.parent} does not exist; make it first")
    address = path.absolute().as_uri()
    if not read_only:
        if path.exists() and not path.is_file():
            raise ValueError(f"store {path}: a folder or a device, not a file; give another file name")
        if path.is_file() and not os.access(path, os.W_OK):
            raise ValueError(f"store {path}: no permission to write it; allow it, or give another file name")
        return f"{address}?mode=rwc"
    if not path.is_file():
        if path.exists():
            raise ValueError(f"store {path}: a folder or a device, not a file; give the file that `record` wrote")
        raise ValueError(f"store {path}: no such file; record one with `aerokernels record --store`")
    file = path.resolve()  # SQLite creates the log beside the file itself, not beside a link to it
    log_exists = file.with_name(f"{file.name}-wal").exists()
    archived = not log_exists and not os.access(file.parent, os.W_OK)
    return f"{address}?mode=ro{'&immutable=1' if archived else ''}"
