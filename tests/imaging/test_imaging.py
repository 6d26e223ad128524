"""Pictures through a flow: displacement against exact deflections, signs, blur, and the loop through correlation.

Angles are exact to second order where the fields are weak; each test says its tolerance, in pixels of the picture.
"""

import warnings

import numpy as np
import pytest

from aerokernels import (
    Camera,
    Disc,
    DotPattern,
    IndexField,
    Sensor,
    background_displacement,
    bos,
    flow,
    image_through,
    wavefront,
)
from aerokernels.benches import read_picture
from aerokernels.benchmark.scenes import CONE_HALF, cone_field, cone_truth
from aerokernels.rays import RayBundle
from tests.imaging.cone_rays import rays_past_cone
from tests.slow import first_of

GRADIENT, FRONT, LENGTH = 3e-3, 0.2, 0.1


def prism(gradient: float = GRADIENT) -> IndexField:
    """Index 1 + gradient y between z = 0.2 and 0.3 m: light is turned toward +y by gradient times length."""
    y = np.linspace(-0.1, 0.1, 21)
    contrast = np.repeat(gradient * y[:, None], 11, axis=1)
    return IndexField.from_samples(contrast, origin=(-0.1, FRONT), spacing=(0.01, 0.01), geometry="planar")


@pytest.mark.parametrize("focus", [None, 0.6])
def test_a_prism_displaces_by_its_deflection(focus):
    """Displacement -g l (D - z of the prism's middle) / scene_pixel along y, none along x; 0.01 pixel."""
    camera = Camera(Disc(0.005), 0.1, 5e-6, (16, 24), distance=1.5, focus=focus)
    found = background_displacement(prism(), camera, allow_truncation=True)
    expected = -GRADIENT * LENGTH * (1.5 - FRONT - 0.5 * LENGTH) / camera.scene_pixel
    assert abs(expected) > 4.0
    assert np.abs(found.displacement - [0.0, expected]).max() < 0.01
    assert found.blur.max() < 0.01 and (found.through == 1.0).all()
    assert found.scene_displacement[0, 0, 1] == pytest.approx(expected * camera.scene_pixel, rel=1e-3)


def test_a_constant_opd_gradient_shifts_a_far_picture_by_that_angle():
    """The wavefront's tilt is +a, the picture moves by -a: here 6 pixels, so that pictures compare pixel by pixel."""
    camera = Camera(Disc(0.005), 0.05, 5e-6)
    scene = np.random.default_rng(1).random((40, 48))
    found = image_through(prism(2.0 * GRADIENT), scene, camera, psf_nodes=2, psf_pixels=16, allow_truncation=True)
    tilt = wavefront(prism(2.0 * GRADIENT), camera.pupil, pixel_count=16, allow_truncation=True).tilt
    pixels = tilt / camera.pixel_tangent
    assert pixels == pytest.approx([0.0, 6.0], abs=1e-4)
    assert np.abs(found.displacement + pixels).max() < 1e-3
    assert np.abs(found.image[:-6] - found.reference[6:])[8:-8, 8:-8].max() < 1e-4
    assert found.spreads.kept.min() > 0.95


def test_a_fraction_of_a_pixel_is_as_exact():
    """A Gaussian spot of 3 pixels seen 2.4 pixels lower, against the spot of the formula moved by that.

    The light of the wings that kernels of 17 pixels do not hold, 0.7 %, is the error: 1e-3 of the peak, where a
    hundredth of a pixel off would be 2e-3.
    """
    camera = Camera(Disc(0.005), 0.05, 5e-6)
    y, x = np.mgrid[:48, :48] - 23.5
    spot = [np.exp(-(x**2 + (y + moved) ** 2) / 18.0) for moved in (0.0, 2.4)]
    options = {"psf_nodes": 3, "psf_pixels": 17, "allow_truncation": True}
    found = image_through(prism(0.8 * GRADIENT), spot[0], camera, **options)
    moved = image_through(prism(1e-9), spot[1], camera, **options)
    assert np.abs(found.displacement - [0.0, -2.4]).max() < 1e-3
    assert np.abs(found.image - moved.image).max() < 1e-3


def test_a_lens_of_air_blurs_as_its_wavefront_does():
    """A far point through a weak lens: the picture of one bright pixel is the lens's point spread function."""
    x, z = np.linspace(-0.02, 0.02, 17), np.linspace(0.01, 0.03, 17)
    bell = np.where((z > 0.0125) & (z < 0.0275), np.sin(np.pi * (z - 0.0125) / 0.015) ** 4, 0.0)
    contrast = 4.0 * (x[:, None, None] ** 2 + x[None, :, None] ** 2) * bell
    field = IndexField.from_samples(
        contrast, origin=(-0.02, -0.02, 0.01), spacing=(0.0025, 0.0025, 0.00125), geometry="volume"
    )
    camera = Camera(Disc(0.005), 0.2, 1e-5)
    scene = np.zeros((33, 33))
    scene[16, 16] = 1.0
    found = image_through(field, scene, camera, psf_nodes=3, psf_pixels=32, wavelength=905e-9)
    place = (np.arange(34 * 4) + 0.5) / 4 - 17.0
    spread = wavefront(field, camera.pupil, pixel_count=32, wavelength=905e-9).psf(place * camera.pixel_tangent)
    overlap = np.clip(1.0 - np.abs(np.arange(33)[:, None] - 16 - place), 0.0, None)
    expected = overlap @ spread.intensity @ overlap.T
    expected /= expected[:32, :32].sum()
    assert expected.max() < 0.5 * found.reference.max()
    # Pixels beside the middle see the lens from aside: a defocus is the same there, but for its own displacement.
    assert np.abs(found.image - expected)[8:-8, 8:-8].max() < 0.03 * expected.max()


def test_a_picture_in_light_of_several_wavelengths():
    """The mean of the pictures at its wavelengths, by weight, moved by one gradient; to rounding.

    Without a flow the light of twice the wavelength spreads twice as far: less of it stays in a bright pixel.
    """
    camera, scene = Camera(Disc(0.005), 0.05, 5e-6), np.random.default_rng(2).random((16, 16, 3))
    options = {"psf_nodes": 2, "psf_pixels": 16, "wavelengths": [450e-9, 900e-9], "allow_truncation": True}
    grey = image_through(prism(), scene[..., 0], camera, weights=[1.0, 3.0], **options)
    alone = {**options, "wavelength": 450e-9}
    each = [image_through(prism(), scene, camera, **(alone | {"wavelengths": [one]})) for one in options["wavelengths"]]
    one, two = (picture.image[..., 0] for picture in each)
    assert np.abs(grey.image - 0.25 * one - 0.75 * two).max() < 1e-12
    assert np.abs(one - two).max() > 1e-2 and grey.wavelength == 450e-9
    assert np.abs(grey.displacement - [0.0, -3.0]).max() < 1e-3
    assert np.abs(each[0].image[:-3] - each[0].reference[3:])[4:-4, 4:-4].max() < 1e-3
    assert grey.to_xarray().weight.values.tolist() == [0.25, 0.75]
    point = np.zeros((17, 17))
    point[8, 8] = 1.0
    spots = [
        image_through(prism(1e-9), point, camera, **(alone | {"wavelengths": [one]})).image[8, 8]
        for one in options["wavelengths"]
    ]
    assert spots[1] < 0.9 * spots[0]


def test_pixels_that_look_through_a_cut_are_marked():
    """Air of y > 0 goes on beyond a cut, that of y < 0 fades out: rows that look up are unknown, the others known.

    Rows look along y = tangent z from a small aperture: those above the axis leave through the disturbed face.
    """
    y, depth = np.linspace(-0.1, 0.1, 21), np.linspace(0.0, 2.0, 41)
    above = np.clip(4.0 * depth, 0.0, 1.0)
    below = np.where(np.abs(depth - 0.5) < 0.25, np.cos(2.0 * np.pi * (depth - 0.5)), 0.0) ** 4
    contrast = 1e-3 * y[:, None] * np.where(y[:, None] > 0.0, above, below)
    given = {"origin": (-0.1, FRONT), "spacing": (0.01, 0.01), "geometry": "planar"}
    whole = IndexField.from_samples(contrast, **given, interpolation="linear")  # a spline rings across the axis
    field = whole.resample(0.01, region=((-0.1, FRONT), (0.1, FRONT + 0.2)))
    camera = Camera(Disc(0.002), 0.05, 5e-4, (20, 4), distance=1.5)
    with pytest.raises(ValueError, match=r"of the picture looks through disturbed air .* allow_truncation=True"):
        background_displacement(field, camera)
    with pytest.raises(ValueError, match="allow_truncation=True"):
        image_through(field, np.ones((20, 4)), camera)
    found = background_displacement(field, camera, allow_truncation=True)
    up = np.arange(20) - 9.5
    assert not found.known[up > 3.0].any() and found.known[up < -3.0].all()
    assert np.isfinite(found.displacement).all() and found.to_xarray().truncated.dims == ("y", "x")


def test_a_few_pixels_that_look_through_a_cut_are_warned_of():
    """One pixel of 1024 looks through the one cell that is disturbed where the box is cut: less than is refused.

    Cells of 3.17 mm at the cut, 0.28 m away, where pixels look 6.39 mm apart, the outermost 1 mm from the edge.
    The flow goes on for 5 mm.
    """
    contrast = np.zeros((64, 64, 18))
    contrast[-1, -1, 16:] = 1e-4
    cell = (0.2 / 63, 0.2 / 63, 0.005)
    whole = IndexField.from_samples(
        contrast,
        origin=(-0.1, -0.1, FRONT),
        spacing=cell,
        geometry="volume",
        interpolation="linear",
    )
    field = whole.resample(cell, region=((-0.1, -0.1, FRONT), (0.1, 0.1, FRONT + 0.08)), interpolation="linear")
    camera = Camera(Disc(1e-4), 0.05, 0.05 * 0.099 / 0.28 / 15.5, (32, 32))
    with pytest.warns(RuntimeWarning, match="^0.0977 % of the picture looks through disturbed air"):
        found = background_displacement(field, camera, aperture_rays=1)
    assert np.argwhere(~found.known).tolist() == [[31, 31]]


def test_a_cone_displaces_as_its_exact_rays_say():
    """The conical layer of aerokernels/benchmark/scenes.py; a point camera; exact rays by DOP853; 0.01 pixel."""
    camera = Camera(Disc(1e-4, center=(0.0, 0.0, -0.2)), 0.05, 8e-6, (12, 12), distance=1.0)
    found = background_displacement(cone_field(), camera, aperture_rays=1, tolerance=1e-4)
    x, y = (axis.ravel() for axis in np.meshgrid(*camera.tangents((12, 12))))
    direction, way = camera.directions(x, y), 0.2 - CONE_HALF[2]
    start = np.stack([x * way, y * way, np.full(len(x), -CONE_HALF[2])], axis=1)
    truth = cone_truth(RayBundle(start, direction))
    beyond = 0.8 - CONE_HALF[2]
    landing = truth.position[:, :2] + beyond * truth.direction[:, :2] / truth.direction[:, 2:]
    expected = -(landing - np.stack([x, y], axis=1)) / camera.scene_pixel
    assert np.abs(expected).max() > 1.0
    assert np.abs(found.displacement.reshape(-1, 2) - expected).max() < 0.01


def test_a_conical_flow_displaces_as_its_exact_rays_say():
    """Snell's law at the shock and DOP853 behind it (cone_rays.py), from four cells inside it; 0.01 pixel.

    The grid smooths the shock over some three cells; the displacement has a pole there, whose error `error` holds.
    """
    gas = flow.cone(2.5, np.deg2rad(15.0), length=0.05)
    field = gas.index_field(wavelength=532e-9, spacing=2.5e-4)
    camera = Camera(Disc(1e-3, center=(-1.0, 0.0, -0.03), normal=(1.0, 0.0, 0.0)), 0.1, 1.5e-5, (241, 1), distance=2.0)
    edge = 0.03 * np.tan(gas.shock.shock_angle)
    height = edge - 2.5e-4 * np.array([2.0, 3.0, 4.3, 5.0, 6.0, 8.0, 12.0])
    y = camera.tangents((241, 1))[1]
    rows = np.argmin(np.abs(y[:, None] - height), axis=0)
    found = background_displacement(field, camera, aperture_rays=1)
    direction = camera.directions(np.zeros(len(rows)), y[rows])
    start = np.broadcast_to(camera.pupil.center, direction.shape)
    place, way = rays_past_cone(gas.shock, field.ambient_index, RayBundle(start, direction))
    landing = place + ((1.0 - place[:, :1]) / way[:, :1]) * way
    straight = start + (2.0 / direction[:, :1]) * direction
    expected = -camera.across(landing - straight) / camera.scene_pixel
    assert np.abs(expected).max() > 1.5
    error = np.abs(found.displacement[rows, 0] - expected).max(axis=1)
    assert error[2:].max() < 0.01 < error[0]
    assert (error <= found.error[rows, 0] + 1e-3).all()


def test_the_shock_of_a_wedge_displaces_as_snell_says():
    """A view down on the shock, the pattern in the gas behind it: refraction at one plane; 0.01 pixel."""
    gas = flow.wedge(2.5, np.deg2rad(10.0), length=0.1, height=0.08)
    field = gas.index_field(wavelength=532e-9).resample(5e-4)
    angle, ratio = gas.solution.shock.shock_angle, gas.solution.shock.density_ratio
    camera = Camera(Disc(5e-4, center=(0.0, 1.0, -0.06), normal=(0.0, -1.0, 0.0)), 0.1, 5e-7, (3, 5), distance=0.98)
    found = background_displacement(field, camera, aperture_rays=1)
    x, y = (axis.ravel() for axis in np.meshgrid(*camera.tangents((3, 5))))
    direction, start = camera.directions(x, y), camera.pupil.center
    normal = np.array([0.0, np.cos(angle), np.sin(angle)])
    hit = start - (start @ normal) / (direction @ normal)[:, None] * direction
    cosine, index = -direction @ normal, field.ambient_index / (1.0 + (field.ambient_index - 1.0) * ratio)
    bent = index * direction + (index * cosine - np.sqrt(1.0 - index**2 * (1.0 - cosine**2)))[:, None] * normal
    landing = hit + ((0.02 - hit[:, 1]) / bent[:, 1])[:, None] * bent
    straight = start + ((0.02 - start[1]) / direction[:, 1])[:, None] * direction
    expected = -camera.across(landing - straight) / camera.scene_pixel
    assert np.abs(expected).max() > 0.3
    assert np.abs(found.displacement.reshape(-1, 2) - expected).max() < 0.01


def bump() -> IndexField:
    """A weak Gaussian lens of unequal widths about z = 0."""
    x = np.linspace(-0.05, 0.05, 33)
    along, up, deep = np.meshgrid(x, x, x, indexing="ij", sparse=True)
    contrast = 2e-4 * np.exp(-((along / 0.02) ** 2) - (up / 0.015) ** 2 - (deep / 0.02) ** 2)
    return IndexField.from_samples(contrast, origin=(-0.05,) * 3, spacing=(x[1] - x[0],) * 3, geometry="volume")


def test_correlating_the_pictures_gives_the_displacement_back():
    """OpenPIV on the two pictures: 0.05 pixel rms of the traced displacement's mean over its windows."""
    pyprocess = pytest.importorskip("openpiv.pyprocess")
    from scipy.ndimage import map_coordinates, uniform_filter

    camera = Camera(Disc(0.004, center=(0.0, 0.0, -0.5)), 0.05, 6.4e-6, 256, distance=1.0)
    pictures = bos(bump(), camera, aperture_rays=4, allow_truncation=True)
    size = {"window_size": 32, "overlap": 16, "search_area_size": 40}
    right, down, _ = pyprocess.extended_search_area_piv(
        pictures.reference[::-1], pictures.picture[::-1], normalized_correlation=True, **size
    )
    column, row = pyprocess.get_coordinates(image_size=(256, 256), search_area_size=40, overlap=16)
    for axis, measured in ((0, right), (1, -down)):
        mean = uniform_filter(pictures.displacement[..., axis], 32)
        traced = map_coordinates(mean, [255.5 - row, column - 0.5], order=1)
        assert np.sqrt(np.mean(traced**2)) > 0.2
        assert np.sqrt(np.mean((measured - traced) ** 2)) < 0.05


def test_depth_of_field_and_the_files(tmp_path):
    """Out of focus by a blur circle of 12 pixels dots fade; files hold 16 bits, the uppermost row first."""
    sharp = Camera(Disc(0.004, center=(0.0, 0.0, -0.5)), 0.05, 6.4e-6, (48, 64), distance=1.0)
    blurred = Camera(sharp.pupil, 0.05, 6.4e-6, (48, 64), distance=1.0, focus=1.2)
    pattern = DotPattern(diameter=4.0, density=0.02, seed=5)
    first, second = (
        bos(bump(), camera, pattern, aperture_rays=8, allow_truncation=True) for camera in (sharp, blurred)
    )
    assert second.reference.std() < 0.6 * first.reference.std()
    noisy = bos(bump(), sharp, pattern, aperture_rays=1, allow_truncation=True, sensor=Sensor(bits=8), seed=2)
    assert np.abs(noisy.reference * 255 - np.rint(noisy.reference * 255)).max() < 1e-9
    for kind in ("tiff", "png"):
        paths = first.write(tmp_path, kind)
        for path, brightness in zip(paths, (first.reference, first.picture), strict=True):
            read = read_picture(path, pixel_size=1.0, nose=(0.0, 0.0)).intensity
            assert np.abs(read - np.clip(brightness, 0.0, 1.0)).max() < 1.0 / 65535
    import xarray

    with xarray.open_dataset(tmp_path / "displacement.nc") as held:
        assert held.displacement.shape == (48, 64, 2) and held.displacement.units == "pixel"
    # A picture of one's own stands where the camera sees it: undisplaced it comes back, but for the pixels' mean.
    own = np.outer(np.hanning(48), np.hanning(64))
    seen = bos(bump(), sharp, own, aperture_rays=1, allow_truncation=True)
    assert np.abs(seen.reference - own).max() < 2e-3


def test_what_is_refused():
    camera = Camera(Disc(0.005), 0.1, 5e-6, 16, distance=1.5)
    with pytest.raises(TypeError, match="Camera"):
        background_displacement(prism(), "camera")
    with pytest.raises(TypeError, match="unknwon"):
        background_displacement(prism(), camera, unknwon=1)
    with pytest.raises(ValueError, match="focal length"):
        Camera(Disc(0.005), 0.1, 5e-6, distance=0.05)
    with pytest.raises(ValueError, match="pixel_count"):
        background_displacement(prism(), Camera(Disc(0.005), 0.1, 5e-6))
    with pytest.raises(ValueError, match="infinite"):
        bos(prism(), Camera(Disc(0.005), 0.1, 5e-6, 16))
    with pytest.raises(ValueError, match="larger by an even number"):
        image_through(prism(), np.zeros((17, 16)), camera)
    with pytest.raises(TypeError, match="real numbers"):
        image_through(prism(), 1j * np.ones((16, 16)), camera)
    with pytest.raises(ValueError, match=r"first is at \[1, 0\]"):
        image_through(prism(), np.where(np.eye(16, k=-1) > 0.0, np.nan, 1.0), camera)
    with pytest.raises(ValueError, match="pupil_pixels"):
        image_through(prism(), np.ones((16, 16)), camera, pupil_pixels=1)
    with pytest.raises(ValueError, match="shape must be one whole number"):
        background_displacement(prism(), camera, shape=(16, 16, 3))
    with pytest.raises(ValueError, match="bits"):
        Sensor(bits=17)


@pytest.mark.parametrize("seed", first_of([0, 9, 11]))
def test_the_errors_told_hold_displacement_and_blur(seed: int):
    """Drawn cameras before air of closed form, whose rays are followed by Runge-Kutta steps of their own."""
    from tests.draws.camera_draws import check_camera, draw_camera

    found = check_camera(draw_camera(seed))
    assert np.mean(found.blur_missed <= found.blur_error + 1e-5) >= 0.9, found
    assert np.mean(found.displacement_missed <= found.displacement_error + 1e-5) >= 0.9, found
    assert np.median(found.blur_error) < 10.0 * np.median(found.blur) + 1e-4


def test_point_spread_functions_that_do_not_hold_their_light_are_told():
    """A scene far out of focus: a blur of 28 pixels in kernels of 16, which gave a picture too sharp without a word."""
    camera = Camera(Disc(4e-3), 0.05, 5e-6, (6, 6), distance=2.0, focus=1.2)
    options = {"psf_nodes": 1, "pupil_pixels": 48, "allow_truncation": True}
    with pytest.warns(
        RuntimeWarning, match=r"\d % of the light of a point spread function is outside of its 16 pixels"
    ):
        found = image_through(prism(), np.ones((6, 6)), camera, psf_pixels=16, **options)
    assert found.spreads.kept.min() < 0.6
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert image_through(prism(), np.ones((6, 6)), camera, psf_pixels=48, **options).spreads.kept.min() > 0.95
