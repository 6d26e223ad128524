"""Where rays end in an index that is a formula: two closed forms, and an integrator for the rest.

The integrator shares nothing with the library's tracers: Hamilton's equations with z for the time, all rays in one
system, SciPy's DOP853 at a relative tolerance of 1e-12. Against the closed forms it is good to about 1e-9 waves.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from aerokernels import RayBundle

# (x, y, z) [m] -> contrast, and its derivatives by x and y [1/m], shape (2, ray_count).
Formula = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class Truth:
    """Where rays end: position [m] and direction (ray_count, 3), OPD [m] (ray_count,)."""

    position: np.ndarray
    direction: np.ndarray
    opd: np.ndarray


def integrate(formula: Formula, ambient: float, z_end: float, longest: float, rays: RayBundle) -> Truth:
    """Rays that all start on one plane z = const, to another.

    dx/dz = px / pz,  dp/dz = n grad n / pz,  dOPD/dz = n^2 / pz - a / dz0,  pz = sqrt(n^2 - px^2 - py^2)

    Args:
        formula: The contrast.
        ambient: Index of zero contrast, a.
        z_end: Where the rays end [m].
        longest: Greatest step [m], so that nothing thin is stepped over.
        rays: The rays; dz0 is the cosine of each with the z axis.

    Raises:
        ValueError: Rays that start on different planes.
    """
    z_start = float(rays.position[0, 2])
    if (rays.position[:, 2] != z_start).any():
        raise ValueError("the rays must start on one plane z = const")
    cosine = rays.direction[:, 2]

    def rate(z: float, state: np.ndarray) -> np.ndarray:
        x, y, px, py, _ = state.reshape(5, -1)
        contrast, slope = formula(x, y, np.full_like(x, z))
        index = ambient + contrast
        pz = np.sqrt(index**2 - px**2 - py**2)
        return np.concatenate([px / pz, py / pz, *(index * slope / pz), index**2 / pz - ambient / cosine])

    start = rays.position[:, :2].T
    contrast, _ = formula(*start, rays.position[:, 2])
    momentum = (ambient + contrast) * rays.direction[:, :2].T
    state = np.concatenate([*start, *momentum, np.zeros(rays.ray_count)])
    # What counts as nothing: 1e-18 m of place and path, 1e-16 of momentum.
    least = np.repeat([1e-18, 1e-18, 1e-16, 1e-16, 1e-18], rays.ray_count)
    solution = solve_ivp(
        rate, (z_start, z_end), state, method="DOP853", rtol=1e-12, atol=least, max_step=longest, t_eval=[z_end]
    )
    x, y, px, py, opd = solution.y[:, -1].reshape(5, -1)
    contrast, _ = formula(x, y, np.full_like(x, z_end))
    index = ambient + contrast
    pz = np.sqrt(index**2 - px**2 - py**2)
    return Truth(np.stack([x, y, np.full_like(x, z_end)], axis=1), np.stack([px, py, pz], axis=1) / index[:, None], opd)


def parabola_truth(n0: float, g: float, z_end: float, rays: RayBundle) -> Truth:
    """Any rays in n^2 = n0^2 (1 - g^2 r^2): x and y are sinusoids in sigma, z is proportional to it; ambient n0.

    x = x0 cos(k sigma) + (T_x / k) sin(k sigma),  k = n0 g,  path = n0^2 sigma - k^2 int (x^2 + y^2) d sigma
    """
    start, k = rays.position, n0 * g
    momentum = n0 * np.sqrt(1.0 - g**2 * np.sum(start[:, :2] ** 2, axis=1))[:, None] * rays.direction
    length = z_end - start[:, 2]
    sigma = (length / momentum[:, 2])[:, None]
    x0, t0 = start[:, :2], momentum[:, :2] / k
    cosine, sine = np.cos(k * sigma), np.sin(k * sigma)
    wobble = sine * cosine / k
    square = 0.5 * x0**2 * (sigma + wobble) + 0.5 * t0**2 * (sigma - wobble) + x0 * t0 * sine**2 / k
    tangent = np.c_[k * (t0 * cosine - x0 * sine), momentum[:, 2]]
    return Truth(
        np.c_[x0 * cosine + t0 * sine, np.full(len(x0), z_end)],
        tangent / np.linalg.norm(tangent, axis=1)[:, None],
        n0**2 * sigma[:, 0] - k**2 * square.sum(axis=1) - n0 * length / rays.direction[:, 2],
    )


def sech_truth(n0: float, g: float, z_end: float, rays: RayBundle) -> Truth:
    """Rays from z = 0, parallel to z, in n = n0 sech(g r); ambient n0.

    sinh(g r) = sinh(g r0) cos(g z),  path = (n0 / g) arctan(tan(g z) / cosh(g r0)) on the branch that starts at 0
    """
    r0 = np.hypot(*rays.position[:, :2].T)
    outward = rays.position[:, :2] / np.where(r0 > 0.0, r0, 1.0)[:, None]
    cosine, sine = np.cos(g * z_end), np.sin(g * z_end)
    height = np.arcsinh(np.sinh(g * r0) * cosine) / g
    slope = -np.sinh(g * r0) * sine / np.cosh(g * height)
    stretch = np.cosh(g * r0)
    # The arctan less g z, which is the undisturbed ray's.
    ahead = np.arctan2((1.0 - stretch) * sine * cosine, stretch * cosine**2 + sine**2)
    tangent = np.c_[slope[:, None] * outward, np.ones(len(r0))]
    return Truth(
        np.c_[height[:, None] * outward, np.full(len(r0), z_end)],
        tangent / np.linalg.norm(tangent, axis=1)[:, None],
        n0 / g * ahead,
    )
