"""From the cells of a mesh to the nodes of a uniform grid: what the mesh alone decides is worked out once and kept.

Which cell holds a node, how a slope follows from what lies about a cell, which nodes take an average, which lie in no
cell and whence their density is carried on: all that belongs to the mesh. A set of densities then costs a pass over the
cells and one over the nodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..sampled_density import GridDensity, linear_between
from ..species import Composition
from .dataset import Block, ReadError
from .grid_choice import check_solids, choose_grid
from .raster import CellFacts, NodeGrid, draw
from .reconstruction import Linear, Reconstruction, Rows
from .solid_walls import solid_body

LINES = 8  # along x and y, on which the error is measured
LEAST_AVERAGED = 4  # cells about a node from which on their average says more than the one that holds it
CARRIED_ON = 8  # nodes by which the density is carried on into a body, and beyond the mesh


@dataclass(frozen=True)
class VolumeResampling:
    """What resampling a mesh to a uniform grid changed, by cause.

    Attributes:
        spacing: Node spacing of the grid [m], one per axis.
        density_rms: Root mean square change of the density between grid and cells [kg/m3], on lines along z.
        density_max: Greatest change of it seen [kg/m3].
        column_rms: Root mean square change of the integral of the density along those lines [kg/m2].
        column_max: Greatest change of that [kg/m2].
        reconstruction_rms: What of the columns comes from the slopes inside cells: against cells of one density each.
        outside_share: Share of the nodes that no cell holds: in a body, or beyond the mesh.
        averaged_share: Share of the nodes whose neighbourhood has several cells, which were averaged.
    """

    spacing: tuple[float, float, float]
    density_rms: float
    density_max: float
    column_rms: float
    column_max: float
    reconstruction_rms: float
    outside_share: float
    averaged_share: float


class Resampling:
    """The map from the cells of a mesh to the nodes of a uniform grid, worked out once for any number of snapshots.

    `flow.Reader` keeps one from file to file; `apply` takes densities from anywhere else.

    Attributes:
        origin: The first node [m], shape (3,).
        spacing: Node spacing [m], shape (3,).
        shape: Number of nodes along x, y and z.
        outside_share: Share of the nodes that no cell holds.
        body: The solid body in the flow, or None.
    """

    def __init__(self, reading, moved: Sequence[np.ndarray], spacing=None, region=None, walls=None):
        """Draw the cells of what was read into a grid.

        Args:
            reading: What was read.
            moved: The points of its blocks in the optical frame [m], each (n, 3).
            spacing: Greatest node spacing [m]; None follows from the cells.
            region: Lowest and highest corner of the grid [m]; None takes all.
            walls: Names of the patches that bound the body; None takes the file's walls, else holes of the mesh.

        Raises:
            ReadError: Cells inside out, points twice, no node in a cell.
            ValueError: A spacing or a region that makes no grid.
        """
        path, blocks = reading.path, list(reading.dataset.blocks)
        low, step, shape = choose_grid(path, blocks, moved, spacing, region)
        self.origin, self.spacing, self.shape = low, step, shape
        self._asked = _plain(spacing), _plain(region), walls
        self._frame, self._meshes = (reading.frame, reading.scale), [_mesh_of(block) for block in blocks]
        self._where = [where for _, where in reading.densities]
        grid = NodeGrid(low, step, shape)
        extent = step * (np.array(shape) - 1)
        fine = max(2, min(4 * shape[2], 4096))
        lines = NodeGrid(
            low + extent * np.array([0.5 / LINES, 0.5 / LINES, 0.5 / fine]),
            extent / np.array([LINES, LINES, fine]),
            (LINES, LINES, fine),
        )
        self._parts: list[Reconstruction] = []
        facts: list[CellFacts] = []
        first = 0
        for block, points, where in zip(blocks, moved, self._where, strict=True):
            found = draw(block, points, [grid, lines], first)
            check_solids(path, block, points, found)
            self._parts.append(Reconstruction(block, points, where, found))
            facts.append(found)
            first += block.cell_count
        self._cell = grid.cell
        held = grid.cell >= 0
        if not held.any():
            raise ReadError(
                path, "no node of the grid lies in a cell of it", "repair the mesh, or give a smaller spacing"
            )
        self.body = solid_body(path, reading.dataset, blocks, moved, reading.moved, grid, walls)
        averages = all(where == "cell" for where in self._where)
        self._small = _SmallCells(grid, facts, blocks, held) if averages else None
        self._front = _front(held, shape)
        self._empty = _Empty(held, shape)
        self.outside_share = 1.0 - float(held.mean())
        node = np.flatnonzero(lines.cell >= 0)
        self._lines = lines.shape, float(lines.spacing[2]), node, lines.cell[node], lines.positions(node)

    def fits(self, reading, spacing=None, region=None, walls=None) -> bool:
        """Whether another reading lies on this very mesh, in the same frame, and asks for the same grid."""
        if self._asked != (_plain(spacing), _plain(region), walls) or self._frame != (reading.frame, reading.scale):
            return False
        blocks = reading.dataset.blocks
        if [where for _, where in reading.densities] != self._where or len(blocks) != len(self._meshes):
            return False
        return all(
            len(one) == len(other) and all(_same(a, b) for a, b in zip(one, other, strict=True))
            for one, other in zip(self._meshes, map(_mesh_of, blocks), strict=True)
        )

    def apply(
        self, densities, *, ambient_density: float | None = None, conditions=None, provenance: str = ""
    ) -> GridDensity:
        """Densities of the cells (or the points) on the grid.

        Args:
            densities: [kg/m3], one per cell or per point as in the first file, in its order; one array, or a list of
                one for each block.
            ambient_density: [kg/m3]; None takes what prevails in the foremost layers.
            conditions: The free stream, or None.
            provenance: Where they come from, in words.

        Raises:
            ValueError: Arrays that do not fit the mesh, or densities that are no gas's.
        """
        given = [densities] if isinstance(densities, np.ndarray) else list(densities)
        if given and np.ndim(given[0]) == 0:
            given = [np.asarray(given)]
        if len(given) != len(self._parts):
            raise ValueError(
                f"{len(given)} arrays of densities for {len(self._parts)} blocks of cells: give one for each"
            )
        for part, own, name in zip(self._parts, given, self._where, strict=True):
            if np.shape(own) != (part.count,):
                raise ValueError(
                    f"densities have shape {np.shape(own)}, the mesh {part.count} {name}s: give one for each"
                )
        linear, density = self._drawn(given)
        ambient = float(np.median(density[self._front])) if ambient_density is None else float(ambient_density)
        self._empty.fill(density, ambient)
        density = density.reshape(self.shape)
        density.setflags(write=False)
        measured = self._measured(linear, density)
        return GridDensity(
            density,
            self.origin,
            self.spacing,
            "volume",
            ambient,
            body=self.body,
            conditions=conditions,
            provenance=provenance,
            resampling=measured,
        )

    def _drawn(self, given) -> tuple[Linear, np.ndarray]:
        """Values of each block's cells or points: linear in each cell, and at the nodes that lie in one."""
        linear = Linear.joined([part.linear(own, self.origin) for part, own in zip(self._parts, given, strict=True)])
        nodes = self._at_nodes(linear)
        if self._small is not None:
            self._small.average(linear, nodes)
        return linear, nodes

    def _composition(self, reading, ambient: float) -> Composition | None:
        """The mixture at the nodes, by partial densities that go the way of the density."""
        fractions = reading.fractions
        if fractions is None:
            return None
        pairs = list(zip(reading.densities, fractions.blocks, strict=True))
        each = range(len(fractions.names))
        partial = np.stack([self._drawn([rho * own[k] for (rho, _), own in pairs])[1] for k in each])
        around = partial[:, self._front].mean(axis=1)
        for own, share in zip(partial, around / around.sum(), strict=True):
            self._empty.fill(own, share * ambient)
        found: Composition = fractions.composition(partial.reshape(-1, *self.shape), around)
        return found

    def field(self, reading) -> GridDensity:
        """The density field of a reading on this mesh, its provenance with what the resampling changed."""
        found = self.apply(
            [own for own, _ in reading.densities], ambient_density=reading.ambient or reading.dataset.ambient
        )
        measured = found.resampling
        assert isinstance(measured, VolumeResampling)
        said = [
            *reading.described(),
            f"resampled to {' x '.join(map(str, self.shape))} nodes of "
            f"{' x '.join(f'{s:.4g}' for s in self.spacing)} m, which changes the density by "
            f"{measured.density_rms:.2g} kg/m3 rms, columns along z by {measured.column_rms:.2g} kg/m2 rms",
            *(
                [f"{self.outside_share:.1%} of the nodes lie in a body or beyond the mesh: the density is carried on"]
                if self.outside_share
                else []
            ),
            *([] if self.body is None else [f"a body of {len(self.body.triangles)} triangles"]),
            f"ambient {found.ambient_density:.6g} kg/m3",
        ]
        object.__setattr__(found, "composition", self._composition(reading, found.ambient_density))
        object.__setattr__(found, "provenance", f"{reading.path}: {'; '.join(said)}")
        return found

    def _at_nodes(self, linear: Linear) -> np.ndarray:
        from .mesh_kernels import launch, node_values

        density = np.zeros(len(self._cell))
        launch(
            node_values, self.shape[0] * self.shape[1], self._cell, self.shape[2], self.shape[1],
            tuple(self.spacing), linear.function, density,
        )  # fmt: skip
        return density

    def _measured(self, linear: Linear, density: np.ndarray) -> VolumeResampling:
        shape, step, node, cell, at = self._lines
        change, flat = np.zeros(int(np.prod(shape))), np.zeros(int(np.prod(shape)))
        if len(node):
            truth = linear.at(cell, at)
            change[node] = linear_between(density, self.origin, self.spacing, at) - truth
            flat[node] = linear.value[cell] - truth
        columns = [step * values.reshape(shape).sum(axis=2) for values in (change, flat)]
        seen = change[node] if len(node) else change
        rms = [float(np.sqrt(np.mean(own**2))) for own in (seen, columns[0], columns[1])]
        return VolumeResampling(
            tuple(float(s) for s in self.spacing),  # type: ignore[arg-type]
            rms[0],
            float(np.abs(change).max()),
            rms[1],
            float(np.abs(columns[0]).max()),
            rms[2],
            self.outside_share,
            0.0 if self._small is None else self._small.share,
        )


class _SmallCells:
    """Nodes about which several cells have their middles, which take their average, by volume."""

    def __init__(self, grid: NodeGrid, facts: list[CellFacts], blocks: list[Block], held: np.ndarray):
        middle = np.concatenate([own.middle for own in facts])
        volume = np.abs(np.concatenate([own.volume for own in facts]))
        index = np.round((middle - grid.low) / grid.spacing)
        inside = (volume > 0.0) & np.all((index >= 0) & (index < grid.shape), axis=1)
        blank = [
            b.blank if b.blank is not None and len(b.blank) == b.cell_count else np.zeros(b.cell_count, bool)
            for b in blocks
        ]
        inside &= ~np.concatenate(blank)
        cell = np.flatnonzero(inside)
        node = np.ravel_multi_index(tuple(index[cell].astype(np.int64).T), grid.shape)
        count = np.bincount(node, minlength=len(held))
        total = np.bincount(node, volume[cell], len(held))
        # Cells that fill most of the node's surroundings: fewer would shift the average to one side.
        several = (count >= LEAST_AVERAGED) & held & (total >= 0.7 * grid.spacing.prod())
        self.share = float(several.mean())
        self.node = np.flatnonzero(several)
        number = np.zeros(len(held), np.int32)
        number[self.node] = np.arange(len(self.node))
        some = several[node]
        self._cell, self._of = cell[some], number[node[some]]
        self._share = volume[self._cell] / total[self.node][self._of]

    def average(self, linear: Linear, density: np.ndarray) -> None:
        """Give these nodes the averages."""
        if len(self.node):
            density[self.node] = np.bincount(self._of, self._share * linear.value[self._cell], len(self.node))


def _front(held: np.ndarray, shape) -> np.ndarray:
    """The nodes of the foremost twentieth of the layers that the mesh holds."""
    inside = held.reshape(shape)
    layers = np.flatnonzero(inside.any(axis=(0, 1)))
    first = int(layers[int(0.95 * (len(layers) - 1))])
    across, layer = np.nonzero(inside.reshape(-1, shape[2])[:, first:])
    return np.asarray(across * shape[2] + first + layer)


class _Empty:
    """Nodes without a cell: the mean of their neighbours, layer by layer; deeper ones are ambient."""

    def __init__(self, held: np.ndarray, shape):
        known = held.copy()
        empty = np.flatnonzero(~known)
        strides = (shape[1] * shape[2], shape[2], 1)
        self._layers: list[tuple[np.ndarray, Rows]] = []
        for _ in range(CARRIED_ON):
            if not len(empty):
                break
            place = np.unravel_index(empty, shape)
            row, near = [], []
            for axis, stride in enumerate(strides):
                for side in (-1, 1):
                    there = (place[axis] > 0) if side < 0 else (place[axis] < shape[axis] - 1)
                    good = there & known[np.where(there, empty + side * stride, empty)]
                    row.append(np.flatnonzero(good))
                    near.append(empty[good] + side * stride)
            rows = Rows.sorted(np.concatenate(row), np.concatenate(near), len(empty))[0]
            found = np.diff(rows.start) > 0
            self._layers.append((empty[found], Rows(np.append(rows.start[:-1][found], rows.start[-1]), rows.column)))
            known[empty[found]] = True
            empty = empty[~found]
        self._deep = empty

    def fill(self, density: np.ndarray, ambient: float) -> None:
        """Give them their densities."""
        density[self._deep] = ambient
        for node, rows in self._layers:
            density[node] = rows.means(density)


def _mesh_of(block: Block) -> tuple:
    cells = block.cells
    if cells is None:
        return block.points, block.shape, block.blank
    faces = cells.faces
    more = () if faces is None else (faces.start, faces.points, faces.owner, faces.neighbour)
    return block.points, block.blank, cells.types, cells.start, cells.points, *more


def _same(one, other) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one is other or np.array_equal(one, other)
    return one is other or (not isinstance(one, np.ndarray) and not isinstance(other, np.ndarray) and one == other)


def _plain(asked):
    return None if asked is None else np.asarray(asked, dtype=np.float64).tolist()
