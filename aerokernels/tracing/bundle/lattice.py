"""Traced lines on lattices of parameters, each twice as fine as the last, in blocks of four by four cells.

Between nodes the results are bicubic Hermite patches with an error of f''''/384, like a cubic spline; but a slope, of
the quartic through five nodes of its neighbourhood, keeps a rough place local.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from aerokernels.tracing.tasks.family import FaceClasses, Family

from ...medium import IndexField
from ...rays import RayBundle
from ..blocks import greatest_around
from ..lines import box_span
from ..stop import RayStatus, stop_distance

# Deviations from the undisturbed line, which alone are small and smooth: optical path difference [m], direction (3),
# end point [m] (3), arc length [m].
CHANNELS = 8
# Number of channels that the outputs need: for "opd" alone, and for "direction".
OPD, WITH_DIRECTION = 1, 4
# Outputs that are requested of the traced lines.
TRACED = frozenset(
    ("opd", "direction", "position", "arc_length", "step_error", "step_count", "evaluation_count", "optical_path")
)
# (rays) -> per-ray arrays by name
Tracer = Callable[[RayBundle], dict[str, np.ndarray]]


def channels_of(outputs: frozenset) -> int:
    """Number of channels that these outputs need."""
    if outputs & {"position", "arc_length"}:
        return CHANNELS
    return WITH_DIRECTION if "direction" in outputs else OPD


def undisturbed_length(field: IndexField, position: np.ndarray, direction: np.ndarray, until) -> np.ndarray:
    """Lengths of undisturbed lines up to their stop [m], shape (n,)."""
    if until is None:
        return box_span(field, position, direction).leave
    return stop_distance(position, direction, until)


@dataclass(frozen=True, eq=False)
class Traced:
    """Traced lines: CHANNELS (n, 8), NaN if not OK; classes; step error [m], steps and evaluations (n, 3)."""

    values: np.ndarray
    line_class: np.ndarray
    costs: np.ndarray

    @classmethod
    def joined(cls, *parts: "Traced") -> "Traced":
        """The lines of some lists, one list after the other."""
        names = [entry.name for entry in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def trace_lines(family: Family, classes: FaceClasses, tracer: Tracer, parameters: np.ndarray) -> Traced:
    """Trace the lines with these parameters, shape (n, 2)."""
    position, direction = family.rays(parameters)
    arrays = tracer(RayBundle(position, direction))
    length = undisturbed_length(classes.field, position, direction, classes.until)
    values = np.full((len(position), CHANNELS), np.nan)
    line_class = classes.numbers(position, direction)
    good = (arrays["status"] == RayStatus.OK) & np.isfinite(length) & (line_class >= 0)
    values[good, 0] = arrays["opd"][good]
    values[good, 1:4] = (arrays["direction"] - direction)[good]
    values[good, 4:7] = (arrays["position"] - position)[good] - length[good, None] * direction[good]
    values[good, 7] = arrays["arc_length"][good] - length[good]
    costs = np.stack([arrays[name] for name in ("step_error", "step_count", "evaluation_count")], axis=1)
    return Traced(values, line_class, costs)


# Blocks along the shorter and along the longer axis of the coarsest lattice: at least, and at most.
FEWEST, MOST = 2, 8


@dataclass(eq=False)
class Lattice:
    """Lines with parameters `low` + node times `step`; `row` is that of each in `lines`, 0 where it was not traced."""

    low: np.ndarray
    step: np.ndarray
    blocks: tuple[int, int]
    lines: Traced
    row: np.ndarray

    @classmethod
    def empty(cls, low: np.ndarray, step: np.ndarray, blocks: tuple[int, int], lines: Traced) -> "Lattice":
        """A lattice without traced nodes."""
        return cls(low, step, blocks, lines, np.zeros(tuple(CELLS * count + 1 for count in blocks), np.int32))

    @classmethod
    def coarsest(cls, low: np.ndarray, high: np.ndarray) -> "Lattice":
        """The coarsest lattice, whose cells are about square."""
        extent = high - low
        ratio = np.sqrt(extent / extent[::-1])
        counts = np.clip(np.round(FEWEST * ratio), 1, MOST).astype(int)
        # Row 0 stands for every line that was not traced.
        none = Traced(np.full((1, CHANNELS), np.nan), np.zeros(1, np.int64), np.zeros((1, 3)))
        return cls.empty(low, extent / (CELLS * counts), (int(counts[0]), int(counts[1])), none)

    def halved(self) -> "Lattice":
        """Return the lattice of half the step, with the nodes that both share."""
        made = Lattice.empty(self.low, 0.5 * self.step, (2 * self.blocks[0], 2 * self.blocks[1]), self.lines)
        made.row[::2, ::2] = self.row
        return made

    def missing(self, blocks: np.ndarray) -> np.ndarray:
        """Nodes of some blocks (n, 2) that have not been traced, shape (m, 2)."""
        wanted = np.zeros(self.row.shape, bool)
        node = np.arange(NODES)
        rows = (CELLS * blocks[:, 0, None] + node)[:, :, None]
        wanted[rows, (CELLS * blocks[:, 1, None] + node)[:, None, :]] = True
        return np.argwhere(wanted & (self.row == 0))

    def parameters(self, nodes: np.ndarray) -> np.ndarray:
        """Parameters of nodes (n, 2)."""
        return np.asarray(self.low + nodes * self.step)

    def put(self, nodes: np.ndarray, traced: Traced) -> None:
        """Store the results of traced nodes (n, 2)."""
        self.row[tuple(nodes.T)] = len(self.lines.costs) + np.arange(len(nodes))
        self.lines = Traced.joined(self.lines, traced)

    @property
    def bent(self) -> float:
        """Greatest displacement of the traced lines from their undisturbed ends [m]."""
        return float(np.nanmax(np.abs(self.lines.values[self.row[self.row > 0], 4:7]), initial=0.0))

    def rows(self, blocks: np.ndarray, beside: int = 0) -> np.ndarray:
        """Rows of the nodes of blocks (n, 2) and of some beside them; 0 also where a node is outside the lattice."""
        node = np.arange(-beside, NODES + beside)
        wanted = [CELLS * blocks[:, axis, None] + node for axis in (0, 1)]
        inside = [np.clip(each, 0, size - 1) for each, size in zip(wanted, self.row.shape, strict=True)]
        found = self.row[inside[0][:, :, None], inside[1][:, None, :]]
        is_there = (wanted[0] == inside[0])[:, :, None] & (wanted[1] == inside[1])[:, None, :]
        return np.asarray(found * is_there)

    def are_uniform(self, blocks: np.ndarray) -> np.ndarray:
        """Whether all nodes of blocks (n, 2) are OK and of one class, shape (n,)."""
        rows = self.rows(blocks)
        line_class = self.lines.line_class[rows]
        is_good = np.isfinite(self.lines.values[rows, 0]) & (line_class == line_class[:, :1, :1])
        return np.asarray(is_good.all(axis=(1, 2)) & (line_class[:, 0, 0] >= 0))

    def patches(self, blocks: np.ndarray, channels: int) -> np.ndarray:
        """Patches of uniform blocks (n, 2): see hermite.patches."""
        rows = self.rows(blocks, BESIDE)
        line_class, values = self.lines.line_class[rows], self.lines.values[rows, :channels]
        middle = WINDOW // 2
        usable = np.isfinite(values[..., 0]) & (line_class == line_class[:, middle, middle, None, None])
        return patches(np.where(usable[..., None], values, 0.0), usable)

    def surplus(self, blocks: np.ndarray, made: np.ndarray, finer_one: "Lattice", scale: np.ndarray) -> np.ndarray:
        """Residuals of patches of blocks (n, 2) at the nodes of half the step, greatest over `scale`, (n, 9, 9).

        Infinite where a node is not OK, 0 where it was not traced.
        """
        rows, channels = finer_one.row[self._finer_nodes(blocks)], made.shape[-1]
        miss = np.abs(finer(made) - finer_one.lines.values[rows, :channels]) / scale[:channels]
        miss = np.where(np.isfinite(miss), miss, np.inf).max(axis=-1)
        return np.asarray(np.where(rows > 0, miss, 0.0))

    def spread(self, blocks: np.ndarray, surplus: np.ndarray, finer_one: "Lattice", quarters: np.ndarray) -> np.ndarray:
        """Greatest surplus of blocks (n, 2) at the nodes of quarters (m, 2), of half the step, and two nodes beyond."""
        table = np.zeros(finer_one.row.shape)
        np.maximum.at(table, self._finer_nodes(blocks), np.where(np.isfinite(surplus), surplus, 0.0))
        half = NODES // 2 + BESIDE
        wide = greatest_around(table, (-half, -half), (half, half))
        return np.asarray(wide[CELLS * quarters[:, 0] + NODES // 2, CELLS * quarters[:, 1] + NODES // 2])

    @staticmethod
    def _finer_nodes(blocks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        node = np.arange(FINER)
        return (2 * CELLS * blocks[:, 0, None] + node)[:, :, None], (2 * CELLS * blocks[:, 1, None] + node)[:, None, :]


# Cells and nodes of a block along each axis, and nodes beyond it that slopes may use.
CELLS = 4
NODES = CELLS + 1
BESIDE = 2
WINDOW = NODES + 2 * BESIDE
# Nodes of a block once its cells are halved.
FINER = 2 * CELLS + 1


def slope_matrix(has_low: bool, has_high: bool) -> np.ndarray:
    """The matrix from values at nodes -2 to 6 to slopes at 0 to 4 [per cell]; nodes beyond 0 to 4 may be unused."""
    first, last = (0 if has_low else BESIDE), (WINDOW if has_high else WINDOW - BESIDE) - 5
    matrix = np.zeros((NODES, WINDOW))
    for node in range(NODES):
        begin = int(np.clip(node, first, last))  # the centred five begin two nodes before, which is index `node`
        place = np.arange(begin, begin + 5) - (node + BESIDE)
        powers = np.vander(place.astype(float), 5, increasing=True)
        matrix[node, begin : begin + 5] = np.linalg.inv(powers)[1]
    return matrix


SLOPES = {(low, high): slope_matrix(low, high) for low in (False, True) for high in (False, True)}
OWN_SLOPES = SLOPES[False, False][:, BESIDE : BESIDE + NODES]


def hermite_weights(u: np.ndarray) -> np.ndarray:
    """Weights of value and slope at 0 and at 1, shape (4, *u.shape)."""
    v = 1.0 - u
    return np.stack([(1.0 + 2.0 * u) * v * v, u * v * v, u * u * (3.0 - 2.0 * u), -u * u * v])


def _finer_matrices() -> tuple[np.ndarray, np.ndarray]:
    values, slopes = np.zeros((FINER, NODES)), np.zeros((FINER, NODES))
    for row in range(FINER):
        cell = min(row // 2, CELLS - 1)
        found = hermite_weights(np.asarray(0.5 * row - cell))
        values[row, cell], slopes[row, cell], values[row, cell + 1], slopes[row, cell + 1] = found
    return values, slopes


FINER_VALUES, FINER_SLOPES = _finer_matrices()


def patches(window: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Value, slopes along both axes and mixed slope [per cell] at the nodes of blocks, shape (n, 5, 5, 4, channels).

    `window` (n, 9, 9, channels) reaches two nodes beyond each block; those that are not `usable` may be anything but
    NaN.
    """
    inner = slice(BESIDE, BESIDE + NODES)
    made = np.empty((len(window), NODES, NODES, 4, window.shape[-1]))
    made[..., 0, :] = window[:, inner, inner]
    for axis, lines in ((0, window[:, :, inner]), (1, np.moveaxis(window[:, inner], 1, 2))):
        free = usable[:, :, inner] if axis == 0 else np.moveaxis(usable[:, inner], 1, 2)
        low, high = free[:, :BESIDE].all(axis=(1, 2)), free[:, -BESIDE:].all(axis=(1, 2))
        for case, matrix in SLOPES.items():
            rows = np.flatnonzero((low == case[0]) & (high == case[1]))
            if len(rows):
                slope = np.einsum("ij,njkc->nikc", matrix, lines[rows], optimize=True)
                made[rows, :, :, 1 + axis] = slope if axis == 0 else np.moveaxis(slope, 1, 2)
    made[..., 3, :] = np.einsum("ij,nkjc->nkic", OWN_SLOPES, made[..., 1, :], optimize=True)
    return made


def finer(made: np.ndarray) -> np.ndarray:
    """The patches evaluated at the nodes of cells half as wide, shape (n, 9, 9, channels)."""
    values, slopes = FINER_VALUES, FINER_SLOPES
    along = np.einsum("ai,nijpc->najpc", values, made[..., (0, 2), :], optimize=True)
    along += np.einsum("ai,nijpc->najpc", slopes, made[..., (1, 3), :], optimize=True)
    found = np.einsum("bj,najc->nabc", values, along[..., 0, :], optimize=True)
    found += np.einsum("bj,najc->nabc", slopes, along[..., 1, :], optimize=True)
    return np.asarray(found)
