"""A family's patches, as kernels look them up: parameters, then a block, then a cell of it."""

from dataclasses import dataclass

import numpy as np

from ...derived import Derived
from .family import Family
from .hermite import CELLS, NODES, hermite_weights
from .nodes import Ways

# Numbers that head each block: parameters of its first node, cells per parameter along both axes; the number of its
# way; step error [m], steps and evaluations of its lines, at most.
HEADER = 8


@dataclass(frozen=True, eq=False)
class BundleTable(Derived):
    """Patches on the blocks of a family's parameters that hold, and how they were found.

    Attributes:
        family: The lines.
        ways: How lines come into the box and leave it.
        channels: How many of nodes.CHANNELS the patches have.
        map: Number of the block at each place, -1 where there is none, over the family's range, shape (mu, mv).
        header: HEADER numbers of each block, shape (block_count, 8).
        values: Value, slopes and mixed slope at the nodes of each block [per cell], shape (block_count, 5, 5, 4, c), in
            float32 where its rounding does not count.
        traced: Lines that were traced for it.
        error: Greatest estimated OPD error of the patches [m].
        refused: Why rays are not delivered, and how many about, by reason.
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
        """Places of the map per parameter, shape (2,)."""
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
    """The map of that shape, of blocks (n, 2) that are `stride` places wide, level by level; numbered in that order."""
    made = np.full(shape, -1, np.int32)
    first = 0
    for stride, some in blocks:
        view = made.reshape(shape[0] // stride, stride, shape[1] // stride, stride)
        view[some[:, 0], :, some[:, 1], :] = (first + np.arange(len(some), dtype=np.int32))[:, None, None]
        first += len(some)
    return made


assert NODES == CELLS + 1
