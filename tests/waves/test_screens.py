"""Two phase screens, the length between them, and the crossing of rays: by brute force and closed forms."""

import math

import numpy as np
import pytest
from scipy.fft import next_fast_len

from aerokernels import Disc, IndexField, Rectangle, Wavefront
from aerokernels.waves.screens import (
    MapPaths,
    _two_screens,
    crossings_of,
    disturbance,
    paths_of,
    places_across,
    spread_along,
    stride_of,
)
from tests.random_fields import uniform_field

WAVELENGTH = 905e-9


def even_distribution(layers: np.ndarray, begin: float, end: float) -> tuple[float, float]:
    """Length of an even distribution with the deviation of the layers' variances, each even over its layer; its end."""
    weight = layers.var(axis=1)
    weight = weight / weight.sum()
    faces = np.linspace(begin, end, len(layers) + 1)
    mean = weight @ (0.5 * (faces[1:] + faces[:-1]))
    thirds = ((faces[1:] - mean) ** 3 - (faces[:-1] - mean) ** 3) / 3.0 / (faces[1:] - faces[:-1])
    length = math.sqrt(12.0 * float(weight @ thirds))
    return length, float(mean) + 0.5 * length


@pytest.mark.parametrize(("begin", "end"), [(0.3, 1.7), (1.7, 0.3), (-0.2, 0.1)])
def test_an_even_distribution_has_the_mean_and_deviation_of_the_layers(begin: float, end: float):
    layers = np.random.default_rng(1).normal(size=(7, 5)) * np.array([1, 3, 0, 2, 5, 0.5, 0.1])[:, None] + 4.0
    found = spread_along(layers, begin, end)
    assert (found.length, found.until) == pytest.approx(even_distribution(layers, begin, end), rel=1e-12, abs=0.0)
    alike = np.arange(5.0)[:, None] * np.ones(4)
    assert spread_along(alike, begin, end).length == spread_along(alike, begin, end).until == 0.0


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("pupil", [Disc(6e-3), Rectangle(2e-3, 8e-3)])
def test_places_across_a_pupil_follow_the_golden_section(pupil, count: int):
    """Number k at the fraction of (k + 1/2) (sqrt 5 - 1) / 2, over the wider of the pupil's sides."""
    half = max(pupil.half_extent)
    expected = [half * (2.0 * math.modf((k + 0.5) * (math.sqrt(5.0) - 1.0) / 2.0)[0] - 1.0) for k in range(count)]
    np.testing.assert_allclose(places_across(pupil, count), expected, rtol=1e-12)


def lines_of(pupil) -> np.ndarray:
    """Starts of the lines through a pupil that light passes, shape (lines, 3)."""
    place = places_across(pupil, 4)
    starts = [
        pupil.center + x * pupil.axes[0] + y * pupil.axes[1]
        for y in place
        for x in place
        if pupil.transmission(np.array([x]), np.array([y]))[0] > 0.0
    ]
    return np.array(starts)


def noisy_air(geometry: str) -> IndexField:
    """Noise over 15 x 13 x 11 cells of unequal sides, off the origin; a radius begins on the axis."""
    shape, spacing, origin = (16, 14, 12), (2e-4, 2.3e-4, 3e-4), (-1.4e-3, -1.2e-3, 5e-4)
    if geometry != "volume":
        shape, spacing, origin = shape[1:], spacing[1:], origin[1:]
    if geometry == "axisymmetric":
        origin = (0.0, origin[1])
    samples = 1e-5 * np.random.default_rng(2).normal(size=shape)
    return IndexField.from_samples(samples, origin=origin, spacing=spacing, geometry=geometry)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("radius", "place"), [(0.6e-3, 0.37), (1.6e-3, 0.37), (0.6e-3, -0.1), (0.6e-3, 1.1)])
def test_the_disturbed_length_along_z_is_that_of_the_nearest_nodes(
    geometry: str, sign: float, radius: float, place: float
):
    """Nodes in front of a slanted pupil in the box, before or behind it; lines beside the box meet no contrast."""
    field = noisy_air(geometry)
    low, high = field.box
    center = (2e-4, 3e-4, float(low[2] + place * (high[2] - low[2])))
    pupil, look = Disc(radius, center, (0.2, -0.3, sign)), np.array([0.0, 0.0, sign])
    grid = field.samples
    z = grid.origin[-1] + grid.spacing[-1] * np.arange(grid.shape[-1])
    ahead = sign * (z - center[2]) >= 0.0
    found = disturbance(field, pupil, look)
    if not ahead.any():
        assert found.length == found.until == 0.0
        return
    columns = []
    for x, y, _ in lines_of(pupil):
        across = {"volume": (x, y), "planar": (y,), "axisymmetric": (math.hypot(x, y),)}[geometry]
        node = [round((p - o) / h) for p, o, h in zip(across, grid.origin, grid.spacing, strict=False)]
        inside = all(0 <= k < n for k, n in zip(node, grid.shape, strict=False))
        columns.append(grid.samples[tuple(node)][ahead] if inside else np.zeros(ahead.sum()))
    # Each node stands for a cell from it on.
    first, last = np.flatnonzero(ahead)[[0, -1]]
    begin, end = (sign * (grid.origin[-1] + grid.spacing[-1] * node - center[2]) for node in (first, last + 1))
    assert len(columns) > 3
    assert (found.length, found.until) == pytest.approx(
        even_distribution(np.array(columns).T, begin, end), rel=1e-9, abs=0.0
    )
    aside = disturbance(field, Disc(1e-4, (0.1, 0.1, center[2]), (0.0, 0.0, sign)), look)
    assert aside.length == aside.until == 0.0


@pytest.mark.parametrize("start", [-1e-3, 1.2e-3])
def test_the_disturbed_length_along_a_slanted_line_is_that_of_layers(start: float):
    """32 layers between where the first line enters the box and the last one leaves it, by corner planes of the box."""
    field = uniform_field("volume")
    low, high = field.box
    look = np.array([0.15, -0.1, 1.0])
    look /= np.linalg.norm(look)
    pupil = Disc(8e-4, (1e-4, 2e-4, float(low[2]) + start), look)
    lines = lines_of(pupil)
    faces = [np.sort([(low - line) / look, (high - line) / look], axis=0) for line in lines]
    spans = [(max(each[0].max(), 0.0), each[1].min()) for each in faces]
    begin, end = min(one for one, _ in spans), max(one for _, one in spans)
    depth = begin + (end - begin) * (np.arange(32) + 0.5) / 32
    layers = np.array([field.contrast_at(lines + one * look) for one in depth])
    found = disturbance(field, pupil, look)
    assert (found.length, found.until) == pytest.approx(even_distribution(layers, begin, end), rel=1e-6, abs=0.0)
    away = Disc(8e-4, (1e-4, 2e-4, float(high[2]) + 1e-3), look)
    assert disturbance(field, away, look).length == disturbance(field, away, look).until == 0.0


def test_pixels_are_as_coarse_as_the_finest_phase_allows():
    """At most 64 across; from there twice as coarse while 32 are left and a half period has 4 of the coarse ones."""
    for count, stride in ((40, 1), (63, 1), (64, 1), (65, 2), (128, 2), (129, 3), (200, 4)):
        assert stride_of(count, 1e-3, 0.0) == stride
    for count, feature, stride in ((64, 8e-3, 2), (64, 7.9e-3, 1), (63, 8e-3, 1), (128, 1.0, 4), (256, 1.0, 8)):
        assert stride_of(count, 1e-3, feature) == stride
    assert stride_of(200, 1e-3, 32e-3) == 4 and stride_of(256, 1e-3, 31e-3) == 4
    assert stride_of(256, 1e-3, 64e-3) == 8 and stride_of(256, 2e-3, 33e-3) == 4


def test_paths_of_a_map_and_their_strehl_ratio():
    """Without the delay of the brightest pixel, float32; rows and columns from the middle of a stride on."""
    draw = np.random.default_rng(3)
    opd, weight = 0.2 * WAVELENGTH * draw.normal(size=(7, 7)), draw.uniform(0.2, 1.0, (7, 7))
    weight[0, :3], weight[4, 5] = 0.0, 1.5
    opd[weight == 0.0] = np.nan
    paths = paths_of(Wavefront(opd, weight, 2e-3, WAVELENGTH))
    np.testing.assert_allclose(paths.path, opd - opd[4, 5], atol=1e-6 * WAVELENGTH)
    assert paths.path.dtype == paths.light.dtype == np.float32
    lit = weight > 0.0
    total = (weight[lit] * np.exp(2j * np.pi * opd[lit] / WAVELENGTH)).sum() / weight.sum()
    assert paths.strehl == pytest.approx(abs(total) ** 2, rel=1e-5, abs=0.0)
    assert paths.whole_light == pytest.approx(weight.sum(), rel=1e-6, abs=0.0)
    assert paths.every(1) is paths
    for stride, kept in ((2, [1, 3, 5]), (3, [1, 4])):
        fewer = paths.every(stride)
        np.testing.assert_array_equal(fewer.path, paths.path[kept][:, kept])
        np.testing.assert_array_equal(fewer.light, paths.light[kept][:, kept])
        assert fewer.pixel == pytest.approx(2e-3 * stride) and fewer.wavelength == WAVELENGTH


@pytest.mark.parametrize("strength", [0.2, 1.0, 6.0])
@pytest.mark.parametrize("column", [False, True])
def test_crossing_and_focusing_by_eigenvalues_of_second_differences(strength: float, column: bool):
    """Rays cross where det(1 + D H) < 0 and focus by the most negative eigenvalue of D H, two pixels from the rim."""
    pixel, distance = 0.7, 6.0
    draw = np.random.default_rng(5)
    shape = (12, 1) if column else (9, 11)
    path = strength * 0.05 * draw.normal(size=shape)
    light = draw.uniform(0.5, 1.0, shape)
    light[3, 0 if column else 4] = 0.0
    path[3, 0 if column else 4] += 0.1 * strength  # a focus without light
    if not column:
        path[4, -2] = np.nan
    whole = crossed = near = greatest = 0.0
    for i in range(2, shape[0] - 2):
        for j in (0,) if column else range(2, shape[1] - 2):
            along_y = (path[i + 2, j] + path[i - 2, j] - 2.0 * path[i, j]) / (2.0 * pixel) ** 2
            hessian = np.array([[along_y]])
            if not column:
                along_x = (path[i, j + 2] + path[i, j - 2] - 2.0 * path[i, j]) / (2.0 * pixel) ** 2
                ends = [path[i + a, j + b] * a * b for a in (-1, 1) for b in (-1, 1)]
                mixed = sum(ends) / (2.0 * pixel) ** 2
                hessian = np.array([[along_y, mixed], [mixed, along_x]])
            if light[i, j] == 0.0 or not np.isfinite(hessian).all():
                continue
            values = distance * np.linalg.eigvalsh(hessian)
            whole += light[i, j]
            crossed += light[i, j] * (np.prod(1.0 + values) < 0.0)
            near += light[i, j] * (-values.min() > 0.5)
            greatest = max(greatest, -values.min())
    found = crossings_of(path, pixel, light, distance)
    assert found.curvature == pytest.approx(greatest, rel=1e-9, abs=0.0)
    assert found.crossed == pytest.approx(crossed / whole, abs=1e-12)
    assert found.near == pytest.approx(near / whole, abs=1e-12)
    assert (found.near > 0.0) == (strength > 0.5) and (found.crossed > 0.0 or strength < 2.0)
    dark = crossings_of(path, pixel, np.zeros(shape), distance)
    assert (dark.crossed, dark.curvature, dark.near) == (0.0, 0.0, 0.0)
    bowl = crossings_of((np.arange(9.0) ** 2)[:, None] * np.ones(9), pixel, np.ones((9, 9)), distance)
    assert (bowl.crossed, bowl.curvature, bowl.near) == (0.0, 0.0, 0.0)  # light that spreads does not focus


@pytest.mark.parametrize("widths", [1.4, 3.2, 12.0])
def test_two_half_screens_with_free_space_between(widths: float):
    """In double precision: half of the phase, Fresnel's factor over L / sqrt 3, half of the phase, by FFTs.

    The window has the pupil's pixels and 2 widths sqrt(lambda L) on a side, 4 pixels or more, half the pupil or less.
    """
    draw = np.random.default_rng(8)
    count, pixel, index = 40, 1e-4, 1.3
    length = (widths * pixel) ** 2 / WAVELENGTH
    place = np.arange(count) - 19.5
    disc = (np.hypot(place, place[:, None]) < 19.5) * draw.uniform(0.6, 1.0, (count, count))
    path = 0.15 * WAVELENGTH * (np.sin(0.7 * place + 0.4 * place[:, None]) + 0.3 * draw.normal(size=(count, count)))
    paths = MapPaths(
        np.where(disc > 0, path + 3.0 * WAVELENGTH, np.nan).astype("f4"), disc.astype("f4"), pixel, WAVELENGTH
    )
    beside = max(4, math.ceil(2.0 * widths))
    size = next_fast_len(count + min(2 * beside, math.ceil(0.5 * count)))
    light, phase = np.zeros((2, size, size))
    light[:count, :count] = disc
    mean = (path * disc).sum() / disc.sum()
    phase[:count, :count] = np.where(disc > 0.0, np.pi / WAVELENGTH * (path - mean), 0.0)
    square = (2.0 * np.pi * np.fft.fftfreq(size, pixel)) ** 2
    turn = length / math.sqrt(3.0) * WAVELENGTH / (4.0 * np.pi * index)
    free = np.exp(-1j * turn * (square[:, None] + square))
    wave = np.fft.ifft2(free * np.fft.fft2(light * np.exp(1j * phase))) * np.exp(1j * phase)
    rays = light * np.exp(2j * phase)
    expected = (abs(wave.sum()) ** 2 - abs(rays.sum()) ** 2) / light.sum() ** 2
    assert abs(expected) > 1e-4
    assert _two_screens(paths, index, length) == pytest.approx(expected, abs=3e-6)


def test_planar_air_along_x_has_no_width():
    """Air that all lines pass alike disturbs nothing."""
    field = IndexField.from_samples(
        np.full((9, 9), 1e-5), origin=(-0.01, 0.0), spacing=(2.5e-3, 2.5e-3), geometry="planar"
    )
    assert disturbance(field, Disc(5e-3, (0.0, 0.0, -1e-3)), np.array([0.0, 0.0, 1.0])).length == 0.0
