"""Bound the structure that known rays miss between samples on the device that computes a grid's tables.

This is MissedStructure's bound by the rule (between_samples.py), for the values of any field on known nodes: the tables
of blocks stay on the device. What comes to the host is the greatest error that a ray may meet in each layer of blocks
across the axis that the lines run along most, and at both ends of each line.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...medium.grid import UniformGrid
from ..engines import Engine
from ..engines.kernel_table import STRUCTURE_KERNELS
from ..scheme import MISSED_SLOPE
from .between_samples import NEGLIGIBLE, MissedStructure
from .missed_on_lines import ENDS_SHARE, Layers, known_ends, path_of, with_lever_arm
from .unresolved import RULE_AT_END, rule_scales, turned


class StructureOnDevice:
    """The launches that bound the structure missed by some lines with a number of samples, for one field at a time.

    Attributes:
        arrays: The host arrays that receive the results, see Engine.fetched.
    """

    def __init__(self, engine: Engine, structure: MissedStructure, count: int, block: int, shape: tuple[int, ...]):
        """Allocate the memory.

        Args:
            engine: The engine.
            structure: The lines, in a field on these nodes.
            count: Number of samples.
            block: Cells in a block along each axis.
            shape: Number of blocks along each axis.
        """
        self.engine, self.structure = engine, structure
        field, lines = structure.field, structure.lines
        grid = field.samples
        assert isinstance(grid, UniformGrid)
        self.grid = grid
        self.block, self.shape, self.table = block, shape, math.prod(shape)
        self.path = path_of(lines, field.geometry, grid.low, block * grid.spacing, shape)
        sampling = structure.sampled(count)
        scales = [0.0] * (3 - len(shape)) + rule_scales(field.geometry, sampling)
        # The tables hold differences, not derivatives: see GridTables.
        steps = np.append(np.ones(3 - len(shape)), grid.spacing)
        self.scales = np.array(scales) / (grid.ambient_index * steps**4)
        self.slope = MISSED_SLOPE / float(np.min(grid.spacing))  # [1/m]
        self.at_end = RULE_AT_END * sampling.spacing
        self.lever_arms = with_lever_arm(field, lines)
        self.size = float((block * np.asarray(grid.spacing)).max())
        self.missed = engine.empty(self.table)
        ends = np.concatenate([np.ravel_multi_index(places, shape) for places in known_ends(field, lines, shape)])
        self.ends = engine.put(ends.astype(np.int32))
        self.layers = self.path.layers[0] if self.path.layers else _whole(shape)
        part = self.path.part
        sizes = [each.stop - each.start for each in part]
        pitches = [math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
        begin = sum(each.start * pitch for each, pitch in zip(part, pitches, strict=True))
        along = self.layers.axis
        runs = [(1, 0, 1)] * (3 - len(shape))
        for axis, width in self.layers.beside:
            width = min(width, sizes[axis])
            runs.append((sizes[axis] - width + 1, pitches[axis], width))
        (rows, *row), (columns, *column) = runs
        self.places = [begin, pitches[along], rows, *row, columns, *column]
        self.weights = np.broadcast_to(1.0 + self.slope * self.layers.lever_arms.reshape(-1), (sizes[along],))
        self.kernels = engine.kernels(STRUCTURE_KERNELS)
        self.arrays = [np.empty(sizes[along] * rows * columns), np.empty(2 * len(ends))]

    def start(self, tables: Any, made: Sequence[Any]) -> None:
        """Start the launches, into buffers for the arrays.

        `tables` is a buffer with tables of blocks: three of fourth differences, and that of the potential.
        """
        engine, kernels, shape = self.engine, self.kernels, (1, *self.shape)[-3:]
        (in_layers, at_ends), (layers, ends) = made, self.arrays
        engine.launch(kernels["rule_in_blocks"], [tables, self.table, self.scales], [self.missed], self.table)
        engine.launch(kernels["missed_in_layers"], [self.missed, *self.places], [in_layers], len(layers))
        around = [self.missed, tables, 3 * self.table, *shape, self.ends]
        engine.launch(kernels["missed_around"], around, [at_ends], len(ends) // 2)

    def greatest(self, arrays: Sequence[np.ndarray], limit: float) -> float:
        """The greatest error of any line [m], from the arrays with the results.

        `limit` is the OPD error allowed to a ray [m].
        """
        if not len(self.lever_arms):
            return 0.0
        in_layers, at_ends = arrays
        path, layers = self.path, self.layers
        found = float(in_layers.max()) * (1.0 + self.slope * path.lever_arm) * path.longest
        if path.layers:
            sums = self.weights @ in_layers.reshape(len(self.weights), -1)
            found = min(found, float(sums.max()) * layers.thickness / layers.least)
        missed, potential = at_ends.reshape(-1, 2).T
        if float(potential.max()) * self.size > ENDS_SHARE * limit:
            both = np.add(*missed.reshape(2, -1))
            found += self.at_end * float((both * self.lever_arms).max())
        return turned(self.grid, self.structure.lever_arm(limit)) * found

    def is_enough(self, arrays: Sequence[np.ndarray], limit: float) -> bool:
        """Whether the number of samples misses no structure; arguments as for `greatest`."""
        return self.greatest(arrays, limit) <= NEGLIGIBLE * limit


def _whole(shape: tuple[int, ...]) -> Layers:
    """Layers of which only the greatest of all blocks counts."""
    beside = tuple((axis, 1) for axis in range(1, len(shape)))
    return Layers(0, np.zeros(1), beside, math.inf, 1.0)
