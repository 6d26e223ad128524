"""Read the mesh of an SU2 run from a CGNS file: SU2 numbers its points as they are in the file's zone.

SU2 takes the coordinates as metres, whatever unit the file states, and so do its restarts.
"""

from pathlib import Path

import numpy as np

from ..calling import in_child
from ..dataset import Cells, Patch, ReadError


def cgns_meshes(path: Path) -> list[tuple[np.ndarray, Cells, list[Patch]]]:
    """Return points, cells and patches of each zone.

    Raises:
        ReadError: A damaged file, or zones that are structured, which SU2 does not read either.
    """
    found = in_child("cgns_file", path, None, {})
    if wrong := [block.name for block in found.blocks if block.cells is None]:
        raise ReadError(path, f"zone {wrong[0]!r} is structured", "give the mesh that SU2 read, which is unstructured")
    return [(block.points, block.cells, list(found.patches)) for block in found.blocks if block.cells is not None]
