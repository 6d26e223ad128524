"""The box of a field is its flow: open boxes pass every door with the OPD of the box, and a sentence says so."""

import json
import warnings

import numpy as np
import pytest

from aerokernels import (
    Camera,
    Disc,
    IndexField,
    RayBundle,
    background_displacement,
    estimate_strehl,
    look_map,
    optical_series,
    schlieren,
    strehl,
    trace,
    wavefront,
)
from aerokernels.flow import open_series
from aerokernels.medium import Body
from aerokernels.tracing import Plane, RayStatus
from aerokernels.tracing.pupil.air import TruncationWarning

from .disturbed_boxes import CONTRAST, GEOMETRIES, HALF, LENGTH, UP, WAVE, box

COUNT, SIZE = 64, 0.1
CELL = SIZE / COUNT


def kolmogorov(seed: int = 5, rms: float = 2e-6) -> np.ndarray:
    """Turbulence of the spectrum k^(-11/3) up to Nyquist's frequency, not faded out anywhere, shape (64, 64, 64)."""
    axes = np.fft.fftfreq(COUNT), np.fft.fftfreq(COUNT), np.fft.rfftfreq(COUNT)
    wave = COUNT * np.sqrt(sum(axis**2 for axis in np.meshgrid(*axes, indexing="ij")))
    wave[0, 0, 0] = 1.0
    noise = np.fft.rfftn(np.random.default_rng(seed).standard_normal((COUNT,) * 3)) * wave ** (-11.0 / 6.0)
    noise[wave > 0.49 * COUNT] = 0.0
    noise[0, 0, 0] = 0.0
    found = np.fft.irfftn(noise)
    return rms * found / found.std()


@pytest.fixture(scope="module")
def air() -> IndexField:
    return IndexField.from_samples(
        kolmogorov(), origin=(0.0,) * 3, spacing=(CELL,) * 3, geometry="volume", ambient_index=1.0002, wavelength=WAVE
    )


PUPIL = Disc(0.03, (0.5 * SIZE, 0.5 * SIZE, -1e-3))


def opd_of_box(field: IndexField, position: np.ndarray) -> np.ndarray:
    """The integral of the spline along z through the box [m], exact: four Gauss points in each cell, shape (n,)."""
    place, weight = np.polynomial.legendre.leggauss(4)
    z = (CELL * (np.arange(COUNT - 1)[:, None] + 0.5 + 0.5 * place)).ravel()
    points = np.repeat(position[:, None], len(z), axis=1)
    points[..., 2] = z
    return field.contrast_at(points.reshape(-1, 3)).reshape(len(position), -1) @ np.tile(0.5 * CELL * weight, COUNT - 1)


def test_an_open_box_of_turbulence_has_the_opd_of_the_box(air):
    """Trace, Strehl ratio and wavefront: nothing refused, warned of or lost; each plan says where the flow ends."""
    rays = RayBundle.collimated(PUPIL, 2000)
    truth = opd_of_box(air, rays.position)
    with warnings.catch_warnings():
        warnings.simplefilter("error", TruncationWarning)
        traced = trace(air, rays, until=Plane((0.0, 0.0, SIZE), UP))
        found = estimate_strehl(air, PUPIL, ray_count=16384)
        seen = wavefront(air, PUPIL, pixel_count=64)
    assert (traced.status == RayStatus.OK).all() and not traced.truncation.any()
    assert np.abs(traced.opd - truth).max() < 3e-3 * WAVE  # a straight line's; and rays bend
    assert found.value == pytest.approx(strehl(truth, WAVE), abs=5.0 * found.standard_error + 0.02)
    assert seen.strehl() == pytest.approx(found.value, abs=0.02)
    for each in (traced, found):
        assert each.error["truncation"] == 0.0
        assert each.plan.reasons.count(each.plan.reasons[-1]) == 1
    for each in (traced, found, seen):
        (sentence,) = [reason for reason in each.plan.reasons if "the flow ends" in reason]
        assert "z = 0 mm and z = 98.4375 mm" in sentence and "contrast up to" in sentence
        assert sentence in str(each.plan)
        told = float(sentence.split("contrast up to ")[1].split(":")[0])
        assert 0.3 * np.abs(kolmogorov()[..., [0, -1]]).max() < told <= 1.01 * np.abs(kolmogorov()[..., [0, -1]]).max()


def test_an_open_box_goes_through_look_maps_pictures_and_series(air, recwarn):
    maps = look_map(air, [-0.02, 0.0, 0.02], [0.0], Disc(0.01, (0.5 * SIZE, 0.5 * SIZE, -1e-3)), ray_count=256)
    assert (maps.known == 1.0).all() and "the flow ends with its box" in maps.attrs["ends"]
    camera = Camera(Disc(1e-3, (0.5 * SIZE, 0.5 * SIZE, -0.5)), 0.05, 1e-5, pixel_count=24, distance=1.0)
    picture = background_displacement(air, camera, aperture_rays=1)
    assert picture.known.all() and np.isfinite(picture.displacement).all()
    assert schlieren(air, view="z", pixel_count=16).known.all()
    density = [1.2 + 1e3 * kolmogorov(seed) for seed in range(2)]
    options = {"geometry": "volume", "origin": (0.0,) * 3, "spacing": (CELL,) * 3, "ambient_density": 1.2}
    series = optical_series(open_series(density, time_step=1e-5, **options), PUPIL, pixel_count=16)
    assert float(series.known.min()) > 1.0 - 1e-9 and "z = 0 mm and z = 98.4375 mm" in series.attrs["ends"]
    assert not [one for one in recwarn if issubclass(one.category, TruncationWarning)]


@pytest.mark.parametrize("on_mesh", [False, True])
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_place_and_the_contrast_are_told(geometry, on_mesh):
    """A box of contrast CONTRAST: both ends along z, or the one beyond a start inside; nothing where air fades out."""
    if on_mesh and geometry == "volume":
        pytest.skip("meshes have two axes")
    where = "the rim of the mesh" if on_mesh else "z = -4 mm and z = 4 mm"
    rays = RayBundle([[0.0, 1e-3, -LENGTH], [0.0, 2e-3, -LENGTH]], UP)
    expected = f"the flow ends with its box at {where}, where rays pass through air of a contrast up to 1e-05"
    field = box(geometry, on_mesh=on_mesh)
    assert any(reason.startswith(expected) for reason in trace(field, rays).plan.reasons)
    inside = trace(field, rays, until=Plane((0.0, 0.0, 0.0), UP)).plan.reasons
    assert any("the rim of the mesh" in one if on_mesh else "at z = -4 mm, where" in one for one in inside)
    fading = box(geometry, value=lambda *p: CONTRAST * np.cos(np.pi * p[-1] / LENGTH) ** 2, on_mesh=on_mesh)
    assert not any("the flow ends" in reason for reason in trace(fading, rays).plan.reasons)


def test_a_wall_is_no_end_of_the_flow():
    """Rays that end on a body cross no face behind it; on a mesh the rim at the body is its wall."""
    square = np.array([(-HALF, 1e-3), (HALF, 1e-3), (HALF, HALF), (-HALF, HALF)])
    across = np.linspace(-HALF, HALF, 17)
    contrast = np.where(across < -3e-3, 0.0, CONTRAST) * np.ones((17, 1))
    field = IndexField.from_samples(
        contrast, origin=(-HALF, -HALF), spacing=(5e-4, 5e-4), geometry="planar", body=Body(square, "planar")
    )
    plan = trace(field, RayBundle([[0.0, 1e-4, -LENGTH]], UP), until=Plane((0.0, 0.0, LENGTH), UP)).plan
    assert not any("the flow ends" in reason for reason in plan.reasons)


@pytest.mark.parametrize(("center", "share"), [(0.0, 0.0), (0.015, 0.0), (0.0225, 2.0), (0.05, 50.0)])
def test_a_pupil_that_looks_past_the_box_is_told_so(air, center, share):
    """A disc of 3 cm whose centre moves toward and over the side of the box; the share is that of its area.

    Above a hundredth there is a warning, above half a refusal.
    """
    pupil = Disc(0.03, (0.5 * SIZE + center, 0.5 * SIZE, -1e-3))
    beyond = (SIZE - CELL - 0.5 * SIZE - center) / 0.03  # the box ends there, in radii from the centre
    truth = 0.0 if beyond >= 1.0 else 100.0 * (np.arccos(beyond) - beyond * np.sqrt(1.0 - beyond**2)) / np.pi
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        if truth > 50.0:
            with pytest.raises(ValueError, match=r"5\d(\.\d+)? % of the pupil looks past the field's box"):
                wavefront(air, pupil, pixel_count=32)
            with pytest.raises(ValueError, match=r"looks past the field's box.*allow_truncation"):
                estimate_strehl(air, pupil, ray_count=1024)
            return
        plans = [wavefront(air, pupil, pixel_count=32).plan, estimate_strehl(air, pupil, ray_count=1024).plan]
    for plan in plans:
        said = [reason for reason in plan.reasons if "looks past the field's box" in reason]
        assert len(said) == (truth > 0.0)
        assert not said or float(said[0].split(" %")[0]) == pytest.approx(truth, abs=0.1)
    assert sum(issubclass(one.category, TruncationWarning) for one in told) == 2 * (truth > 1.0)
    assert truth == pytest.approx(share, abs=6.0)


def test_a_run_of_an_open_box_says_where_it_ends():
    """In the plan of its summary; nothing is lost."""
    from aerokernels.jobs.run import simulate
    from aerokernels.scene import Scene

    origin = (-0.5 * SIZE, -0.5 * SIZE, 0.0)
    flow = IndexField.from_samples(
        kolmogorov(), origin=origin, spacing=(CELL,) * 3, geometry="volume", ambient_index=1.0002, wavelength=WAVE
    )
    scene = Scene.load("wind-tunnel-mach3", {"strehl.ray_count": 1024, "receiver.aperture_z": "-1 mm"})
    found = simulate(scene, field=flow, with_echo=False)
    assert not found.strehl.error["truncation"]
    assert "the flow ends with its box" in json.dumps(found.summary["plan"])
