"""Sums, differences, comparisons, tables and files of wavefronts: closed forms in Zernike polynomials."""

import csv

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Wavefront, compare_wavefronts, wavefront
from aerokernels.wavefronts.pixels import pupil_grid
from tests.phase_plates import RADIUS, WAVELENGTH, modes, phase_plate

# The names of Noll's first polynomials in optics, for angles from x toward y.
NAMES = """piston; tilt x; tilt y; defocus; astigmatism 45 deg; astigmatism 0 deg; coma y; coma x; trefoil 30 deg;
trefoil 0 deg; spherical; secondary astigmatism 0 deg; secondary astigmatism 45 deg; quadrafoil 0 deg;
quadrafoil 22.5 deg; secondary coma x; secondary coma y""".replace("\n", " ").split("; ")


def made(coefficients: dict[int, float], error: float = 0.0, pupil=None, count: int = 64, wrong=None) -> Wavefront:
    """A wavefront of Zernike polynomials [m] by Noll's index, with an error of its OPD [m]."""
    pupil = pupil or Disc(RADIUS)
    coordinate, pixel, weight, intensity = pupil_grid(pupil, count)
    x, y = np.meshgrid(coordinate, coordinate)
    opd = modes(coefficients)(x, y) + (0.0 if wrong is None else wrong(x, y))
    own = {"intensity": intensity, "radius": pupil.reach, "pupil": pupil}
    return Wavefront(opd, weight, pixel, WAVELENGTH, **own, budget=lambda: {"total": error})


def test_a_difference_has_the_difference_of_the_coefficients():
    """Zernike coefficients are linear in the OPD; errors of 3 and 4 nm make one of 5 nm."""
    a, b = made({4: 5e-8, 8: 2e-8}, 3e-9), made({4: 1e-8, 7: -3e-8}, 4e-9)
    for found, expected in (
        (a - b, {4: 4e-8, 7: 3e-8, 8: 2e-8}),
        (a + b, {4: 6e-8, 7: -3e-8, 8: 2e-8}),
        (b - a, {4: -4e-8, 7: -3e-8, 8: -2e-8}),
    ):
        assert found.zernike(8) == pytest.approx([expected.get(index, 0.0) for index in range(1, 9)], abs=1e-17)
        assert found.opd_error == pytest.approx(5e-9)
        assert repr(found.pupil) == repr(a.pupil) and found.wavelength == WAVELENGTH
    for found, factor in ((2.5 * a, 2.5), (a * np.float64(2.5), 2.5), (np.float64(2.5) * a, 2.5)):
        assert found.zernike(8) == pytest.approx(factor * a.zernike(8), abs=1e-17)
        assert found.opd_error == pytest.approx(7.5e-9)
    assert (a / 2).zernike(8) == pytest.approx(0.5 * a.zernike(8), abs=1e-17) and (a / 2).opd_error == 1.5e-9
    with pytest.raises(ValueError, match="divided by 0"):
        a / 0
    assert (-a).zernike(4)[3] == pytest.approx(-5e-8) and (-a).opd_error == pytest.approx(3e-9)
    assert (a.remove("focus") - b.remove("focus")).zernike(4)[3] == pytest.approx(0.0, abs=1e-17)


def test_a_wavefront_less_itself_is_nothing_and_its_double_has_twice_the_error():
    a = wavefront(phase_plate(modes({4: 5e-8}), 4e-3), Disc(1e-3, (0, 0, -1e-3)), wavelength=WAVELENGTH, pixel_count=16)
    nothing = a - a
    assert not nothing.samples[0].any() and nothing.opd_error == 0.0
    assert nothing.quantities["strehl"].value == 1.0 and nothing.quantities["strehl"].error == 0.0
    assert (a + a).opd_error == (2 * a).opd_error == pytest.approx(2.0 * a.opd_error)
    # Errors of one wavefront and of what was made from it are not independent.
    assert (a + a.remove("tilt")).opd_error == pytest.approx(a.opd_error + a.remove("tilt").opd_error)
    assert np.isnan((a - Wavefront(a.opd, a.weight, a.pixel, WAVELENGTH, a.intensity)).opd_error)


def test_other_pupils_pixels_and_wavelengths_are_refused():
    a = made({4: 5e-8})
    for other, message in (
        (made({4: 5e-8}, count=32), "have 64 pixels of .* and 32 pixels of .*: make both"),
        (made({4: 5e-8}, pupil=Annulus(RADIUS, 0.5 * RADIUS)), "different pupils"),
        (a.at_wavelength(1e-6), "at 905 nm and 64 pixels of .* at 1000 nm: make both"),
    ):
        for call in (a.__sub__, a.__add__, a.compare):
            with pytest.raises(ValueError, match=message):
                call(other)
    for wrong in (lambda: a * "2", lambda: a - 1.0, lambda: a + a.opd, lambda: a.compare(1.0)):
        with pytest.raises(TypeError, match="Wavefront"):
            wrong()


def test_pixels_that_are_dark_in_one_are_dark_in_the_difference():
    a, hidden = made({4: 5e-8}), made({4: 1e-8})
    weight = np.where(np.arange(64) < 20, 0.0, hidden.weight)
    hidden = Wavefront(hidden.opd, weight, hidden.pixel, WAVELENGTH, radius=RADIUS, pupil=hidden.pupil, blocked=0.25)
    found = a - hidden
    assert np.array_equal(found.lit, hidden.lit) and found.zernike(4)[3] == pytest.approx(4e-8)
    assert found.blocked == pytest.approx(1.0 - weight.sum() / a.weight.sum())


def test_a_comparison_has_correlation_and_strehl_ratios_with_errors():
    """Orthogonal polynomials on a disc: r = 5 / sqrt(5^2 + 2^2); rms of the difference 2; midpoints: 1e-3 at N = 64."""
    a, b = made({4: 5e-8}, 1e-9), made({4: 5e-8, 8: 2e-8}, 1e-9)
    found = a.compare(b)
    numbers = found.quantities
    assert (
        numbers["correlation"].value == pytest.approx(5.0 / np.sqrt(29.0), abs=2e-3)
        and numbers["correlation"].error < 0.05
    )
    assert numbers["opd_rms_difference"].value == pytest.approx(2e-8, rel=5e-3)
    assert numbers["strehl_change"].value == a.strehl() - b.strehl()
    assert numbers["strehl_change"].error == pytest.approx(
        np.hypot(a.quantities["strehl"].error, b.quantities["strehl"].error)
    )
    assert "correlation: 0.9" in repr(found)
    same = a.compare(a)
    assert (same.quantities["correlation"].value, same.quantities["correlation"].error) == (pytest.approx(1.0), 0.0)
    assert same.quantities["strehl_change"].error == 0.0
    assert a.compare(-a).quantities["correlation"].value == pytest.approx(-1.0)
    assert np.isnan(a.compare(0.0 * a).quantities["correlation"].value)


def test_errors_of_a_comparison_cover_smooth_errors():
    """OPDs off by waves of a tenth of the radius or longer, of rms e / 2 each: 18 of 20 numbers are covered."""
    error, rng, covered = 4e-9, np.random.default_rng(5), []
    told = made({4: 5e-8, 5: 3e-8}, error, count=32).compare(made({4: 4e-8, 8: 2e-8}, error, count=32)).quantities
    names = ("strehl_change", "opd_rms_difference", "correlation")
    for size in (1.0, 0.5, 0.2, 0.1) * 2:

        def wrong(x, y, size=size):
            way, phase = rng.normal(0.0, 1.0 / (size * RADIUS), (2, 20)), rng.uniform(0.0, 7.0, 20)
            flat = np.cos(np.multiply.outer(x, way[0]) + np.multiply.outer(y, way[1]) + phase).sum(axis=-1)
            return 0.5 * error * (flat - flat.mean()) / flat.std()

        one, other = made({4: 5e-8, 5: 3e-8}, count=32, wrong=wrong), made({4: 4e-8, 8: 2e-8}, count=32, wrong=wrong)
        seen = one.compare(other).quantities
        covered += [abs(seen[name].value - told[name].value) <= told[name].error for name in names]
    assert np.mean(covered) >= 0.9


def test_a_zernike_table_has_names_values_and_errors(tmp_path):
    wave = made({4: 5e-8, 8: -2e-8}, 1e-9)
    table = wave.zernike_table(17)
    assert [one.name for one in table] == NAMES and [one.index for one in table] == list(range(1, 18))
    assert [(one.n, one.m) for one in table[:8]] == [(0, 0), (1, 1), (1, -1), (2, 0), (2, -2), (2, 2), (3, -1), (3, 1)]
    assert np.array_equal([one.value for one in table], wave.zernike(17))
    assert np.array_equal([one.error for one in table], wave.zernike_errors(17))
    table.to_csv(tmp_path / "table.csv")
    with open(tmp_path / "table.csv", encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert [float(row["value"]) for row in rows] == list(wave.zernike(17)) and rows[7]["name"] == "coma x"
    frame = table.to_pandas()
    assert frame.loc[8, "value"] == table[7].value and list(frame.columns) == ["n", "m", "name", "value", "error"]
    lines = repr(table).splitlines()
    assert len(lines) == 18 and "-20.0" in lines[8] and "coma x" in lines[8] and lines[8].endswith("nm")
    assert wave.zernike_table(37)[-1].name == "tertiary spherical"
    with pytest.raises(ValueError, match="at least 1"):
        wave.zernike_table(0)


def test_a_file_is_read(tmp_path):
    """Coma along x alone: a turned, mirrored or negated map has another coefficient 7 or 8."""
    wave = made({7: 1e-8, 8: 3e-8}, 2e-9).remove("piston")
    file, torn = tmp_path / "wave.nc", tmp_path / "torn.nc"
    wave.to_xarray().to_netcdf(file)
    back = Wavefront.read(file)
    assert back.zernike(8)[6:] == pytest.approx([1e-8, 3e-8], abs=1e-18)
    assert (back.pixel, back.wavelength, back.opd_error) == (wave.pixel, wave.wavelength, wave.opd_error)
    assert np.array_equal(back.weight, wave.weight) and back.removed == ("piston",)
    assert not (back - wave).samples[0].any()
    torn.write_bytes(file.read_bytes()[:400])
    for wrong in (torn, tmp_path / "none.nc", tmp_path):
        with pytest.raises(ValueError, match=str(wrong)):
            Wavefront.read(wrong)


def test_each_sample_has_an_error_of_its_own():
    """Errors of 1 nm on one half and 7 nm on the other: 5 nm, their rms, of which patterns are drawn."""
    rng = np.random.default_rng(2)
    places = np.array([one for one in rng.uniform(-1.0, 1.0, (3000, 2)) * RADIUS if np.hypot(*one) <= RADIUS])
    opd = modes({4: 5e-8, 7: 2e-8})(*places.T)
    error = np.where(places[:, 0] < 0.0, 1e-9, 7e-9)
    found = Wavefront.from_samples(places, opd, Disc(RADIUS), WAVELENGTH, pixel_count=24, error=error)
    assert found.error["sampling"] == pytest.approx(5e-9, rel=0.15)
    assert found.quantities["strehl"].error > 0.0
    for wrong in (-1e-9, np.full(3, 1e-9), np.nan):
        with pytest.raises(ValueError, match="error must be a length of at least 0 m"):
            Wavefront.from_samples(places, opd, Disc(RADIUS), WAVELENGTH, error=wrong)


def test_errors_of_the_pixels_are_those_of_all_numbers():
    """Errors of 1 nm at x < 0 and of 9 nm at x > 0: kept by arithmetic and files, and behind the other errors."""
    a = made({8: 5e-8}, 0.0)
    sizes = np.where(np.arange(64) < 32, 1e-9, 9e-9) * np.ones((64, 64))
    a = Wavefront(a.opd, a.weight, a.pixel, WAVELENGTH, a.intensity, RADIUS, a.pupil, error_map=sizes)
    assert np.array_equal(a.pixel_errors[a.lit], sizes[a.lit]) and np.isnan(a.pixel_errors[~a.lit]).all()
    assert (a / 2).pixel_errors[32] == pytest.approx(0.5 * a.pixel_errors[32], nan_ok=True)
    b = Wavefront(2 * a.opd, a.weight, a.pixel, WAVELENGTH, a.intensity, RADIUS, a.pupil, error_map=sizes)
    assert (a - b).pixel_errors[32, 40] == pytest.approx(np.sqrt(2.0) * 9e-9)
    assert Wavefront.from_xarray(a.to_xarray()).pixel_errors == pytest.approx(a.pixel_errors, nan_ok=True)
    # The greatest and the least OPD of coma x lie at x > 0 and at x < 0.
    valley = a.quantities["peak_to_valley"]
    assert valley.value == a.peak_to_valley and valley.error > 1e-8
    assert all(0.0 < term.error < 9e-9 for term in a.zernike_table(8))
    with pytest.raises(ValueError, match="error_map"):
        Wavefront(a.opd, a.weight, a.pixel, WAVELENGTH, error_map=-sizes)


def test_errors_of_traced_pixels_hold_what_each_is_off_by():
    """A ripple at x > 0 alone, in a field of few samples: there the pixels are off, and are said to be."""

    def opd(x, y):
        return 2e-8 * np.exp(-((x - 1e-3) ** 2 + y**2) / 4e-4**2) * np.cos(1.2e4 * x)

    field = phase_plate(opd, 4e-3, count=47)
    seen = wavefront(field, Disc(RADIUS, (0, 0, -1e-3)), wavelength=WAVELENGTH, pixel_count=41)
    x, y = np.meshgrid(seen.coordinate, seen.coordinate)
    off = np.abs(seen.opd - opd(x, y))
    known = seen.lit
    assert np.mean(off[known] <= seen.pixel_errors[known] + 1e-12) >= 0.95
    left, right = (seen.pixel_errors[known & side].mean() for side in (x < -5e-4, np.hypot(x - 1e-3, y) < 4e-4))
    assert right > 3.0 * left


def test_flows_are_compared_in_one_call():
    """Two plates of 5e-8 and 3e-8 m of defocus; the same as tracing both and subtracting."""
    pupil = Disc(RADIUS, (0, 0, -1e-3))
    plates = [phase_plate(modes({4: size}), 4e-3) for size in (5e-8, 3e-8)]
    options = {"wavelength": WAVELENGTH, "pixel_count": 32}
    found = compare_wavefronts(*plates, pupil, **options)
    one, other = (wavefront(plate, pupil, **options) for plate in plates)
    assert found.quantities["opd_rms_difference"].value == pytest.approx(2e-8, rel=2e-2)
    assert np.array_equal(found.difference.opd, (one - other).opd, equal_nan=True)
    assert np.array_equal(one.compare(other).difference.opd, found.difference.opd, equal_nan=True)
    with pytest.raises(TypeError, match="pupil"):
        compare_wavefronts(*plates)
