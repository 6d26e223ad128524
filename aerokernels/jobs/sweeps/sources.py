"""Detect whether the files that a sweep reads have changed since it began, by hashes of their contents."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from aerokernels.flow.reading.formats import files_behind

WHOLE = 1 << 26  # [bytes] a file up to this size is hashed whole; of a larger one, its size and pieces are hashed
# Of a flow that was computed again both ends may be as they were: numbers of cells, and undisturbed air.
PIECES, PIECE = 1024, 1 << 14  # evenly from one end to the other; [bytes] of each


def content_hashes(sources: Iterable[Any]) -> dict[str, str]:
    """Return a hash of the content for each of the texts that names a file or a folder.

    The content is that of all files that are read with it: the pieces that it names, the mesh beside it, a whole case.
    """
    found = {}
    for source in sources:
        path = Path(source) if isinstance(source, (str, Path)) and str(source) else None
        if path is not None and path.exists():
            found[str(source)] = _content_hash(path)
    return found


def _content_hash(path: Path) -> str:
    sum_ = hashlib.sha256()
    for file in files_behind(path):
        size = file.stat().st_size
        sum_.update(f"{os.path.relpath(file, path) if file != path else ''} {size}\n".encode(errors="surrogateescape"))
        with file.open("rb") as data:
            if size <= WHOLE:
                sum_.update(data.read())
                continue
            for number in range(PIECES):
                data.seek(number * (size - PIECE) // (PIECES - 1))
                sum_.update(data.read(PIECE))
    return sum_.hexdigest()[:32]
