"""Interferograms against the fringe law, and what all pictures have in common."""

import math
import warnings

import numpy as np
import pytest

from aerokernels import interferogram, schlieren, shadowgraph
from aerokernels.benches import line_of_sight
from aerokernels.medium import IndexField

PEAK, SIZE, WIDTH, WAVELENGTH = 1e-4, 0.004, 0.02, 500e-9


def blob() -> IndexField:
    line = np.arange(-0.02, 0.02 + 1e-6, 2.5e-4)
    y, z = np.meshgrid(line, line, indexing="ij")
    contrast = PEAK * np.exp(-(y**2 + z**2) / SIZE**2)
    return IndexField.from_samples(contrast, origin=[-0.02] * 2, spacing=[2.5e-4] * 2, geometry="planar")


OPTIONS = {"width": WIDTH, "pixel_count": 60, "wavelength": WAVELENGTH, "tolerance": 1e-4}


def test_infinite_fringe_is_the_optical_path():
    """Four waves at the middle: bright where OPD is a whole number of waves, dark half way between.

    Expected: (1 + cos(2 pi OPD / wavelength)) / 2 of the exact line integral. Error sources: focused on its middle, the
    path through the flow differs from the straight one by W^3 (grad m)^2 / 24 = 1e-10 m or 2e-4 wave; the spline's
    value 1e-5 of 4 waves; the tracer 1e-4 wave. Tolerance 5e-3 of the brightness (1e-3 wave times pi).
    """
    image = interferogram(blob(), **OPTIONS)
    across, along = np.meshgrid(image.horizontal, image.vertical)
    waves = PEAK * WIDTH * np.exp(-(across**2 + along**2) / SIZE**2) / WAVELENGTH
    assert waves.max() > 3.9
    np.testing.assert_allclose(image.intensity, 0.5 + 0.5 * np.cos(2.0 * np.pi * waves), atol=5e-3)


@pytest.mark.parametrize("turned", [False, True], ids=["infinite fringe", "finite fringe"])
def test_fringes_narrower_than_two_rays_are_told_of(turned: bool):
    """The blob's four waves within 4 mm, over pixels of 0.5 mm and of 2 mm; four rays a pixel are as good as pixels.

    Expected share: where |d OPD| over a pixel along x or y is more than half a wave, of the exact line integral; with
    fringes across one axis their own change counts too.
    """
    fringes = {"fringe_spacing": 8.4e-3, "fringe_angle": 0.0} if turned else {}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        interferogram(blob(), **{**OPTIONS, "pixel_count": 80}, **fringes)
        interferogram(blob(), **{**OPTIONS, "pixel_count": 20}, rays_per_pixel=4, **fringes)
    with pytest.warns(UserWarning, match="half a fringe from one ray to the next") as told:
        image = interferogram(blob(), **{**OPTIONS, "pixel_count": 20}, **fringes)
    across, along = np.meshgrid(image.horizontal, image.vertical)
    waves = PEAK * WIDTH * np.exp(-(across**2 + along**2) / SIZE**2) / WAVELENGTH
    waves += across / 8.4e-3 if turned else 0.0
    narrow = np.zeros(waves.shape, bool)
    narrow[:-1] |= np.abs(np.diff(waves, axis=0)) > 0.5
    narrow[:, :-1] |= np.abs(np.diff(waves, axis=1)) > 0.5
    assert f"in {100.0 * narrow.mean():.2g} % of" in str(told[0].message)


@pytest.mark.parametrize("degrees", [0.0, 90.0, 30.0])
def test_finite_fringes(degrees: float):
    """Straight fringes of 4 mm across the given direction, displaced by OPD / wavelength; visibility and phase."""
    light = line_of_sight(blob(), **OPTIONS)
    image = interferogram(light, fringe_spacing=0.004, fringe_angle=math.radians(degrees), phase=0.25, visibility=0.8)
    across, along = np.meshgrid(image.horizontal, image.vertical)
    place = across * math.cos(math.radians(degrees)) + along * math.sin(math.radians(degrees))
    waves = image.opd / WAVELENGTH + place / 0.004 + 0.25
    np.testing.assert_allclose(image.intensity, 0.5 + 0.4 * np.cos(2.0 * np.pi * waves), atol=1e-9)


def test_pixels_are_means_over_their_rays():
    """3 x 3 rays a pixel: deflection, path and light are the means of a picture three times as fine."""
    fine = line_of_sight(blob(), **{**OPTIONS, "pixel_count": 60})
    coarse = line_of_sight(blob(), **{**OPTIONS, "pixel_count": 20}, rays_per_pixel=3)
    np.testing.assert_allclose(coarse.opd, fine.opd, atol=1e-12)
    sensitivity = 2000.0
    one, many = (schlieren(light, sensitivity=sensitivity) for light in (coarse, fine))
    assert one.intensity.shape == (20, 20)
    np.testing.assert_allclose(one.intensity, many.intensity.reshape(20, 3, 20, 3).mean(axis=(1, 3)), atol=1e-4)
    assert many.intensity.max() == 1.0


def test_an_edge_at_any_angle_and_exposure():
    """I = 1 - cut_off + sensitivity (e_right cos a + e_up sin a), times the exposure, white at 1."""
    light = line_of_sight(blob(), **OPTIONS)
    for degrees in (30.0, 135.0, 180.0, 270.0):
        angle = math.radians(degrees)
        image = schlieren(light, knife_edge=angle, sensitivity=300.0, cut_off=0.6, exposure=1.5)
        cut = image.deflection @ [math.cos(angle), math.sin(angle)]
        expected = np.clip(1.5 * np.clip(0.4 + 300.0 * cut, 0.0, 1.0), 0.0, 1.0)
        np.testing.assert_allclose(image.intensity, expected, atol=1e-12)
    named, by_angle = (schlieren(light, knife_edge=edge) for edge in ("vertical", math.pi))
    np.testing.assert_allclose(named.intensity + by_angle.intensity, 1.0, atol=1e-12)


def test_datasets_carry_units():
    field = blob()
    for image in (
        schlieren(field, **OPTIONS),
        shadowgraph(field, distance=1.0, **OPTIONS),
        interferogram(field, fringe_spacing=0.002, **OPTIONS),
    ):
        data = image.to_xarray()
        assert all("units" in variable.attrs for variable in data.variables.values())
        assert data["intensity"].dims == ("vertical", "horizontal")
        np.testing.assert_array_equal(data["intensity"], image.intensity)
        assert data.attrs["kind"] in ("schlieren", "shadowgraph", "interferogram")


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"fringe_spacing": -1.0}, "fringe_spacing"),
        ({"fringe_spacing": 1e-4}, "less than two pixels"),
        ({"fringe_angle": math.inf}, "fringe_angle"),
        ({"fringe_angle": 90.0}, r"fringe_angle = 90.0: .* radians .* is it in degrees\?"),
        ({"visibility": 2.0}, "visibility"),
        ({"exposure": math.nan}, "exposure"),
        ({r"rays_per_pixel": 0}, "rays_per_pixel .* at least 1, got 0"),
    ],
)
def test_arguments_that_make_no_sense(options: dict, match: str):
    with pytest.raises(ValueError, match=match):
        interferogram(blob(), **{**OPTIONS, **options})
