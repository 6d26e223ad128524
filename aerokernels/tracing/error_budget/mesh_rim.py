"""The rim of a mesh: the edges at which the known air of a field on a mesh ends, and where straight rays cross them.

The rim excludes the wall of the body, the axis, seams (edges that coincide with other edges of the boundary), and edges
in undisturbed air. A ray from p along d crosses the edge from a to b, with e = b - a, in the plane of the mesh where

    planar          p + t d = a + s e,  0 <= s <= 1                                        [y, z]
    axisymmetric    r e_z = (z - a_z) e_r + a_r e_z,  r^2 = x^2 + y^2                       a quadratic in t
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...medium import IndexField
from ..lines import box_size, cylinder_span, slab_span

# Pairs of rays and edges that are tested together.
PAIRS = 1_000_000  # speed only
# An edge is on the wall if both of its ends are nearer to the wall than this, over the edge's length.
ON_WALL = 0.2
SAME_PLACE = 1e-8
# A point is on the rim if it is nearer to an edge than this, over the box's size. It is looked for among so many edges
# whose middles are nearest.
ON_RIM, NEAREST = 1e-6, 4


@dataclass(frozen=True, eq=False)
class MeshRim:
    """Edges of a mesh's boundary where disturbed air ends.

    Attributes:
        start: Start of each edge [m], shape (e, 2); the mesh lies to the left of start to end.
        end: Its end [m].
        strength: Greatest |contrast| of each edge, shape (e,).
        cell: Size of the cell inside the edge [m], shape (e,).
    """

    start: np.ndarray
    end: np.ndarray
    strength: np.ndarray
    cell: np.ndarray

    def part(self, weakest: float) -> "MeshRim":
        """The edges that are stronger than `weakest`."""
        kept = self.strength > weakest
        return MeshRim(self.start[kept], self.end[kept], self.strength[kept], self.cell[kept])

    @cached_property
    def tree(self):
        """Search tree of the edges' midpoints."""
        from scipy.spatial import cKDTree

        return cKDTree(0.5 * (self.start + self.end))


@dataclass(frozen=True, eq=False)
class Crossings:
    """Where rays cross the rim.

    Attributes:
        ray: Number of the ray, shape (k,).
        point: Crossing points [m], shape (k, 3).
        inward: Unit vector along the ray into the mesh, shape (k, 3).
        path: Length of the path outside the mesh, from the start or to the stop [m], shape (k,).
        contrast: |contrast| at the crossing, shape (k,).
        cell: Size of the cell there [m], shape (k,).
    """

    ray: np.ndarray
    point: np.ndarray
    inward: np.ndarray
    path: np.ndarray
    contrast: np.ndarray
    cell: np.ndarray


def mesh_rim(field: IndexField) -> MeshRim:
    """The rim of a field's mesh, cached on the field."""
    return field.derive("mesh rim", lambda: _find_rim(field))


def _find_rim(field: IndexField) -> MeshRim:

    mesh, size = field.mesh, np.abs(field.samples.values)
    cell, a, b = mesh.derive(("rim", field.body), lambda: _edges_of(field), most=2)
    kept = size[a] + size[b] > 0.0
    cell, a, b = cell[kept], a[kept], b[kept]
    strength = np.maximum(size[a], size[b])
    return MeshRim(mesh.vertices[a], mesh.vertices[b], strength, mesh.cell_size[cell])


def _edges_of(field: IndexField) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The cells and the first and last vertices of all edges that may be part of the rim, whatever the contrast."""
    from scipy.spatial import cKDTree

    mesh = field.mesh
    cell, edge = np.nonzero(mesh.neighbors < 0)
    a, b = mesh.cells[cell, edge], mesh.cells[cell, (edge + 1) % 4]
    start, end = mesh.vertices[a], mesh.vertices[b]
    near, kept = SAME_PLACE * box_size(field), np.ones(len(cell), dtype=bool)
    if field.geometry == "axisymmetric":
        kept &= np.maximum(start[:, 0], end[:, 0]) > near
    if len(start) > 1:
        # The edge on the other side of a seam has the same ends in reverse order.
        distance, other = cKDTree(0.5 * (start + end)).query(0.5 * (start + end), k=2)
        facing = np.linalg.norm(start - end[other[:, 1]], axis=1) <= near
        kept &= ~((distance[:, 1] <= near) & facing)
    if field.body is not None and kept.any():
        length, rows = np.linalg.norm(end - start, axis=1), np.flatnonzero(kept)
        ends = np.stack([start[rows], end[rows]])
        foot = field.body.nearest_wall(ends.reshape(-1, 2)).reshape(ends.shape)
        kept[rows] = np.linalg.norm(foot - ends, axis=2).max(axis=0) > ON_WALL * length[rows]
    return cell[kept], a[kept], b[kept]


def rim_contrast(field: IndexField, points: np.ndarray) -> np.ndarray:
    """|contrast| of the rim at points (n, 3) that rounding moved off it; 0 elsewhere."""
    rim = mesh_rim(field)
    if len(rim.start) == 0 or len(points) == 0:
        return np.zeros(len(points))
    local = field.local_coordinates(points)[:, None]
    _, edge = rim.tree.query(local[:, 0], k=np.arange(1, min(NEAREST, len(rim.start)) + 1))
    start, along = rim.start[edge], (rim.end - rim.start)[edge]
    share = np.clip(np.sum((local - start) * along, axis=2) / np.sum(along**2, axis=2), 0.0, 1.0)
    distance = np.linalg.norm(start + share[..., None] * along - local, axis=2)
    return np.where(distance <= ON_RIM * box_size(field), rim.strength[edge], 0.0).max(axis=1)


def mesh_crossings(
    field: IndexField, position: np.ndarray, direction: np.ndarray, stop: np.ndarray, weakest: float
) -> Crossings:
    """Return where straight rays (n, 3) cross the rim between their start and their stop `stop` [m], shape (n,).

    Edges whose |contrast| is nowhere above `weakest` are ignored.
    """
    rim = mesh_rim(field).part(weakest)
    margin = SAME_PLACE * box_size(field)
    rays, edges, paths = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    near = np.flatnonzero(_may_cross(field, rim, position, direction, margin)) if len(rim.start) else np.zeros(0, int)
    chunk = max(1, PAIRS // max(len(rim.start), 1))  # speed only
    solve = _round if field.geometry == "axisymmetric" else _flat
    for first in range(0, len(near), chunk):
        part = near[first : first + chunk]
        for distance, share in solve(rim, position[part], direction[part]):
            with np.errstate(invalid="ignore"):
                hit = (share >= 0.0) & (share < 1.0) & (distance >= -margin) & (distance <= stop[part, None] + margin)
            ray, edge = np.nonzero(hit)
            rays.append(part[ray])
            edges.append(edge)
            paths.append(distance[hit])
    ray, edge, distance = np.concatenate(rays), np.concatenate(edges), np.concatenate(paths)
    point = position[ray] + distance[:, None] * direction[ray]
    across, rise = (rim.end - rim.start)[edge].T
    if field.geometry == "axisymmetric":
        outward = np.sum(point[:, :2] * direction[ray, :2], axis=1) / np.maximum(
            np.hypot(point[:, 0], point[:, 1]), 1e-300
        )
    else:
        outward = direction[ray, 1]
    leaves = outward * rise - direction[ray, 2] * across > 0.0
    path = np.where(leaves, stop[ray] - distance, distance)
    inward = np.where(leaves, -1.0, 1.0)[:, None] * direction[ray]
    kept = path > margin
    return Crossings(*(array[kept] for array in (ray, point, inward, path, rim.strength[edge], rim.cell[edge])))


def _may_cross(field: IndexField, rim: MeshRim, position, direction, margin: float) -> np.ndarray:
    """Which rays meet the bounding box of the edges: a cylinder in an axisymmetric field."""
    low = np.minimum(rim.start, rim.end).min(axis=0) - margin
    high = np.maximum(rim.start, rim.end).max(axis=0) + margin
    enter, leave = slab_span(position[:, 2], direction[:, 2], low[1], high[1])
    if field.geometry == "axisymmetric":
        others = cylinder_span(position, direction, float(high[0]), 0.0)
    else:
        others = slab_span(position[:, 1], direction[:, 1], low[0], high[0])
    return np.asarray(np.maximum(np.maximum(enter, others[0]), 0.0) <= np.minimum(leave, others[1]))


def _flat(rim: MeshRim, position: np.ndarray, direction: np.ndarray):
    """Distances along the rays and shares of the edges at which they meet, shape (rays, edges)."""
    (py, pz), (dy, dz) = position[:, 1:].T[..., None], direction[:, 1:].T[..., None]
    (ay, az), (ey, ez) = rim.start.T, (rim.end - rim.start).T
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rate = dy * ez - dz * ey
        yield ((ay - py) * ez - (az - pz) * ey) / rate, ((ay - py) * dz - (az - pz) * dy) / rate


def _round(rim: MeshRim, position: np.ndarray, direction: np.ndarray):
    """The same for edges of an axisymmetric field, which rays may meet twice; yields both."""
    px, py, pz = position.T[..., None]
    dx, dy, dz = direction.T[..., None]
    (ar, az), (er, ez) = rim.start.T, (rim.end - rim.start).T
    square, middle, near = dx * dx + dy * dy, px * dx + py * dy, px * px + py * py
    base, slope = (pz - az) * er + ar * ez, dz * er
    a = ez * ez * square - slope * slope
    b = ez * ez * middle - base * slope
    c = ez * ez * near - base * base
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rest = b * b - a * c
        once = np.abs(rest) <= 1e-12 * b * b  # for edges across the axis
        root = np.sqrt(np.where(once, 0.0, np.maximum(rest, 0.0)))
        none = (rest < 0.0) & ~once
        pivot = -(b + np.where(b < 0.0, -root, root))
        for distance in (pivot / a, np.where(once, np.nan, c / pivot)):
            r = np.hypot(px + distance * dx, py + distance * dy)
            share = ((pz + distance * dz - az) * ez + (r - ar) * er) / (er * er + ez * ez)
            # The quadratic also describes the mirror image of the edge, at -r.
            mirrored = (base + distance * slope) * ez < -1e-9 * r * ez * ez
            yield distance, np.where(none | mirrored, np.nan, share)
