"""Bundles of rays through the benchmark's cone and through turbulence, for `scripts/peers bundles`.

They start on the face z = -8 mm and end on z = +8 mm: "along z", "slanted" by 0.05 and 0.02, "divergent" from a point
60 mm ahead, "incoherent" with slopes of 0.02 rms. "turbulence" has the spectrum of Kolmogorov's turbulence between its
own size and its cells, 0.4 wave rms along z, and slanted rays.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerokernels.benchmark.scenes import CONE_HALF, WAVELENGTH, Truth, cone_field, cone_truth
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace

KINDS = ("along z", "slanted", "divergent", "incoherent", "turbulence")
APERTURE = 1.2e-3  # half the width of the square of rays where they cross z = 0, or start [m]
SLOPE = np.array([0.05, 0.02, 1.0])
APEX = np.array([0.1e-3, -0.2e-3, -60e-3])
TURBULENT_NODES, TURBULENT_SPACING, TURBULENT_WAVES = 96, 1e-3, 0.4
TURBULENT_SLOPE = np.array([0.1, -0.05, 1.0])
TURBULENT_AMBIENT = 1.00027


@dataclass(frozen=True, eq=False)
class BundleScene:
    """A field and bundles of rays through it.

    Attributes:
        kind: A name from KINDS.
        make_field: Returns a new field at every call.
        make_rays: Returns rays of the same bundle for (ray_count, seed).
        until: Where they stop.
    """

    kind: str
    make_field: Callable[[], IndexField]
    make_rays: Callable[[int, int], RayBundle]
    until: Plane


def bundle_scene(kind: str) -> BundleScene:
    """Return the scene of a kind from KINDS."""
    if kind == "turbulence":
        end = 0.5 * TURBULENT_NODES * TURBULENT_SPACING
        return BundleScene(kind, turbulent_field, turbulent_rays, Plane(np.array([0.0, 0.0, end]), TURBULENT_SLOPE))
    stop = Plane(np.array([0.0, 0.0, CONE_HALF[2]]), np.array([0.0, 0.0, 1.0]))
    return BundleScene(kind, cone_field, lambda count, seed: bundle_rays(kind, count, seed), stop)


def bundle_rays(kind: str, ray_count: int, seed: int) -> RayBundle:
    """Rays of a bundle through the cone scene, at random places."""
    rng = np.random.default_rng(seed)
    across = rng.uniform(-APERTURE, APERTURE, (ray_count, 2))
    start = np.c_[across, np.full(ray_count, -CONE_HALF[2])]
    if kind == "along z":
        return RayBundle(start, np.array([[0.0, 0.0, 1.0]]))
    if kind == "slanted":
        return RayBundle(start - CONE_HALF[2] * SLOPE * [1.0, 1.0, 0.0], SLOPE[None])
    middle = start * [1.0, 1.0, 0.0]
    way = middle - APEX if kind == "divergent" else np.c_[rng.normal(0.0, 0.02, (ray_count, 2)), np.ones(ray_count)]
    return RayBundle(middle - CONE_HALF[2] * way / way[:, 2:], way)


def turbulent_field() -> IndexField:
    """Random phases with the amplitude spectrum |k|^(-11/6), faded out at the faces of the box."""
    count, spacing = TURBULENT_NODES, TURBULENT_SPACING
    cycles = np.fft.fftfreq(count) * count
    size = np.sqrt(sum(axis**2 for axis in np.meshgrid(cycles, cycles, cycles, indexing="ij")))
    size[0, 0, 0] = 1.0
    noise = np.random.default_rng(5).normal(size=(count,) * 3)
    made = np.fft.ifftn(np.fft.fftn(noise) * size ** (-11.0 / 6.0)).real
    edge = np.clip(np.minimum(np.arange(count), count - 1 - np.arange(count)) / 8.0, 0.0, 1.0)
    edge = edge**2 * (3.0 - 2.0 * edge)
    made *= edge[:, None, None] * edge[:, None] * edge
    inner = slice(count // 4, 3 * count // 4)
    made *= TURBULENT_WAVES * WAVELENGTH / (made.sum(axis=2)[inner, inner].std() * spacing)
    return IndexField.from_samples(
        made,
        origin=(-0.5 * (count - 1) * spacing,) * 3,
        spacing=(spacing,) * 3,
        geometry="volume",
        ambient_index=TURBULENT_AMBIENT,
    )


def turbulent_rays(ray_count: int, seed: int) -> RayBundle:
    """Slanted rays through the middle of the turbulent volume, at random places."""
    half = 0.5 * TURBULENT_NODES * TURBULENT_SPACING
    across = np.random.default_rng(seed).uniform(-0.6 * half, 0.6 * half, (ray_count, 2))
    start = np.c_[across, np.full(ray_count, -half)]
    return RayBundle(start - half * TURBULENT_SLOPE * [1.0, 1.0, 0.0], TURBULENT_SLOPE[None])


def bundle_truth(scene: BundleScene, rays: RayBundle) -> Truth:
    """The ends of rays: of the cone's formula, or by error control in float64 where there is no formula."""
    if scene.kind != "turbulence":
        return cone_truth(rays)
    options = {"method": "adaptive", "precision": "float64", "tolerance": 2e-5, "wavelength": WAVELENGTH}
    found = trace(scene.make_field(), rays, until=scene.until, **options)
    return Truth(found.position, found.direction, found.opd)
