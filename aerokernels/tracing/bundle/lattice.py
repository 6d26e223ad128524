"""Traced lines on lattices of parameters, each twice as fine as the last, in blocks of four by four cells."""

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
        values: CHANNELS of each node, NaN where it was not traced or is not OK, shape (nu, nv, 8).
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
        return cls(
            low,
            step,
            blocks,
            np.full((*shape, CHANNELS), np.nan),
            np.zeros(shape, np.int64),
            np.zeros((*shape, 3)),
            np.zeros(shape, bool),
        )

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
        for name in ("values", "line_class", "costs", "is_traced"):
            getattr(made, name)[::2, ::2] = getattr(self, name)
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

    def _gather(self, name: str, blocks: np.ndarray, beside: int, fill) -> np.ndarray:
        array = getattr(self, name)
        if beside:
            width = [(beside, beside)] * 2 + [(0, 0)] * (array.ndim - 2)
            array = np.pad(array, width, constant_values=fill)
        node = np.arange(NODES + 2 * beside)
        rows = (CELLS * blocks[:, 0, None] + node)[:, :, None]
        return np.asarray(array[rows, (CELLS * blocks[:, 1, None] + node)[:, None, :]])

    def are_uniform(self, blocks: np.ndarray) -> np.ndarray:
        """Whether all nodes of blocks (n, 2) are OK and of one class, shape (n,)."""
        values, line_class = self._gather("values", blocks, 0, 0), self._gather("line_class", blocks, 0, 0)
        return np.asarray(
            np.isfinite(values[..., 0]).all(axis=(1, 2))
            & (line_class == line_class[:, :1, :1]).all(axis=(1, 2))
            & (line_class[:, 0, 0] >= 0)
        )

    def block_classes(self, blocks: np.ndarray) -> np.ndarray:
        """Class of the lines of blocks (n, 2)."""
        return np.asarray(self.line_class[CELLS * blocks[:, 0], CELLS * blocks[:, 1]])

    def block_costs(self, blocks: np.ndarray) -> np.ndarray:
        """Greatest step error [m], steps and evaluations of the nodes of blocks (n, 2), shape (n, 3)."""
        return np.asarray(self._gather("costs", blocks, 0, 0).max(axis=(1, 2)))

    def patches(self, blocks: np.ndarray, channels: int) -> np.ndarray:
        """Patches of uniform blocks (n, 2): see hermite.patches."""
        line_class = self._gather("line_class", blocks, BESIDE, -1)
        values = self._gather("values", blocks, BESIDE, np.nan)[..., :channels]
        middle = WINDOW // 2
        usable = np.isfinite(values[..., 0]) & (line_class == line_class[:, middle, middle, None, None])
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
