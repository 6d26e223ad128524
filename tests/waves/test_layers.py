"""Layers and bent rays of waves: against points, faces and quadratic screens, one by one."""

import math
from itertools import pairwise

import numpy as np
import pytest

from aerokernels import IndexField, Wave, split_step
from aerokernels.waves import angular_spectrum
from aerokernels.waves.layers import mean_layers, path_range, sample_layers
from aerokernels.waves.validity import bending
from tests.moved_air import PITCH, lumps
from tests.random_fields import mesh_field, uniform_field

WAVELENGTH = 905e-9


def wave_of(field: IndexField, normal, shape=(5, 4), pixel: float = 1.5e-4, back: float = 5e-4) -> Wave:
    """A wave whose window starts before the field's box, off its middle."""
    low, high = field.box
    z = float(low[2]) - back if normal[2] > 0.0 else float(high[2]) + back
    return Wave(np.ones(shape), pixel, WAVELENGTH, np.array([1e-4, 2e-4, z]), normal)


def points_of(wave: Wave, distance: float) -> np.ndarray:
    """Middles of a window's pixels at a distance, shape (rows, columns, 3)."""
    x, y = np.meshgrid(*wave.coordinates)
    return wave.center + distance * wave.normal + x[..., None] * wave.axes[0] + y[..., None] * wave.axes[1]


def ends_of(field: IndexField, wave: Wave) -> tuple[np.ndarray, np.ndarray]:
    """Distances at which the line of each pixel enters and leaves the box, by its planes and its cylinder."""
    start, (low, high), normal = points_of(wave, 0.0), field.box, wave.normal
    round_box = field.geometry == "axisymmetric"
    with np.errstate(divide="ignore"):
        ends = np.sort([(low - start) / normal, (high - start) / normal], axis=0)[..., 2 if round_box else 0 :]
    enter, leave = ends[0].max(axis=-1), ends[1].min(axis=-1)
    if round_box and (normal[:2] != 0.0).any():
        square, across = normal[:2] @ normal[:2], start[..., :2] @ normal[:2]
        half = np.sqrt(across**2 - square * ((start[..., :2] ** 2).sum(axis=-1) - high[0] ** 2))
        enter, leave = np.maximum(enter, (-across - half) / square), np.minimum(leave, (half - across) / square)
    return enter, leave


def sampled(field: IndexField, wave: Wave, begin: float, end: float, count: int) -> np.ndarray:
    """The contrast in the middle of each layer's part in the box, times that part."""
    edges, (enter, leave) = np.linspace(begin, end, count + 1), ends_of(field, wave)
    layers = []
    for first, last in pairwise(edges):
        low, high = np.maximum(first, enter), np.minimum(last, leave)
        points = points_of(wave, 0.0) + (0.5 * (low + high))[..., None] * wave.normal
        contrast = field.contrast_at(points.reshape(-1, 3)).reshape(low.shape)
        layers.append(np.where(high > low, (high - low) * contrast, 0.0))
    return np.array(layers)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric", "mesh"])
@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.1, -0.2, 1.0), (0.1, 0.05, -1.0)])
def test_a_layer_is_the_contrast_at_its_middle_times_its_thickness(geometry: str, normal):
    field = mesh_field() if geometry == "mesh" else uniform_field(geometry)
    wave = wave_of(field, normal)
    expected = sampled(field, wave, 4e-4, 3e-3, 7)
    found = sample_layers(field, wave, 4e-4, 3e-3, 7)
    assert np.ptp(expected) > 0.0
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("count", [1, 7, 64])
def test_slanted_faces_of_a_box_cut_layers(geometry: str, count: int):
    """A constant contrast. Expected: the contrast times each line's way through the box, in any number of layers."""
    shape = (5, 5, 9) if geometry == "volume" else (5, 9)
    low = (0.0, 0.0) if geometry == "axisymmetric" else (-2e-3,) * (len(shape) - 1) + (0.0,)
    field = IndexField.from_samples(np.full(shape, 1e-4), origin=low, spacing=(1e-3,) * len(shape), geometry=geometry)
    wave = wave_of(field, (0.1, -0.2, 1.0))
    enter, leave = ends_of(field, wave)
    found = mean_layers(field, wave, *path_range(field, wave), count)[0].sum(axis=0)
    assert np.ptp(enter) > 1e-4
    np.testing.assert_allclose(found, 1e-4 * (leave - enter), rtol=1e-5)


@pytest.mark.parametrize("shape", [(9, 8), (11, 1)])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_rays_through_quadratic_screens_bend_exactly(shape: tuple[int, int], count: int):
    """Paths g x + x H x / 2 at each screen: rays by their places and slopes, and what they gain over straight ones."""
    draw = np.random.default_rng(count)
    pixel, step, after = 0.2, 0.7, 1.9
    wide = shape[1] > 1
    y = pixel * (np.arange(shape[0]) - 3.0)[:, None] * np.ones(shape)
    x = pixel * (np.arange(shape[1]) - 2.0) * np.ones(shape) if wide else np.zeros(shape)
    place = np.stack([y, x], axis=-1)
    gradient, hessian = 0.02 * draw.normal(size=(count, 2)), 0.05 * draw.normal(size=(count, 2, 2))
    hessian = hessian + hessian.swapaxes(1, 2)
    if not wide:
        gradient[:, 1], hessian[:, 1, :], hessian[:, :, 1] = 0.0, 0.0, 0.0
    height = lambda k, at: at @ gradient[k] + 0.5 * np.einsum("...i,ij,...j->...", at, hessian[k], at)  # noqa: E731
    paths = np.array([height(k, place) for k in range(count)])
    turn, aside, gained = np.zeros(place.shape), np.zeros(place.shape), np.zeros(shape)
    for k in range(count):
        gained += height(k, place + aside) - height(k, place)
        turn += gradient[k] + (place + aside) @ hessian[k]
        distance = 0.5 * step + after if k == count - 1 else step
        gained += 0.5 * distance * (turn**2).sum(axis=-1)
        aside += distance * turn
    found = bending(paths, pixel, step, after)
    inner = (slice(2, -2), slice(2, -2) if wide else slice(None))
    np.testing.assert_allclose(found[inner], gained[inner], rtol=1e-11)


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


def test_a_wave_that_is_moved_with_the_air_is_the_same_wave():
    found = []
    for move in (np.zeros(3), PITCH * np.array([4.0, -2.0, 8.0])):
        light = Wave(np.ones((32, 32)), PITCH / 4.0, WAVELENGTH, np.array([PITCH, 0.0, -16.0 * PITCH]) + move)
        found.append(split_step(lumps(move), light, step_count=16).amplitude)
    np.testing.assert_allclose(found[1], found[0], atol=1e-5)
    assert np.abs(np.angle(found[0])).max() > 1e-3
