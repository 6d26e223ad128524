"""Steps of a wave, its numbers, and slabs of wide windows: by hand, at the edges of each rule."""

import math

import numpy as np
import pytest

from aerokernels import Body, Disc, IndexField, Rectangle, Wave, split_step
from aerokernels.wavefront import Wavefront
from aerokernels.wavefront.changes import of_pixels
from aerokernels.waves import angular_spectrum
from aerokernels.waves.angular_spectrum import transfer_exponent
from aerokernels.waves.layers import layer_count, mean_layers, path_range
from aerokernels.waves.shadows import SlabsPastBody
from aerokernels.waves.slabs import LookingAlong, SlabsAlongZ, is_summed, slabs_of
from aerokernels.waves.split_step import _refined, every_second, every_second_pixel, plane_wave
from tests.phase_plates import WAVELENGTH
from tests.random_fields import uniform_field

AXES = (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))


def test_exponents_of_plane_waves():
    """Sqrt(k^2 - K^2) - k, or -K^2 / 2 k; waves beyond k decay."""
    shape, pixel, index = (6, 5), 4e-7, 1.2
    wave_number = 2.0 * np.pi * index / WAVELENGTH
    up, right = (2.0 * np.pi * np.fft.fftfreq(n, pixel) for n in shape)
    square = up[:, None] ** 2 + right**2
    exact, paraxial = (transfer_exponent(shape, pixel, WAVELENGTH, index, kind) for kind in (False, True))
    np.testing.assert_allclose(paraxial, -0.5j * square / wave_number, rtol=1e-12)
    expected = 1j * (np.sqrt((wave_number**2 - square).astype(complex)) - wave_number)
    np.testing.assert_allclose(exact, expected, rtol=1e-9, atol=1e-3)
    assert (square > wave_number**2).any() and (exact[square > wave_number**2].real < 0.0).all()
    draw = np.random.default_rng(1)
    amplitude = draw.normal(size=shape) + 1j * draw.normal(size=shape)
    moved = angular_spectrum(amplitude, pixel, WAVELENGTH, 3e-7, ambient_index=index)
    direct = np.fft.ifft2(np.fft.fft2(amplitude) * np.exp(3e-7 * exact))
    np.testing.assert_allclose(moved, direct, atol=1e-12)


def test_numbers_of_a_wave():
    """Places about the middle pixel; Strehl ratio over the initial sum, NaN without light along the axis."""
    draw = np.random.default_rng(2)
    amplitude = draw.normal(size=(5, 4)) + 1j * draw.normal(size=(5, 4))
    wave = Wave(amplitude, 2e-4, WAVELENGTH, (1e-3, 2e-3, 3e-3), (0.1, 0.2, 1.0), incident=3.0 - 1.0j)
    x, y = wave.coordinates
    np.testing.assert_allclose(x, 2e-4 * np.array([-2.0, -1.0, 0.0, 1.0]))
    np.testing.assert_allclose(y, 2e-4 * np.arange(-2.0, 3.0))
    assert wave.strehl() == pytest.approx(abs(amplitude.sum()) ** 2 / 10.0)
    assert Wave(amplitude, 2e-4, WAVELENGTH).strehl() == pytest.approx(1.0)
    np.testing.assert_allclose(wave.intensity, np.abs(amplitude) ** 2)
    angle = np.array([-1e-3, 0.0, 2e-3])
    found = wave.psf(angle).intensity
    for i, j in np.ndindex(3, 3):
        turned = np.exp(-2j * np.pi / WAVELENGTH * (angle[j] * x + angle[i] * y[:, None]))
        assert found[i, j] == pytest.approx(abs((amplitude * turned).sum()) ** 2 / 10.0, rel=1e-9, abs=0.0)
    odd = Wave(np.array([[1.0, -1.0], [0.5, -0.5]]), 2e-4, WAVELENGTH)
    assert math.isnan(odd.strehl()) and np.isnan(odd.psf(angle).intensity).all()
    moved = wave.propagate(0.01)
    np.testing.assert_allclose(moved.center, wave.center + 0.01 * wave.normal)
    np.testing.assert_allclose(moved.amplitude, angular_spectrum(amplitude, 2e-4, WAVELENGTH, 0.01), atol=1e-12)


def test_steps_are_doubled_until_the_error_is_within_the_tolerance():
    """A result of second order in the steps: a third of the difference over the size is the error of the finer one.

    Two steps count their whole difference from one, which may be too thick for that order.
    """
    exact = np.array([2.0, 1.0])
    asked = []

    def propagate(steps: int) -> np.ndarray:
        asked.append(steps)
        return exact + np.array([3.0, 4.0]) / steps**2

    size = 10.0
    for tolerance, most, last in ((0.4, 64, 2), (0.05, 64, 4), (0.003, 64, 16), (1e-9, 16, 16)):
        asked.clear()
        found, coarse, steps, error = _refined(propagate, size, most, tolerance, None)
        assert steps == last and asked == [2**k for k in range(int(math.log2(last)) + 1)]
        np.testing.assert_array_equal(found, exact + np.array([3.0, 4.0]) / last**2)
        np.testing.assert_array_equal(coarse, exact + np.array([3.0, 4.0]) / (last // 2) ** 2)
        assert error == pytest.approx((15.0 if last == 2 else 5.0) / last**2 / size)
    at = _refined(propagate, size, 64, 15.0 / 4.0 / size, None)  # the tolerance itself is met
    assert at[2] == 2
    found, coarse, steps, error = _refined(propagate, size, 64, 1e-9, 6)
    assert steps == 6 and error == pytest.approx(5.0 / 36.0 / size) and coarse is not None
    odd = _refined(propagate, size, 64, 1e-9, 5)
    assert odd[1] is None and math.isnan(odd[3]) and odd[2] == 5


def test_every_second_pixel_keeps_the_middle_one():
    for count in (8, 9, 10, 11):
        part = every_second((count, count))[0]
        assert count // 2 in range(count)[part] and part.step == 2
    light = Disc(1e-3)
    wave = plane_wave(light, WAVELENGTH, 20, 1.5, 1.1)
    sparse = every_second_pixel(light, wave, 1.5)
    assert sparse.pixel == pytest.approx(2.0 * wave.pixel) and sparse.ambient_index == 1.1
    np.testing.assert_allclose(sparse.coordinates[0], wave.coordinates[0][every_second((20,))[0]], atol=1e-15)
    assert every_second_pixel(light, plane_wave(light, WAVELENGTH, 16, 1.5, 1.0), 1.5).amplitude.shape == (8, 8)
    assert every_second_pixel(light, plane_wave(light, WAVELENGTH, 15, 1.5, 1.0), 1.5) is None
    draw = np.random.default_rng(3)
    own = Wave(draw.uniform(size=(6, 7)), 1e-4, WAVELENGTH)
    half = every_second_pixel(own, own, 2.0)
    np.testing.assert_array_equal(half.amplitude, own.amplitude[1::2, 1::2])
    assert half.pixel == pytest.approx(2e-4) and half.incident == pytest.approx(half.amplitude.sum())
    dark = np.zeros((4, 4))
    dark[1, 1] = 1.0
    assert every_second_pixel(Wave(dark, 1e-4, WAVELENGTH), Wave(dark, 1e-4, WAVELENGTH), 2.0) is None


@pytest.mark.parametrize("body", [False, True])
def test_the_error_of_a_strehl_ratio_by_half_as_many_steps_and_pixels(body: bool):
    """A third of the change by the steps, all of the change by pixels and layers, and the edge of straight paths."""
    r, z = np.linspace(0.0, 4e-3, 17), np.linspace(0.0, 0.02, 17)
    samples = 1e-4 * np.cos(r[:, None] / 1.2e-3) * np.sin(np.pi * z / 0.02) ** 2
    solid = Body(np.array([[0.0, 0.005], [0.3e-3, 0.005], [0.3e-3, 0.009], [0.0, 0.009]]), "axisymmetric")
    field = IndexField.from_samples(
        samples, origin=(0.0, 0.0), spacing=(r[1], z[1]), geometry="axisymmetric", body=solid if body else None
    )
    pupil = Rectangle(2e-3, 2.4e-3, (1e-4, 2e-4, -1e-3))
    options = {"wavelength": WAVELENGTH, "window": 1.6, "pixel_count": 40, "step_count": 8}
    fine = split_step(field, pupil, **options)
    fewer = split_step(field, pupil, **options | {"step_count": 4})
    light = plane_wave(pupil, WAVELENGTH, 40, 1.6, 1.0)
    begin, end = path_range(field, light)
    count = layer_count(field, end - begin, 8)
    path = mean_layers(field, light, begin, end, count)[0].sum(axis=0)
    half = plane_wave(pupil, WAVELENGTH, 20, 1.6, 1.0)
    rough = mean_layers(field, half, begin, end, count // 2, cells_apart=2.0)[0].sum(axis=0)
    layers = [half.amplitude * np.exp(2j * np.pi / WAVELENGTH * own) for own in (path[::2, ::2], rough)]
    size = [np.linalg.norm(one) for one in (fine.amplitude - fewer.amplitude, light.amplitude, half.amplitude)]
    by_layers = np.linalg.norm(layers[0] - layers[1]) / size[2]
    assert fine.step_count == 8 and fine.error == pytest.approx(size[0] / 3.0 / size[1] + by_layers, rel=1e-3, abs=0.0)
    coarse = split_step(field, pupil, **options | {"pixel_count": 20})
    expected = abs(fine.strehl() - fewer.strehl()) / 3.0 + abs(fine.strehl() - coarse.strehl())
    expected += abs(float(np.subtract(*(abs(one.sum() / half.amplitude.sum()) ** 2 for one in layers))))
    weight = light.amplitude.real
    # One row and column more: their middle is the pupil's.
    whole = [np.pad(one, [(0, 1), (0, 1)]) for one in (path, weight)]
    expected += float(of_pixels(Wavefront(*whole, light.pixel, WAVELENGTH, pupil=pupil), Wavefront.strehl))
    assert fine.strehl_error == pytest.approx(expected, rel=0.05, abs=2e-7)
    assert math.isnan(split_step(field, pupil, **options | {"step_count": 5}).strehl_error)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("look", [1.0, -1.0])
@pytest.mark.parametrize(("half", "aside"), [(1.3e-3, 0.0), (0.4e-3, 0.9e-3), (1.3e-3, 1.1e-3), (2e-3, 0.0)])
def test_slabs_of_windows_that_look_past_the_box(geometry: str, look: float, half: float, aside: float):
    """Paths less the first line's against two Gauss points to a cell of the contrast, which is zero beside the box."""
    field = uniform_field(geometry, "cubic", amplitude=3e-6)
    low, high = field.box
    center = np.array([-0.7 * aside, aside, low[2] if look > 0.0 else high[2]])
    normal = np.array([0.0, 0.0, look])
    wave = Wave(np.ones((2, 2)), 1e-3, WAVELENGTH, center, normal)
    window = LookingAlong(center, normal, wave.axes, half)
    x, y = half * np.linspace(-0.95, 1.0, 6), half * np.linspace(-1.0, 0.9, 7)
    slabs = slabs_of(field, window, 0.0, float(high[2] - low[2]), WAVELENGTH)
    assert isinstance(slabs, SlabsAlongZ)
    across, up = np.meshgrid(x, y)
    points = center + across[..., None] * wave.axes[0] + up[..., None] * wave.axes[1]
    cells = field.samples.shape[-1] - 1
    edges = np.linspace(slabs.first, slabs.last, 3)
    for count in (1, 2):
        found = slabs.paths(x, y, count)
        for number, (begin, end) in enumerate(zip(edges[:: 2 // count], edges[2 // count :: 2 // count], strict=False)):
            nodes = np.linspace(0.0, float(high[2] - low[2]), cells + 1)
            knots = np.sort([begin, *nodes[(nodes > begin) & (nodes < end)], end])
            expected = np.zeros(across.shape)
            for middle, reach in zip(0.5 * (knots[1:] + knots[:-1]), 0.5 * np.diff(knots), strict=True):
                for place in (-1.0, 1.0):
                    at = points + (middle + reach * place / math.sqrt(3.0)) * normal
                    expected += reach * field.contrast_at(at.reshape(-1, 3)).reshape(across.shape)
            apart = (found[number] - found[number, 0, 0]) - (expected - expected[0, 0])
            assert np.abs(apart).max() < 2e-6 * np.abs(expected).max()


def test_lines_of_sight_along_z_alone_are_summed():
    for turn, along in ((0.0, True), (1e-9, True), (1e-6, False)):
        normal = np.array([math.sin(turn), 0.0, math.cos(turn)])
        assert (
            is_summed(uniform_field("volume"), normal) is along and is_summed(uniform_field("volume"), -normal) is along
        )


def test_paths_in_a_shadow_go_on_as_beside_it():
    """Every dark pixel has the path of the nearest lit one; where all or none is dark nothing changes."""
    y, z = np.linspace(-4e-3, 4e-3, 33), np.linspace(0.0, 0.02, 21)
    body = Body(np.array([[0.55e-3, 0.004], [1.45e-3, 0.004], [1.45e-3, 0.012], [0.55e-3, 0.012]]), "planar")
    samples = 1e-5 * np.cos(y[:, None] / 2e-3) * np.ones(21)
    given = {"origin": (y[0], 0.0), "spacing": (y[1] - y[0], z[1]), "geometry": "planar"}
    field, free = (IndexField.from_samples(samples, **given, **more) for more in ({"body": body}, {}))
    center = np.array([0.0, 0.0, -1e-3])
    window = LookingAlong(center, np.array([0.0, 0.0, 1.0]), AXES, 2e-3)
    x, place = 2.5e-4 * np.arange(-3.0, 4.0), 2.5e-4 * np.arange(-6.0, 7.0)
    slabs, open_slabs = (SlabsPastBody(one, window, 1e-3, 0.021, WAVELENGTH) for one in (field, free))
    found, plain = slabs.paths(x, place, 4), open_slabs.paths(x, place, 4)
    dark = slabs.opaque(x, place, 1)[0].all(axis=1)
    np.testing.assert_array_equal(dark, (place > 0.55e-3) & (place < 1.45e-3))
    lit = np.flatnonzero(~dark)
    for row in np.flatnonzero(dark):
        nearest = lit[np.abs(lit - row) == np.abs(lit - row).min()]
        assert any(np.allclose(found[:, row], plain[:, one], atol=1e-13) for one in nearest)
    np.testing.assert_allclose(found[:, ~dark], plain[:, ~dark], atol=1e-13)
    assert not open_slabs.opaque(x, place, 4).any()
    opaque = slabs.opaque(x, place, 4)
    assert opaque.shape == (4, 13, 7) and [bool(one.any()) for one in opaque] == [True, True, True, False]
    behind = 2.5e-4 * np.arange(3.0, 6.0)
    assert slabs.opaque(x, behind, 4)[1].all()
    open_air = np.where(np.abs(behind[:, None] - 1e-3) < 0.45e-3, slabs.paths(x, behind, 4)[3], 0.0)
    np.testing.assert_allclose(open_air, open_slabs.paths(x, behind, 4)[3], atol=1e-13)
