"""Random bodies with an exact answer: star-shaped, stepped and thin profiles, and lines at random through them."""

import numpy as np

from aerokernels import Body


def star(rng: np.random.Generator, geometry: str, size: float = 1.0, count: int = 20) -> Body:
    """Corners at random distances from the origin, in the order of their angle: sharp, deeply concave."""
    if geometry == "planar":
        angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
        radius = size * rng.uniform(0.2, 1.0, count)
        return Body(np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), geometry)
    angle = np.concatenate([[0.0], np.sort(rng.uniform(0.0, np.pi, count)), [np.pi]])
    radius = size * rng.uniform(0.2, 1.0, count + 2)
    profile = np.stack([radius * np.sin(angle), radius * np.cos(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    return Body(profile, geometry)


def stepped(rng: np.random.Generator, geometry: str, size: float = 1.0, count: int = 6) -> Body:
    """Steps along z, of random height: on the axis, or on one side of y = 0."""
    z = size * np.sort(rng.uniform(-1.0, 1.0, count + 1))
    radius = size * rng.uniform(0.1, 1.0, count)
    steps = [[r, z[k + end]] for k, r in enumerate(radius) for end in (0, 1)]
    return Body(np.array([[0.0, z[0]], *steps, [0.0, z[-1]]]), geometry)


def plate(rng: np.random.Generator, geometry: str, size: float = 1.0, thickness: float = 1e-6) -> Body:
    """A plate or a washer of some thickness across z, its hole or gap beside it; planar ones are tilted."""
    inner, outer = size * np.sort(rng.uniform(0.05, 0.9, 2))
    place = size * rng.uniform(-0.5, 0.5)
    ring = np.array([[inner, 0.0], [outer, 0.0], [outer, thickness], [inner, thickness]])
    if geometry == "planar":
        turn = rng.uniform(-1.0, 1.0)
        ring = ring @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    return Body(ring + np.array([0.0, place]), geometry)


def lines(rng: np.random.Generator, count: int, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Points about the origin and directions, a tenth each along z, along y, across z and within 1e-7 rad of z."""
    position = size * rng.uniform(-1.2, 1.2, (count, 3))
    direction = rng.normal(size=(count, 3))
    part = count // 10
    direction[:part] = [0.0, 0.0, 1.0]
    direction[part : 2 * part] = [0.0, 1.0, 0.0]
    direction[2 * part : 3 * part, 2] = 0.0
    direction[3 * part : 4 * part, :2] *= 1e-7
    return position, direction / np.linalg.norm(direction, axis=1, keepdims=True)


def local(body: Body, points: np.ndarray) -> np.ndarray:
    """(y, z) or (r, z) of points in x, y, z, shape (..., 2)."""
    across = points[..., 1] if body.geometry == "planar" else np.hypot(points[..., 0], points[..., 1])
    return np.stack([across, points[..., 2]], axis=-1)
