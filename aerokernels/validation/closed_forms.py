"""Closed forms of rays in graded-index media, and what the cases of media.py, made of them, share.

Closed forms are written in the parameter sigma of the ray equation, d sigma = ds / n: r'' = grad(n^2) / 2, |r'| = n,
optical path = integral of n^2 d sigma; or in an angle that takes its place. Lengths of rays without a closed form are
Gauss integrals of a smooth integrand, good to rounding.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane

Index = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Ends:
    """Where exact rays end: position [m], unit tangent, optical path [m], length [m]."""

    position: np.ndarray
    direction: np.ndarray
    optical_path: np.ndarray
    arc_length: np.ndarray

    def opd(self, rays: RayBundle, ambient: float, plane: Plane) -> np.ndarray:
        """Optical path less that of the undisturbed rays to the plane [m], shape (ray_count,)."""
        undisturbed = (plane.point - rays.position) @ plane.normal / (rays.direction @ plane.normal)
        return self.optical_path - ambient * undisturbed


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


def integral(integrand, start, stop, panels: int = 8) -> np.ndarray:
    """Integrals from `start` to `stop`, shapes (n,), of a function of arrays (n, q), with 16 Gauss points a panel."""
    start, stop = np.broadcast_arrays(np.asarray(start, dtype=float), np.asarray(stop, dtype=float))
    node, weight = np.polynomial.legendre.leggauss(16)
    share = ((np.arange(panels)[:, None] + 0.5 * (node + 1.0)) / panels).ravel()
    span = stop - start
    return integrand(start[:, None] + span[:, None] * share) @ np.tile(0.5 * weight / panels, panels) * span


def first_root(a, b, c) -> np.ndarray:
    """Least angle above zero at which a cos + b sin = c."""
    middle, half = np.arctan2(b, a), np.arccos(c / np.hypot(a, b))
    return np.mod(np.stack([middle - half, middle + half]), 2.0 * np.pi).min(axis=0)


def unit(vectors) -> np.ndarray:
    """Vectors, made unit vectors."""
    vectors = np.asarray(vectors, dtype=float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def parabolic_contrast(height: np.ndarray, n0: float, g: float) -> np.ndarray:
    """n0 (sqrt(1 - g^2 y^2) - 1), without cancellation."""
    square = (g * height) ** 2
    return -n0 * square / (1.0 + np.sqrt(1.0 - square))


def sech_contrast(height: np.ndarray, n0: float, g: float) -> np.ndarray:
    """n0 (sech(g y) - 1), without cancellation."""
    return -2.0 * n0 * np.sinh(0.5 * g * height) ** 2 / np.cosh(g * height)


def quadratic_ends(index: Index, rays: RayBundle, sigma, *, stiffness=(0, 0, 0), force=(0, 0, 0), panels=8) -> Ends:
    """After `sigma` in n^2 = constant - sum k_i x_i^2 + 2 sum f_i x_i; along an axis k_i or f_i is zero.

    The axes part: x_i swings about 0 with frequency sqrt(k_i), or falls with f_i. As n^2 = |r'|^2, the optical path is
    the sum over the axes of the integral of (x_i')^2 d sigma.
    """
    start = rays.position
    launch = index(start)[:, None] * rays.direction
    stop = np.broadcast_to(np.asarray(sigma, dtype=float), len(start))
    fall = np.asarray(force, dtype=float)
    rate = np.sqrt(np.asarray(stiffness, dtype=float))
    swings = rate > 0.0
    safe = np.where(swings, rate, 1.0)

    def momentum(at):
        s = at[..., None]
        place, kick = start[:, None, :], launch[:, None, :]
        return np.where(swings, kick * np.cos(rate * s) - place * rate * np.sin(rate * s), kick + fall * s)

    s = stop[:, None]
    cosine, sine = np.cos(rate * s), np.sin(rate * s)
    position = np.where(swings, start * cosine + launch * sine / safe, start + launch * s + 0.5 * fall * s**2)
    beat = 0.5 * sine * cosine / safe
    swung = launch**2 * (0.5 * s + beat) + (start * rate) ** 2 * (0.5 * s - beat) - start * launch * sine**2
    fallen = launch**2 * s + launch * fall * s**2 + fall**2 * s**3 / 3.0
    arc = integral(lambda at: np.linalg.norm(momentum(at), axis=-1), np.zeros_like(stop), stop, panels)
    end = momentum(stop[:, None])[:, 0]
    return Ends(position, unit(end), np.where(swings, swung, fallen).sum(axis=1), arc)


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


def layered_direction(rays: RayBundle) -> tuple[np.ndarray, np.ndarray]:
    """For media n(y): the unit vector along x, z that a ray keeps, shape (n, 3), and its angle to it, shape (n,)."""
    level = rays.direction * [1.0, 0.0, 1.0]
    return unit(level), np.arctan2(rays.direction[:, 1], np.linalg.norm(level, axis=1))


def sech_ends(rays: RayBundle, advance, n0: float, g: float) -> Ends:
    """After `advance` [m] along x, z in n = n0 sech(g y).

    u = sinh(g y) = A sin(g l + phase) with l along x, z; beta = n cos(slope) = n0 / sqrt(1 + A^2) is kept. The optical
    path, the integral of n^2 / beta dl, is n0 / g times the growth of arctan(sqrt(1 + A^2) tan(g l + phase)).
    """
    level, slope = layered_direction(rays)
    start = np.sinh(g * rays.position[:, 1])
    rise = np.cosh(g * rays.position[:, 1]) * np.tan(slope)  # du / d(g l)
    phase = np.arctan2(start, rise)
    swing = np.hypot(start, rise)
    phase_end = phase + g * np.asarray(advance, dtype=float)
    root = np.sqrt(1.0 + swing**2)

    def stretched(at):
        """arctan(root tan(at)), continued over all turns."""
        return at + np.arctan2((root - 1.0) * np.sin(at) * np.cos(at), np.cos(at) ** 2 + root * np.sin(at) ** 2)

    def tangent(at):
        a = swing[:, None]
        return a * np.cos(at) / np.sqrt(1.0 + (a * np.sin(at)) ** 2)

    turns = int(np.ceil(np.max(phase_end - phase) / np.pi))
    arc = integral(lambda at: np.sqrt(1.0 + tangent(at) ** 2), phase, phase_end, 8 * turns) / g
    position = rays.position + level * (np.asarray(advance) * np.ones(rays.ray_count))[:, None]
    position[:, 1] = np.arcsinh(swing * np.sin(phase_end)) / g
    direction = unit(level + tangent(phase_end[:, None]) * [0.0, 1.0, 0.0])
    return Ends(position, direction, n0 / g * (stretched(phase_end) - stretched(phase)), arc)


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
