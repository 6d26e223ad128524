"""Two-dimensional files: their points in the optical frame, their mesh, and the density on it and at its walls."""

from dataclasses import dataclass

import numpy as np

from aerokernels.flow.reading.dataset import FLAT, QUAD, Block, Cells, Dataset, ReadError, wall_patches
from aerokernels.flow.reading.frame import Frame
from aerokernels.flow.reading.planes.polygons import Polygons, joined, merged, quad_mesh
from aerokernels.medium import Body, QuadMesh

ON_AXIS = 1e-12  # of the greatest radius: rounding of points on the axis
BOTH_SIDES = 1e-6  # of the plane's width: farther beyond the axis than rounding of single precision


@dataclass(frozen=True, eq=False)
class Plane:
    """Position of a two-dimensional file in the optical frame."""

    geometry: str  # "planar" or "axisymmetric"
    axes: np.ndarray  # x, y, z of the optical frame in the file's axes, as rows, shape (3, 3)
    origin: np.ndarray  # the origin in the file's unit, shape (3,)
    scale: float  # the file's unit of length [m]

    @classmethod
    def of(cls, reading) -> "Plane":
        """Return the plane of a file; refuse a frame that does not fit the geometry."""
        path, dataset, frame = reading.path, reading.dataset, reading.frame
        geometry, scale, normal, origin = reading.geometry, reading.scale, reading.normal, np.array(frame.origin)
        if geometry == "planar":
            assert normal is not None
            return cls(geometry, frame.axes(normal), origin, scale)
        axis = np.array(dataset.axis or (1.0, 0.0, 0.0))
        if dataset.axis is None and frame.look is not None and normal is not None and abs(axis @ normal) > 1e-6:
            axis = -frame.look  # a plane of y and z, whose axis the file does not name
        if normal is not None:
            _check_half_plane(path, dataset, axis, normal, origin)
        look = frame.look if frame.look is not None else -axis
        if abs(abs(look @ axis) - 1.0) > 1e-9 or float(frame.rotation) != 0.0:
            raise ReadError(
                path,
                f"the optical axis {look.tolist()} is not along the flow's axis of symmetry {axis.tolist()}",
                "leave the frame along it, and let the rays run across: give their directions to the bundle or pupil",
            )
        off = origin - axis * (axis @ origin)
        if off.any():
            raise ReadError(
                path, f"the origin {list(frame.origin)} is not on the axis of symmetry", "move it along the axis"
            )
        return cls(geometry, Frame(optical=tuple(look), up=frame.up).axes(), origin, scale)

    def local(self, points: np.ndarray) -> np.ndarray:
        """Return points in the file's frame, shape (..., 3), as (y, z) or (r, z) [m], shape (..., 2)."""
        moved = self.scale * ((points - self.origin) @ self.axes.T)
        if self.geometry == "planar":
            return np.asarray(moved[..., 1:] + 0.0)
        radius = np.hypot(moved[..., 0], moved[..., 1])
        radius = np.where(radius > ON_AXIS * radius.max(initial=0.0), radius, 0.0)
        return np.stack([radius, moved[..., 2]], axis=-1) + 0.0


def plane_in_words(plane: Plane, frame: Frame, mesh: QuadMesh) -> str:
    """Describe the frame of a two-dimensional file, and the doubt of one that begins at an axis, if it may be one."""
    words = frame.described(plane.axes)
    if plane.geometry == "axisymmetric":
        return f"axisymmetric, {words.split(',')[0]} of the file"
    low, high = float(mesh.vertices[:, 0].min()), float(mesh.vertices[:, 0].max())
    begins = min(abs(low), abs(high)) <= ON_AXIS * (high - low)
    doubt = "; it begins at y = 0: if that is an axis of symmetry, give geometry = 'axisymmetric'" if begins else ""
    return f"planar, {words}{doubt}"


def _check_half_plane(path, dataset: Dataset, axis: np.ndarray, normal: np.ndarray, origin: np.ndarray) -> None:
    """Check that a plane contains the axis of symmetry and lies on one side of it."""
    if abs(axis @ normal) > 1e-6:
        raise ReadError(
            path,
            f"its plane is across {normal.tolist()}, and so does not contain the axis of symmetry {axis.tolist()}",
            "give the optical axis, against which the flow runs: optical = '-z', say",
        )
    beside = np.concatenate([(block.points - origin) @ np.cross(normal, axis) for block in dataset.blocks])
    low, high = float(beside.min()), float(beside.max())
    if low < -BOTH_SIDES * np.ptp(beside) and high > BOTH_SIDES * np.ptp(beside):
        raise ReadError(
            path,
            f"its points lie on both sides of the axis of symmetry, from {low:.6g} to {high:.6g} in the file's unit",
            "give one half of the plane, or leave geometry out where the flow is planar",
        )


def block_polygons(path, block: Block, plane: Plane, values: np.ndarray, where: str) -> Polygons:
    """Return the cells of a block as polygons in the plane, without blanked cells."""
    points, cells = plane.local(block.points), block.cells
    if block.shape is not None:
        counts = [n for n in block.shape if n > 1]
        if len(counts) != 2:
            fault = f"block {block.name!r} of {block.shape} points is not flat"
            raise ReadError(path, fault, "give a plane or a volume")
        index = np.arange(counts[0] * counts[1]).reshape(counts[1], counts[0])
        corners = [index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]]
        cells = Cells.of_one_type(QUAD, np.stack(corners, axis=-1).reshape(-1, 4))
    if cells is None or not len(cells):
        what = f"block {block.name!r} has points and no cells"
        raise ReadError(path, what, "give a file with cells, or a grid's shape")
    keep = np.isin(cells.types, FLAT)  # without lines of the boundary, say
    if not keep.any():
        what = f"block {block.name!r} has no triangles, quadrilaterals or polygons"
        raise ReadError(path, what, "give a flow's mesh")
    polygons = Polygons(points, cells.start, cells.points, values, where)
    if block.blank is not None and block.blank.any():
        at_points = len(block.blank) == len(block.points)
        keep &= ~(np.maximum.reduceat(block.blank[cells.points], cells.start[:-1]) if at_points else block.blank)
    return polygons.used() if keep.all() else polygons.kept(keep)  # without mid-edge nodes of quadratic cells, say


def structured_mesh(block: Block, plane: Plane) -> QuadMesh | None:
    """Return the mesh of a structured block without holes, in its own order; None if its cells need cutting."""
    if block.shape is None or (block.blank is not None and block.blank.any()):
        return None
    counts = [n for n in block.shape if n > 1]
    if len(counts) != 2:
        return None
    local = plane.local(block.points).reshape(counts[1], counts[0], 2)
    for axis in (0, 1):
        if (np.diff(local, axis=axis) == 0.0).all(axis=-1).any():
            return None  # collapsed edges, at a pole
    try:
        return QuadMesh.structured(local[..., 0], local[..., 1], plane.geometry)
    except ValueError:
        return None  # as polygons such cells are cut, or rejected with a specific message


def plane_mesh(path, blocks: list[Block], plane: Plane, densities) -> tuple[QuadMesh, np.ndarray, str, str]:
    """Return the mesh of a two-dimensional file, its densities, their place ("cell" or "point"), and a remark."""
    try:
        if len(blocks) == 1 and (mesh := structured_mesh(blocks[0], plane)) is not None:
            return mesh, densities[0][0], densities[0][1], ""
        parts = [block_polygons(path, block, plane, *own) for block, own in zip(blocks, densities, strict=True)]
        polygons = merged(parts, [block.shape is not None for block in blocks])
        if all(block.shape is not None for block in blocks):
            polygons = polygons.without_repeats()  # at the pole of a grid; elsewhere double points are an error
        mesh, values, remark = quad_mesh(polygons, plane.geometry)
    except ReadError:
        raise
    except ValueError as fault:
        raise ReadError(path, f"its mesh cannot be used: {fault}", "repair the mesh and write the file again") from None
    return mesh, values, polygons.where, remark


def wall_density(reading, plane: Plane) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the solver's densities at points of the walls; None if no wall has others than those of its cells.

    An edge's value belongs to its middle. At a corner between two edges the value is interpolated linearly between
    their middles; at the end of a wall it is extrapolated from the last edge.
    """
    result: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for patch in wall_patches(reading.path, reading.dataset.patches, reading.options["walls"]):
        if patch.values is None or not len(patch.edges):
            continue
        pairs = {dimension: patch.values(name) for dimension, name in reading.choice.names.items()}
        known = {dimension: pair for dimension, pair in pairs.items() if pair is not None}
        if len(known) == len(pairs):
            pair = [reading.choice.densities({dimension: own[k] for dimension, own in known.items()}) for k in (0, 1)]
            result.setdefault(patch.name, []).append((plane.local(patch.edges), np.stack(pair)))
    points, values = [], []
    for parts in result.values():  # a part for each processor
        edges = np.concatenate([own for own, _ in parts])
        wall, cell = np.concatenate([pair for _, pair in parts], axis=1)
        # A file with six digits tells no less than 1e-5 of a cell's density from it.
        if not (np.isfinite(wall) & (wall > 0.0)).all() or (np.abs(wall - cell) <= 1e-5 * cell).all():
            continue
        corners, at_corners = _at_corners(edges, wall)
        points += [edges.mean(axis=1), corners]
        values += [wall, at_corners]
    return (np.concatenate(points), np.concatenate(values)) if points else None


def _at_corners(edges: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the points where edges (n, 2, 2) end, and the values there, from those of the edges' middles."""
    ends = edges.reshape(-1, 2)
    first, point = joined(ends, 1e-9 * max(float(np.ptp(ends, axis=0).max()), 1e-300))
    length = np.repeat(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1), 2)
    weight = 1.0 / length
    total = np.bincount(point, weight)
    result = np.bincount(point, weight * np.repeat(values, 2)) / total
    count = np.bincount(point)
    other = point.reshape(-1, 2)[:, ::-1].ravel()
    end = (count[point] == 1) & (count[other] > 1)
    result[point[end]] = 2.0 * np.repeat(values, 2)[end] - result[other[end]]
    return ends[first], np.clip(result, values.min(), values.max())


CLOSE = 1e-9  # of the field's size: closer points are the same


def wall_body(edges: np.ndarray, mesh: QuadMesh) -> Body | None:
    """Return the body that walls bound by their edges (edge_count, 2, 2) [m], or None if they bound nothing.

    A closed wall is the body's outline. A wall that ends on the edge of the field is closed behind it: on the axis of
    symmetry, or along the side of the field behind the wall. ValueError: walls that branch, what `Body` rejects.
    """
    size = float(max(np.ptp(mesh.vertices, axis=0).max(), 1e-300))
    outlines = []
    for chain in chains(edges, CLOSE * size):
        closed = np.linalg.norm(chain[0] - chain[-1]) <= CLOSE * size
        outline = chain[:-1] if closed else _closed_behind(chain, mesh)
        if abs(_area(outline)) > 1e-9 * size**2:
            outlines.append(outline)
    return _joined(outlines, mesh.geometry)


def hole_body(mesh: QuadMesh) -> Body | None:
    """Return the body in the holes of a mesh, or None if it has none."""
    behind = mesh.neighbors
    cell, side = np.nonzero(behind < 0)
    ends = np.stack([mesh.cells[cell, side], mesh.cells[cell, (side + 1) % 4]], axis=1)
    size = float(max(np.ptp(mesh.vertices, axis=0).max(), 1e-300))
    edges = mesh.vertices[ends]
    # Edges that occur twice are the seam of a grid that closes on itself.
    pairs = np.sort(joined(edges.reshape(-1, 2), CLOSE * size)[1].reshape(-1, 2), axis=1)
    _, same, count = np.unique(pairs, axis=0, return_inverse=True, return_counts=True)
    edges = edges[count[same.ravel()] == 1]
    try:
        result = chains(edges, CLOSE * size)
    except ValueError:  # cells that touch in a corner only: holes are ambiguous there
        return None
    loops = [chain[:-1] for chain in result if len(chain) > 3 and np.linalg.norm(chain[0] - chain[-1]) <= CLOSE * size]
    if len(loops) < 2:
        return None
    loops.sort(key=lambda loop: -abs(_area(loop)))
    return _joined(loops[1:], mesh.geometry)


def chains(edges: np.ndarray, near: float) -> list[np.ndarray]:
    """Join edges end to end: return the points of each chain, shape (k, 2); a closed chain ends where it begins."""
    ends = edges.reshape(-1, 2)
    first, point = joined(ends, near)
    places, pairs = ends[first], point.reshape(-1, 2)
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    touching: dict[int, list[int]] = {}
    for number, pair in enumerate(pairs.tolist()):
        for end in pair:
            touching.setdefault(end, []).append(number)
    if touching and max(len(own) for own in touching.values()) > 2:
        crowded = next(end for end, own in touching.items() if len(own) > 2)
        raise ValueError(f"the walls branch at {places[crowded].tolist()}: a wall has two ends")
    free, result = set(range(len(pairs))), []
    open_ends = [end for end, own in touching.items() if len(own) == 1]
    for begin in [*open_ends, *touching]:
        chain = [begin]
        while (following := next((n for n in touching[chain[-1]] if n in free), None)) is not None:
            free.discard(following)
            one, other = pairs[following].tolist()
            chain.append(other if one == chain[-1] else one)
        if len(chain) > 1:
            result.append(places[chain])
    return result


def _closed_behind(chain: np.ndarray, mesh: QuadMesh) -> np.ndarray:
    """Return an open wall closed on the side of the solid."""
    low, high = mesh.box
    if mesh.geometry == "axisymmetric":
        # A wall that faces inward, such as a nozzle's, has its solid outside.
        if _fluid_is_beyond(chain, mesh, np.array([1.0, 0.0])):
            ends = [[0.0, point[1]] for point in (chain[-1], chain[0]) if point[0] > 0.0]
            return np.vstack([chain, np.array(ends).reshape(-1, 2)])
        outer = float(high[0] + 0.1 * (high[0] - low[0]))
        return np.vstack([chain, [outer, chain[-1, 1]], [outer, chain[0, 1]]])
    extent = np.ptp(chain, axis=0)
    across = int(np.argmin(extent)) if extent.min() < 1e-9 * extent.max() else 0
    side = np.eye(2)[across]
    beyond = _fluid_is_beyond(chain, mesh, side)
    edge = float(low[across] if beyond else high[across])
    if extent[across] < 1e-9 * float(np.ptp(mesh.vertices, axis=0).max()):  # a straight wall: give it depth
        edge += (-0.1 if beyond else 0.1) * float(high[across] - low[across])
    feet = []
    for point in (chain[-1], chain[0]):
        foot = point.copy()
        foot[across] = edge
        if abs(foot[across] - point[across]) > 0.0:
            feet.append(foot)
    return np.vstack([chain, *feet])


def _fluid_is_beyond(chain: np.ndarray, mesh: QuadMesh, side: np.ndarray) -> bool:
    """Return whether the flow is on the side of a wall to which a direction points."""
    step = np.diff(chain, axis=0)
    middle, length = 0.5 * (chain[1:] + chain[:-1]), np.linalg.norm(step, axis=1)
    reach = 0.05 * float(np.median(length))
    steep = np.abs(step @ side) < 0.999 * length
    middle = middle[steep] if steep.any() else middle
    ahead, back = mesh.locate(middle + reach * side) >= 0, mesh.locate(middle - reach * side) >= 0
    return int(ahead.sum()) >= int(back.sum())


def _joined(outlines: list[np.ndarray], geometry: str) -> Body | None:
    """Return one profile of all outlines; each further one is connected by a bridge of no width, there and back."""
    if not outlines:
        return None
    profile = outlines[0]
    for other in outlines[1:]:
        profile = np.vstack([profile, profile[:1], other, other[:1]])
    return Body(profile, geometry)


def _area(outline: np.ndarray) -> float:
    first, second = outline.T
    return float(0.5 * np.sum(first * np.roll(second, -1) - np.roll(first, -1) * second))
