"""The cone scene, a field given by a formula, on which the benchmark and the work-precision runs measure errors.

n = 1 + 2.4e-4 (1 + 0.5 tanh((r - a tan 25 deg) / 0.5 mm)), a = y + 6 mm, r = sqrt(x^2 + z^2), a shock cone about the y
axis that rays along z cross twice. Far from the axis n tends to 1 + 3.6e-4: that is the ambient index, and at the faces
z = +-8 mm through which rays enter and leave the contrast is below 1e-10.
"""

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle

from .truth import TIGHT, Truth, integrate, potential_of

CONE_AMBIENT = 1.0 + 3.6e-4
CONE_NODES = (65, 65, 257)
CONE_SPACING = 1e-3 / 16.0  # [m]
CONE_HALF = (2e-3, 2e-3, 8e-3)  # [m]
CONE_APERTURE = 1.5e-3  # half the width of the square of rays [m]
_SLOPE, _APEX, _THICKNESS = np.tan(np.deg2rad(25.0)), 6e-3, 0.5e-3
# Longest step of the true rays, so that none steps over the layer.
LONGEST_STEP = 1e-3  # [m]


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
