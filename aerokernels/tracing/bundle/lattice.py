"""Traced lines on lattices of parameters, each twice as fine as the last, in blocks of four by four cells.

Of a fine lattice only few lines are traced, but its arrays have room for all nodes. They are zero where none is traced
and are read and written at traced nodes only, so that the system provides no memory for the rest.
"""

from dataclasses import dataclass

import numpy as np

from ..blocks import greatest_around
from .hermite import BESIDE, CELLS, FINER, NODES, WINDOW, finer, patches
from .nodes import CHANNELS, Traced

# Blocks along the shorter and along the longer axis of the coarsest lattice: at least, and at most.
FEWEST, MOST = 2, 8


@dataclass(eq=False)
class Lattice:
    """Lines with parameters on a lattice, of which some have been traced.

    Attributes:
        low: Parameters of the first node, shape (2,).
        step: Parameters from node to node, shape (2,).
        blocks: Blocks along each axis.
        values: CHANNELS of each traced node, NaN where its line is not OK, shape (nu, nv, 8).
        line_class: Class of each node in nodes.FaceClasses, shape (nu, nv).
        costs: Step error [m], steps, evaluations, shape (nu, nv, 3).
        is_traced: Whether it was traced, shape (nu, nv).
    """

    low: np.ndarray
    step: np.ndarray
    blocks: tuple[int, int]
    values: np.ndarray
    line_class: np.ndarray
    costs: np.ndarray
    is_traced: np.ndarray

    @classmethod
    def empty(cls, low: np.ndarray, step: np.ndarray, blocks: tuple[int, int]) -> "Lattice":
        """A lattice without traced nodes."""
        shape = tuple(CELLS * count + 1 for count in blocks)
        values, costs = np.zeros((*shape, CHANNELS)), np.zeros((*shape, 3))
        return cls(low, step, blocks, values, np.zeros(shape, np.int64), costs, np.zeros(shape, bool))

    @classmethod
    def coarsest(cls, low: np.ndarray, high: np.ndarray) -> "Lattice":
        """The coarsest lattice, whose cells are about square."""
        extent = high - low
        ratio = np.sqrt(extent / extent[::-1])
        counts = np.clip(np.round(FEWEST * ratio), 1, MOST).astype(int)
        return cls.empty(low, extent / (CELLS * counts), (int(counts[0]), int(counts[1])))

    def halved(self) -> "Lattice":
        """Return the lattice of half the step, with the nodes that both share."""
        made = Lattice.empty(self.low, 0.5 * self.step, (2 * self.blocks[0], 2 * self.blocks[1]))
        here = np.nonzero(self.is_traced)
        for name in ("values", "line_class", "costs", "is_traced"):
            getattr(made, name)[::2, ::2][here] = getattr(self, name)[here]
        return made

    def take_over(self, finer_one: "Lattice") -> None:
        """Copy the shared nodes from the lattice of half the step."""
        for name in ("values", "line_class", "costs", "is_traced"):
            getattr(self, name)[...] = getattr(finer_one, name)[::2, ::2]

    def missing(self, blocks: np.ndarray) -> np.ndarray:
        """Nodes of some blocks (n, 2) that have not been traced, shape (m, 2)."""
        wanted = np.zeros(self.is_traced.shape, bool)
        node = np.arange(NODES)
        rows = (CELLS * blocks[:, 0, None] + node)[:, :, None]
        wanted[rows, (CELLS * blocks[:, 1, None] + node)[:, None, :]] = True
        return np.argwhere(wanted & ~self.is_traced)

    def parameters(self, nodes: np.ndarray) -> np.ndarray:
        """Parameters of nodes (n, 2)."""
        return np.asarray(self.low + nodes * self.step)

    def put(self, nodes: np.ndarray, traced: Traced) -> None:
        """Store the results of traced nodes (n, 2)."""
        at = tuple(nodes.T)
        self.values[at], self.line_class[at], self.costs[at] = traced.values, traced.line_class, traced.costs
        self.is_traced[at] = True

    @property
    def bent(self) -> float:
        """Greatest displacement of the traced lines from their undisturbed ends [m]."""
        return float(np.nanmax(np.abs(self.values[self.is_traced, 4:7]), initial=0.0))

    def _nodes_of(self, blocks: np.ndarray, beside: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Nodes of blocks (n, 2) and some beside them, as two arrays for indexing, and which of them are traced.

        Of a node outside the lattice the nearest one is returned, and it counts as not traced.
        """
        node = np.arange(-beside, NODES + beside)
        wanted = [CELLS * blocks[:, axis, None] + node for axis in (0, 1)]
        inside = [np.clip(each, 0, size - 1) for each, size in zip(wanted, self.is_traced.shape, strict=True)]
        rows, columns = inside[0][:, :, None], inside[1][:, None, :]
        is_there = (wanted[0] == inside[0])[:, :, None] & (wanted[1] == inside[1])[:, None, :]
        return rows, columns, is_there & self.is_traced[rows, columns]

    def are_uniform(self, blocks: np.ndarray) -> np.ndarray:
        """Whether all nodes of blocks (n, 2) are OK and of one class, shape (n,)."""
        *nodes, is_traced = self._nodes_of(blocks)
        line_class = self.line_class[tuple(nodes)]
        is_good = is_traced & np.isfinite(self.values[(*nodes, 0)]) & (line_class == line_class[:, :1, :1])
        return np.asarray(is_good.all(axis=(1, 2)) & (line_class[:, 0, 0] >= 0))

    def block_classes(self, blocks: np.ndarray) -> np.ndarray:
        """Class of the lines of blocks (n, 2)."""
        return np.asarray(self.line_class[CELLS * blocks[:, 0], CELLS * blocks[:, 1]])

    def block_costs(self, blocks: np.ndarray) -> np.ndarray:
        """Greatest step error [m], steps and evaluations of the nodes of blocks (n, 2), shape (n, 3)."""
        *nodes, _ = self._nodes_of(blocks)
        return np.asarray(self.costs[tuple(nodes)].max(axis=(1, 2)))

    def patches(self, blocks: np.ndarray, channels: int) -> np.ndarray:
        """Patches of uniform blocks (n, 2): see hermite.patches."""
        *nodes, is_traced = self._nodes_of(blocks, BESIDE)
        line_class, values = self.line_class[tuple(nodes)], self.values[tuple(nodes)][..., :channels]
        middle = WINDOW // 2
        alike = line_class == line_class[:, middle, middle, None, None]
        usable = is_traced & np.isfinite(values[..., 0]) & alike
        return patches(np.where(usable[..., None], values, 0.0), usable)

    def surplus(self, blocks: np.ndarray, made: np.ndarray, finer_one: "Lattice", scale: np.ndarray) -> np.ndarray:
        """Hierarchical surplus: residuals of patches of blocks (n, 2) at the nodes of half the step, shape (n, 9, 9).

        Each is the greatest over the channels in units of `scale`; infinite where a node is not OK, 0 where it was not
        traced.
        """
        at = self._finer_nodes(blocks)
        channels = made.shape[-1]
        miss = np.abs(finer(made) - finer_one.values[at][..., :channels]) / scale[:channels]
        miss = np.where(np.isfinite(miss), miss, np.inf).max(axis=-1)
        return np.asarray(np.where(finer_one.is_traced[at], miss, 0.0))

    def spread(self, blocks: np.ndarray, surplus: np.ndarray, finer_one: "Lattice", quarters: np.ndarray) -> np.ndarray:
        """Greatest surplus at the nodes of blocks (m, 2) of the lattice of half the step, and at two nodes beyond.

        Args:
            blocks: Blocks of this lattice, shape (n, 2).
            surplus: Their surplus, shape (n, 9, 9).
            finer_one: The lattice of half the step.
            quarters: Its blocks.
        """
        table = np.zeros(finer_one.is_traced.shape)
        np.maximum.at(table, self._finer_nodes(blocks), np.where(np.isfinite(surplus), surplus, 0.0))
        half = NODES // 2 + BESIDE
        wide = greatest_around(greatest_around(table, -half, half, 0), -half, half, 1)
        return np.asarray(wide[CELLS * quarters[:, 0] + NODES // 2, CELLS * quarters[:, 1] + NODES // 2])

    @staticmethod
    def _finer_nodes(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        node = np.arange(FINER)
        return (2 * CELLS * blocks[:, 0, None] + node)[:, :, None], (2 * CELLS * blocks[:, 1, None] + node)[:, None, :]
