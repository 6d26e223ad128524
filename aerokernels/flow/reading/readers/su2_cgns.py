"""Read the mesh of an SU2 run from a CGNS file: SU2 numbers its points as they are in the file's zone.

SU2 takes the coordinates as metres, whatever unit the file states, and so do its restarts.
"""

from pathlib import Path

import numpy as np

from aerokernels.flow.reading.calling import in_child
from aerokernels.flow.reading.dataset import Cells, Patch, ReadError


def cgns_mesh(path: Path) -> tuple[np.ndarray, Cells, list[Patch]]:
    """Return points, cells and patches of its zone.

    Raises:
        ReadError: A damaged file, several zones, or a structured one, neither of which SU2 reads.
    """
    found = in_child("cgns_file", path, None, {})
    if len(found.blocks) != 1:
        fault = f"it has {len(found.blocks)} zones, and SU2 reads a mesh in CGNS of one"
        raise ReadError(path, fault, "give the mesh that SU2 read")
    (block,) = found.blocks
    if block.cells is None:
        raise ReadError(
            path, f"zone {block.name!r} is structured", "give the mesh that SU2 read, which is unstructured"
        )
    return block.points, block.cells, list(found.patches)
