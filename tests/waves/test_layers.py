"""Layers and bent rays of waves: against points, faces and quadratic screens, one by one."""

import math
from itertools import pairwise

import numpy as np
import pytest

from aerokernels import Body, IndexField, Wave
from aerokernels.waves.bending import bending
from aerokernels.waves.layers import check_memory, layer_count, mean_layers, path_range, sample_layers, span_of
from aerokernels.waves.slabs import LookingAlong, SlabsOfLayers
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


@pytest.mark.parametrize("count", [1, 3, 20, 64])
def test_a_layer_thicker_than_a_cell_has_several_samples(count: int):
    """As many as cells along the line of sight, up to 16; and 16 layers at a time make no difference."""
    field = uniform_field("volume")
    wave = wave_of(field, (0.3, 0.0, 1.0))
    begin, end = 4e-4, 4.5e-3
    cell = 1.0 / np.abs(wave.normal / field.spacing).max()
    parts = min(max(math.ceil((end - begin) / count / cell), 1), 16)
    # How many samples there are per cell of a slanted line is a choice: between the two that are common.
    finest = 1.0 / np.abs(wave.normal / field.spacing).sum()
    choices = {parts, min(max(math.ceil((end - begin) / count / finest), 1), 16)}
    found, opaque = mean_layers(field, wave, begin, end, count)
    assert opaque is None and found.dtype == np.float32
    apart = []
    for number in choices:
        expected = sampled(field, wave, begin, end, count * number).reshape(count, number, *wave.amplitude.shape)
        apart.append(np.abs(found - expected.sum(axis=1)).max() / np.abs(found).max())
    assert min(apart) < 1e-6


@pytest.mark.parametrize("inside", [False, True])
def test_light_ends_on_a_body_and_begins_where_it_leaves_it(inside: bool):
    """Three samples a layer: none counts inside; a layer is opaque where one of them meets it behind air."""
    z, r = np.linspace(0.0, 5e-3, 26), np.linspace(0.0, 3e-3, 16)
    body = Body(np.array([[0.0, 1.05e-3], [1.15e-3, 1.05e-3], [1.15e-3, 2.85e-3], [0.0, 2.85e-3]]), "axisymmetric")
    samples = 1e-5 * np.cos(r[:, None] / 1e-3 + z / 2e-3)
    field = IndexField.from_samples(
        samples, origin=(0.0, 0.0), spacing=(r[1], z[1]), geometry="axisymmetric", body=body
    )
    start = 2.03e-3 if inside else -5e-4
    wave = Wave(np.ones((9, 8)), 3e-4, WAVELENGTH, np.array([2e-4, 1e-4, start]), (0.1, 0.0, 1.0))
    begin, end, count = (0.0, 2.7e-3, 18) if inside else (6e-4, 5e-3, 22)
    found, opaque = mean_layers(field, wave, begin, end, count)
    per_layer = None
    for parts in range(1, 5):
        step = (end - begin) / count / parts
        expected = np.zeros(found.shape)
        dark = np.zeros(found.shape, dtype=bool)
        behind = body.contains(field.local_coordinates(points_of(wave, 0.0).reshape(-1, 3))).reshape(9, 8)
        first = behind.copy()
        for k in range(count * parts):
            points = points_of(wave, begin + step * (k + 0.5)).reshape(-1, 3)
            within = body.contains(field.local_coordinates(points)).reshape(9, 8)
            behind &= within
            expected[k // parts] += np.where(within, 0.0, step * field.contrast_at(points).reshape(9, 8))
            dark[k // parts] |= within & ~behind
        if np.abs(found - expected).max() < 1e-6 * np.abs(expected).max():
            per_layer = parts
            np.testing.assert_array_equal(opaque, dark)
            assert first.any() == inside and dark.any()
    assert per_layer is not None


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.2, 0.1, 1.0), (0.3, -0.2, -1.0)])
@pytest.mark.parametrize("where", ["before", "in", "aside"])
def test_the_path_through_a_box_is_that_of_17_by_17_lines(normal, where: str):
    """From where the first line enters the box to where the last one leaves it, by the planes of its faces."""
    field = uniform_field("volume")
    low, high = field.box
    wave = wave_of(field, normal, (6, 5), 4e-4, -1.1e-3 if where == "in" else 5e-4)
    center = wave.center + (np.array([0.6, 0.0, 0.0]) * (high - low) if where == "aside" else 0.0)
    across, up = ((float(one[0]), float(one[-1])) for one in wave.coordinates)
    begin, end = math.inf, -math.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        for x in np.linspace(*across, 17):
            for y in np.linspace(*up, 17):
                start = center + x * wave.axes[0] + y * wave.axes[1]
                faces = np.sort([(low - start) / wave.normal, (high - start) / wave.normal], axis=0)
                if faces[0].max() < faces[1].min() and faces[1].min() > 0.0:
                    begin, end = min(begin, max(faces[0].max(), 0.0)), max(end, faces[1].min())
    found = span_of(field, center, wave.normal, wave.axes, across, up)
    assert found == pytest.approx((begin, end), rel=1e-9, abs=1e-12)
    if where != "aside":
        assert path_range(field, wave) == found
    with pytest.raises(ValueError, match="does not meet"):
        span_of(field, center + 2.0 * (high - low), wave.normal, wave.axes, across, up)
    with pytest.raises(ValueError, match="does not meet"):
        span_of(field, center + 20.0 * (high - low)[2] * wave.normal, wave.normal, wave.axes, across, up)


def test_how_many_layers_a_path_has():
    """The power of two, or the multiple of the steps, at or above the number of cells; at least two."""
    field = uniform_field("volume")
    cell = float(field.spacing.min())
    for cells, steps, layers in (
        (0.5, None, 2), (1.5, None, 2), (2.5, None, 4), (7.9, None, 8), (8.5, None, 16), (700.0, None, 512),
        (7.5, 3, 9), (8.5, 3, 9), (9.5, 3, 12), (2.5, 7, 7), (700.0, 100, 600),
    ):  # fmt: skip
        assert layer_count(field, cells * cell, steps) == layers
    assert layer_count(field, 700.0 * cell, None, 64) == 64 and layer_count(field, 700.0 * cell, 5, 64) == 65
    check_memory(1 << 19, 1 << 10)
    with pytest.raises(ValueError, match=r"524288 layers of 1025 pixels need 2\.0 GiB"):
        check_memory(1 << 19, (1 << 10) + 1)


@pytest.mark.parametrize("count", [1, 4, 8, 16, 64])
def test_slabs_of_a_slanted_window_are_sums_of_layers(count: int):
    """32 layers for up to 8 slabs, two to a slab and 64 at least for more; each slab less its first line."""
    field = uniform_field("volume")
    wave = wave_of(field, (0.1, -0.2, 1.0), (6, 5))
    look = LookingAlong(wave.center, wave.normal, wave.axes, 5e-4)
    begin, end = 8e-4, 4e-3  # all within the box
    slabs = SlabsOfLayers(field, look, begin, end)
    layers = 32 if count <= 8 else max(64, 2 * count)
    expected = sampled(field, wave, begin, end, layers).reshape(count, -1, 6, 5).sum(axis=1)
    expected -= expected[:, :1, :1]
    x, y = wave.coordinates
    for _ in range(2):
        np.testing.assert_allclose(slabs.paths(x, y, count), expected, atol=1e-6 * np.abs(expected).max())
    assert (slabs.first, slabs.last) == (begin, end) and slabs.opaque(x, y, 4) is None


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
    rim = np.ones(shape, dtype=bool)
    rim[inner] = False
    assert (found[rim] == 0.0).all() and found.dtype == np.float64
    single = bending(paths.astype("f4"), pixel, step, after)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single[inner], gained[inner], atol=2e-5)


def test_many_screens_are_bent_as_few_are():
    """Screens without a phase in between, and a window so large that screens are processed one by one."""
    draw = np.random.default_rng(9)
    paths = 0.01 * draw.normal(size=(6, 8, 9))
    paths[1::2] = 0.0
    fewer = bending(paths[::2], 0.3, 1.0, 0.4)
    more = bending(paths, 0.3, 0.5, 0.15)
    np.testing.assert_allclose(more, fewer, rtol=1e-9)
    tall = np.zeros((3, 4100, 8))
    tall[:, 100:108] = paths[:3, :, :8]
    again = bending(tall, 0.3, 1.0, 0.4)
    part = bending(tall[:, 90:118], 0.3, 1.0, 0.4)
    np.testing.assert_allclose(again[96:112], part[6:22], rtol=1e-9)
