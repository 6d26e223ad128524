"""Closed forms of rays in media that only tests look at, written as in exact_ends.py."""

from dataclasses import dataclass

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane
from tests.physics.exact_ends import Ends, Index, integral, layered_direction, unit


@dataclass(frozen=True, eq=False)
class Case:
    """A medium, rays through it, the stop, and where the rays end exactly.

    Attributes:
        index: The exact index at points (..., 3).
        field: The medium on a grid.
        rays: The rays; they start inside the field's box.
        until: The stop.
        ends: Where the rays end.
        scale: Length over which the medium changes [m]. A ray that is `position` off is about position / scale off in
            direction, so directions are judged in units of path / scale.
    """

    index: Index
    field: IndexField
    rays: RayBundle
    until: Plane
    ends: Ends
    scale: float


def build_field(index: Index, geometry: str, axes, ambient: float) -> IndexField:
    """The field of `index` on uniform axes, each given as (low, high, cell count)."""
    nodes = [np.linspace(low, high, cells + 1) for low, high, cells in axes]
    mesh = np.meshgrid(*nodes, indexing="ij")
    zero = np.zeros_like(mesh[0])
    points = {"volume": mesh, "planar": [zero, *mesh], "axisymmetric": [mesh[0], zero, mesh[-1]]}[geometry]
    return IndexField.from_samples(
        index(np.stack(points, axis=-1)) - ambient,
        origin=[low for low, _, _ in axes],
        spacing=[(high - low) / cells for low, high, cells in axes],
        geometry=geometry,
        ambient_index=ambient,
    )


def first_root(a, b, c) -> np.ndarray:
    """Least angle above zero at which a cos + b sin = c."""
    middle, half = np.arctan2(b, a), np.arccos(c / np.hypot(a, b))
    return np.mod(np.stack([middle - half, middle + half]), 2.0 * np.pi).min(axis=0)


def fish_eye_ends(rays: RayBundle, angle, n0: float, radius: float) -> Ends:
    """After `angle` round the sphere in n = n0 / (1 + (r / R)^2).

    The stereographic image of the medium is a sphere in four dimensions, whose great circles are the rays: with
    r = R X / (1 - W), |X|^2 + W^2 = 1, the index times ds is n0 R / 2 times the angle.
    """
    start, along = fish_eye_sphere(rays, radius)
    turn = np.broadcast_to(np.asarray(angle, dtype=float), rays.ray_count)

    def on_sphere(at):
        cosine, sine = np.cos(at)[..., None], np.sin(at)[..., None]
        return start[:, None, :] * cosine + along[:, None, :] * sine

    def length_rate(at):
        return radius / (1.0 - on_sphere(at)[..., 3])  # ds / d angle = (R^2 + r^2) / (2 R) = R / (1 - W)

    there = on_sphere(turn[:, None])[:, 0]
    motion = on_sphere(turn[:, None] + 0.5 * np.pi)[:, 0]
    gap = 1.0 - there[:, 3:]
    direction = unit(motion[:, :3] / gap + there[:, :3] * motion[:, 3:] / gap**2)
    arc = integral(length_rate, np.zeros_like(turn), turn)
    return Ends(radius * there[:, :3] / gap, direction, 0.5 * n0 * radius * turn, arc)


def fish_eye_sphere(rays: RayBundle, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Start on the unit sphere and unit tangent there of rays in a fish-eye, shapes (n, 4)."""
    r, d = rays.position / radius, rays.direction
    square = np.sum(r**2, axis=1, keepdims=True)
    radial = np.sum(r * d, axis=1, keepdims=True)
    start = np.concatenate([2.0 * r, square - 1.0], axis=1) / (1.0 + square)
    along = np.concatenate([d - 2.0 * r * radial / (1.0 + square), 2.0 * radial / (1.0 + square)], axis=1)
    return start, along


def exponential_ends(rays: RayBundle, advance, n0: float, length: float) -> Ends:
    """After `advance` [m] along x, z in n = n0 exp(y / L).

    n cos(slope) is kept, so the slope grows evenly, by l / L; y = y0 + L ln(cos(slope0) / cos(slope)), the catenary of
    equal strength; optical path n cos(slope) L (tan(slope) - tan(slope0)).
    """
    level, slope = layered_direction(rays)
    end = slope + np.asarray(advance, dtype=float) / length
    kept = n0 * np.exp(rays.position[:, 1] / length) * np.cos(slope)
    position = rays.position + level * (length * (end - slope))[:, None]
    position[:, 1] += length * np.log(np.cos(slope) / np.cos(end))
    direction = level * np.cos(end)[:, None] + np.sin(end)[:, None] * [0.0, 1.0, 0.0]
    optical_path = kept * length * (np.tan(end) - np.tan(slope))
    return Ends(position, direction, optical_path, length * (np.arcsinh(np.tan(end)) - np.arcsinh(np.tan(slope))))


def power_ends(rays: RayBundle, normal, n0: float, power: float, radius: float = 1.0) -> Ends:
    """At the plane through the centre across `normal`, in n = n0 (r / R)^p.

    In the plane of the ray, with polar angle a from its start and the angle b = pi/2 - psi by which it climbs,
    Bouguer's n r cos(b) = constant gives db/da = p + 1 = q and r^q cos(b) = constant; the optical path is
    n0 r0^q cos(b0) (tan(b) - tan(b0)) / (q R^p). For q = 0, a logarithmic spiral, b stays and it is n0 R a / cos(b).
    """
    r0 = np.linalg.norm(rays.position, axis=1)
    outward = rays.position / r0[:, None]
    climb = np.arcsin(np.sum(outward * rays.direction, axis=1))
    onward = unit(rays.direction - np.sin(climb)[:, None] * outward)
    angle = np.mod(np.arctan2(-(outward @ np.asarray(normal)), onward @ np.asarray(normal)), np.pi)
    q = power + 1.0

    def reach(at):
        """Radius and climb at polar angles (n, q)."""
        b0 = climb[:, None]
        b = b0 + q * at
        if q == 0.0:
            return r0[:, None] * np.exp(at * np.tan(b0)), b
        return r0[:, None] * (np.cos(b0) / np.cos(b)) ** (1.0 / q), b

    def length_rate(at):
        r, b = reach(at)
        return r / np.cos(b)

    r, b = (array[:, 0] for array in reach(angle[:, None]))
    here = np.cos(angle)[:, None] * outward + np.sin(angle)[:, None] * onward
    ahead = np.cos(angle)[:, None] * onward - np.sin(angle)[:, None] * outward
    growth = angle / np.cos(climb) ** 2 if q == 0.0 else (np.tan(b) - np.tan(climb)) / q
    optical_path = n0 * r0**q * radius**-power * np.cos(climb) * growth
    arc = integral(length_rate, np.zeros_like(angle), angle)
    return Ends(r[:, None] * here, np.sin(b)[:, None] * here + np.cos(b)[:, None] * ahead, optical_path, arc)
