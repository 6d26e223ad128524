"""The state of the reference engine's rays in flight, where a parabola first meets a surface, and the body's walls."""

from dataclasses import dataclass, field

import numpy as np

from .medium import dot, plane_motion


@dataclass
class Flight:
    """The state of rays in flight, one entry per ray.

    Constant: start [m], direction, side (1 or -1, so that side times the distance from the stop plane is negative
    before the plane), normal of the body where the ray leaves it, zero for other rays. State: along t [m], q [m],
    momentum P, work W [m], stretch S [m], cell. Errors: lever_arm [m] and gain, by which errors of direction and of
    position become errors of the optical path; error [m]. Counts: steps, evaluations, attempts. Ends: stopped (at the
    user's stop), left (the box), hit (the body), failed (not finite), spent (all steps).
    """

    start: np.ndarray
    direction: np.ndarray
    side: np.ndarray
    along: np.ndarray
    lever_arm: np.ndarray
    gain: np.ndarray
    cell: np.ndarray
    normal: np.ndarray = field(init=False)
    q: np.ndarray = field(init=False)
    momentum: np.ndarray = field(init=False)

    def __post_init__(self):
        """Start undisturbed."""
        count = len(self.start)
        self.q, self.momentum, self.normal = (np.zeros((count, 3)) for _ in range(3))
        self.work, self.stretch, self.error = np.zeros(count), np.zeros(count), np.zeros(count)
        self.steps, self.evaluations, self.attempts = (np.zeros(count, dtype=np.int64) for _ in range(3))
        self.stopped, self.left, self.hit, self.failed, self.spent = (np.zeros(count, dtype=bool) for _ in range(5))

    @property
    def going(self) -> np.ndarray:
        """Numbers of the rays that are still in flight."""
        return np.flatnonzero(~(self.stopped | self.left | self.hit | self.failed | self.spent))


def starting_momentum(ambient: float, contrast, direction, normal) -> np.ndarray:
    """Return the momenta n dr/ds of rays where they begin, minus `ambient` times their directions, shape (n, 3).

    Rays that leave the body, where `normal` is not zero, are refracted there; others keep their direction. A ray that
    would be reflected within the body runs along its surface.
    """
    before = ambient * np.sum(direction * normal, axis=1)
    twice = contrast * (2.0 * ambient + contrast)  # n^2 - a^2
    behind = np.sqrt(np.maximum(before**2 + twice, 0.0))
    leaves = before > 0.0
    kick = np.maximum(twice / np.where(leaves, before + behind, 1.0), -before)
    return np.asarray(np.where(leaves[:, None], kick[:, None] * normal, contrast[:, None] * direction))


def rising_root(v0, v1, v2, tolerance) -> np.ndarray:
    """Return the first h >= 0 at which v0 + v1 h + v2 h^2 rises through zero; inf if it does not, 0 if it is above."""
    known = np.isfinite(v0)
    v0 = np.where(known, v0, -1.0)
    disc = v1 * v1 - 4.0 * v2 * v0
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        rest = np.sqrt(np.maximum(disc, 0.0))
        forward = np.where(v1 + rest > 0.0, -2.0 * v0 / (v1 + rest), np.inf)
        back = np.where(v2 > 0.0, (rest - v1) / (2.0 * v2), np.inf)
        root = np.where(v1 >= 0.0, forward, back)
    root = np.where(disc < 0.0, np.inf, root)
    # A ray that is above only by rounding and moves inward is not outside.
    above = (v0 >= 0.0) & ((v1 > 0.0) | ((v1 == 0.0) & (v2 > 0.0)) | ((v0 > tolerance) & (disc < 0.0)))
    root = np.where(above, 0.0, root)
    return np.where(known, np.maximum(root, 0.0), np.inf)


PAIRS = 200_000  # rays times segments that are computed together; speed only
# Share of a segment's length by which a crossing may be beyond its ends, so that no ray slips through a corner.
BEYOND = 1e-10


class Segments:
    """Segments from `start` to `end` [m], each (w, 2), in the plane (y, z) or (r, z); their left side is inside."""

    def __init__(self, start: np.ndarray, end: np.ndarray, axisymmetric: bool):
        """Keep directions and lengths."""
        self.start, self.axisymmetric = np.asarray(start, dtype=np.float64), axisymmetric
        self.step = np.asarray(end, dtype=np.float64) - self.start
        self.length = np.linalg.norm(self.step, axis=1)
        self.normal = np.stack([self.step[:, 1], -self.step[:, 0]], axis=1) / self.length[:, None]  # outward

    def __len__(self) -> int:
        """Number of segments."""
        return len(self.start)

    def depth(self, which, place, tangent, force) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance of each ray inside segment `which` (n,) [m], with the rate and curvature over sigma, each (n,)."""
        there, velocity, bend = plane_motion(place, tangent, force, self.axisymmetric)
        normal = -self.normal[which]
        return dot(normal, there - self.start[which]), dot(normal, velocity), dot(normal, bend)

    def crossings(self, place, heading) -> tuple[np.ndarray, np.ndarray]:
        """Distances [m] at which straight rays meet the segments, nan where they do not, and rates outward; (n, w, 2).

        A ray meets a cone twice at most; in a planar field the second is always nan.
        """
        there = plane_motion(place, heading, np.zeros_like(place), self.axisymmetric)[0]
        apart = np.einsum("nwk,wk->nw", there[:, None] - self.start, self.normal)
        n0, n1 = self.normal.T
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            if self.axisymmetric:
                root = self._cone_roots(place, heading, there[:, 0], apart)
            else:
                flat = -apart / (heading[:, 1:] @ self.normal.T)
                root = np.stack([flat, np.full_like(flat, np.nan)], axis=2)
            root = np.where(np.isfinite(root), root, np.nan)
            met = place[:, None, None] + root[..., None] * heading[:, None, None]
            if self.axisymmetric:
                radius = np.hypot(met[..., 0], met[..., 1])
                rise = met[..., 0] * heading[:, None, None, 0] + met[..., 1] * heading[:, None, None, 1]
                rise = rise / np.where(radius > 0.0, radius, 1.0)
                first, rate = radius, n0[:, None] * rise + n1[:, None] * heading[:, None, None, 2]
            else:
                first = met[..., 1]
                rate = np.broadcast_to((heading[:, 1:] @ self.normal.T)[..., None], root.shape)
            share = (first - self.start[:, None, 0]) * self.step[:, None, 0]
            share = (share + (met[..., 2] - self.start[:, None, 1]) * self.step[:, None, 1]) / self.length[:, None] ** 2
            # A root on the other nappe of the cone has the wrong radius, which its distance from the segment shows.
            off = n0[:, None] * (first - self.start[:, None, 0]) + n1[:, None] * (met[..., 2] - self.start[:, None, 1])
            size = self.length[:, None] + np.abs(self.start).max()
            good = (share >= -BEYOND) & (share <= 1.0 + BEYOND) & (np.abs(off) <= 1e-9 * size)
        return np.where(good, root, np.nan), rate

    def _cone_roots(self, place, heading, radius, apart) -> np.ndarray:
        n0, n1 = self.normal.T
        sideways = dot(heading[:, :2], heading[:, :2])[:, None]
        middle = dot(place[:, :2], heading[:, :2])[:, None]
        climb = heading[:, 2:]
        g0 = radius[:, None] - apart / n0
        g1 = -n1 / n0 * climb
        a, b, c = g1**2 - sideways, g0 * g1 - middle, -apart / n0 * (g0 + radius[:, None])
        square = b * b - a * c
        # On the axis both roots are equal: rounding must not remove them.
        rest = np.sqrt(np.where(np.abs(square) <= 1e-14 * b * b, 0.0, square))
        big = -(b + np.where(b >= 0.0, rest, -rest))
        flat = np.abs(n0) < 1e-12
        across = -apart / (n1 * climb)
        one = np.where(flat, across, big / a)
        other = np.where(flat, np.nan, c / big)
        return np.stack([one, other], axis=2)

    def first_crossing(self, place, heading, inward: bool, least: float) -> tuple[np.ndarray, np.ndarray]:
        """Distance [m] to the first segment that a straight ray crosses inward (or outward), and which one.

        Crossings nearer than `least` do not count; inf and 0 where there is none.
        """
        distance, which = np.full(len(place), np.inf), np.zeros(len(place), dtype=np.int64)
        block = max(1, PAIRS // max(len(self), 1))  # speed only
        for first in range(0, len(place), block):
            rows = slice(first, first + block)
            root, rate = self.crossings(place[rows], heading[rows])
            good = (root >= least) & ((rate < 0.0) if inward else (rate > 0.0))
            near = np.where(good, root, np.inf).min(axis=2)
            which[rows] = near.argmin(axis=1)
            distance[rows] = near.min(axis=1)
        return distance, which


class Triangles(Segments):
    """Triangles in space, counter-clockwise seen from outside, each as a plane with barycentric coordinates."""

    def __init__(self, corners: np.ndarray):
        """Compute their planes; corners [m], shape (w, 3, 3)."""
        self.corner, self.axisymmetric = corners[:, 0], False
        self.edge = corners[:, 1:] - corners[:, :1]
        area = np.cross(self.edge[:, 0], self.edge[:, 1])
        self.normal = area / np.linalg.norm(area, axis=1)[:, None]  # outward
        # Barycentric coordinates of the second and the third corner, as products with the vector from the first corner.
        size = np.sum(area * area, axis=1)[:, None]
        self.share = (
            np.stack([np.cross(self.edge[:, 1], area), np.cross(area, self.edge[:, 0])], axis=1) / size[:, None]
        )

    def __len__(self) -> int:
        """Number of triangles."""
        return len(self.corner)

    def depth(self, which, place, tangent, force) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distance of each ray inside the plane of triangle `which` [m], with the rate and curvature over sigma."""
        normal = -self.normal[which]
        return dot(normal, place - self.corner[which]), dot(normal, tangent), dot(normal, force)

    def crossings(self, place, heading) -> tuple[np.ndarray, np.ndarray]:
        """Distances [m] at which straight rays meet the triangles, nan for none, and rates outward; (n, w, 1)."""
        rate = heading @ self.normal.T
        with np.errstate(divide="ignore", invalid="ignore"):
            root = (np.sum(self.corner * self.normal, axis=1) - place @ self.normal.T) / rate
            root = np.where(np.isfinite(root), root, np.nan)
            met = place[:, None] + root[..., None] * heading[:, None] - self.corner
            second, third = (np.einsum("nwk,wk->nw", met, self.share[:, k]) for k in (0, 1))
            good = (second >= -BEYOND) & (third >= -BEYOND) & (second + third <= 1.0 + BEYOND)
        return np.where(good, root, np.nan)[..., None], rate[..., None]
