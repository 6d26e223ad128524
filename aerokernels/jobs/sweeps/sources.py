"""What tells whether the files that a sweep reads have changed since it began."""

import hashlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

WHOLE = 1 << 26  # bytes up to which all of a file counts; of a larger one its size and its two ends do
END = 1 << 22


def file_marks(sources: Iterable[Any]) -> dict[str, str]:
    """A mark for each of these texts that names a file or a folder: other content, another mark."""
    found = {}
    for source in sources:
        path = Path(source) if isinstance(source, (str, Path)) and str(source) else None
        if path is not None and path.exists():
            found[str(source)] = _mark(path)
    return found


def _mark(path: Path) -> str:
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
