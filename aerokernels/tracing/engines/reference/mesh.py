"""A quadrilateral mesh for the reference integrator (see engines/reference/medium.py), with the gaps around it.

Outside all cells the index is ambient: a ray flies straight to where it next enters a cell or leaves the box.
"""

import numpy as np

from ....medium import IndexField
from ....medium.mesh_samples import inverse_distance_weights
from .flight import Segments
from .medium import approach, dot, outward, plane_motion

# Share of a cell's size by which a place is moved ahead to find the cell behind an edge.
AHEAD = 1e-7
NEWTON_STEPS = 30


class MeshAir:
    """A mesh."""

    def __init__(self, field: IndexField):
        """Find the rim, the edges without a neighbour."""
        samples, mesh = field.samples, field.samples.mesh
        self.samples, self.mesh, self.ambient = samples, mesh, field.ambient_index
        self.interpolation = samples.interpolation
        self.axisymmetric = field.geometry == "axisymmetric"
        # The slope along the radius need not vanish on the axis.
        self.axis_is_kink = self.axisymmetric
        self.face_count = 5 if self.axisymmetric else 4
        self.size = float(mesh.cell_size.min())
        self.force_scale = float(np.abs(samples.values).max()) / self.size
        # Edges without a neighbour: the rim, and both sides of a seam.
        cell, edge = np.nonzero(mesh.neighbors < 0)
        corners = mesh.corners
        # An edge on the axis of symmetry is not an end of the mesh: rays go on beyond it.
        self.on_axis = (corners[..., 0] == 0.0) & (np.roll(corners[..., 0], -1, axis=1) == 0.0) & self.axisymmetric
        keep = ~self.on_axis[cell, edge]
        cell, edge = cell[keep], edge[keep]
        self.rim = Segments(corners[cell, edge], corners[cell, (edge + 1) % 4], self.axisymmetric)
        self.rim_cell = cell

    def cell_at(self, place, tangent) -> np.ndarray:
        """The cell of a ray; for a ray on an edge, the cell that it enters; -1 in a gap."""
        there, velocity, _ = plane_motion(place, tangent, np.zeros_like(place), self.axisymmetric)
        speed = np.linalg.norm(velocity, axis=1)
        ahead = velocity / np.where(speed > 0.0, speed, 1.0)[:, None]
        low, high = self.mesh.box
        shifted = there + AHEAD * self.size * ahead
        return self.mesh.locate(np.where((shifted < low) | (shifted > high), there, shifted))[:, None]

    def in_gap(self, cell) -> np.ndarray:
        """Whether a ray is outside all cells."""
        return cell[:, 0] < 0

    def cross(self, cell, face, place, tangent) -> tuple[np.ndarray, np.ndarray]:
        """The cells behind edges (-1: a gap), and which rays leave the box: none, they leave it through gaps only."""
        after = cell.copy()
        edge = face < 4  # the last face is the closest approach to the axis
        after[edge, 0] = self.mesh.neighbors[cell[edge, 0], face[edge]]
        lost = np.flatnonzero(after[:, 0] < 0)
        if len(lost):
            found = self.cell_at(place[lost], tangent[lost])[:, 0]
            after[lost, 0] = np.where(found == cell[lost, 0], -1, found)
        return after, np.zeros(len(cell), dtype=bool)

    def normal(self, cell, face, place) -> np.ndarray:
        """Unit normals of edges, of either sense, at places on them, shape (n, 3)."""
        rows, edge = cell[:, 0], np.minimum(face, 3)
        step = self.mesh.corners[rows, (edge + 1) % 4] - self.mesh.corners[rows, edge]
        step = step / np.linalg.norm(step, axis=1)[:, None]
        across = outward(place) if self.axisymmetric else np.array([0.0, 1.0, 0.0])
        return step[:, 1:] * across - step[:, :1] * np.array([0.0, 0.0, 1.0])

    def reenter(self, place, heading) -> tuple[np.ndarray, np.ndarray]:
        """Distance [m] at which straight rays in a gap enter a cell, inf if none, and that cell, shape (n, 1)."""
        distance, which = self.rim.first_crossing(place, heading, inward=True, least=-AHEAD * self.size)
        return np.maximum(distance, 0.0), self.rim_cell[which][:, None]

    def frame(self, cell, place) -> "MeshFrame":
        """The pieces of the interpolant in these cells, relative to these places."""
        return MeshFrame(self, cell[:, 0], place)


class MeshFrame:
    """The cells of a mesh in which the rays of a bundle are."""

    def __init__(self, air: MeshAir, cell, place):
        """Gather corners and values of the cells."""
        self.air, self.place = air, place
        corners = air.mesh.corners[cell]
        self.on_axis = air.on_axis[cell]
        self.origin = corners[:, 0]
        self.corners = corners - self.origin[:, None]
        vertex = air.mesh.cells[cell]
        self.values = air.samples.values[vertex]
        if air.interpolation != "bilinear":
            self.slopes = air.samples.gradients[vertex]
        self.there = plane_motion(place, np.zeros_like(place), np.zeros_like(place), air.axisymmetric)[0]
        self.local = np.full((len(cell), 2), 0.5)

    def point(self, delta) -> np.ndarray:
        """Place + delta in the plane of the mesh, from the cell's first corner [m], shape (n, 2)."""
        if not self.air.axisymmetric:
            return self.there - self.origin + delta[:, 1:]
        both = self.place + delta
        radius = np.hypot(both[:, 0], both[:, 1])
        total = self.there[:, 0] + radius
        change = dot(self.place[:, :2] + both[:, :2], delta[:, :2]) / np.where(total > 0.0, total, 1.0)
        return self.there - self.origin + np.stack([change, delta[:, 2]], axis=1)

    def sample(self, delta) -> tuple[np.ndarray, np.ndarray]:
        """Potential s, shape (n,), and its gradient [1/m], shape (n, 3), at place + delta."""
        air, point = self.air, self.point(delta)
        if air.interpolation == "idw":
            weight = inverse_distance_weights(self.corners, point)
            contrast, slope = dot(weight, self.values), np.einsum("nk,nkd->nd", weight, self.slopes)
        else:
            contrast, slope = self._bilinear(point)
        index = air.ambient + contrast
        potential, force = contrast * (air.ambient + 0.5 * contrast), index[:, None] * slope
        if not air.axisymmetric:
            return potential, np.concatenate([np.zeros((len(point), 1)), force], axis=1)
        there = self.place[:, :2] + delta[:, :2]
        radius = np.hypot(there[:, 0], there[:, 1])
        outward = there / np.where(radius > 0.0, radius, 1.0)[:, None]
        return potential, np.concatenate([outward * force[:, :1], force[:, 1:]], axis=1)

    def _bilinear(self, point) -> tuple[np.ndarray, np.ndarray]:
        """Contrast and its gradient in the plane: inverts the bilinear map by Newton, starting at the last solution."""
        b, c, d = (self.corners[:, k] for k in (1, 2, 3))
        twist = c - b - d
        xi, eta = self.local[:, :1], self.local[:, 1:]
        for _ in range(NEWTON_STEPS):
            along, across = b + eta * twist, d + xi * twist
            miss = point - xi * b - eta * across
            determinant = along[:, :1] * across[:, 1:] - along[:, 1:] * across[:, :1]
            step = (miss[:, :1] * across[:, 1:] - miss[:, 1:] * across[:, :1]) / determinant
            lift = (along[:, :1] * miss[:, 1:] - along[:, 1:] * miss[:, :1]) / determinant
            xi, eta = np.clip(xi + step, -0.5, 1.5), np.clip(eta + lift, -0.5, 1.5)
            if max(np.abs(step).max(initial=0.0), np.abs(lift).max(initial=0.0)) < 1e-9:  # the next would be rounding
                break
        self.local = np.concatenate([xi, eta], axis=1)
        along, across = b + eta * twist, d + xi * twist
        m0, m1, m2, m3 = (self.values[:, k : k + 1] for k in range(4))
        contrast = (1 - xi) * (1 - eta) * m0 + xi * (1 - eta) * m1 + xi * eta * m2 + (1 - xi) * eta * m3
        if self.air.interpolation == "bilinear-barron":
            weight = np.concatenate([(1 - xi) * (1 - eta), xi * (1 - eta), xi * eta, (1 - xi) * eta], axis=1)
            return contrast[:, 0], np.einsum("nk,nkd->nd", weight, self.slopes)
        rise, lift = (1 - eta) * (m1 - m0) + eta * (m2 - m3), (1 - xi) * (m3 - m0) + xi * (m2 - m1)
        determinant = along[:, :1] * across[:, 1:] - along[:, 1:] * across[:, :1]
        first = (rise * across[:, 1:] - lift * along[:, 1:]) / determinant
        second = (lift * along[:, :1] - rise * across[:, :1]) / determinant
        return contrast[:, 0], np.concatenate([first, second], axis=1)

    def faces(self, delta, tangent, force) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance outside each edge [m], its rate and its curvature over sigma, each (n, face_count)."""
        air = self.air
        shape = (len(delta), air.face_count)
        value, rate, curve = np.empty(shape), np.empty(shape), np.empty(shape)
        _, velocity, bend = plane_motion(self.place + delta, tangent, force, air.axisymmetric)
        point = self.point(delta)
        for k in range(4):
            from_corner, to_corner = self.corners[:, k], self.corners[:, (k + 1) % 4]
            edge = to_corner - from_corner
            normal = np.stack([edge[:, 1], -edge[:, 0]], axis=1) / np.linalg.norm(edge, axis=1)[:, None]
            value[:, k] = dot(normal, point - from_corner)
            rate[:, k], curve[:, k] = dot(normal, velocity), dot(normal, bend)
        if air.axisymmetric:
            value[:, :4][self.on_axis] = -np.inf
            for array, part in zip((value, rate, curve), approach(self.place + delta, tangent, force), strict=True):
                array[:, 4] = part
        return value, rate, curve

    def turning(self) -> np.ndarray:
        """Which faces are the closest approach to the axis, shape (n, face_count)."""
        result = np.zeros((len(self.place), self.air.face_count), dtype=bool)
        if self.air.axisymmetric:
            result[:, 4] = True
        return result
