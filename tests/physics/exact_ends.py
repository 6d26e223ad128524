"""Closed forms of rays in graded-index media.

They are written in the parameter sigma of the ray equation, d sigma = ds / n: r'' = grad(n^2) / 2, |r'| = n,
optical path = integral of n^2 d sigma; or in an angle in its place. Lengths of rays without a closed form are Gauss
integrals of a smooth integrand, accurate to rounding.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

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


def integral(integrand, start, stop, panels: int = 8) -> np.ndarray:
    """Integrals from `start` to `stop`, shapes (n,), of a function of arrays (n, q), with 16 Gauss points a panel."""
    start, stop = np.broadcast_arrays(np.asarray(start, dtype=float), np.asarray(stop, dtype=float))
    node, weight = np.polynomial.legendre.leggauss(16)
    share = ((np.arange(panels)[:, None] + 0.5 * (node + 1.0)) / panels).ravel()
    span = stop - start
    return integrand(start[:, None] + span[:, None] * share) @ np.tile(0.5 * weight / panels, panels) * span


def unit(vectors) -> np.ndarray:
    """Normalise vectors."""
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
    """Ends after `sigma` in n^2 = constant - sum k_i x_i^2 + 2 sum f_i x_i; along an axis k_i or f_i is zero.

    The axes separate: x_i oscillates about 0 with frequency sqrt(k_i), or falls with f_i. As n^2 = |r'|^2, the optical
    path is the sum over the axes of the integral of (x_i')^2 d sigma.
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


def layered_direction(rays: RayBundle) -> tuple[np.ndarray, np.ndarray]:
    """For media n(y): the constant unit vector along x, z of a ray, shape (n, 3), and its angle to it, shape (n,)."""
    level = rays.direction * [1.0, 0.0, 1.0]
    return unit(level), np.arctan2(rays.direction[:, 1], np.linalg.norm(level, axis=1))


def sech_ends(rays: RayBundle, advance, n0: float, g: float) -> Ends:
    """Ends after `advance` [m] along x, z in n = n0 sech(g y).

    u = sinh(g y) = A sin(g l + phase) with l along x, z; beta = n cos(slope) = n0 / sqrt(1 + A^2) is constant. The
    optical path, the integral of n^2 / beta dl, is n0 / g times the increase of arctan(sqrt(1 + A^2) tan(g l + phase)).
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
