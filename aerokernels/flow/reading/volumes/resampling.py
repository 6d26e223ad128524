"""The map from the cells of a mesh to the nodes of a uniform grid; its mesh-dependent part is computed once and reused.

The mesh alone determines which cell contains a node, how slopes follow from the surrounding cells, which nodes take an
average, which nodes are in no cell, and from where their density is extrapolated. A set of densities then costs one
pass over the cells and one over the nodes.
"""

import math
from collections.abc import Sequence

import numpy as np

from aerokernels.flow.composition import Composition
from aerokernels.flow.reading.dataset import SOLID, Block, ReadError
from aerokernels.flow.reading.volumes.node_fill import EmptyNodes, SmallCells, foremost
from aerokernels.flow.reading.volumes.reconstruction import CellNodes, MeasuringLines, Reconstruction, VolumeResampling
from aerokernels.flow.reading.volumes.solid_walls import solid_body
from aerokernels.flow.reading.volumes.solids import CellFacts, NodeGrid, rasterise
from aerokernels.flow.sampled_density import GridDensity

OUTSIDE = "are in a body or beyond the mesh: the density is extrapolated there"


class Resampling:
    """The map from the cells of a mesh to the nodes of a uniform grid, computed once for any number of snapshots.

    `flow.Reader` reuses one from file to file; `apply` takes densities from any other source.

    Attributes:
        origin: The first node [m], shape (3,).
        spacing: Node spacing [m], shape (3,).
        shape: Number of nodes along x, y and z.
        front: Numbers of the nodes in the most upstream twentieth of the layers that the mesh covers.
        outside_share: Share of the nodes that are in no cell.
        body: The solid body in the flow, or None.
    """

    def __init__(self, reading, moved: Sequence[np.ndarray]):
        """Rasterise the cells of a file that was read into a grid.

        `moved` are the points of its blocks in the optical frame [m], each (n, 3).
        """
        path, blocks = reading.path, list(reading.dataset.blocks)
        low, step, shape = choose_grid(path, blocks, moved, reading.options["spacing"], reading.options["region"])
        self.origin, self.spacing, self.shape = low, step, shape
        self._asked, self._meshes = _asked(reading), [_mesh_of(block) for block in blocks]
        self._where = [where for _, where in reading.densities]
        grid, lines = NodeGrid(low, step, shape), MeasuringLines(low, step, shape)
        self._parts: list[Reconstruction] = []
        facts: list[CellFacts] = []
        firsts = _first_numbers(blocks, moved)
        for block, points, where, first in zip(blocks, moved, self._where, firsts, strict=True):
            result = rasterise(block, points, [grid, lines.grid], first)
            check_solids(path, block, points, result)
            self._parts.append(Reconstruction(block, points, where, result))
            facts.append(result)
        held = grid.cell >= 0
        if not held.any():
            raise ReadError(
                path, "no node of the grid is in one of its cells", "repair the mesh, or give a smaller spacing"
            )
        self.body = solid_body(reading, moved, grid)
        averages = all(where == "cell" for where in self._where)
        self._small = SmallCells(grid, facts, blocks, held) if averages else None
        self.front = foremost(held, shape)
        self._empty = EmptyNodes(held, shape)
        self.outside_share = 1.0 - float(held.mean())
        counts = [block.cell_count for block in blocks]
        lines.settle(self._parts, firsts, counts)
        self._lines, self._cell_nodes = lines, []
        for part, first, count in zip(self._parts, firsts, counts, strict=True):
            self._cell_nodes.append(CellNodes.of(part, grid.cell, first, count))
            part.forget_slopes()  # CellNodes keeps those of cells that contain a node

    def fits(self, reading) -> bool:
        """Return whether another file has this mesh, in the same frame, and is to be read onto the same grid."""
        if self._asked != _asked(reading):
            return False
        blocks = reading.dataset.blocks
        if [where for _, where in reading.densities] != self._where or len(blocks) != len(self._meshes):
            return False
        return all(
            len(one) == len(other) and all(a is b or np.array_equal(a, b) for a, b in zip(one, other, strict=True))
            for one, other in zip(self._meshes, map(_mesh_of, blocks), strict=True)
        )

    def apply(
        self, densities, *, ambient_density: float | None = None, conditions=None, provenance: str = ""
    ) -> GridDensity:
        """Resample densities of the cells (or the points) to the grid.

        Args:
            densities: [kg/m3], one per cell or per point as in the first file, in its order; one array, or a list of
                one for each block.
            ambient_density: [kg/m3]; None takes the median of the most upstream layers.
            conditions: The free stream, or None.
            provenance: Origin of the densities, for the field's provenance.

        Raises:
            ValueError: Arrays that do not fit the mesh, or densities that no gas has.
        """
        arrays = [densities] if isinstance(densities, np.ndarray) else list(densities)
        arrays = [np.asarray(arrays)] if arrays and np.ndim(arrays[0]) == 0 else arrays
        if len(arrays) != len(self._parts):
            raise ValueError(
                f"{len(arrays)} arrays of densities for {len(self._parts)} blocks of cells: give one for each"
            )
        for part, own, name in zip(self._parts, arrays, self._where, strict=True):
            if np.shape(own) != (part.count,):
                raise ValueError(
                    f"densities have shape {np.shape(own)}, the mesh {part.count} {name}s: give one for each"
                )
        values, density = self._resampled(arrays)
        ambient = float(np.median(density[self.front])) if ambient_density is None else float(ambient_density)
        self._empty.fill(density, ambient)
        averaged = 0.0 if self._small is None else self._small.share
        measured = self._lines.measure(values, density, self.outside_share, averaged)
        density = density.reshape(self.shape)
        density.setflags(write=False)
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

    def _resampled(self, given) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
        """Return the inputs of the functions in each block's cells, and the values at the nodes inside cells."""
        values = [part.values(own) for part, own in zip(self._parts, given, strict=True)]
        density = np.empty(math.prod(self.shape))
        for nodes, (value, near) in zip(self._cell_nodes, values, strict=True):
            nodes.set_densities(value, near, self.origin, self.shape, self.spacing, density)
        if self._small is not None:
            own = [value for value, _ in values]
            self._small.average(own[0] if len(own) == 1 else np.concatenate(own), density)
        return values, density

    def _composition(self, reading, ambient: float) -> Composition | None:
        """Return the mixture at the nodes, from partial densities that are resampled like the density."""
        fractions = reading.fractions
        if fractions is None:
            return None
        pairs = list(zip(reading.densities, fractions.blocks, strict=True))
        each = range(len(fractions.names))
        partial = np.stack([self._resampled([rho * own[k] for (rho, _), own in pairs])[1] for k in each])
        around = partial[:, self.front].mean(axis=1)
        for own, share in zip(partial, around / around.sum(), strict=True):
            self._empty.fill(own, share * ambient)
        result: Composition = fractions.composition(partial.reshape(-1, *self.shape), around)
        return result

    def field(self, reading) -> GridDensity:
        """Return the density field of a file on this mesh; its provenance states the changes due to resampling."""
        result = self.apply([own for own, _ in reading.densities], ambient_density=reading.options["ambient_density"])
        measured = result.resampling
        assert isinstance(measured, VolumeResampling)
        walls = sorted({patch.name for patch in reading.dataset.patches if patch.kind == "wall"})
        unused = ", ".join(walls[:3]) + (", ..." if len(walls) > 3 else "")
        said = [
            *reading.described(),
            f"resampled to {' x '.join(map(str, self.shape))} nodes of "
            f"{' x '.join(f'{s:.4g}' for s in self.spacing)} m, which changes the density by "
            f"{measured.density_rms:.2g} kg/m3 rms, columns along z by {measured.column_rms:.2g} kg/m2 rms",
            *([f"{self.outside_share:.1%} of the nodes {OUTSIDE}"] if self.outside_share else []),
            *([] if self.body is None else [f"a body of {len(self.body.triangles)} triangles"]),
            *([f"the solver's values at walls ({unused}) are not used in volumes: the cells beside them count"]
              if walls and self._small is not None else []),
            f"ambient {result.ambient_density:.6g} kg/m3",
        ]  # fmt: skip
        object.__setattr__(result, "composition", self._composition(reading, result.ambient_density))
        object.__setattr__(result, "provenance", f"{reading.path}: {'; '.join(said)}")
        return result


def _first_numbers(blocks: Sequence[Block], moved: Sequence[np.ndarray]) -> list[int]:
    """Return the number of each block's first cell, in descending order of cell size.

    Where blocks overlap, the cell with the greatest number wins, which is then the finer one.
    """
    extents = [np.ptp(points, axis=0).prod() if len(points) else 0.0 for points in moved]
    sizes = [extent / max(block.cell_count, 1) for extent, block in zip(extents, blocks, strict=True)]
    coarseness = [round(math.log2(size)) if size > 0.0 else 0 for size in sizes]
    firsts, number = [0] * len(blocks), 0
    for k in sorted(range(len(blocks)), key=coarseness.__getitem__, reverse=True):
        firsts[k] = number
        number += blocks[k].cell_count
    return firsts


def _mesh_of(block: Block) -> tuple:
    cells = block.cells
    if cells is None:
        return block.points, block.shape, block.blank
    faces = cells.faces
    more = () if faces is None else (faces.start, faces.points, faces.owner, faces.neighbour)
    return block.points, block.blank, cells.types, cells.start, cells.points, *more


def _asked(reading) -> tuple:
    """Return what a caller asks of the grid and of the frame, in a form that compares."""
    grid = [np.asarray(own, np.float64).tolist() if (own := reading.options[name]) is not None else None
            for name in ("spacing", "region")]  # fmt: skip
    return grid, reading.options["walls"], reading.frame, reading.scale


def choose_grid(path, blocks, moved, spacing, region):
    """Return first node [m], spacing [m] and shape of the grid for blocks with points `moved` to the optical frame [m].

    The limits are of a grid whose spacing the caller did not choose.
    """
    default_nodes, least_nodes = 8_000_000, 5
    low = np.min([points.min(axis=0) for points in moved], axis=0)
    high = np.max([points.max(axis=0) for points in moved], axis=0)
    whole = high - low
    if region is not None:
        form = "region must be the lowest and the highest corner [m], three numbers each"
        first, last = _metres(region, form, (2, 3))
        if not (np.maximum(first, low) < np.minimum(last, high)).all():
            raise ValueError(f"region {region!r} is outside the flow of {path}, {low.tolist()} to {high.tolist()} m")
        low, high = np.maximum(first, low), np.minimum(last, high)
    extent = high - low
    if spacing is None:
        cells = max(sum(block.cell_count for block in blocks), 1)
        size = float((np.prod(whole) / cells) ** (1.0 / 3.0))
        step = max(size, float((extent.prod() / default_nodes) ** (1.0 / 3.0)))
        # An axis along which the mesh is thinner still gets least_nodes nodes; the other axes get fewer in return.
        thin = extent < step * (least_nodes - 1)
        if thin.any() and not thin.all():
            long = extent[~thin]
            step = max(step, float((long.prod() * least_nodes ** thin.sum() / default_nodes) ** (1.0 / len(long))))
        wanted = np.full(3, step)
    else:
        form = "spacing must be positive: metres along every axis, or three numbers"
        wanted = np.broadcast_to(_metres(spacing, form, (), (3,)), (3,))
        if not (np.isfinite(wanted).all() and (wanted > 0.0).all()):
            raise ValueError(f"spacing must be positive, got {spacing!r}")
    nodes = np.maximum(np.ceil(extent / wanted * (1.0 - 1e-9)) + 1.0, least_nodes)
    if nodes.prod() > 2e8:
        raise ValueError(f"spacing {spacing!r} m asks for {nodes.prod():.3g} nodes, more than 2e+08: take a wider one")
    shape = tuple(int(n) for n in nodes)
    return low, extent / (nodes - 1.0), shape


def _metres(given, form: str, *shapes: tuple[int, ...]) -> np.ndarray:
    """Return numbers of one of the shapes; raise ValueError with the expected form otherwise."""
    try:
        result = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{form}, got {given!r}") from None
    if result.shape not in shapes:
        raise ValueError(f"{form}, got {given!r}")
    return result


def check_solids(path, block: Block, points: np.ndarray, facts: CellFacts) -> None:
    """Reject cells that are inside out against the majority, cells of zero volume, and duplicate points."""
    solid = np.ones(block.cell_count, bool) if block.shape is not None else np.isin(block.cells.types, SOLID)  # type: ignore[union-attr]
    volume = facts.volume[solid]
    inverted = volume < 0.0
    if inverted.any() and not inverted.all():
        wrong = np.flatnonzero(solid)[inverted if inverted.mean() <= 0.5 else ~inverted]
        raise ReadError(
            path,
            f"{len(wrong)} of {len(volume)} cells are inside out, the first is cell {wrong[0]} at "
            f"{facts.middle[wrong[0]].tolist()} m",
            "order the corners of every cell the same way round",
        )
    if (volume == 0.0).any() and block.shape is None:
        wrong = np.flatnonzero(solid)[volume == 0.0]
        raise ReadError(path, f"{len(wrong)} cells have no volume, the first is cell {wrong[0]}", "repair the mesh")
    if block.shape is not None:
        return
    order = np.argsort(points @ np.array([1.0, math.pi, math.e]), kind="stable")
    same = np.flatnonzero((points[order[1:]] == points[order[:-1]]).all(axis=1))
    if len(same):
        one, other = order[same[0]], order[same[0] + 1]
        raise ReadError(path, f"points {one} and {other} lie in the same place", "merge duplicate nodes of the mesh")
