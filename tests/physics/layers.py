"""Plane-parallel layers: the index depends on one coordinate, so Snell's law solves every ray.

With q the distance along the layer's normal, the momentum along the layer, n sin(angle), is kept. Across it the
momentum is p(q) = sqrt(n^2 - kept^2), and a ray moves int kept / p dq along the layer on an optical path of
int n^2 / p dq. A sharp or smooth step, n = a + jump (1 + tanh(q / width)) / 2, sits at q = 0.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.special import spence

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane
from tests.physics.exact_ends import integral, unit


@dataclass(frozen=True)
class Step:
    """A step of the index across a plane in (y, z).

    Attributes:
        jump: Change of the index across it.
        width: Length scale of the tanh [m]; 0 for a sharp step.
        angle: Angle between the layer's normal and z [rad].
        place: Where the normal through the origin meets the middle of the step [m].
        ambient: Index at q = -infinity.
    """

    jump: float
    width: float
    angle: float = 0.0
    place: float = 0.0
    ambient: float = 1.0

    @property
    def normal(self) -> np.ndarray:
        """Unit normal (0, y, z)."""
        return np.array([0.0, np.sin(self.angle), np.cos(self.angle)])

    def depth(self, points) -> np.ndarray:
        """Distance q [m] at points (n, 3)."""
        return np.asarray(points) @ self.normal - self.place

    def contrast(self, q) -> np.ndarray:
        """Contrast to the ambient index at distances q."""
        if self.width == 0.0:
            return self.jump * np.heaviside(q, 0.5)
        return 0.5 * self.jump * (1.0 + np.tanh(q / self.width))

    def sampled(self, y, z) -> np.ndarray:
        """Contrast at the nodes of a grid."""
        return self.contrast(np.sin(self.angle) * y[:, None] + np.cos(self.angle) * z - self.place)

    def averaged(self, y, z) -> np.ndarray:
        """Averages over the cells centred on the nodes, exact: the second antiderivative at the cells' corners."""
        steps = (y[1] - y[0], z[1] - z[0])
        across, along = np.sin(self.angle), np.cos(self.angle)
        edge_y = np.append(y - 0.5 * steps[0], y[-1] + 0.5 * steps[0])
        edge_z = np.append(z - 0.5 * steps[1], z[-1] + 0.5 * steps[1])
        if across == 0.0:
            row = np.diff(self._once(edge_z - self.place)) / steps[1]
            return np.repeat(row[None], len(y), axis=0)
        corner = self._twice(across * edge_y[:, None] + along * edge_z - self.place)
        return np.diff(np.diff(corner, axis=0), axis=1) / (across * along * steps[0] * steps[1])

    def _once(self, q) -> np.ndarray:
        if self.width == 0.0:
            return self.jump * np.maximum(q, 0.0)
        # ln(2 cosh u) = |u| + ln(1 + exp(-2 |u|)); the straight part is added as the step's own.
        return self.jump * (np.maximum(q, 0.0) + 0.5 * self.width * np.log1p(np.exp(-2.0 * np.abs(q) / self.width)))

    def _twice(self, q) -> np.ndarray:
        sharp = 0.5 * self.jump * np.maximum(q, 0.0) ** 2
        if self.width == 0.0:
            return sharp
        # The integral of ln(1 + exp(-2 u)) from 0 is (pi^2 / 12 + Li2(-exp(-2 u))) / 2; Li2(-x) = spence(1 + x).
        tail = 0.5 * (np.pi**2 / 12.0 + spence(1.0 + np.exp(-2.0 * np.abs(q) / self.width)))
        return sharp + 0.5 * self.jump * self.width**2 * np.sign(q) * tail

    def field(self, y, z, interpolation="cubic", *, cell_averages=True) -> IndexField:
        """On the nodes y, z: from cell averages or from samples at the nodes."""
        return IndexField.from_samples(
            self.averaged(y, z) if cell_averages else self.sampled(y, z),
            origin=(y[0], z[0]),
            spacing=(y[1] - y[0], z[1] - z[0]),
            geometry="planar",
            ambient_index=self.ambient,
            interpolation=interpolation,
            cell_averages=cell_averages,
        )

    def exact(self, rays: RayBundle, until: Plane, past: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Position, direction and optical path of rays at a plane.

        They cross the layer without turning back, and beyond q = `past` the index no longer changes.
        """
        q = self.depth(rays.position)
        across = rays.direction @ self.normal
        along = rays.direction - across[:, None] * self.normal
        sine = np.linalg.norm(along, axis=1)
        kept = (self.ambient + self.contrast(q)) * sine
        level = along / np.maximum(sine, 1e-300)[:, None]

        def momentum(at):
            return np.sqrt((self.ambient + self.contrast(at)) ** 2 - kept[:, None] ** 2)

        slide, path = np.zeros(len(q)), np.zeros(len(q))
        # In parts, so that Gauss points crowd where the index changes; they never lie on an edge, where it may jump.
        edges = np.concatenate([[-np.inf], self.width * np.linspace(-20.0, 20.0, 41), [np.inf]])
        for low, high in itertools.pairwise(edges):
            start, end = np.clip(q, low, high), np.full_like(q, np.clip(past, low, high))
            slide += integral(lambda at: kept[:, None] / momentum(at), start, end, 2)
            path += integral(lambda at: (self.ambient + self.contrast(at)) ** 2 / momentum(at), start, end, 2)
        position = rays.position + (past - q)[:, None] * self.normal + slide[:, None] * level
        forward = momentum(np.full((len(q), 1), past))
        direction = unit(kept[:, None] * level + forward * self.normal)
        rest = (until.point - position) @ until.normal / (direction @ until.normal)
        path += (self.ambient + float(self.contrast(past))) * rest
        return position + rest[:, None] * direction, direction, path
