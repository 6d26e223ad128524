"""One number from five doors: the Strehl ratio and the OPD rms of the same pupil, by the same causes of an error.

`estimate_strehl`, `trace`, `wavefront`, `look_map` and `optical_series` look through the same samples of the same flow.
Expected: errors within a factor of 1.3 of each other, values that agree within their errors, and the truth within them.
The truth is that of the formula or the Fourier series of a scene on a grid of a third of the spacing, or of the mesh
that was sampled, by NumPy from rays traced there in double precision.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from aerokernels import (
    Disc,
    IndexField,
    RayBundle,
    estimate_strehl,
    flow,
    look_map,
    optical_series,
    strehl,
    trace,
    wavefront,
)
from aerokernels.pupils import direction_of
from aerokernels.tracing.stop import plane_beyond

pytestmark = pytest.mark.slow

WAVELENGTH = 905e-9
SIDE, FINER, RAYS = 0.0613, 3, 32768  # boxes [m]; cells of the truth's grid in one; rays
AMBIENT, RATIO = 1.0, 1.3
Density = Callable[..., np.ndarray]


@dataclass(frozen=True)
class Scene:
    """A density (x, y, z) on a grid seen by a disc that looks along azimuth and elevation [rad]."""

    name: str
    geometry: str
    density: Density
    nodes: int = 33
    azimuth: float = 0.0
    elevation: float = 0.0
    radius: float = 0.012
    center: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def pupil(self) -> Disc:
        return Disc(self.radius, self.center, direction_of(self.azimuth, self.elevation))

    def series(self, finer: int = 1) -> flow.Series:
        """One snapshot on the grid, or one of finer cells; axisymmetric ones have half of the nodes along r."""
        cells = finer * (self.nodes - 1)
        step = SIDE / cells
        across, along = step * np.arange(cells + 1) - 0.5 * SIDE, step * np.arange(cells + 1)
        if self.geometry == "volume":
            axes, origin = [across, across, along], [-0.5 * SIDE, -0.5 * SIDE, 0.0]
        elif self.geometry == "planar":
            axes, origin = [across, along], [-0.5 * SIDE, 0.0]
        else:
            axes, origin = [step * np.arange(cells // 2 + 1), along], [0.0, 0.0]
        return snapshot(self.density(*np.meshgrid(*axes, indexing="ij")), self.geometry, origin, step)

    def truth(self) -> IndexField:
        """The field in which the truth is found."""
        return self.series(FINER)[0].index_field(WAVELENGTH)


def snapshot(samples: np.ndarray, geometry: str, origin, step: float, ambient: float = AMBIENT) -> flow.Series:
    return flow.open_series(
        [samples], time=[0.0], geometry=geometry, origin=origin, spacing=[step] * len(origin), ambient_density=ambient
    )


@dataclass(frozen=True)
class Shipped:
    """A shipped flow on a grid of its own, seen along the axis from beside the body, through the shock of the nose."""

    name: str
    radius: float = 0.004
    center: tuple[float, float, float] = (0.0, 0.02, -0.03)
    azimuth: float = 0.0
    elevation: float = 0.0

    @property
    def pupil(self) -> Disc:
        return Disc(self.radius, self.center)

    def series(self) -> flow.Series:
        air, step = flow.shipped(self.name), 0.3e-3
        contrast = air.index_field(WAVELENGTH)
        r, z = np.meshgrid(step * np.arange(121), -0.03 + step * np.arange(121), indexing="ij")
        found = contrast.evaluate(np.stack([np.zeros(r.size), r.ravel(), z.ravel()], axis=1))[0].reshape(r.shape)
        constant = flow.refractivity_model().constant(WAVELENGTH)
        samples = air.ambient_density + np.nan_to_num(found) / constant
        return snapshot(samples, "axisymmetric", [0.0, -0.03], step, air.ambient_density)

    def truth(self) -> IndexField:
        return flow.shipped(self.name).index_field(WAVELENGTH)


def turbulence(seed: int, share: float, faded: bool = False, strength: float = 0.012) -> Density:
    """Modes of a Kolmogorov spectrum up to a share of the Nyquist frequency of 33 nodes a side."""
    rng = np.random.default_rng(seed)
    count, greatest = 160, share * np.pi * 32.0 / SIDE
    size = greatest * rng.uniform(0.08, 1.0, count)
    way = rng.normal(size=(count, 3))
    wave = size[:, None] * way / np.linalg.norm(way, axis=1, keepdims=True)
    height = size ** (-5.0 / 6.0)
    height *= strength / np.sqrt(0.5 * np.sum(height**2))
    phase = rng.uniform(0.0, 2.0 * np.pi, count)

    def density(x, y, z):
        found = np.zeros(x.shape)
        ways = [np.exp(1j * wave[:, k, None] * np.unique(axis)) for k, axis in enumerate((x, y, z))]
        found = np.einsum("ma,mb,mc->abc", (height * np.exp(1j * phase))[:, None] * ways[0], *ways[1:], optimize=True)
        return AMBIENT + found.real * (np.sin(np.pi * z / SIDE) ** 2 if faded else 1.0)

    return density


def blobs(seed: int, width: float, dimension: int = 3, strength: float = 0.04) -> Density:
    """Gaussian blobs of a width [cells of 33 nodes a side]."""
    rng = np.random.default_rng(seed)
    size, count = width * SIDE / 32.0, 40
    middle = np.column_stack(
        [rng.uniform(-0.3 * SIDE, 0.3 * SIDE, (count, dimension - 1)), rng.uniform(0.3, 0.7, count) * SIDE]
    )
    height = strength * rng.choice([-1.0, 1.0], count)

    def density(*places):
        return AMBIENT + sum(
            high * np.exp(-sum((place - at) ** 2 for place, at in zip(places, one, strict=True)) / (2.0 * size**2))
            for high, one in zip(height, middle, strict=True)
        )

    return density


def rings(width: float, strength: float = 0.05) -> Density:
    """Rings about the axis [cells of 33 nodes]."""
    size = width * SIDE / 32.0
    return lambda r, z: (
        AMBIENT
        + strength
        * sum(
            sign
            * (
                np.exp(-(((r - at) ** 2 + (z - far) ** 2) / (2.0 * size**2)))
                + np.exp(-(((r + at) ** 2 + (z - far) ** 2) / (2.0 * size**2)))
            )
            for at, far, sign in ((0.003, 0.02, 1.0), (0.008, 0.03, -1.0), (0.011, 0.04, 1.0))
        )
    )


def front(width: float, slant: float) -> Density:
    """A resolved front across y and z, width in cells of 65 nodes a side, which fades toward the faces."""
    return lambda y, z: (
        AMBIENT
        + 0.03
        * np.exp(-(((z - 0.5 * SIDE) / (0.15 * SIDE)) ** 2))
        * np.tanh((y - slant * (z - 0.5 * SIDE)) / (width * SIDE / 64.0))
    )


SCENES = [
    Scene("turbulence to half of the Nyquist frequency", "volume", turbulence(1, 0.5)),
    Scene("turbulence to 0.6 of it", "volume", turbulence(2, 0.6)),
    Scene("turbulence to 0.7 of it", "volume", turbulence(3, 0.7)),
    Scene("faded turbulence", "volume", turbulence(4, 0.6, True)),
    Scene("strong turbulence", "volume", turbulence(5, 0.5, strength=0.05)),
    Scene("turbulence from aslant", "volume", turbulence(6, 0.55), azimuth=0.2, elevation=0.1, radius=0.009),
    Scene("turbulence from farther aslant", "volume", turbulence(7, 0.6), azimuth=-0.3, elevation=0.2, radius=0.007),
    Scene("turbulence before a small pupil", "volume", turbulence(8, 0.6), radius=0.004, center=(0.006, -0.004, 0.0)),
    Scene("small blobs", "volume", blobs(1, 1.2)),
    Scene("blobs", "volume", blobs(2, 1.6)),
    Scene("blobs from aslant", "volume", blobs(3, 1.4), azimuth=0.25, elevation=-0.15),
    Scene("planar blobs", "planar", blobs(14, 1.1, 2, 0.02)),
    Scene("planar blobs from aslant", "planar", blobs(5, 1.3, 2, 0.02), azimuth=0.2, elevation=0.15),
    Scene("a planar front", "planar", front(0.8, 0.2), 65),
    Scene("a planar front from aslant", "planar", front(0.8, 0.4), 65, elevation=0.2),
    Scene("rings", "axisymmetric", rings(1.6)),
    Scene("rings beside the axis", "axisymmetric", rings(1.4), center=(0.004, 0.002, 0.0), radius=0.008),
    Scene("rings from aslant", "axisymmetric", rings(1.4), azimuth=0.15, elevation=0.1, radius=0.008),
    Shipped("mach3"),
    Shipped("mach4"),
]


@dataclass(frozen=True)
class Told:
    """A door's Strehl ratio and OPD rms [m] with their errors; NaN for a ratio that a door does not have."""

    door: str
    value: np.ndarray
    error: np.ndarray


def doors(field: IndexField, series: flow.Series, scene: Scene) -> Iterator[Told]:
    pupil = scene.pupil
    own = {"tolerance": 2e-5}
    found = estimate_strehl(field, pupil, ray_count=RAYS, **own).quantities
    yield Told("estimate_strehl", *np.transpose([(one.value, one.error) for one in (found["value"], found["opd_rms"])]))
    rays = RayBundle.collimated(pupil, 4096, direction=pupil.normal)
    rms = trace(field, rays, until=plane_beyond(field, pupil, pupil.normal), outputs="opd", **own).quantities["opd_rms"]
    yield Told("trace", np.array([np.nan, rms.value]), np.array([np.nan, rms.error]))
    found = wavefront(field, pupil, pixel_count=128, **own).quantities
    yield Told("wavefront", *np.transpose([(one.value, one.error) for one in (found["strehl"], found["opd_rms"])]))
    seen = look_map(field, [scene.azimuth], [scene.elevation], pupil, ray_count=RAYS, **own).isel(
        azimuth=0, elevation=0
    )
    names = ("strehl", "opd_rms")
    yield Told("look_map", *(np.array([float(seen[name + end]) for name in names]) for end in ("", "_error")))
    maps = optical_series(series, pupil, remove=("piston",), pixel_count=128, wavelength=WAVELENGTH, **own).isel(time=0)
    names = ("strehl", "opd_rms_with_tilt")
    yield Told("optical_series", *(np.array([float(maps[name + end]) for name in names]) for end in ("", "_error")))


def true_numbers(scene: Scene | Shipped) -> np.ndarray:
    field, pupil = scene.truth(), scene.pupil
    rays = RayBundle.collimated(pupil, 8192, direction=pupil.normal)
    stop = plane_beyond(field, pupil, pupil.normal)
    opd = trace(field, rays, until=stop, outputs="opd", precision="float64", tolerance=1e-4).opd
    return np.array([strehl(opd, WAVELENGTH), opd.std()])


@pytest.mark.parametrize("scene", SCENES, ids=lambda one: one.name)
def test_five_doors_tell_one_error(scene: Scene | Shipped):
    series = scene.series()
    found = list(doors(series[0].index_field(WAVELENGTH), series, scene))
    value, error = (np.array([getattr(one, name) for one in found]) for name in ("value", "error"))
    told = {one.door: one.error for one in found}
    assert (np.nanmax(error, axis=0) < 1.3 * np.nanmin(error, axis=0)).all(), told
    apart = np.abs(value[:, None] - value)
    assert not (apart > np.hypot(error[:, None], error)).any()
    off = np.abs(value - true_numbers(scene)) / error
    assert not (off > 1.0).any(), dict(zip(told, off, strict=True))
