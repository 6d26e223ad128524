"""Does the step error of rays along straight lines cover the bending that the lines neglect?

Set-up: random blobs, layers and shears of contrast 1e-4 to 1e-2, planar, axisymmetric and volumes, cubic and linear;
rays within 0.05 rad of the axis, ended by the box or by planes 20 mm to 1 m on, up to 80 degrees from the axis.

Expected: the difference of the optical path from that of the bent ray, 2 to 50,000 tolerances in most of the fields, is
at most the `step_error` of the ray (or the tolerance); rays above the tolerance have the status TOLERANCE_NOT_MET. It
was 5e-4 waves on all of them, for differences of up to 34 waves. The median of reported over true is at most 10.
"""

import warnings

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, RayStatus, trace
from aerokernels.tracing.stop import reached

from ..backends import WAVE, on

pytestmark = pytest.mark.slow

CELL, NODES, RAYS = 5e-4, 33, 40


def scene(seed: int):
    """Field, rays and stop of a seed."""
    rng = np.random.default_rng([seed, 5])
    geometry = ("planar", "axisymmetric", "volume")[seed % 3]
    z = CELL * np.arange(NODES)
    y, middle = z - 0.5 * z[-1], 0.5 * z[-1]
    axes = {"planar": (y, z), "axisymmetric": (z, z), "volume": (y, y, z)}[geometry]
    at = np.meshgrid(*axes, indexing="ij")
    size, place = CELL * rng.uniform(3.0, 8.0), rng.uniform(-3e-3, 3e-3)
    tilt = rng.uniform(0.0, 0.3)
    across = (at[-2] * np.cos(tilt) - (at[-1] - middle) * np.sin(tilt) - place) / size
    blob = np.exp(-0.5 * ((at[-2] - place) ** 2 + (at[-1] - middle) ** 2) / size**2)
    shape = (blob, np.exp(-0.5 * across**2), 0.5 * (1.0 + np.tanh(across)))[rng.integers(3)]
    field = IndexField.from_samples(
        10.0 ** rng.uniform(-4.0, -2.0) * rng.choice([-1.0, 1.0]) * shape,
        origin=[axis[0] for axis in axes],
        spacing=[CELL] * len(axes),
        geometry=geometry,
        interpolation="linear" if seed % 5 == 4 else "cubic",
    )
    position = np.c_[rng.uniform(-5e-3, 5e-3, (RAYS, 2)), np.full(RAYS, -1e-3)]
    rays = RayBundle(position, np.c_[rng.uniform(-0.05, 0.05, (RAYS, 2)), np.ones(RAYS)])
    angle = rng.choice([0.0, rng.uniform(0.0, 1.4)])
    plane = Plane((0.0, 0.0, rng.choice([0.02, 0.1, 1.0])), (0.0, np.sin(angle), np.cos(angle)))
    return field, rays, None if rng.random() < 0.3 else plane


# Kinds of scenes, geometry, interpolation and whether there is a plane, that OpenCL does not trace, and the only ones
# that Warp does: each pair of them occurs on OpenCL, and Warp takes kernels of test_backends_agree.py. A kind takes
# OpenCL four seconds, and Warp nine.
LEFT_OUT = [("planar", "cubic", False), *((geometry, "linear", False) for geometry in ("axisymmetric", "planar"))]
ON_WARP = [("volume", "cubic", True), ("axisymmetric", "cubic", False), ("planar", "linear", True)]


@pytest.mark.parametrize(("engine", "count"), [("opencl-cpu", 120), ("warp-cpu", 30), ("reference", 12)])
def test_the_step_error_of_straight_rays_covers_their_bending(engine, count):
    backend = {"backend": "reference"} if engine == "reference" else on(engine)
    missed, unsaid, ratios = [], 0, []
    scenes = [(seed, *scene(seed)) for seed in range(count)]
    kinds = [(field.geometry, field.interpolation, until is not None) for _, field, _, until in scenes]
    if engine == "opencl-cpu":
        scenes = [one for one, kind in zip(scenes, kinds, strict=True) if kind not in LEFT_OUT]
    if engine == "warp-cpu":
        scenes = [one for one, kind in zip(scenes, kinds, strict=True) if kind in ON_WARP]
        assert {kind for kind in kinds if kind in ON_WARP} == set(ON_WARP)
    for seed, field, rays, until in scenes:
        settings = {"until": until, "precision": "float64", "bundle": "off", **backend}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            line = trace(field, rays, method="straight", tolerance=1e-3, **settings)
            bent = trace(field, rays, method="adaptive", tolerance=1e-6, **settings)
        both = reached(line.status) & reached(bent.status)
        true = np.maximum(np.abs(line.opd - bent.opd) - bent.step_error, 0.0)[both] / WAVE
        reported = line.step_error[both] / WAVE
        missed += [(seed, *worst) for worst in zip(true, reported, strict=True) if worst[0] > max(worst[1], 1e-3)]
        unsaid += np.count_nonzero((true > 1e-3) & (line.traced_status[both] != RayStatus.TOLERANCE_NOT_MET))
        ratios += list((reported / np.maximum(true, 1e-12))[true > 1e-3])
    assert not missed and not unsaid, (missed, unsaid)
    assert len(ratios) > 0.3 * len(scenes) * RAYS and np.median(ratios) < 10.0


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric", "volume"])
def test_slopes_that_jump_at_faces_are_no_bending(geometry):
    """A weak blob on a linear grid, rays aslant to its faces and to the stop.

    Between the line's and the ray's crossings of a face the slope is wrong by its jump there, for a time of second
    order in the contrast. The jump was counted for the whole step: 0.1 waves, and TOLERANCE_NOT_MET, for 5e-7 waves.
    """
    z = 5e-3 * np.arange(-20.0, 21.0)
    axes = {"planar": (z, z), "axisymmetric": (z[20:], z), "volume": (z, z, z)}[geometry]
    square = sum(axis**2 for axis in np.meshgrid(*axes, indexing="ij"))
    field = IndexField.from_samples(
        2e-6 * np.exp(-square / 0.03**2),
        origin=[axis[0] for axis in axes],
        spacing=[5e-3] * len(axes),
        geometry=geometry,
        interpolation="linear",
    )
    position = np.c_[np.random.default_rng(0).uniform(-0.03, 0.03, (RAYS, 2)), np.full(RAYS, -0.2)]
    rays = RayBundle(position, [[0.1, 0.2, 1.0]])
    settings = {"until": Plane((0.0, 0.0, 0.3), (0.0, 0.0, 1.0)), "precision": "float64", **on("opencl-cpu")}
    line = trace(field, rays, method="straight", tolerance=1e-3, **settings)
    bent = trace(field, rays, method="adaptive", tolerance=1e-6, **settings)
    true = np.abs(line.opd - bent.opd).max() / WAVE
    assert 1e-7 < true < line.step_error.max() / WAVE < 30.0 * true
    assert not np.any(line.status == RayStatus.TOLERANCE_NOT_MET)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("until", [None, ArcLength(2.5), Plane((0.0, 0.0, 3.0), (0.3, 0.2, 1.0))])
def test_the_reference_ends_its_straight_rays_in_the_air_where_the_air_ends(geometry: str, until):
    """A contrast c in a box from z = 1 to z = 2: c times the length of the ray's way through it, to a rounding.

    The ray runs ahead of its undisturbed line by c times that length. To where the line leaves the box it had c^2 times
    the length too much, 0.09 waves of 1 um over 1 m.
    """
    contrast, volume = 3e-4, geometry == "volume"
    shape, origin = ((5, 5, 7) if volume else (5, 7)), [-1.0, -1.0, 1.0] if volume else [-1.0, 1.0]
    spacing = [0.5, 0.5, 1.0 / 6.0] if volume else [0.5, 1.0 / 6.0]
    if geometry == "axisymmetric":
        origin, spacing = [0.0, 1.0], [0.25, 1.0 / 6.0]
    grid = np.full(shape, contrast)
    field = IndexField.from_samples(grid, origin=origin, spacing=spacing, geometry=geometry)
    rays = RayBundle([[0.0, 0.0, 0.0], [0.1, 0.2, 0.0], [0.2, -0.1, 1.5]], [[0, 0, 1], [0.2, -0.3, 1], [0.1, -0.3, 1]])
    length = np.array([1.0, 1.0, 0.5]) / np.asarray(rays.direction)[:, 2]
    found = trace(field, rays, until=until, backend="reference", method="straight", wavelength=1e-6)
    np.testing.assert_allclose(found.opd, contrast * length, rtol=1e-12)
    assert found.ok.all() and not (found.status == RayStatus.TOLERANCE_NOT_MET).any()
