"""Numbers of wavefronts by plain least squares: terms, Zernike coefficients, quantities, samples."""

import math

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Mask, Rectangle, Wavefront
from aerokernels.wavefront import fit_tilt, remove_terms
from aerokernels.wavefront.grid import pupil_grid
from aerokernels.wavefront.modes import fit_zernike, most_polynomials, zernike_errors, zernike_surface
from aerokernels.wavefront.scattered import _beyond, _check_cover, _interpolated
from aerokernels.wavefront.terms import check_metres, map_points
from aerokernels.zernike import zernike_modes

WAVELENGTH = 633e-9


def fitted(basis: np.ndarray, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Weighted least squares."""
    root = np.sqrt(weight)
    return np.linalg.lstsq(basis * root[:, None], values * root, rcond=None)[0]


def disc_map(count: int = 12, error: float | None = 3e-9, remove: tuple[str, ...] = ()) -> Wavefront:
    """Noise and a tilt over a disc whose edge crosses pixels."""
    pupil = Disc(5e-3)
    coordinate, pixel, weight, intensity = pupil_grid(pupil, count)
    draw = np.random.default_rng(4)
    x, y = np.meshgrid(coordinate, coordinate)
    opd = 2e-8 * draw.normal(size=weight.shape) + 3e-5 * x - 2e-5 * y + 2e-3 * (x * x + y * y)
    wave = Wavefront(
        opd, weight, pixel, WAVELENGTH, intensity=intensity, radius=5e-3, pupil=pupil,
        budget=None if error is None else lambda: {"total": error},
    )  # fmt: skip
    return wave.remove(*remove) if remove else wave


@pytest.mark.parametrize("remove", [(), ("piston",), ("tilt",), ("focus",), ("piston", "focus"), ("tilt", "focus")])
@pytest.mark.parametrize("weighted", [False, True])
def test_terms_are_fitted_together_with_the_mean(remove: tuple[str, ...], weighted: bool):
    """What is taken away has mean 0 unless piston is removed; focus is about the origin."""
    draw = np.random.default_rng(1)
    points, opd = draw.uniform(-1.0, 2.0, (40, 2)), 1e-6 * draw.normal(size=40)
    weight = draw.uniform(0.2, 1.0, 40) if weighted else np.ones(40)
    columns = [np.ones(40)]
    columns += [*points.T] if "tilt" in remove else []
    columns += [(points**2).sum(axis=1)] if "focus" in remove else []
    basis = np.stack(columns, axis=1)
    left = opd - basis @ fitted(basis, opd, weight)
    if "piston" not in remove:
        left = left + np.average(opd, weights=weight)
    found = remove_terms(opd, remove, points, weight if weighted else None)
    np.testing.assert_allclose(found, left, atol=1e-18)


def test_a_plane_and_its_residual_by_weighted_least_squares():
    draw = np.random.default_rng(2)
    points, opd, weight = draw.uniform(-1.0, 2.0, (30, 2)), draw.normal(size=30), draw.uniform(0.2, 1.0, 30)
    weight[3], opd[3] = 0.0, np.nan
    good = weight > 0.0
    basis = np.column_stack([np.ones(29), points[good]])
    plane = fitted(basis, opd[good], weight[good])
    found = fit_tilt(opd, points, weight)
    assert found.piston == pytest.approx(np.average(opd[good], weights=weight[good]))
    np.testing.assert_allclose(found.tilt, plane[1:], rtol=1e-9)
    left = opd[good] - basis @ plane
    assert found.residual_rms == pytest.approx(math.sqrt(np.average(left**2, weights=weight[good])))
    np.testing.assert_array_equal(
        map_points(np.zeros((2, 3)), None), [[i - 0.5, j - 1.0] for i in (0, 1) for j in range(3)]
    )
    flat, half = np.full(4, 0.25), np.array([0.0, 0.0, 1.0, 1.0])
    check_metres(3.0 + 0.0199 * half, flat)
    with pytest.raises(ValueError, match=r"rms is 0\.0101 m"):
        check_metres(3.0 + 0.0202 * half, flat)


@pytest.mark.parametrize("count", [1, 4, 7])
def test_zernike_coefficients_by_least_squares(count: int):
    wave = disc_map()
    opd, weight = wave.samples
    modes = zernike_modes(count, *(wave.points.T / 5e-3)).T
    found = fit_zernike(wave, count)
    np.testing.assert_allclose(found, fitted(modes, opd, weight), rtol=1e-8)
    surface = zernike_surface(wave, found)
    np.testing.assert_allclose(surface[wave.lit], modes @ found, rtol=1e-12)
    assert np.isnan(surface[~wave.lit]).all() and (zernike_errors(wave, count) > 0.0).all()
    few = disc_map(4)
    assert np.isinf(zernike_errors(few, 99)).all() and len(zernike_errors(few, 99)) == 99
    with pytest.raises(ValueError, match="cannot distinguish 99"):
        fit_zernike(few, 99)


def test_quantities_are_means_over_the_pixels():
    wave = disc_map()
    opd, weight = wave.samples
    told = wave.quantities
    assert told["peak_to_valley"].value == pytest.approx(opd.max() - opd.min())
    plane = fitted(np.column_stack([np.ones(len(opd)), wave.points]), opd, weight)
    assert [told[name].value for name in ("tilt_x", "tilt_y")] == pytest.approx(plane[1:].tolist())
    assert told["strehl"].value == pytest.approx(abs((weight * np.exp(2j * np.pi / WAVELENGTH * opd)).sum()) ** 2)
    assert told["opd_rms"].value == pytest.approx(math.sqrt(weight @ (opd - weight @ opd) ** 2))
    assert wave.opd_error == 3e-9 and all(one.error > 0.0 for one in told.values())


def test_a_wavefront_of_few_pixels_or_of_a_line():
    single = Wavefront(np.zeros((1, 1)), np.ones((1, 1)), 1e-3, WAVELENGTH)
    assert math.isnan(single.quantities["strehl"].error) and math.isnan(single.quantities["tilt_x"].error)
    assert single.coordinate.tolist() == [0.0] and single.power == 1.0
    line = np.zeros((4, 4))
    line[1, 1:] = 1.0
    told = Wavefront(np.zeros((4, 4)), line, 1e-3, WAVELENGTH, budget=lambda: {"total": 1e-9}).quantities
    assert math.isnan(told["tilt_y"].error) and told["tilt_x"].error > 0.0
    assert math.isnan(Wavefront(np.zeros((4, 4)), line, 1e-3, WAVELENGTH).opd_error)


@pytest.mark.parametrize("pupil", [Disc(5e-3), Rectangle(8e-3, 5e-3), Annulus(5e-3, 2e-3)])
def test_a_grid_holds_its_pupil(pupil):
    half = max(pupil.half_extent)
    coordinate, pixel, weight, intensity = pupil_grid(pupil, 10)
    edges = half * (2.0 * np.arange(11) / 10 - 1.0)
    assert pixel == pytest.approx(0.2 * half)
    np.testing.assert_allclose(coordinate, 0.5 * (edges[1:] + edges[:-1]), atol=1e-18)
    np.testing.assert_allclose(weight, pupil.coverage(edges, edges), atol=1e-12)
    np.testing.assert_allclose(intensity, np.where(weight > 0.0, pupil.coverage(edges, edges, 2), 0.0), atol=1e-12)
    assert len(pupil_grid(pupil, None)[0]) == 128 and len(pupil_grid(pupil, 2)[0]) == 2
    with pytest.raises(ValueError, match="pixel_count"):
        pupil_grid(pupil, 1)
    for shape, pixels, count in (((6, 9), 1e-3, 9), ((6, 9), (1e-3, 2e-3), 128), ((1, 1), 1e-3, 128)):
        assert len(pupil_grid(Mask(np.ones(shape), pixels), None)[0]) == count


def test_maps_are_checked_and_read():
    weight = np.array([[0.0, 0.5, 1.0], [1.0, 1.0, 0.2], [0.4, 0.0, 0.3]])
    wave = Wavefront(1e-7 * np.arange(9.0).reshape(3, 3), weight, 2e-3, WAVELENGTH)
    np.testing.assert_allclose(wave.coordinate, [-2e-3, 0.0, 2e-3])
    np.testing.assert_allclose(wave.intensity, weight**2)
    assert wave.power == pytest.approx((weight**2).sum()) and wave.radius == pytest.approx(3e-3)
    np.testing.assert_allclose(wave.points[:3], [[0.0, -2e-3], [2e-3, -2e-3], [-2e-3, 0.0]], atol=1e-18)
    opd, share = wave.samples
    np.testing.assert_allclose(opd, 1e-7 * np.array([1, 2, 3, 4, 5, 6, 8]))
    np.testing.assert_allclose(share, weight[weight > 0.0] / weight.sum())
    assert np.isnan(wave.opd[0, 0]) and wave.peak_to_valley == pytest.approx(7e-7)
    for intensity, fine in ((0.9999 * weight**2, False), (weight**2, True), (2.0 * weight**2, True)):
        if fine:
            assert Wavefront(wave.opd, weight, 2e-3, WAVELENGTH, intensity=intensity).power == intensity.sum()
        else:
            with pytest.raises(ValueError, match="nowhere below"):
                Wavefront(wave.opd, weight, 2e-3, WAVELENGTH, intensity=intensity)


def test_scattered_samples_keep_polynomials_and_parabolas():
    """Three samples for each of up to 36 modes; beyond the outermost samples the parabola through the near ones."""
    draw = np.random.default_rng(5)
    for count, modes in ((200, 36), (60, 20), (12, 4), (9, 3)):
        angle, size = draw.uniform(0.0, 2.0 * np.pi, count), 3e-3 * np.sqrt(draw.uniform(0.0, 1.0, count))
        place = np.stack([size * np.cos(angle), size * np.sin(angle)], axis=1)
        wanted = 0.9 * place[:7] + 0.1 * place[1:8]
        coefficients = draw.normal(size=modes)
        values = coefficients @ zernike_modes(modes, *(place.T / 3e-3))
        expected = coefficients @ zernike_modes(modes, *(wanted.T / 3e-3))
        np.testing.assert_allclose(_interpolated(place, values, wanted, 3e-3), expected, atol=1e-6)
    place = draw.uniform(-1.0, 1.0, (40, 2))
    wanted = np.array([[1.3, 0.2], [-0.5, 1.4], [0.4, -1.6]])
    parabola = lambda p: 0.3 - p[:, 0] + 2.0 * p[:, 1] + p[:, 0] ** 2 - 0.5 * p[:, 0] * p[:, 1] + 0.7 * p[:, 1] ** 2  # noqa: E731
    np.testing.assert_allclose(_beyond(place, parabola(place), wanted), parabola(wanted), atol=1e-6)
    few = place[:8]
    np.testing.assert_allclose(_beyond(few, parabola(few), wanted), parabola(wanted), atol=1e-5)


def test_a_hole_is_farther_from_every_sample_than_four_mean_distances():
    """Pixels of side 1, four times as many as samples, which are 2 apart then: 8 is allowed, in the pupil."""
    pupil = Rectangle(40.0, 2.0)
    wanted = np.column_stack([np.arange(-19.5, 20.0), np.zeros(40)])
    for gap, fine in ((7.99, True), (8.01, False)):
        place = np.column_stack([np.linspace(-19.5, 19.5 - gap, 10), np.zeros(10)])
        if fine:
            _check_cover(place, wanted, 1.0, pupil)
        else:
            with pytest.raises(ValueError, match=r"2\.5 % of the pupil is farther than 8 m"):
                _check_cover(place, wanted, 1.0, pupil)
    # The middle of a pixel may be outside the pupil by half of its diagonal.
    place = np.column_stack([np.linspace(-19.5, 13.0, 10), np.zeros(10)])
    for end, fine in ((21.69, True), (21.72, False)):
        outside = np.vstack([wanted[:32], np.tile([end, 0.0], (8, 1))])
        if fine:
            _check_cover(place, outside, 1.0, pupil)
        else:
            with pytest.raises(ValueError, match="20 % of the pupil"):
                _check_cover(place, outside, 1.0, pupil)


def test_corners_beside_a_disc_need_no_samples():
    """Many samples up to the rim; the corners of the map are farther from them than any hole may be."""
    number = np.arange(1500)
    angle, size = 2.399963 * number, 3e-3 * np.sqrt((number + 0.5) / 1500)
    place = np.stack([size * np.cos(angle), size * np.sin(angle)], axis=1)
    wave = Wavefront.from_samples(place, 1e-7 * place[:, 0] / 3e-3, Disc(3e-3), WAVELENGTH, pixel_count=16)
    np.testing.assert_allclose(wave.opd[wave.lit], 1e-7 * wave.points[:, 0] / 3e-3, atol=1e-13)


@pytest.mark.parametrize("count", [40, 41])
def test_each_sample_is_predicted_from_three_quarters_of_the_others(count: int):
    """The interpolation error is twice the rms about its mean; the samples' own error is added as squares."""
    draw = np.random.default_rng(6)
    angle, size = 2.399963 * np.arange(count), 3e-3 * np.sqrt((np.arange(count) + 0.5) / count)
    place = np.stack([size * np.cos(angle), size * np.sin(angle)], axis=1)
    values = 1e-8 * draw.normal(size=count)
    wave = Wavefront.from_samples(place, values, Disc(3e-3), WAVELENGTH, pixel_count=6, opd_error=4e-8)
    off = np.zeros(count)
    for first in range(4):
        out = np.arange(count) % 4 == first
        off[out] = _interpolated(place[~out], values[~out], place[out], 3e-3) - values[out]
    assert wave.error["interpolation"] == pytest.approx(2.0 * off.std(), rel=0.1)
    assert wave.error["sampling"] == pytest.approx(4e-8, rel=0.05)
    assert wave.opd_error == pytest.approx(math.hypot(2.0 * off.std(), 4e-8), rel=0.1)
    np.testing.assert_allclose(wave.opd[wave.lit], _interpolated(place, values, wave.points, 3e-3), atol=1e-15)
    pupil = Disc(3e-3, (0.1, 0.2, 0.3), (0.3, 0.1, 1.0))
    space = pupil.center + place @ np.array(pupil.axes)
    turned = Wavefront.from_samples(space, values, pupil, WAVELENGTH, pixel_count=6)
    np.testing.assert_allclose(turned.opd[turned.lit], wave.opd[wave.lit], atol=1e-13)
    assert turned.error["sampling"] == 0.0


@pytest.mark.parametrize("pupil", [Disc(5e-3), Rectangle(1e-2, 4e-3), Annulus(5e-3, 3e-3)])
def test_polynomials_that_columns_of_pixels_do_not_distinguish_are_refused_without_a_fit(pupil):
    """Never fewer than have singular values above 1e-9 of the greatest one, and no more than one order above."""
    _, pixel, weight, intensity = pupil_grid(pupil, 20)
    wave = Wavefront(np.zeros(weight.shape), weight, pixel, WAVELENGTH, intensity=intensity, radius=5e-3, pupil=pupil)

    def distinct(order: int) -> bool:
        modes = zernike_modes((order + 1) * (order + 2) // 2, *(wave.points.T / 5e-3))
        size = np.linalg.svd(modes * np.sqrt(wave.samples[1]), compute_uv=False)
        return len(wave.points) >= len(modes) and size[-1] > 1e-9 * size[0]

    greatest = max(order for order in range(1, 22) if distinct(order))
    most = most_polynomials(wave, 10**6)
    assert most in [(order + 1) * (order + 2) // 2 for order in (greatest, greatest + 1)]
    assert most_polynomials(wave, most) == most and most_polynomials(wave, 10) == 10
    assert most_polynomials(wave, len(wave.points) + 1) < len(wave.points)


def test_too_many_polynomials_for_the_memory_are_refused():
    """50,000 of them on 55,000 pixels: a matrix of 22 GB."""
    weight = np.ones((235, 235))
    wave = Wavefront(0.0 * weight, weight, 1e-4, WAVELENGTH)
    with pytest.raises(ValueError, match="55225 samples cannot distinguish 50000 Zernike polynomials, only about"):
        wave.zernike(50_000)
    assert np.isinf(wave.zernike_errors(50_000)).all()


@pytest.mark.parametrize("count", [0, -3])
def test_fewer_than_one_polynomial_is_refused(count: int):
    wave = Wavefront(np.zeros((8, 8)), np.ones((8, 8)), 1e-4, WAVELENGTH)
    for ask in (wave.zernike, wave.zernike_errors):
        with pytest.raises(ValueError, match=f"count must be a whole number of at least 1, got {count}"):
            ask(count)
