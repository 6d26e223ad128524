"""A wave and its rays through given slabs, the window they pass, and their search for fine phases: by brute force."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aerokernels import Annulus, Disc, IndexField, Rectangle
from aerokernels.waves.coarse_wave import (
    _by_traced,
    _finest_of,
    _finest_on,
    _half_window,
    _mean_squares,
    _most_slabs,
    _slabs_length,
    finest_and_squares,
    fresnel_number,
    is_one_column,
)
from aerokernels.waves.diffraction import SlabResult, WaveAndRays, window_of
from aerokernels.waves.screens import Crossings, places_across, spread_along
from aerokernels.waves.shadows import shadow_of
from aerokernels.waves.slabs import FINEST, Slabs

WAVELENGTH = 905e-9
INDEX = 1.2


class Given(Slabs):
    """Slabs of a formula: 64 layers of smooth paths, strongest in the first third, and a wall on one side if asked."""

    most_pixels = 30

    def __init__(self, strength: float = 0.3, first: float = 0.02, last: float = 0.32, wall: float = np.inf):
        self.strength, self.first, self.last, self.wall = strength * WAVELENGTH, first, last, wall

    def layers(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        place = (np.arange(64) + 0.5)[:, None, None] / 64
        along = np.exp(-(((place - 0.3) / 0.2) ** 2))
        wave = np.sin(3e3 * x + 4.0 * place) * np.cos(2e3 * y[:, None] - place) + 0.5 * np.cos(5e3 * y[:, None] + place)
        return self.strength / 20.0 * along * wave

    def paths(self, x, y, count):
        return self.layers(x, y).reshape(count, -1, len(y), len(x)).sum(axis=1).astype(np.float32)

    def opaque(self, x, y, count):
        if np.isinf(self.wall):
            return None
        ends = np.broadcast_to(x > self.wall, (64, len(y), len(x))) & (np.arange(64) > 20)[:, None, None]
        return ends.reshape(count, -1, len(y), len(x)).any(axis=1)


def wave_sum(given: WaveAndRays, count: int) -> complex:
    """Sum of the amplitude behind `count` screens over the rays' initial one, in double precision."""
    window, slabs = given.window, given.slabs
    shape = window.amplitude.shape
    step = (slabs.last - slabs.first) / count
    fy, fx = (2.0 * np.pi * np.fft.fftfreq(n, window.pixel) for n in shape)
    square = fy[:, None] ** 2 + (fx**2 if shape[1] > 1 else 0.0)
    free = lambda z: np.exp(-1j * z * given.wavelength / (4.0 * np.pi * given.ambient_index) * square)  # noqa: E731
    wave = window.amplitude.astype(complex)
    opaque = slabs.opaque(window.x, window.y, count)
    for number, path in enumerate(slabs.paths(window.x, window.y, count).astype(float)):
        wave = np.fft.ifft2(np.fft.fft2(wave) * free(given.before + 0.5 * step if number == 0 else step))
        wave *= np.exp(2j * np.pi / given.wavelength * path)
        if opaque is not None:
            wave[opaque[number]] = 0.0
    return complex(wave.sum()) / float(given.light.sum())


def straight_strehl(given: WaveAndRays) -> float:
    path = given.slabs.paths(given.window.x, given.window.y, 1)[0].astype(float)
    total = (given.light * np.exp(2j * np.pi / given.wavelength * path)).sum()
    return float(abs(total) / given.light.sum()) ** 2


def comparison(slabs: Slabs, one_column: bool = False, **options) -> WaveAndRays:
    window = window_of(Annulus(2e-3, 0.4e-3), 3e-3, 48, one_column)
    light = shadow_of(slabs, window, WAVELENGTH, 0.5)[1]
    return WaveAndRays(window, slabs, light, 0.07, 0.11, WAVELENGTH, INDEX, straight=True, **options)


@pytest.mark.parametrize("one_column", [False, True])
def test_a_wave_through_slabs_is_free_space_and_thin_screens(one_column: bool):
    """One slab, two and more, beside straight rays: complex sums in double precision by plain transforms."""
    given = comparison(Given(0.15), one_column)
    results = [*given._first_two(), given._result(4), given._result(16)]
    for count, found in zip((1, 2, 4, 16), results, strict=True):
        expected = wave_sum(given, count)
        assert abs(found.wave - expected) < 3e-5
        assert found.change == pytest.approx(abs(expected) ** 2 - straight_strehl(given), abs=5e-5)
        assert found.apart == 0.0
    assert abs(results[0].change) > 1e-3
    again = given._result(2)
    assert abs(again.wave - results[1].wave) < 1e-6


def test_traced_rays_replace_those_of_the_slabs_or_tell_how_far_apart_they_are():
    given = comparison(Given(0.15))
    rays = straight_strehl(given)
    for found in (replace(given, traced=0.6)._result(4), replace(given, traced=0.6)._first_two()[0]):
        assert found.apart == pytest.approx(abs(rays - 0.6), abs=3e-5)
        assert found.change == pytest.approx(abs(found.wave) ** 2 - rays, abs=3e-5)
    instead = replace(given, traced=0.6, by_traced=True)._result(4)
    assert instead.apart == 0.0 and instead.change == pytest.approx(abs(instead.wave) ** 2 - 0.6, abs=1e-6)


def test_light_that_a_wall_stops_is_dark_in_its_slab():
    """All slabs are used, and the error is not known."""
    given = comparison(Given(0.3, wall=0.6e-3))
    assert 0.0 < given.light.sum() < given.window.amplitude.sum()
    change, error = given.change(0.01)
    assert change == pytest.approx(abs(wave_sum(given, FINEST)) ** 2 - straight_strehl(given), abs=1e-4)
    assert math.isnan(error)
    assert not math.isnan(comparison(Given(0.3, wall=1.0)).change(0.01)[1])


@pytest.mark.parametrize("strength", [0.02, 0.1, 0.3, 0.8])
@pytest.mark.parametrize("limit", [1e-4, 1e-3, 0.01, 0.1])
@pytest.mark.parametrize("traced", [None, 0.5])
def test_slabs_are_doubled_until_the_change_is_known_well_enough(strength: float, limit: float, traced: float | None):
    """Halving moves it by 5 % of the limit at most or half of its distance from it; below 4 slabs it must be small."""
    given = comparison(Given(strength), traced=traced, most_slabs=16)
    rays, most = straight_strehl(given), 16
    apart = 0.0 if traced is None else abs(rays - traced)
    change = {count: abs(wave_sum(given, count)) ** 2 - rays for count in (1, 2, 4, 8, 16)}
    for count in (2, 4, 8, 16):
        moved = abs(change[count] - change[count // 2])
        doubt = max(moved, apart)
        settled = doubt <= max(0.05 * limit, 0.5 * abs(abs(change[count]) - limit))
        if count == 2 and abs(change[2]) > 0.25 * limit:
            continue
        if settled or count == most or (count >= 4 and moved <= 0.05 * limit):
            break
    # Bent rays of one screen alone are straight ones; here the rays are straight, and their error is not known.
    found, error = given.change(limit)
    assert found == pytest.approx(change[count], abs=5e-5) and error == math.inf
    bent = replace(given, straight=False, by_traced=traced is not None)
    assert (bent.change(limit)[1] < math.inf) and bent.change(limit)[1] >= 0.0


def test_doubt_of_a_wave_alone_counts_its_phase():
    one, other = SlabResult(0.6 + 0.3j, 0.05, 0.0), SlabResult(0.3 + 0.6j, 0.02, 0.0)
    assert one.doubt(other, False) == pytest.approx(0.03)
    assert one.doubt(other, True) == pytest.approx(math.sqrt(0.18) * 2.0 * math.sqrt(0.45))


@pytest.mark.parametrize("pupil", [Rectangle(3e-3, 1.6e-3), Disc(2e-3), Annulus(2.2e-3, 1e-3)])
@pytest.mark.parametrize("count", [24, 25])
def test_a_window_holds_the_pupils_light(pupil, count: int):
    """Pixels about half a pixel off the middle, all the light of the pupil, and two pixels about it."""
    half = 3e-3
    window = window_of(pupil, half, count)
    pixel = 2.0 * half / count
    assert window.pixel == pytest.approx(pixel) and window.width == pytest.approx(pixel)
    np.testing.assert_allclose(window.x, pixel * (np.arange(count) - count // 2), atol=1e-15)
    np.testing.assert_array_equal(window.x, window.y)
    edges = np.append(window.x - 0.5 * pixel, window.x[-1] + 0.5 * pixel)
    cover = pupil.coverage(edges, edges)
    np.testing.assert_allclose(window.amplitude, cover, atol=1e-6)
    lit = [np.flatnonzero(np.abs(window.x) <= extent + 0.5 * pixel) for extent in pupil.half_extent]
    for part, places in zip(window.near, lit[::-1], strict=True):
        assert part == slice(max(places[0] - 2, 0), places[-1] + 3) or window.amplitude[part].sum() > 0.0
    assert window.amplitude[window.near].sum() == pytest.approx(window.amplitude.sum())
    column = window_of(pupil, half, count, True)
    assert column.amplitude.shape == (count, 1) and column.x.tolist() == [0.0]
    assert column.width == pytest.approx(2.0 * half) and column.pixel == pytest.approx(pixel)
    whole = pupil.coverage(edges[[0, -1]], edges)
    np.testing.assert_allclose(column.amplitude, whole, atol=1e-6)


def test_the_finest_phase_of_lines_by_second_differences():
    """At strides of 1, 2, 4 ..: the first at which the differences' amplitude, a quarter of them, is twice 0.03 rad."""
    draw = np.random.default_rng(4)
    count, pixel = 41, 0.3
    for wave in (2.0, 5.0, 9.0, 17.0):
        lines = np.sin(2.0 * np.pi * (np.arange(count) / wave + draw.uniform(size=(2, 3, 1))))
        lines[0, 1, 5:8] = np.nan
        for size in (0.001, 0.02, 0.05, 0.3):
            path = size * WAVELENGTH / 2.0 / np.pi * lines
            expected, square = math.inf, 0.0
            for stride in (1, 2, 4, 8, 16):
                some = path[..., :: max(1, stride // 2)]
                apart = stride // max(1, stride // 2)
                second = some[..., 2 * apart :] + some[..., : -2 * apart] - 2.0 * some[..., apart:-apart]
                square = sum(float(np.nanmean(one**2)) for one in second)
                assert _mean_squares(some, apart) == pytest.approx(square, rel=1e-9, abs=0.0)
                if 2.0 * math.pi / WAVELENGTH * math.sqrt(square / 8.0) > 0.06:
                    expected = stride * pixel
                    break
            found = _finest_on(path, pixel, WAVELENGTH)
            assert found[0] == pytest.approx(expected) and found[1] == pytest.approx(square, rel=1e-9, abs=0.0)
    one = _finest_on(np.zeros((1, 1, 3)), pixel, WAVELENGTH)
    assert one == (math.inf, 0.0)


def test_the_finest_phase_of_a_map_is_that_of_some_rows_and_columns():
    path = WAVELENGTH * np.random.default_rng(7).normal(size=(35, 35))
    for given, expected in (
        (path, np.array([path.T[::2], path[::2]])),
        (path[:, :7], np.array([path[:, :7].T[::2]])),
        (path[:, :1], np.array([path[:, :1].T])),
    ):
        found, lines = finest_and_squares(given, 0.1, WAVELENGTH), _finest_on(expected, 0.1, WAVELENGTH)
        assert found == lines and found[0] == 0.1


def test_the_half_width_of_a_window():
    """1.15 pupils and two widths sqrt(lambda L) beside them, 4 pupils at most; what it must hold at least."""
    reach = 5e-3
    assert _half_window(reach, 1e-6, 0.0, 0.0) == pytest.approx(1.15 * reach)
    assert _half_window(reach, 1e-6, 0.25, 0.0) == pytest.approx(1.15 * reach + 1e-3)
    assert _half_window(reach, 1e-6, 1e4, 0.0) == pytest.approx(4.0 * reach)
    assert _half_window(reach, 1e-6, 0.25, 7e-3) == pytest.approx(12e-3)
    assert fresnel_number(2e-3, 1e-6, 0.5) == pytest.approx(8.0) and fresnel_number(1.0, 1.0, 0.0) == math.inf


def test_waves_that_nobody_asked_for_have_few_samples():
    """16 slabs, and fewer where all of them together have more than 300,000 pixels."""
    for pixels, slabs in ((64, 16), (136, 16), (137, 8), (193, 8), (194, 4)):
        assert _most_slabs(replace(window_of(Disc(1.0), 2.0, 8), amplitude=np.zeros((pixels, pixels)))) == slabs


def test_when_a_wave_is_compared_with_traced_rays():
    """Where rays cross; or near foci, if the finest phase has four pixels of the map."""
    for crossed, near, feature, by in (
        (0.1, 0.0, 1.0, True),
        (0.0, 0.02, 4.0, True),
        (0.0, 0.02, 3.9, False),
        (0.0, 0.01, 9.0, False),
        (0.0, 0.0, 9.0, False),
    ):
        assert _by_traced(Crossings(crossed, 1.0, near), feature, 1.0) is by


def test_one_column_is_enough_for_planar_air_seen_across_its_axis():
    samples = np.random.default_rng(1).normal(size=(9, 9)) * 1e-6
    for geometry, normal, flat in (
        ("planar", (0.0, 0.3, 1.0), True),
        ("planar", (0.1, 0.0, 1.0), False),
        ("axisymmetric", (0.0, 0.0, 1.0), False),
    ):
        field = IndexField.from_samples(samples, origin=(0.0, 0.0), spacing=(1e-3, 1e-3), geometry=geometry)
        assert is_one_column(field, np.array(normal)) is flat


@pytest.mark.parametrize("flat", [False, True])
@pytest.mark.parametrize("wall", [np.inf, 0.7e-3])
def test_lines_through_slabs_find_the_finest_phase_and_the_disturbed_length(flat: bool, wall: float):
    """Rows and columns of two thirds of the most pixels; 16 places each way, those in the light and free of a wall."""
    slabs, pupil = Given(2.0, wall=wall), Rectangle(4e-3, 3e-3)
    place = places_across(pupil, 16)
    across = np.zeros(1) if flat else place
    x, y = np.meshgrid(across, place)
    lit = np.abs(y) <= 1.5e-3
    if not flat:
        lit &= np.abs(x) <= 2e-3
    lit &= ~(x > wall)
    expected = spread_along(slabs.paths(across, place, 64)[:, lit], slabs.first, slabs.last).length
    assert _slabs_length(slabs, pupil, flat) == pytest.approx(expected, rel=1e-6, abs=0.0)
    count = 512 if flat else 20
    pixel = 4e-3 / count
    place = pixel * (np.arange(count) - count // 2)
    some = np.zeros(1) if flat else place[:: max(1, count // 16)]
    columns = slabs.paths(some, place, 1)[0]
    columns[np.abs(place) > 1.5e-3] = np.nan
    columns[:, some > wall] = np.nan
    lines = [columns.T]
    if not flat:
        rows = slabs.paths(place, some, 1)[0]
        rows[np.abs(some) > 1.5e-3] = np.nan
        rows[:, place > wall] = np.nan
        lines.append(rows)
    for wavelength in (WAVELENGTH, 8.0 * WAVELENGTH):
        found = _finest_of(slabs, pupil, flat, wavelength)
        assert found == _finest_on(np.stack(lines), pixel, wavelength)[0] < math.inf


def test_the_disturbed_length_behind_a_wall_is_that_of_all_lines():
    """Where no line is free of the wall the wall is left out of account."""
    pupil = Disc(2e-3)
    hidden, free = (_slabs_length(Given(2.0, wall=wall), pupil, False) for wall in (-1.0, np.inf))
    assert hidden == free > 0.0


def test_a_shadow_is_measured_by_its_light():
    """Share of the squared amplitude that a wall takes, and the Fresnel number of the area that is left."""
    slabs = Given(0.3, first=0.1, last=0.74, wall=0.5e-3)
    window = window_of(Disc(2e-3), 3e-3, 40)
    shadow, light = shadow_of(slabs, window, WAVELENGTH, 0.9)
    dark = window.x > 0.5e-3
    np.testing.assert_array_equal(light, np.where(dark, 0.0, window.amplitude))
    kept = window.amplitude[:, ~dark]
    assert shadow.blocked == pytest.approx(1.0 - (kept**2).sum() / (window.amplitude**2).sum(), rel=1e-5, abs=0.0)
    area = kept.sum() * window.pixel**2
    assert shadow.fresnel_number == pytest.approx(area / (math.pi * WAVELENGTH * (0.9 - 0.31)), rel=1e-5, abs=0.0)
    beside, light = shadow_of(Given(wall=1.0), window, WAVELENGTH, 0.9)
    assert (beside.blocked, beside.fresnel_number) == (0.0, math.inf) and light.sum() == window.amplitude.sum()
    with pytest.raises(ValueError, match="blocks all"):
        shadow_of(Given(wall=-1.0), window, WAVELENGTH, 0.9)
