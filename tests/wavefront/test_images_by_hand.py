"""Images of wavefronts by plain sums: point spread functions, transfer functions, encircled energy, widths."""

import math

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from aerokernels import Wavefront
from aerokernels.wavefront import point_spread_function
from aerokernels.wavefront.modes import centroid, structure_function
from aerokernels.wavefront.point_spread import PointSpread, far_field, steady_product
from aerokernels.wavefront.polychromatic import mixed_weights, polychromatic_psf
from aerokernels.wavefront.transfer import EncircledEnergy, Transfer, autocorrelation, encircled, sensitivity

WAVELENGTH, PIXEL = 633e-9, 2.5e-4


def uneven(count: int = 7, seed: int = 1, scale: float = 0.08) -> Wavefront:
    """Noise over a square with uneven weights, dark corners, and more intensity than the weights' squares."""
    draw = np.random.default_rng(seed)
    weight = draw.uniform(0.3, 1.0, (count, count))
    weight[0, 0] = weight[-1, -2] = weight[2, 0] = 0.0
    opd = scale * WAVELENGTH * draw.normal(size=(count, count))
    return Wavefront(opd, weight, PIXEL, WAVELENGTH, intensity=1.1 * weight**2)


def amplitude(wave: Wavefront, ax: float, ay: float) -> complex:
    """Sum of the field over the pixels toward an angle, over the sum of the weights."""
    total = 0j
    for row, column in zip(*np.nonzero(wave.weight), strict=True):
        phase = wave.opd[row, column] - ax * wave.coordinate[column] - ay * wave.coordinate[row]
        total += wave.weight[row, column] * np.exp(2j * np.pi / WAVELENGTH * phase)
    return total / wave.weight.sum()


@pytest.mark.parametrize("count", [6, 7])
def test_a_point_spread_function_is_a_sum_over_pixels(count: int):
    wave = uneven(count)
    angle = np.array([-3e-4, 0.0, 1.1e-4, 5e-4])
    found = wave.psf(angle)
    expected = [[abs(amplitude(wave, ax, ay)) ** 2 for ax in angle] for ay in angle]
    np.testing.assert_allclose(found.intensity, expected, rtol=1e-9)
    for padding in (1, 3):
        whole = wave.psf(padding=padding)
        step = WAVELENGTH / (PIXEL * count * padding)
        first = -((count * padding) // 2)
        np.testing.assert_allclose(whole.angle, step * (first + np.arange(count * padding)), rtol=1e-12, atol=1e-18)
        for row, column in ((0, 1), (2, 4), (count * padding - 1, 3)):
            one = abs(amplitude(wave, whole.angle[column], whole.angle[row])) ** 2
            assert whole.intensity[row, column] == pytest.approx(one, rel=1e-9, abs=0.0)
        half = 2.5 * step
        part = wave.psf(padding=padding, half_width=half)
        kept = np.abs(whole.angle) <= half
        np.testing.assert_allclose(part.angle, whole.angle[kept])
        np.testing.assert_allclose(part.intensity, whole.intensity[kept][:, kept], rtol=1e-9)
    plain = point_spread_function(wave.opd, wave.weight, PIXEL, WAVELENGTH, angle=angle)
    np.testing.assert_array_equal(plain.intensity, found.intensity)
    assert whole.peak == whole.intensity.max()


def test_pixels_and_paddings_that_are_none():
    wave = uneven()
    for pixel, padding in ((-1.0, 8), (math.inf, 8), (math.nan, 8), (0.0, 8), (PIXEL, 0)):
        with pytest.raises(ValueError, match="pixel and padding must be positive"):
            point_spread_function(wave.opd, wave.weight, pixel, WAVELENGTH, padding=padding)
    with pytest.raises(ValueError, match="half_width"):
        point_spread_function(wave.opd, wave.weight, PIXEL, WAVELENGTH, half_width=-1e-9)
    assert point_spread_function(wave.opd, wave.weight, PIXEL, WAVELENGTH, half_width=0.0).angle.tolist() == [0.0]
    for bad in (-wave.weight, np.where(wave.weight > 0.9, np.nan, wave.weight), 0.0 * wave.weight):
        with pytest.raises(ValueError, match="mask must be|pupil must not"):  # noqa: RUF043
            point_spread_function(wave.opd, bad, PIXEL, WAVELENGTH)


def test_products_of_matrices_in_blocks():
    draw = np.random.default_rng(2)
    left, right = draw.normal(size=(70, 45)) + 1j * draw.normal(size=(70, 45)), draw.normal(size=(45, 33))
    np.testing.assert_allclose(steady_product(left, right), left @ right, atol=1e-12)
    wave, x, y = draw.normal(size=(3, 5)) + 0j, PIXEL * np.arange(5.0), PIXEL * np.arange(3.0)
    angle = np.array([1e-4, -3e-4])
    found = far_field(wave, (x, y), angle, WAVELENGTH)
    for i, j in np.ndindex(2, 2):
        turned = np.exp(-2j * np.pi / WAVELENGTH * (angle[j] * x + angle[i] * y[:, None]))
        assert found[i, j] == pytest.approx((wave * turned).sum(), rel=1e-9, abs=0.0)


def test_the_width_of_a_spot_is_that_of_a_circle_of_its_area():
    """An ellipse a by b above half, without a hole of radius c in it; NaN where half of the peak reaches the edge."""
    angle = 1e-6 * np.linspace(-50.0, 50.0, 201)
    a, b, c = 3e-5, 2e-5, 8e-6
    x, y = np.meshgrid(angle, angle)
    ellipse = 1.0 - 0.5 * ((x / a) ** 2 + (y / b) ** 2)
    found = PointSpread(0.7 * np.clip(ellipse, 0.0, 1.0), angle)
    assert found.fwhm == pytest.approx(2.0 * math.sqrt(a * b), rel=2e-3, abs=0.0)
    ring = np.clip(ellipse, 0.0, 1.0)
    ring = np.minimum(ring, 0.5 * (np.hypot(x, y) / c) ** 2)
    holed = PointSpread(ring / ring.max(), angle)
    area = math.pi * (a * b * (2.0 - ring.max()) - c**2 * ring.max())
    assert holed.fwhm == pytest.approx(2.0 * math.sqrt(area / math.pi), rel=5e-3, abs=0.0)
    for edge in ((0, 100), (-1, 100), (100, 0), (100, -1)):
        wide = 0.7 * np.clip(ellipse, 0.0, 1.0)
        wide[edge] = 0.36
        assert math.isnan(PointSpread(wide, angle).fwhm)


def transfer_by_hand(wave: Wavefront, power: float) -> np.ndarray:
    """Sum of the field times its shifted conjugate over the power, for every shift; 1 without shift."""
    n = len(wave.opd)
    field = np.where(wave.lit, wave.weight * np.exp(2j * np.pi / WAVELENGTH * np.nan_to_num(wave.opd)), 0.0)
    found = np.zeros((2 * n - 1, 2 * n - 1), dtype=complex)
    for dy, dx in np.ndindex(2 * n - 1, 2 * n - 1):
        for row, column in np.ndindex(n, n):
            i, j = row + dy - n + 1, column + dx - n + 1
            if 0 <= i < n and 0 <= j < n:
                found[dy, dx] += field[row, column] * np.conj(field[i, j]) / power
    found[n - 1, n - 1] = 1.0
    return found


@pytest.mark.parametrize("count", [5, 6])
def test_transfer_functions_are_correlations_of_the_field(count: int):
    wave = uneven(count)
    power = 1.1 * (wave.weight**2).sum()
    found = wave.otf()
    value = transfer_by_hand(wave, power)
    np.testing.assert_allclose(found.value, value, atol=1e-12)
    flat = Wavefront(np.zeros(wave.opd.shape), wave.weight, PIXEL, WAVELENGTH)
    perfect = np.abs(transfer_by_hand(flat, power))
    np.testing.assert_allclose(found.perfect, perfect, atol=1e-12)
    np.testing.assert_allclose(found.frequency, PIXEL / WAVELENGTH * np.arange(1 - count, count), rtol=1e-12)
    np.testing.assert_allclose(wave.mtf().value, np.abs(value), atol=1e-12)
    # Lines through the middle, between the samples too.
    frequency, line = found.along()
    np.testing.assert_allclose(frequency, found.frequency[count - 1 :])
    np.testing.assert_allclose(line, found.value[count - 1, count - 1 :], atol=1e-12)
    np.testing.assert_allclose(found.along(0.5 * math.pi)[1], found.value[count - 1 :, count - 1], atol=1e-12)
    step = found.frequency[1] - found.frequency[0]
    _, slanted = found.along(math.atan2(0.3, 0.8))
    up, right = (np.array([0.3, 0.8]) / math.hypot(0.3, 0.8) * frequency[1] / step).tolist()
    i = j = count - 1
    corners = found.value[i : i + 2, j : j + 2]
    expected = np.array([1.0 - up, up]) @ corners @ np.array([1.0 - right, right])
    assert slanted[1] == pytest.approx(expected, rel=1e-9, abs=0.0)
    other = np.random.default_rng(4).normal(size=(count, count))
    mixed = autocorrelation(np.asarray(wave.weight, dtype=complex), other + 0j)
    for dy, dx in ((0, 0), (2, 4), (count - 1, count)):
        direct = sum(
            wave.weight[r, c] * other[r + dy - count + 1, c + dx - count + 1]
            for r, c in np.ndindex(count, count)
            if 0 <= r + dy - count + 1 < count and 0 <= c + dx - count + 1 < count
        )
        assert mixed[dy, dx] == pytest.approx(direct, abs=1e-12)
    # The point source sensitivity, with air and without: air is integrated, here by 21 points per spacing and axis,
    # over what lines join between the frequencies.
    assert wave.pssn() == pytest.approx((np.abs(value) ** 2).sum() / (perfect**2).sum(), rel=1e-9, abs=0.0)
    place = np.arange(1 - count, count)
    fine = np.linspace(1 - count, count - 1, 21 * (2 * count - 2) + 1)
    apart = PIXEL * np.hypot(fine[:, None], fine)
    for fried in (2e-3, 4e-4):
        air = np.exp(-6.88 * (apart / fried) ** (5.0 / 3.0))
        top, below = (
            (RegularGridInterpolator((place, place), one**2)(np.stack(np.meshgrid(fine, fine), axis=-1)) * air).sum()
            for one in (np.abs(value.T), perfect.T)
        )
        assert sensitivity(found, WAVELENGTH, fried, False)(found.value) == pytest.approx(
            top / below, rel=5e-3, abs=0.0
        )


@pytest.mark.parametrize("center", [(0.0, 0.0), (2e-4, -3e-4)])
def test_encircled_energy_is_the_integral_of_the_pixels_point_spread_function(center):
    """Over a circle in one period of the transform, by many points of it; all light is within a period."""
    wave = uneven(5, 3, 0.15)
    period = WAVELENGTH / PIXEL
    count = 601
    edge = period * ((np.arange(count) + 0.5) / count - 0.5)
    # The intensity about the centre: the transform at angles shifted by it.
    x, y = wave.coordinate, wave.coordinate[:, None]
    field = wave.weight * np.exp(2j * np.pi / WAVELENGTH * (np.nan_to_num(wave.opd) - center[0] * x - center[1] * y))
    light = np.abs(far_field(field, (wave.coordinate, wave.coordinate), edge, WAVELENGTH)) ** 2
    # A pixel's power exceeds its squared amplitude here: what does so is spread evenly over the period.
    power = wave.power * count**2
    rest = (1.1 - 1.0) * (wave.weight**2).sum() / power * np.ones(light.shape)
    light = light / power + rest
    assert light.sum() == pytest.approx(1.0, rel=1e-9, abs=0.0)
    radius = np.hypot(edge, edge[:, None])
    angles = period * np.array([[0.0, 0.07, 0.2], [0.45, 0.5, 0.55], [0.65, 0.71, 0.8]])
    found = wave.encircled_energy(angles, center=center)
    expected = [[light[radius <= one].sum() for one in row] for row in angles]
    np.testing.assert_allclose(found.energy, expected, atol=2e-3)
    assert found.energy[2, 2] == found.energy[2, 1] == 1.0
    np.testing.assert_array_equal(found.center, center)
    np.testing.assert_allclose(encircled(wave.otf(), angles, np.array(center)), found.energy)
    with pytest.raises(ValueError, match="one pixel"):
        encircled(Transfer(np.ones((1, 1)), np.zeros(1), np.ones((1, 1))), angles, np.zeros(2))


def test_the_radius_that_encircles_a_share():
    """Between the given angles, in whatever order they are; NaN beyond them."""
    found = EncircledEnergy(np.array([3.0, 1.0, 2.0]), np.array([0.9, 0.2, 0.5]), np.zeros(2))
    assert found.radius(0.35) == pytest.approx(1.5) and found.radius(0.7) == pytest.approx(2.5)
    assert math.isnan(found.radius(0.1)) and math.isnan(found.radius(0.95))
    assert np.isnan(found.error).all() and float(EncircledEnergy(np.array(1.0), np.array(0.5), np.zeros(2))) == 0.5


def test_the_angles_of_encircled_energy_that_are_not_given():
    """65 angles up to eight times wavelength over width, about the centroid."""
    wave = uneven()
    found = wave.encircled_energy()
    np.testing.assert_allclose(found.angle, np.linspace(0.0, 8.0 * WAVELENGTH / (7 * PIXEL), 65))
    np.testing.assert_allclose(found.center, wave.centroid)


def test_light_of_several_wavelengths_is_their_mean_by_peaks():
    """Each weighs as its share over the squared wavelength; angles up to half a period of the shortest one."""
    wave, lengths, shares = uneven(), np.array([5e-7, 8e-7, 6e-7]), np.array([1.0, 3.0, 2.0])
    weight = shares / lengths**2 / (shares / lengths**2).sum()
    np.testing.assert_allclose(mixed_weights(lengths, shares), weight)
    for options in ({"angle": np.array([-2e-4, 0.0, 3e-4])}, {"padding": 2}, {"half_width": 1.01e-3, "padding": 3}):
        found = polychromatic_psf(wave, lengths, shares, **options)
        expected = sum(
            w * wave.at_wavelength(one).psf(found.angle).intensity for w, one in zip(weight, lengths, strict=True)
        )
        np.testing.assert_allclose(found.intensity, expected, rtol=1e-9)
    reach = 0.5 * 5e-7 / PIXEL
    np.testing.assert_allclose(polychromatic_psf(wave, lengths, None, padding=2).angle, reach / 7 * np.arange(-7, 8))
    steps = math.ceil(1.01e-3 * 7 * PIXEL * 3 / 5e-7)
    np.testing.assert_allclose(found.angle, 1.01e-3 / steps * np.arange(-steps, steps + 1))
    single = polychromatic_psf(wave, lengths, None, half_width=0.0)
    np.testing.assert_array_equal(single.angle, [0.0])
    assert len(polychromatic_psf(wave, lengths, None, half_width=0.1 * reach, padding=2).angle) == 3
    with pytest.raises(ValueError, match="angles along a side"):
        polychromatic_psf(wave, lengths, None, half_width=2050 * 5e-7 / (7 * PIXEL), padding=1)
    with pytest.raises(ValueError, match="padding"):
        polychromatic_psf(wave, lengths, None, padding=0)


def test_the_centroid_of_a_parabola_is_its_mean_slope():
    """Weighted by the intensity, over the pixels that have a neighbour along the axis."""
    draw = np.random.default_rng(6)
    n = 8
    place = PIXEL * (np.arange(n) - 3.5)
    x, y = place, place[:, None]
    opd = 2e-4 * x + 3e-4 * y + 0.1 * x**2 - 0.3 * y**2 + 0.2 * x * y
    weight = draw.uniform(0.4, 1.0, (n, n))
    weight[0, 0] = 0.0
    wave = Wavefront(opd, weight, PIXEL, WAVELENGTH, intensity=1.3 * weight**2)
    share = weight**2 / (weight**2).sum()
    along_x, along_y = 2e-4 + 0.2 * x + 0.2 * y, 3e-4 - 0.6 * y + 0.2 * x
    np.testing.assert_allclose(centroid(wave), [(share * along_x).sum(), (share * along_y).sum()], rtol=1e-9)
    alone = np.zeros((n, n))
    alone[2, 2:6], alone[6, 6] = (0.5, 1.0, 0.7, 0.6), 1.0
    line = Wavefront(opd, alone, PIXEL, WAVELENGTH)
    share = alone[2, 2:6] ** 2 / (alone[2, 2:6] ** 2).sum()
    assert centroid(line)[0] == pytest.approx(share @ (2e-4 + 0.2 * x[2:6] + 0.2 * place[2]), rel=1e-9, abs=0.0)
    assert math.isnan(centroid(line)[1])


def test_the_structure_function_over_rings_of_pairs():
    """Weighted mean square difference of all pairs whose distance rounds to a number of pixels, and its error."""
    wave = uneven(6, 9)
    rows, columns = np.nonzero(wave.weight)
    rings: dict[int, list[tuple[float, float, float]]] = {}
    for i in range(len(rows)):
        for j in range(len(rows)):
            if i != j:
                distance = math.hypot(rows[i] - rows[j], columns[i] - columns[j])
                pair = wave.weight[rows[i], columns[i]] * wave.weight[rows[j], columns[j]]
                difference = wave.opd[rows[i], columns[i]] - wave.opd[rows[j], columns[j]]
                rings.setdefault(round(distance), []).append((pair, distance, difference**2))
    found = structure_function(wave)
    start = 1 if found.separation[0] == 0.0 else 0
    for place, ring in enumerate(sorted(rings), start=start):
        pair, distance, square = np.array(rings[ring]).T
        assert found.separation[place] == pytest.approx(PIXEL * np.average(distance, weights=pair))
        assert found.value[place] == pytest.approx(np.average(square, weights=pair), rel=1e-9, abs=0.0)
        assert found.pair_weight[place] / found.pair_weight[start:].sum() == pytest.approx(
            pair.sum() / sum(one[0] for each in rings.values() for one in each)
        )
    assert found.pair_weight.sum() == pytest.approx(1.0) and math.isnan(found.error[-1])
