"""The patches of a family as kernels read them: from a ray's parameters to a block, and to one of its cells."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...derived import Derived
from .family import Family
from .hermite import CELLS, NODES
from .nodes import FaceClasses

# Numbers in the header of a block: parameters of its first node (2), cells per unit of each parameter (2), the class of
# its lines (nodes.FaceClasses), and the greatest step error [m], step count and evaluation count of its lines.
HEADER = 8


@dataclass(frozen=True, eq=False)
class BundleTable(Derived):
    """The patches of a family that meet the tolerance, and how they were found.

    Attributes:
        family: The lines.
        classes: Classes of lines by the faces through which they enter and leave the box.
        channels: How many of nodes.CHANNELS the patches have.
        map: Number of the block at each place of the parameter range, -1 where there is none, shape (mu, mv).
        header: HEADER numbers of each block, shape (block_count, 8).
        values: Value, slopes and mixed slope at the nodes of each block [per cell], shape (block_count, 5, 5, 4, c), in
            float32 where its rounding is negligible.
        traced: Number of traced lines.
        error: Greatest estimated OPD error of the patches [m].
        refused: Approximate number of rays that are not interpolated, by reason.
    """

    family: Family
    classes: FaceClasses
    channels: int
    map: np.ndarray
    header: np.ndarray
    values: np.ndarray
    traced: int
    error: float
    refused: dict[str, float]

    @cached_property
    def precision(self) -> str:
        """The precision of `values`."""
        return str(self.values.dtype)

    @property
    def rate(self) -> np.ndarray:
        """Places of the map per unit of each parameter, shape (2,)."""
        return np.asarray(self.map.shape / (self.family.high - self.family.low))


def map_of(shape: tuple[int, int], blocks: list[tuple[int, np.ndarray]]) -> np.ndarray:
    """The map of block numbers; `blocks` holds the width in places and the indices (n, 2) of each level's blocks."""
    made = np.full(shape, -1, np.int32)
    first = 0
    for stride, some in blocks:
        view = made.reshape(shape[0] // stride, stride, shape[1] // stride, stride)
        view[some[:, 0], :, some[:, 1], :] = (first + np.arange(len(some), dtype=np.int32))[:, None, None]
        first += len(some)
    return made


assert NODES == CELLS + 1
