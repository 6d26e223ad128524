"""Detect whether the files that a sweep reads have changed since it began, by hashes of their contents."""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

WHOLE = 1 << 26  # [bytes] a file up to this size is hashed whole; of a larger one, its size and both ends are hashed
END = 1 << 22  # [bytes] of either end


def content_hashes(sources: Iterable[Any]) -> dict[str, str]:
    """Return a hash of the content for each of the texts that names a file or a folder."""
    found = {}
    for source in sources:
        path = Path(source) if isinstance(source, (str, Path)) and str(source) else None
        if path is not None and path.exists():
            found[str(source)] = _content_hash(path)
    return found


def _content_hash(path: Path) -> str:
    files = [path] if path.is_file() else sorted(one for one in path.rglob("*") if one.is_file())
    sum_ = hashlib.sha256()
    for file in files:
        size = file.stat().st_size
        sum_.update(f"{file.relative_to(path) if file != path else ''} {size}\n".encode())
        with file.open("rb") as data:
            if size <= WHOLE:
                sum_.update(data.read())
            else:
                sum_.update(data.read(END))
                data.seek(size - END)
                sum_.update(data.read(END))
    return sum_.hexdigest()[:32]
