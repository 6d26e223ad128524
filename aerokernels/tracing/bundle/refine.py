"""Choose the lines of a family that are traced, so that interpolation between them meets the tolerance.

A block of four by four cells of a lattice is divided where lines pass other faces, where the field may hold structure
between them (tubes.py), or where check lines disagree; and while that costs less than tracing its rays one by one. With
S the greatest residual of a block near a quarter and S' its parent's, the error there is SAFETY S / min(S'/S, ORDER).
"""

from dataclasses import dataclass, field, replace

import numpy as np

from aerokernels.tracing.tasks.family import BundleTable, FaceClasses, Family

from .lattice import Lattice, Tracer, trace_lines
from .tubes import RESOLVED, Clearance, Tubes

# Levels that are always divided: 33 x 33 lines on a square.
LEAST_LEVEL = 2
# Greatest number of nodes along an axis of the finest lattice.
MOST_NODES = 1025
SAFETY = 1.5
# Assumed ratio of the residuals of two levels: its greatest value, and its value where it is not known. It is 16 for a
# smooth function.
ORDER, LEAST_ORDER = 12.0, 2.0
# Check lines of a block, as nodes of the 9 x 9 of its quarters: the middles of some cells; and the middles of the other
# cells, which are checked too where no residual of a parent shows how the error differs from cell to cell, and where
# that of the first cells is above the share DOUBTFUL of the limit.
CHECKED = np.array([(1, 3), (3, 7), (5, 1), (7, 5)])
OTHERS = np.array([(1, 1), (1, 5), (1, 7), (3, 1), (3, 3), (3, 5), (5, 3), (5, 5), (5, 7), (7, 1), (7, 3), (7, 7)])
DOUBTFUL = 0.3
# Rays may be displaced by this many times the greatest displacement of the first lines.
MARGIN = 2.0
# Upper bound of the sum of a patch's weights; of the rounding of that sum in float32, relative to the greatest number
# (two million random patches: 6.9 * 2^-24); and the fraction of its limits that single precision may take.
HERMITE_WEIGHTS, SUM_ROUNDING, ROUNDING_SHARE = 1.6, 8.0 * 2.0**-24, 0.02
# Lines traced for a quarter, check lines included, and the fraction of its rays up to which tracing so many lines pays.
COST, WORTH = 18.0, 0.8


@dataclass(eq=False)
class _Level:
    """The blocks of one level, with the residuals of their parents."""

    lattice: Lattice
    blocks: np.ndarray  # (n, 2)
    miss: np.ndarray  # residual of each block's parent in units of the limit; NaN where there is none
    order: np.ndarray  # ratio of the residuals of grandparent and parent


@dataclass(eq=False)
class Refinement:
    """The adaptive refinement; without a known bound there are no `tubes`, without a body no `clearance`."""

    family: Family
    classes: FaceClasses
    tracer: Tracer
    tubes: Tubes | None
    clearance: Clearance | None
    limits: np.ndarray  # of the error of each channel, shape (8,): that of the OPD [m] first
    channels: int
    traced: int = 0
    error: float = 0.0
    refused: dict[str, float] = field(default_factory=dict)

    def run(self, counted: np.ndarray, share: float) -> BundleTable | None:
        """The table of patches, or None, from parameters of some rays (n, 2), each of which represents `share` rays."""
        level = self._first(counted)
        accepted: list[tuple[Lattice, np.ndarray, np.ndarray]] = []
        number = 0
        while len(level.blocks):
            finer = level.lattice.halved()
            good, divided, miss = self._judge(level, finer, number, self._counts(level.lattice, counted, share))
            if good.any():
                blocks = level.blocks[good]
                errors = miss[good] * self.limits[0]
                self.error = max(self.error, float(errors.max(initial=0.0)))
                accepted.append((level.lattice, blocks, errors))
            level = self._divided(level, finer, divided, counted)
            number += 1
        return self._table(accepted) if accepted else None

    def _trace(self, lattice: Lattice, nodes: np.ndarray) -> None:
        if len(nodes):
            lattice.put(nodes, trace_lines(self.family, self.classes, self.tracer, lattice.parameters(nodes)))
            self.traced += len(nodes)

    def _first(self, counted: np.ndarray) -> _Level:
        """The coarsest lattice, with all nodes of the least level traced at once."""
        family = self.family
        lattices = [Lattice.coarsest(family.low, family.high)]
        for _ in range(LEAST_LEVEL):
            lattices.append(lattices[-1].halved())
        finest = lattices[-1]
        nodes = finest.missing(_occupied(finest, counted))
        self._trace(finest, nodes)
        if not self.classes.are_all_alike:
            self.classes = replace(self.classes, margin=MARGIN * finest.bent)
            numbers = self.classes.numbers(*family.rays(finest.parameters(nodes)))
            finest.lines.line_class[finest.row[tuple(nodes.T)]] = numbers
        for coarse, fine in zip(lattices[-2::-1], lattices[:0:-1], strict=True):
            coarse.lines, coarse.row = fine.lines, fine.row[::2, ::2].copy()
        blocks = _occupied(lattices[0], counted)
        return _Level(lattices[0], blocks, np.full(len(blocks), np.nan), np.full(len(blocks), np.nan))

    def _counts(self, lattice: Lattice, counted: np.ndarray, share: float) -> np.ndarray:
        """Approximate number of rays in each block of a lattice, shape (bu, bv)."""
        place = _block_of(lattice, counted)
        flat = np.ravel_multi_index(tuple(place.T), lattice.blocks)
        return np.asarray(share * np.bincount(flat, minlength=np.prod(lattice.blocks)).reshape(lattice.blocks))

    def _judge(self, level: _Level, finer: Lattice, number: int, counts: np.ndarray):
        """Which blocks are accepted, which are divided, and the expected error of each in units of the limit."""
        lattice, blocks = level.lattice, level.blocks
        count = len(blocks)
        good, miss = np.zeros(count, bool), np.full(count, np.inf)
        uniform = lattice.are_uniform(blocks)
        why = np.where(uniform, "smooth", "edges and rays that do not arrive")
        expected = np.where(np.isfinite(level.miss), SAFETY * level.miss / level.order, 0.0)
        levels_to_go = np.ones(count)
        if number >= LEAST_LEVEL:
            rows = np.flatnonzero(uniform)
            near = self._near_body(lattice, blocks[rows])
            why[rows[near]] = "air near the body"
            rows = rows[~near]
            bound = self._bound(lattice, blocks[rows]) / self.limits[0]
            within = bound <= 1.0
            why[rows[~within]] = "structure narrower than the spacing of traced rays"
            levels_to_go[rows[~within]] = self._until_resolved(lattice, blocks[rows])[~within]
            rows = rows[within]
            # A block whose predicted error is more than this many times the limit is divided without check lines.
            close = expected[rows] <= 3.0
            measured = np.full(len(rows), np.inf)
            measured[close] = self._check(lattice, finer, blocks[rows[close]], CHECKED)
            # The others are checked where the first would accept the block, but say little of them.
            unsure = ~np.isfinite(level.miss[rows]) | (measured > DOUBTFUL)
            unsure &= close & (SAFETY * measured <= 1.0)
            measured[unsure] = self._check(lattice, finer, blocks[rows[unsure]], OTHERS)
            miss[rows] = np.maximum(expected[rows], SAFETY * measured)
            good[rows] = miss[rows] <= 1.0
            rough = rows[~good[rows]]
            why[rough] = "rough results"
            size = np.where(np.isfinite(miss[rough]), miss[rough], np.maximum(expected[rough], 1.0))
            # Ratio assumed for further levels when their cost is predicted: residuals fall faster once everything is
            # resolved.
            levels_to_go[rough] = np.maximum(np.ceil(np.log(np.maximum(size, 1.01)) / np.log(8.0)), 1.0)
            levels_to_go[~uniform] = 1.0
        rays = counts[tuple(blocks.T)]
        fits = 4 * 2 * max(lattice.blocks) + 1 <= MOST_NODES
        pays = fits & (COST * 4.0 ** np.minimum(levels_to_go, 12.0) <= WORTH * rays)
        divided = ~good & (pays | (number < LEAST_LEVEL))
        left = ~good & ~divided
        for name in np.unique(why[left]):
            found = float(rays[left & (why == name)].sum())
            self.refused[str(name)] = self.refused.get(str(name), 0.0) + found
        return good, divided, miss

    def _near_body(self, lattice: Lattice, blocks: np.ndarray) -> np.ndarray:
        if self.clearance is None or not len(blocks):
            return np.zeros(len(blocks), bool)
        return ~self.clearance.of_blocks(*_middles(lattice, blocks), lattice.bent)

    def _bound(self, lattice: Lattice, blocks: np.ndarray) -> np.ndarray:
        if self.tubes is None or not len(blocks):
            return np.zeros(len(blocks))
        middle, half = _middles(lattice, blocks)
        return self.tubes.missed(middle, half, lattice.step, np.full(len(blocks), lattice.bent))

    def _until_resolved(self, lattice: Lattice, blocks: np.ndarray) -> np.ndarray:
        assert self.tubes is not None
        middle, _ = _middles(lattice, blocks)
        spacing = np.maximum(self.tubes.greatest_spacing(middle, lattice.step), RESOLVED)
        return np.maximum(np.ceil(np.log2(spacing / RESOLVED)), 1.0)

    def _check(self, lattice: Lattice, finer: Lattice, blocks: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Greatest residual of each block's patches once these cells are checked, in units of the limit, shape (n,)."""
        if not len(blocks):
            return np.zeros(0)
        nodes = (8 * blocks[:, None] + cells).reshape(-1, 2)
        nodes = nodes[finer.row[tuple(nodes.T)] == 0]
        self._trace(finer, nodes)
        made = lattice.patches(blocks, self.channels)
        return lattice.surplus(blocks, made, finer, self.limits).max(axis=(1, 2))

    def _divided(self, level: _Level, finer: Lattice, divided: np.ndarray, counted: np.ndarray) -> _Level:
        """Return the quarters of divided blocks, with their lines traced and their parents' residuals."""
        blocks = level.blocks[divided]
        quarters = (2 * blocks[:, None] + np.array([(0, 0), (0, 1), (1, 0), (1, 1)])).reshape(-1, 2)
        parents = np.repeat(np.arange(len(blocks)), 4)
        there = np.zeros(finer.blocks, bool)
        there[tuple(_occupied(finer, counted).T)] = True
        kept = there[tuple(quarters.T)] if len(quarters) else np.zeros(0, bool)
        quarters, parents = quarters[kept], parents[kept]
        self._trace(finer, finer.missing(quarters))
        uniform = level.lattice.are_uniform(blocks)
        missed = np.full(len(quarters), np.nan)
        if uniform.any():
            made = level.lattice.patches(blocks[uniform], self.channels)
            surplus = level.lattice.surplus(blocks[uniform], made, finer, self.limits)
            known = uniform[parents]
            missed[known] = level.lattice.spread(blocks[uniform], surplus, finer, quarters[known])
        before = level.miss[divided][parents]
        with np.errstate(divide="ignore", invalid="ignore"):
            order = np.where(missed > 0.0, np.clip(before / missed, 1.0, ORDER), ORDER)
        order = np.where(np.isfinite(before) & np.isfinite(missed), order, LEAST_ORDER)
        return _Level(finer, quarters, missed, order)

    def _table(self, accepted: list[tuple[Lattice, np.ndarray, np.ndarray]]) -> BundleTable:
        finest = accepted[-1][0].blocks
        numbers, first = np.full(finest, -1, np.int32), 0  # of the block at each place
        for lattice, blocks, _ in accepted:
            stride = finest[0] // lattice.blocks[0]
            view = numbers.reshape(lattice.blocks[0], stride, lattice.blocks[1], stride)
            own = first + np.arange(len(blocks), dtype=np.int32)
            view[blocks[:, 0], :, blocks[:, 1], :] = own[:, None, None]
            first += len(blocks)
        headers, values = [], []
        for lattice, blocks, errors in accepted:
            costs = np.asarray(lattice.lines.costs[lattice.rows(blocks)].max(axis=(1, 2)))
            costs[:, 0] += errors
            start = lattice.parameters(4 * blocks)
            rate = np.broadcast_to(1.0 / lattice.step, start.shape)
            line_class = lattice.lines.line_class[lattice.row[4 * blocks[:, 0], 4 * blocks[:, 1]]]
            headers.append(np.concatenate([start, rate, line_class[:, None], costs], axis=1))
            values.append(lattice.patches(blocks, self.channels))
        header, whole = np.concatenate(headers), np.concatenate(values)
        # Single precision halves the data loaded for each ray; it is used where no channel shows the difference.
        single = whole.astype(np.float32)
        rounding = HERMITE_WEIGHTS * np.abs(single - whole).max(axis=(0, 1, 2, 3))
        rounding += SUM_ROUNDING * np.abs(whole).max(axis=(0, 1, 2, 3))
        if (rounding <= ROUNDING_SHARE * self.limits[: self.channels]).all():
            whole = single
            header[:, 5] += rounding[0]
            self.error += float(rounding[0])
        return BundleTable(
            self.family, self.classes, self.channels, numbers, header, whole, self.traced, self.error, self.refused
        )


def _middles(lattice: Lattice, blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Parameters of the middles of blocks (n, 2), and half their width."""
    return lattice.low + (4.0 * blocks + 2.0) * lattice.step, 2.0 * lattice.step


def _block_of(lattice: Lattice, parameters: np.ndarray) -> np.ndarray:
    place = np.floor((parameters - lattice.low) / (4.0 * lattice.step)).astype(np.int64)
    return np.asarray(np.clip(place, 0, np.array(lattice.blocks) - 1))


def _occupied(lattice: Lattice, counted: np.ndarray) -> np.ndarray:
    """Blocks (n, 2) that contain rays."""
    occupied = np.zeros(lattice.blocks, bool)
    occupied[tuple(_block_of(lattice, counted).T)] = True
    return np.argwhere(occupied)
