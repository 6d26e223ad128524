"""Statistics of series, number by number: spectra, modes, correlations, the linking equation, errors and trends."""

import math
from itertools import product

import numpy as np
import pytest
from scipy import signal
from scipy.stats import kendalltau

from aerokernels import Disc
from aerokernels.series.linking import _linked_and_path
from aerokernels.series.modes import (
    about_mean,
    first_zero_weights,
    integral_length,
    mean_spectrum,
    orthogonal_modes,
    sample_rate,
    two_point_correlation,
    welch,
)
from aerokernels.series.pupil_grid import MapReader, pupil_grid
from aerokernels.series.statistic_parts import (
    Table,
    _mixing,
    add_correlation,
    add_modes,
    add_spectra,
)
from aerokernels.series.uncertainty import (
    COLUMNS,
    Mean,
    mean_of,
    root_of,
    spread_share,
    standard_errors,
    student_share,
    trend_of,
)

WAVELENGTH = 633e-9


def error_by_hand(values: np.ndarray) -> tuple[float, float]:
    """Standard error of a mean and number of independent samples, by the sums of uncertainty.py one by one."""
    count = len(values)
    orders = range(1, min(count - 1, max(8, round(1.5 * math.sqrt(count)))) + 1)
    size = len(orders)
    sums = [
        math.sqrt(2.0 / count) * sum(x * math.cos(math.pi * j * (t + 0.5) / count) for t, x in enumerate(values))
        for j in orders
    ]
    steps = math.ceil(2.0 * math.log2(10.0 * size * math.pi / 2.0))
    chance, error, independent = [], [], []
    for k in range(steps + 1):
        corner = 2.0 / math.pi * (10.0 * size * math.pi / 2.0) ** (k / steps)
        falls = [1.0 + (j / corner) ** 2 for j in orders]
        total = sum(fall * one**2 for fall, one in zip(falls, sums, strict=True))
        chance.append(math.sqrt(math.prod(falls)) * total ** (-0.5 * size))
        error.append(total / max(size - 2, 1) / count)  # variance of Student's t of `size` degrees of freedom
        independent.append(1.0 + values.var() * count * size / total)
    return math.sqrt(np.average(error, weights=chance)), float(np.average(independent, weights=chance))


@pytest.mark.parametrize("count", [4, 5, 16, 33, 100])
@pytest.mark.parametrize("smooth", [0.0, 0.8, -0.9])
def test_means_of_correlated_samples(count: int, smooth: float):
    draw = np.random.default_rng(count)
    values = draw.normal(size=count)
    for k in range(1, count):
        values[k] += smooth * values[k - 1]
    values += 3.0
    error, independent = error_by_hand(values)
    least = math.sqrt(values.var() / (10.0 * count))  # alternating samples count as ten at most
    found = mean_of(np.append(values, [np.nan, np.inf]))
    assert found.value == pytest.approx(values.mean(), rel=1e-12, abs=0.0)
    assert found.effective_count == pytest.approx(min(independent, 10.0 * count), rel=1e-9, abs=0.0)
    assert found.error == pytest.approx(max(error, least), rel=1e-9, abs=0.0)
    place = np.arange(count)
    slope, start = np.polyfit(place, values, 1)
    left = values - slope * place - start
    more = count / min(error_by_hand(left)[1], 10.0 * count)
    spread = math.sqrt(2.0 * (2.0 * count + 5.0) / (9.0 * count * (count - 1.0)) * max(more, 1.0))
    normal = abs(kendalltau(place, values).statistic) / spread
    assert found.trend == pytest.approx(math.erfc(normal / math.sqrt(2.0)), rel=1e-9, abs=0.0)


def test_means_of_few_samples_and_of_equal_ones():
    assert math.isnan(mean_of([]).value) and mean_of([]).effective_count == 0.0
    for count in (1, 2, 3):
        found = mean_of(np.arange(count) + 1.0)
        assert found.value == 0.5 * (count + 1) and math.isnan(found.error) and math.isnan(found.trend)
        assert found.effective_count == count
    assert mean_of(np.full(9, 2.0)).effective_count == 9.0 and math.isnan(trend_of(np.full(9, 2.0)))
    assert mean_of(np.full(9, 0.1)).error == 0.0
    root = root_of(Mean(4.0, 0.04, 7.0, 0.3))
    assert (root.value, root.error, root.effective_count, root.trend) == (2.0, pytest.approx(0.01, rel=0.02), 7.0, 0.3)
    assert root_of(Mean(0.0, 0.8, 7.0, 0.3)).error == 0.8 and root_of(Mean(-1.0, 0.8, 7.0, 0.3)).value == 0.0
    assert root_of(Mean(4.0, 0.0, 7.0, 0.3)).error == 0.0 and math.isnan(root_of(Mean(4.0, math.nan, 3.0, 0.3)).error)


@pytest.mark.parametrize("freedom", [1.0, 3.0, 20.0, 1e3])
def test_a_variance_of_few_samples_is_often_far_too_small(freedom: float):
    """Two shares hold the variance, and its root, in 95 of 100 draws of chi squared, however few degrees there are."""
    draw = np.random.default_rng(3).chisquare(freedom, 20_000) / freedom
    for power in (1.0, 0.5):
        held = np.mean(np.abs(draw**power - 1.0) <= 2.0 * float(spread_share(freedom, power)) * draw**power)
        assert 0.945 < held < 0.975
    assert float(spread_share(1e12, 0.5)) == pytest.approx(math.sqrt(0.5e-12), rel=1e-9)


def test_rates_of_even_times():
    time = 2.0 + 0.25 * np.arange(16)
    assert sample_rate(time) == pytest.approx(4.0)
    with pytest.raises(ValueError, match="at least 16"):
        sample_rate(time[:15])
    for late, fine in ((0.9e-3, True), (1.1e-3, False)):
        uneven = time.copy()
        uneven[8:] += 0.25 * late * 16 / 15
        if fine:
            assert sample_rate(uneven) == pytest.approx(4.0, rel=1e-3, abs=0.0)
        else:
            with pytest.raises(ValueError, match="even times"):
                sample_rate(uneven)


@pytest.mark.parametrize(
    ("count", "segment", "length"), [(72, None, 16), (40, None, 8), (30, 9, 9), (34, 8, 8), (20, 20, 20)]
)
def test_spectra_are_averaged_periodograms(count: int, segment: int | None, length: int):
    """Hann windows that overlap by half: |sum w x exp|^2 / (rate sum w^2), twice that but at zero and Nyquist's."""
    rate = 5.0
    values = np.random.default_rng(1).normal(size=(count, 2)) + 3.0
    found = welch(values, rate, segment)
    flat = values - values.mean(axis=0)
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(length) / length)
    step = length - length // 2
    starts = range(0, count - length + 1, step)
    lines = length // 2 + 1
    expected = np.zeros((lines, 2))
    for start in starts:
        part = window[:, None] * flat[start : start + length]
        for line in range(lines):
            turned = np.exp(-2j * np.pi * line * np.arange(length) / length) @ part
            twice = 1.0 if line == 0 or 2 * line == length else 2.0
            expected[line] += twice * np.abs(turned) ** 2 / rate / (window @ window) / len(starts)
    np.testing.assert_allclose(found.frequency, rate * np.arange(lines) / length, rtol=1e-12)
    np.testing.assert_allclose(found.density, expected, rtol=1e-9)
    segments = len(starts)
    independent = 18.0 * segments**2 / (19.0 * segments - 1.0) if segments > 1 else 1.0
    assert found.segment_count == pytest.approx(independent)
    ends = np.isin(np.arange(lines), [0, 0.5 * length])
    noise = np.where(ends, spread_share(independent), spread_share(2.0 * independent))[:, None] * expected
    half = length // 2  # the change to segments of half the length is an error of the resolution
    rough, other = signal.welch(flat, rate, "hann", half, half // 2, detrend=False, axis=0)
    change = np.stack([np.interp(found.frequency, rough, one) for one in other.T], axis=1) - expected
    np.testing.assert_allclose(found.error, np.hypot(noise, change), rtol=1e-9)
    for wrong in (7, count + 1):
        with pytest.raises(ValueError, match="a segment"):
            welch(values, rate, wrong)


@pytest.mark.parametrize(("times", "pixels"), [(5, 9), (12, 7), (7, 7)])
def test_modes_are_singular_vectors(times: int, pixels: int):
    """Of the weighted maps about their mean; the greatest entry of a shape is positive."""
    draw = np.random.default_rng(times)
    maps, weight = draw.normal(size=(times, pixels)) + 4.0, draw.uniform(0.2, 1.0, pixels)
    weight /= weight.sum()
    flat = (maps - maps.mean(axis=0)) * np.sqrt(weight)
    left, size, right = np.linalg.svd(flat, full_matrices=False)
    modes = orthogonal_modes(maps, weight, 3)
    assert modes.total == pytest.approx((size**2).sum() / times)
    np.testing.assert_allclose(modes.energy, size[:3] ** 2 / times, rtol=1e-9)
    for k in range(3):
        shape, coefficient = right[k] / np.sqrt(weight), left[:, k] * size[k]
        sign = np.sign(shape[np.abs(shape).argmax()])
        np.testing.assert_allclose(modes.shape[k], sign * shape, atol=1e-9)
        np.testing.assert_allclose(modes.coefficient[:, k], sign * coefficient, atol=1e-9)
    assert len(orthogonal_modes(maps, weight, 99).energy) == min(times - 1, pixels)
    assert len(orthogonal_modes(maps[:1], weight, 5).energy) == 1
    table, coordinates, lit = Table(), {}, np.ones(pixels + 2, dtype=bool)
    lit[[1, 4]] = False
    add_modes(table, coordinates, modes, lit[None])
    share, mixed = _mixing(modes.energy, standard_errors(modes.coefficient**2)[1])
    own = [modes.energy[k] / max(mean_of(modes.coefficient[:, k]).effective_count - 1.0, 1.0) for k in range(3)]
    squares = [math.hypot(mean_of(modes.coefficient[:, k] ** 2).error, share[k] @ mixed[k], own[k]) for k in range(3)]
    np.testing.assert_allclose(table.variables["pod_energy"][1], size[:3] ** 2 / times, rtol=1e-9)
    np.testing.assert_allclose(table.variables["pod_energy_error"][1], squares, rtol=1e-9)
    np.testing.assert_allclose(table.variables["pod_share"][1], size[:3] ** 2 / (size**2).sum(), rtol=1e-9)
    np.testing.assert_allclose(table.variables["pod_share_error"][1], np.array(squares) * times / (size**2).sum())
    mixture = np.sqrt(share**2 @ modes.shape**2)
    np.testing.assert_allclose(table.variables["pod_mode_error"][1][:, lit[None]], mixture, atol=1e-12)
    np.testing.assert_allclose(table.variables["pod_mode"][1][:, lit[None]], modes.shape, atol=1e-12)
    assert np.isnan(table.variables["pod_mode"][1][:, ~lit[None]]).all()
    np.testing.assert_array_equal(coordinates["mode"], [0, 1, 2])
    still = Table()
    add_modes(still, {}, orthogonal_modes(np.ones((times, pixels)), weight, 2), lit[None])
    assert np.isnan(still.variables["pod_share"][1]).all() and (still.variables["pod_energy"][1] == 0.0).all()


def test_a_constant_pixel_has_no_fluctuation_by_rounding():
    maps = np.full((7, 3), 0.1)
    maps[:, 1] += 1e-9 * np.arange(7)
    left = about_mean(maps)
    assert (left[:, [0, 2]] == 0.0).all()
    np.testing.assert_allclose(left[:, 1], 1e-9 * (np.arange(7) - 3.0), rtol=1e-6)


def pairs_by_hand(maps: np.ndarray, lit: np.ndarray) -> np.ndarray:
    """Mean product of two pixels of a pupil by their distance, over maps and pairs."""
    ny, nx = lit.shape
    full = np.full((len(maps), ny, nx), np.nan)
    full[:, lit] = maps
    found = np.full((2 * ny - 1, 2 * nx - 1), np.nan)
    for dy, dx in product(range(1 - ny, ny), range(1 - nx, nx)):
        products = [
            full[:, y, x] * full[:, y + dy, x + dx]
            for y, x in product(range(max(0, -dy), min(ny, ny - dy)), range(max(0, -dx), min(nx, nx - dx)))
            if lit[y, x] and lit[y + dy, x + dx]
        ]
        if products:
            found[dy + ny - 1, dx + nx - 1] = np.mean(products)
    return found


LIT = np.array([[True, True, False, True], [True, True, True, False], [False, True, True, True]])


def test_correlations_of_two_points_are_means_over_pairs():
    maps = np.random.default_rng(3).normal(size=(6, 9)) + 2.0
    np.testing.assert_allclose(
        two_point_correlation(maps, LIT), pairs_by_hand(maps - maps.mean(axis=0), LIT), atol=1e-12
    )
    np.testing.assert_allclose(two_point_correlation(maps, LIT, 0.5), pairs_by_hand(maps - 0.5, LIT), atol=1e-12)


@pytest.mark.parametrize("count", [7, 8, 45])
def test_a_correlation_and_its_lengths_with_their_errors(count: int):
    """Over ten parts of the series or half of its maps; four parts at least give an error."""
    draw = np.random.default_rng(count)
    maps = draw.normal(size=(count, 9)) + 0.8 * draw.normal(size=(count, 1))
    x, y = 1e-3 * np.arange(4), 2e-3 * np.arange(3)
    table, coordinates = Table(), {}
    add_correlation(table, coordinates, maps, LIT, x, y)
    left = maps - maps.mean(axis=0)
    whole = pairs_by_hand(left, LIT)
    power, ratio = whole[2, 3], whole / whole[2, 3]
    np.testing.assert_allclose(table.variables["correlation"][1], ratio, atol=1e-12)
    parts = [pairs_by_hand(part, LIT) for part in np.array_split(left, min(10, count // 2))]
    np.testing.assert_allclose(coordinates["lag_y"], 2e-3 * np.arange(-2, 3), atol=1e-15)
    np.testing.assert_allclose(coordinates["lag_x"], 1e-3 * np.arange(-3, 4), atol=1e-15)
    error = table.variables["correlation_error"][1]
    more = math.nan
    if len(parts) >= 4:
        root = math.sqrt(len(parts))
        by_parts = np.std([part[2, 3] for part in parts], ddof=1) / root
        more = max(1.0, mean_of((left**2).mean(axis=1)).error / by_parts) * student_share(len(parts))
        apart = [(part - ratio * part[2, 3]) / power for part in parts]
        np.testing.assert_allclose(error, more * np.std(apart, axis=0, ddof=1) / root, atol=1e-12)
    else:
        assert np.isnan(error).all()
    for axis, line, pixel in (("y", ratio[2:, 3], 2e-3), ("x", ratio[2, 3:], 1e-3)):
        assert table.variables[f"correlation_length_{axis}"][1] == pytest.approx(integral_length(line, pixel))
        off = table.variables[f"correlation_length_{axis}_error"][1]
        if len(parts) >= 4:
            others = [whole - part / len(parts) for part in parts]
            each = [integral_length(one[2:, 3] if axis == "y" else one[2, 3:], pixel) for one in others]
            assert off == pytest.approx(more * (len(parts) - 1) * np.std(each, ddof=1) / root)
        else:
            assert math.isnan(off)


def test_lengths_up_to_the_first_zero_are_integrals_of_the_line_through_the_entries():
    for line, expected in (
        ([2.0, 1.0, -1.0, 5.0], 0.5 * (2.0 + 1.0) + 0.25),
        ([2.0, 1.0, 0.5], 0.5 * 3.0 + 0.5 * 1.5),
        ([2.0, -2.0], 0.5),
        ([2.0], 0.0),
        ([2.0, 1.0, np.nan, 1.0], 1.5),
        ([2.0, 1.0, 0.5, 0.0, 3.0], 1.5 + 0.75 + 0.25),
    ):
        found = integral_length(np.array(line), 0.1)
        assert found == pytest.approx(0.1 * expected / 2.0, abs=1e-15)
    assert math.isnan(integral_length(np.array([0.0, 1.0]), 0.1))
    np.testing.assert_array_equal(first_zero_weights(np.array([-1.0, 1.0]), 0.1), [0.0, 0.0])


def test_mean_spectra_are_means_of_spectra_however_many_there_are():
    """More columns than are processed together, and as many."""
    rng = np.random.default_rng(5)
    for count in (COLUMNS, 2 * COLUMNS + 7):
        values, weight = rng.normal(size=(40, count)), rng.uniform(size=count)
        found, each = mean_spectrum(values, weight, 3.0, 16), welch(values, 3.0, 16)
        np.testing.assert_allclose(found.density, each.density @ weight, rtol=1e-12)
        np.testing.assert_allclose(found.error, each.error @ weight, rtol=1e-12)
        assert np.array_equal(found.frequency, each.frequency) and found.segment_count == each.segment_count


def test_spectra_of_maps_and_tilts():
    draw = np.random.default_rng(5)
    time = 0.5 * np.arange(40)
    opd, weight, tilts = draw.normal(size=(40, 3)), np.array([0.2, 0.5, 0.3]), draw.normal(size=(40, 2))
    table, coordinates = Table(), {}
    add_spectra(table, coordinates, time, opd, weight, tilts, 12, 8.0, 3.0)
    whole = welch(opd, 2.0, 12)
    np.testing.assert_allclose(table.variables["spectrum_opd"][1], whole.density @ weight, rtol=1e-9)
    np.testing.assert_allclose(table.variables["spectrum_opd_error"][1], whole.error @ weight, rtol=1e-9)
    for k, axis in enumerate("xy"):
        np.testing.assert_allclose(table.variables[f"spectrum_jitter_{axis}"][1], welch(tilts[:, k], 2.0, 12).density)
    np.testing.assert_allclose(coordinates["frequency"], whole.frequency)
    assert coordinates["strouhal"][0] == "frequency"
    np.testing.assert_allclose(coordinates["strouhal"][1], whole.frequency * 3.0 / 8.0)
    without = {}
    add_spectra(Table(), without, time, opd, weight, tilts, 12, None, 3.0)
    assert "strouhal" not in without


@pytest.mark.parametrize("scale", [1.0, 1e-15])
def test_modes_that_mix(scale: float):
    """Whatever the unit of their energies: sqrt(e_k e_j / N) / |e_k - e_j| of each other shape, 1 at most."""
    energy, counts = [4.0, 1.0, 0.9, 0.9], np.array([25.0, 16.0, 9.0, 0.25])
    share, mixed = _mixing(scale * np.array(energy), counts)
    for k, j in product(range(4), range(4)):
        root = math.sqrt(energy[k] * energy[j] / max(counts[k], 1.0))
        assert mixed[k, j] == pytest.approx(scale * root)
        apart = abs(energy[k] - energy[j])
        assert share[k, j] == pytest.approx(0.0 if k == j else min(root / apart, 1.0) if apart else 1.0)


def test_the_linking_equation_by_sums():
    """Sum over planes of the variance times twice its length, one-sided on the longer side; and the double sum."""
    draw = np.random.default_rng(6)
    densities, weights = draw.normal(size=(9, 3, 7)), draw.uniform(0.5, 1.5, (3, 7))
    densities += np.roll(densities, 1, axis=2) + np.roll(densities, 2, axis=2)
    left = densities - densities.mean(axis=0)
    linked = path = 0.0
    for ray in range(3):
        covariance = left[:, ray].T @ left[:, ray] / 9.0
        path += weights[ray] @ covariance @ weights[ray] / 3.0
        for k in range(7):
            lengths = [
                integral_length(side, weights[ray].max())
                for side in (covariance[k, k:], covariance[k, k::-1])
                if len(side) > 1
            ]
            linked += 2.0 * weights[ray, k] * covariance[k, k] * max(lengths) / 3.0
    found = _linked_and_path(densities, weights)
    assert found.shape == (2, 9)
    np.testing.assert_allclose(found.mean(axis=1), [linked, path], rtol=1e-9)


def test_numbers_of_a_map_by_weighted_sums():
    """Piston, tilts, rms with and without, and the Strehl ratio of what is left, with each choice of terms."""
    grid = pupil_grid(Disc(0.02, (1e-3, 2e-3, 3e-3), (0.1, 0.2, 1.0)), 9)
    draw = np.random.default_rng(7)
    xy, weight = grid.coordinates, grid.weight[grid.lit]
    opd = 2e-7 + xy @ [3e-5, -2e-5] + 3e-8 * draw.normal(size=len(xy))
    mean = weight @ opd / weight.sum()
    centred = xy - weight @ xy / weight.sum()
    basis = centred * np.sqrt(weight)[:, None]
    tilt = np.linalg.lstsq(basis, (opd - mean) * np.sqrt(weight), rcond=None)[0]
    level = opd - mean - centred @ tilt
    for remove, left in (
        ((), opd),
        (("piston",), opd - mean),
        (("tilt",), level + mean),
        (("piston", "tilt"), level),
    ):
        found = MapReader(xy, weight, remove, WAVELENGTH)(opd)
        assert found.piston == pytest.approx(mean) and found.tilt == pytest.approx(tilt)
        np.testing.assert_allclose(found.opd, left, atol=1e-17)
        assert found.rms == pytest.approx(math.sqrt(np.average((opd - mean) ** 2, weights=weight)))
        assert found.rms_without_tilt == pytest.approx(math.sqrt(np.average(level**2, weights=weight)))
        phasor = np.average(np.exp(2j * np.pi / WAVELENGTH * left), weights=weight)
        assert found.strehl == pytest.approx(abs(phasor) ** 2)
    middle = grid.points - grid.pupil.center
    np.testing.assert_allclose(middle @ np.array(grid.pupil.axes).T, xy, atol=1e-15)
    np.testing.assert_allclose(middle @ grid.pupil.normal, 0.0, atol=1e-15)
