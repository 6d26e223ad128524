"""The patches of a family as kernels look them up: from a ray's parameters to a block, and to a cell of that block."""

from dataclasses import dataclass

import numpy as np

from ...derived import Derived
from .family import Family
from .hermite import CELLS, NODES, hermite_weights
from .nodes import Ways

# Numbers in the header of a block: parameters of its first node (2), cells per unit of each parameter (2), the class of
# its lines (nodes.Ways), and the greatest step error [m], step count and evaluation count of its lines.
HEADER = 8


@dataclass(frozen=True, eq=False)
class BundleTable(Derived):
    """The patches of a family that meet the tolerance, and how they were found.

    Attributes:
        family: The lines.
        ways: Classes of lines by the faces through which they enter and leave the box.
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
    ways: Ways
    channels: int
    map: np.ndarray
    header: np.ndarray
    values: np.ndarray
    traced: int
    error: float
    refused: dict[str, float]

    @property
    def precision(self) -> str:
        """That of `values`."""
        return str(self.values.dtype)

    @property
    def rate(self) -> np.ndarray:
        """Places of the map per unit of each parameter, shape (2,)."""
        return np.asarray(self.map.shape / (self.family.high - self.family.low))

    def find(self, position: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The block of each ray (n, 3), -1 for those that belong to none, and its parameters."""
        parameters = self.family.parameters(position, direction)
        place = np.floor((parameters - self.family.low) * self.rate).astype(np.int64)
        inside = ((place >= 0) & (place < self.map.shape)).all(axis=1)
        place = np.where(inside[:, None], place, 0)
        block = np.where(inside & self.family.holds_for(position, direction), self.map[tuple(place.T)], -1)
        if not self.ways.are_all_alike:
            alike = self.header[np.maximum(block, 0), 4] == self.ways.numbers(position, direction)
            block = np.where(alike, block, -1)
        return block, parameters

    def evaluate(self, block: np.ndarray, parameters: np.ndarray) -> np.ndarray:
        """CHANNELS of rays in some blocks (n,) with their parameters (n, 2), shape (n, c)."""
        head = self.header[block]
        place = (parameters - head[:, :2]) * head[:, 2:4]
        cell = np.clip(place.astype(np.int64), 0, CELLS - 1)
        wu, wv = (hermite_weights(share) for share in (place - cell).T)
        found = np.zeros((len(block), self.channels))
        for a in (0, 1):
            for b in (0, 1):
                node = self.values[block, cell[:, 0] + a, cell[:, 1] + b]
                weights = [wu[2 * a + k % 2] * wv[2 * b + k // 2] for k in range(4)]
                found += np.einsum("kn,nkc->nc", np.stack(weights), node)
        return found


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
