"""Bound the structure that known rays miss between samples on the device that computes a grid's tables.

This is MissedStructure's bound by the rule (between_samples.py), for the values of any field on known nodes: the tables
of blocks stay on the device, and one number for each column of blocks and each end of a line comes to the host.
"""

import math
from typing import Any

import numpy as np

from ...medium.grid import UniformGrid
from ..engines import Engine
from ..engines.kernel_table import STRUCTURE_KERNELS
from ..scheme import MISSED_SLOPE
from .between_samples import NEGLIGIBLE, MissedStructure
from .missed_on_lines import ENDS_SHARE, known_ends, known_path, with_lever_arm
from .path_through_blocks import Layers
from .unresolved import RULE_AT_END, rule_scales, turned


class StructureOnDevice:
    """The launches that bound the structure missed by some lines with a number of samples, for one field at a time."""

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
        self.path = known_path(grid, block, shape, lines, field.geometry)
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
        self.layers = self.path.layers or (_whole(shape),)
        self.arguments = [self._arguments(layers) for layers in self.layers]
        self.kernels = [engine.kernels(STRUCTURE_KERNELS) for _ in self.layers]
        counts = [places for _, places in self.arguments] + [len(ends)]
        self.reading = engine.fetched([np.empty(2 * places) for places in counts])

    def start(self, tables: Any) -> None:
        """Start the launches for tables of blocks in a buffer: three of fourth differences, and the potential's."""
        engine, first = self.engine, self.kernels[0]
        *sums, around = self.reading.buffers
        engine.launch(first["rule_in_blocks"], [tables, self.table, self.scales], [self.missed], self.table)
        for kernels, (before, places), made in zip(self.kernels, self.arguments, sums, strict=True):
            engine.launch(kernels["missed_in_layers"], [self.missed, *before], [made], places)
        shape = (1, *self.shape)[-3:]
        before = [self.missed, tables, 3 * self.table, *shape, self.ends]
        engine.launch(first["missed_around"], before, [around], len(self.reading.arrays[-1]) // 2)
        self.reading.start()

    def greatest(self, limit: float) -> float:
        """Wait, and return the greatest error of any line [m] where the OPD error allowed to a ray is `limit` [m]."""
        if not len(self.lever_arms):
            return 0.0
        *sums, around = (array.reshape(-1, 2) for array in self.reading.wait())
        path = self.path
        found = float(sums[0][:, 1].max()) * (1.0 + self.slope * path.lever_arm) * path.longest
        for layers, made in zip(path.layers, sums, strict=False):
            found = min(found, float(made[:, 0].max()) * layers.thickness / layers.least)
        if float(around[:, 1].max()) * self.size > ENDS_SHARE * limit:
            both = np.add(*around[:, 0].reshape(2, -1))
            found += self.at_end * float((both * self.lever_arms).max())
        return turned(self.grid, self.structure.lever_arm(limit)) * found

    def is_enough(self, limit: float) -> bool:
        """Wait, and return whether the number of samples misses no structure."""
        return self.greatest(limit) <= NEGLIGIBLE * limit

    def _arguments(self, layers: Layers) -> tuple[list, int]:
        """Arguments of the kernel missed_in_layers after its table, and the number of its places."""
        part = self.path.part
        pitches = [math.prod(self.shape[axis + 1 :]) for axis in range(len(self.shape))]
        sizes = [each.stop - each.start for each in part]
        begin = sum(each.start * pitch for each, pitch in zip(part, pitches, strict=True))
        weight = np.broadcast_to(1.0 + self.slope * layers.lever_arms.reshape(-1), (sizes[layers.axis],))
        runs = []
        for axis, width in layers.beside:
            width = min(width, sizes[axis])
            runs.append((pitches[axis], width, sizes[axis] - width + 1))
        (row_pitch, row_width, rows), (column_pitch, column_width, columns) = [(0, 1, 1), *runs][-2:]
        along = [self.engine.put(np.ascontiguousarray(weight)), begin, sizes[layers.axis], pitches[layers.axis]]
        return [*along, row_pitch, row_width, columns, column_pitch, column_width], rows * columns


def _whole(shape: tuple[int, ...]) -> Layers:
    """Layers of which only the greatest of all blocks counts."""
    beside = tuple((axis, 1) for axis in range(1, len(shape)))
    return Layers(0, np.zeros(1), beside, math.inf, 1.0)
