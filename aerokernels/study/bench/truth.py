r"""Where rays truly end, and how far a tracer is from it.

Hamilton's equations with z for the time and s = (n^2 - a^2) / 2 the optical potential, a the ambient index:

    dx/dz = T_x / T_z,   dT_x/dz = (ds/dx) / T_z,   T_z = sqrt(a^2 + 2 s - T_x^2 - T_y^2)   (y alike)
    dOPD/dz = n^2 / T_z - a = (2 s - a d) / T_z,    d = T_z - a = (2 s - T_x^2 - T_y^2) / (T_z + a)

which has no difference of nearly equal numbers, so that it serves float32 peers as well.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.rays import RayBundle
from aerokernels.study.bench.scenes import CONE_AMBIENT, CONE_HALF, WAVELENGTH, cone_potential

TRUTH_RAYS = 256
TIGHT = 1e-12
# (x, y, z) [m] -> potential, shape (n,), and its gradient [1/m], shape (3, n)
Potential = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class RayEnds:
    """Rays on the face z = +8 mm.

    Attributes:
        direction: Unit tangents, shape (ray_count, 3).
        optical_path: Optical path from the face z = -8 mm on [m], shape (ray_count,).
        evaluations: Field evaluations of a ray.
        seconds: Time for tracing alone, before results were brought into this form.
    """

    direction: np.ndarray
    optical_path: np.ndarray
    evaluations: float
    seconds: float


def slopes(
    potential: Any, gradient_x: Any, gradient_y: Any, momentum_x: Any, momentum_y: Any, sqrt: Any
) -> tuple[Any, ...]:
    """dx/dz, dy/dz, dT_x/dz, dT_y/dz, dOPD/dz; arrays of any library whose square root is `sqrt`."""
    square = momentum_x * momentum_x + momentum_y * momentum_y
    gained = 2.0 * potential - square
    momentum_z = sqrt(CONE_AMBIENT**2 + gained)
    path = (2.0 * potential - CONE_AMBIENT * (gained / (momentum_z + CONE_AMBIENT))) / momentum_z
    return (
        momentum_x / momentum_z,
        momentum_y / momentum_z,
        gradient_x / momentum_z,
        gradient_y / momentum_z,
        path,
    )


def ray_ends(momentum_x: Any, momentum_y: Any, opd: Any, potential: Any, evaluations: float, seconds: float) -> RayEnds:
    """Directions and optical paths from transverse momenta, OPDs [m] and the potential at the ends."""
    x, y = (np.asarray(momentum, dtype=np.float64) for momentum in (momentum_x, momentum_y))
    z = np.sqrt(CONE_AMBIENT**2 + 2.0 * np.asarray(potential, dtype=np.float64) - x**2 - y**2)
    tangent = np.stack([x, y, z], axis=1)
    path = np.asarray(opd, dtype=np.float64) + CONE_AMBIENT * 2.0 * CONE_HALF[2]
    return RayEnds(tangent / np.linalg.norm(tangent, axis=1, keepdims=True), path, evaluations, seconds)


def integrate(rays: RayBundle, potential: Potential = cone_potential, tolerance: float = TIGHT) -> RayEnds:
    """SciPy's DOP853 from the face z = -8 mm to z = +8 mm, all rays in one system.

    The rays run along z where they start, so their transverse momenta are 0 there whatever the index.

    Args:
        rays: Rays of `cone_rays`.
        potential: The medium.
        tolerance: Relative tolerance.
    """
    from scipy.integrate import solve_ivp

    begin = time.perf_counter()
    count = rays.ray_count

    def rate(z: float, state: np.ndarray) -> np.ndarray:
        x, y, momentum_x, momentum_y, _ = state.reshape(5, count)
        value, gradient = potential(x, y, np.full(count, z))
        return np.concatenate(slopes(value, gradient[0], gradient[1], momentum_x, momentum_y, np.sqrt))

    start = np.concatenate([rays.position[:, 0], rays.position[:, 1], np.zeros(3 * count)])
    # What counts as nothing: by the tolerance 1 um of place, 1 mrad of momentum and 1 um of path.
    least = tolerance * np.repeat([1e-6, 1e-6, 1e-3, 1e-3, 1e-6], count)
    end = CONE_HALF[2]
    found = solve_ivp(rate, (-end, end), start, method="DOP853", rtol=tolerance, atol=least, max_step=1e-3)
    x, y, momentum_x, momentum_y, opd = found.y[:, -1].reshape(5, count)
    value, _ = potential(x, y, np.full(count, end))
    return ray_ends(momentum_x, momentum_y, opd, value, float(found.nfev), time.perf_counter() - begin)


def chosen_rays(ray_count: int) -> np.ndarray:
    """Up to TRUTH_RAYS row numbers, in order: those that are compared with the truth, the same ones at every call."""
    return np.sort(np.random.default_rng(905).choice(ray_count, min(TRUTH_RAYS, ray_count), replace=False))


def errors(truth: RayEnds, direction: Any, optical_path: Any, good: Any = None) -> dict:
    """OPD errors in waves, no piston taken out, and the greatest angle error [urad], over the rays that are good.

    Args:
        truth: The true ends.
        direction: Unit tangents of the same rays, shape (n, 3).
        optical_path: Their optical paths [m], shape (n,).
        good: Which rays arrived, shape (n,); None for all.
    """
    good = np.ones(len(optical_path), dtype=bool) if good is None else np.asarray(good)
    if not good.any():
        return {
            "opd_rms_waves": None,
            "opd_max_waves": None,
            "direction_max_urad": None,
            "ray_count": 0,
            "lost_ray_count": len(good),
        }
    waves = (np.asarray(optical_path) - truth.optical_path)[good] / WAVELENGTH
    angle = np.linalg.norm((np.asarray(direction) - truth.direction)[good], axis=1)
    return {
        "opd_rms_waves": float(np.sqrt(np.mean(waves**2))),
        "opd_max_waves": float(np.abs(waves).max()),
        "direction_max_urad": float(1e6 * angle.max()),
        "ray_count": int(good.sum()),
        "lost_ray_count": int((~good).sum()),
    }
