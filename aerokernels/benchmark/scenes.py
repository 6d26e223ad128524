r"""What the benchmark traces, and the true rays of a field that a formula gives.

The cone: n = 1 + 2.4e-4 (1 + 0.5 tanh((r - a tan 25 deg) / 0.5 mm)), a = y + 6 mm, r = sqrt(x^2 + z^2), a shock cone
about the y axis that rays along z cross twice. Far from the axis n tends to 1 + 3.6e-4: that is the ambient index, and
at the faces z = +-8 mm through which rays enter and leave the contrast is below 1e-10.

True rays by SciPy's DOP853, all as one system with z in place of time. With s = (n^2 - a^2) / 2 the optical potential,
a the ambient index and T = n dr/ds the momentum:

    dx/dz = T_x / T_z,   dT_x/dz = (ds/dx) / T_z,   T_z = sqrt(a^2 + 2 s - T_x^2 - T_y^2)   (y alike)
    dOPD/dz = n^2 / T_z - a / c = (2 s - a d) / T_z + a (1 - 1 / c),    d = T_z - a = (2 s - T_x^2 - T_y^2) / (T_z + a)

c is the cosine between the undisturbed ray and z. No two nearly equal numbers are subtracted, so the equations also
suit libraries that compute in float32. The package's own tracers are not used. At a relative tolerance of 1e-12 the
ends agree with closed forms to about 1e-9 waves.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.flow import shipped
from aerokernels.medium import IndexField
from aerokernels.rays import Disc, RayBundle

# (x, y, z) [m] -> a value, shape (n,), and its derivatives by x and y (and z) [1/m], shape (2, n) or (3, n).
Formula = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
# Scales for the absolute tolerance: 1 um of position, 1 mrad of momentum and 1 um of path.
SIZES = (1e-6, 1e-6, 1e-3, 1e-3, 1e-6)
TIGHT = 1e-12
WAVELENGTH = 905e-9
CONE_AMBIENT = 1.0 + 3.6e-4
CONE_NODES = (65, 65, 257)
CONE_SPACING = 1e-3 / 16.0  # [m]
CONE_HALF = (2e-3, 2e-3, 8e-3)  # [m]
CONE_APERTURE = 1.5e-3  # half the width of the square of rays [m]
_SLOPE, _APEX, _THICKNESS = np.tan(np.deg2rad(25.0)), 6e-3, 0.5e-3
# Longest step of the true rays, so that none steps over the layer.
LONGEST_STEP = 1e-3  # [m]


@dataclass(frozen=True, eq=False)
class Truth:
    """The ends of rays on a plane z = const."""

    position: np.ndarray  # places [m], shape (ray_count, 3)
    direction: np.ndarray  # unit tangents, shape (ray_count, 3)
    opd: np.ndarray  # optical path less that of the undisturbed ray [m], shape (ray_count,)
    evaluation_count: int = 0  # evaluations of the formula for each ray; 0 where none was needed


def slopes(
    potential: Any, gradient_x: Any, gradient_y: Any, momentum_x: Any, momentum_y: Any, ambient: float, sqrt: Any
) -> tuple[Any, ...]:
    """dx/dz, dy/dz, dT_x/dz, dT_y/dz, and dOPD/dz for c = 1; for arrays of any library whose square root is `sqrt`."""
    gained = 2.0 * potential - (momentum_x * momentum_x + momentum_y * momentum_y)
    momentum_z = sqrt(ambient**2 + gained)
    path = (2.0 * potential - ambient * (gained / (momentum_z + ambient))) / momentum_z
    return (
        momentum_x / momentum_z,
        momentum_y / momentum_z,
        gradient_x / momentum_z,
        gradient_y / momentum_z,
        path,
    )


def potential_of(contrast: Formula, ambient: float) -> Formula:
    """Return the optical potential (n^2 - a^2) / 2 and its gradient, from the contrast n - a and its gradient."""

    def potential(x: Any, y: Any, z: Any) -> tuple[Any, Any]:
        value, slope = contrast(x, y, z)
        return value * (ambient + 0.5 * value), (ambient + value) * slope

    return potential


def integrate(
    potential: Formula, ambient: float, z_end: float, longest: float, rays: RayBundle, tolerance: float = TIGHT
) -> Truth:
    """Trace rays that all start on one plane z = const, with positive z components, to the plane z = `z_end` [m].

    `potential` is the optical potential, `ambient` the index a, and `longest` the greatest step [m], so that no thin
    structure is stepped over.
    """
    from scipy.integrate import solve_ivp

    z_start, count = float(rays.position[0, 2]), rays.ray_count
    if (rays.position[:, 2] != z_start).any():
        raise ValueError("the rays must start on one plane z = const")
    aslant = ambient * (1.0 - 1.0 / rays.direction[:, 2])

    def rate(z: float, state: np.ndarray) -> np.ndarray:
        x, y, momentum_x, momentum_y, _ = state.reshape(5, -1)
        value, gradient = potential(x, y, np.full_like(x, z))
        *rates, path = slopes(value, gradient[0], gradient[1], momentum_x, momentum_y, ambient, np.sqrt)
        return np.concatenate([*rates, path + aslant])

    x, y = start = rays.position[:, :2].T
    value, _ = potential(x, y, rays.position[:, 2])
    momentum = np.sqrt(ambient**2 + 2.0 * value) * rays.direction[:, :2].T
    result = solve_ivp(
        rate,
        (z_start, z_end),
        np.concatenate([*start, *momentum, np.zeros(count)]),
        method="DOP853",
        rtol=tolerance,
        atol=tolerance * np.repeat(SIZES, count),
        max_step=longest,
        t_eval=[z_end],
    )
    x, y, momentum_x, momentum_y, opd = result.y[:, -1].reshape(5, -1)
    z = np.full_like(x, z_end)
    direction = end_direction(momentum_x, momentum_y, potential(x, y, z)[0], ambient)
    return Truth(np.stack([x, y, z], axis=1), direction, opd, int(result.nfev))


def end_direction(momentum_x: Any, momentum_y: Any, potential: Any, ambient: float) -> np.ndarray:
    """Unit tangents, shape (n, 3), from transverse momenta and the potential where the rays end."""
    x, y, value = (np.asarray(array, dtype=np.float64) for array in (momentum_x, momentum_y, potential))
    tangent = np.stack([x, y, np.sqrt(ambient**2 + 2.0 * value - x**2 - y**2)], axis=1)
    return tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


@dataclass(frozen=True, eq=False)
class PupilScene:
    """A field that a pupil looks through."""

    field: IndexField
    pupil: Disc


def strehl_scene(flow: str = "mach3") -> PupilScene:
    """The part of a shipped flow seen by the forward pupil, resampled; a new field at every call."""
    region = ((0.0, -9e-3), (7.5e-3, 4.4e-3))  # lowest and highest (r, z) [m]
    field = shipped(flow).index_field(WAVELENGTH, "paper").resample(5e-5, region=region)
    return PupilScene(field, Disc(6e-3, np.array([0.0, 0.0, -8e-3])))


def cone_contrast(x: np.ndarray, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Contrast n - CONE_AMBIENT, shape (n,), and its gradient [1/m], shape (3, n), at places [m], shape (n,) each."""
    radius = np.sqrt(x**2 + z**2)
    outside = np.exp(-2.0 * np.abs(place := (radius - (y + _APEX) * _SLOPE) / _THICKNESS))
    # tanh - 1 without cancellation on either side
    contrast = -2.4e-4 * np.where(place > 0.0, outside, 1.0) / (1.0 + outside)
    steepness = 1.2e-4 / _THICKNESS * 4.0 * outside / (1.0 + outside) ** 2
    safe = np.where(radius > 0.0, radius, 1.0)
    return contrast, steepness * np.stack([x / safe, np.full_like(radius, -_SLOPE), z / safe])


# The optical potential (n^2 - CONE_AMBIENT^2) / 2 and its gradient [1/m], shapes as for the contrast.
cone_potential = potential_of(cone_contrast, CONE_AMBIENT)


def cone_field() -> IndexField:
    """The cone's contrast at the nodes of a uniform volume, cubic."""
    axes = [np.arange(count) * CONE_SPACING - half for count, half in zip(CONE_NODES, CONE_HALF, strict=True)]
    x, y, z = np.meshgrid(*axes, indexing="ij")
    return IndexField.from_samples(
        cone_contrast(x, y, z)[0],
        origin=[-half for half in CONE_HALF],
        spacing=(CONE_SPACING,) * 3,
        geometry="volume",
        ambient_index=CONE_AMBIENT,
    )


def cone_rays(ray_count: int) -> RayBundle:
    """A square of rays along z, row by row of equal y, from the face z = -8 mm on.

    `ray_count` is rounded to the nearest square of a whole number.
    """
    side = max(1, round(np.sqrt(ray_count)))
    across = np.linspace(-CONE_APERTURE, CONE_APERTURE, side) if side > 1 else np.zeros(1)
    y, x = np.meshgrid(across, across, indexing="ij")
    place = np.stack([x.ravel(), y.ravel(), np.full(x.size, -CONE_HALF[2])], axis=1)
    return RayBundle(place, np.array([[0.0, 0.0, 1.0]]))


def cone_truth(rays: RayBundle, tolerance: float = TIGHT) -> Truth:
    """The ends on the face z = +8 mm of rays from the face z = -8 mm."""
    return integrate(cone_potential, CONE_AMBIENT, CONE_HALF[2], LONGEST_STEP, rays, tolerance)
