"""Statistics against random fields of Fourier modes, whose every moment is a closed form, and their standard errors.

A mode of wave vector q and random phase has at each point the variance A^2 / 2, and what removing terms leaves of it
over a pupil is A^2 / 2 sum w |e - P e|^2, with e = exp(i q x) and P the weighted projection on these terms.
"""

import numpy as np
import pytest
import xarray

from aerokernels import Disc, statistics
from aerokernels.series.modes import integral_length, mean_of, welch
from aerokernels.series.pupil_grid import PupilGrid, pupil_grid

from .fourier import WAVELENGTH

GRID = pupil_grid(Disc(0.02), 16)
WAVES = np.array([[150.0, 40.0], [-60.0, 210.0], [330.0, -120.0], [90.0, 90.0]])
AMPLITUDES = np.array([8e-9, 6e-9, 5e-9, 3e-9])
LENGTHS = "correlation_length_x", "correlation_length_y"


def drawn(count: int, seed: int, scale: float = 1.0) -> xarray.Dataset:
    """Independent draws of the phases."""
    phase = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, (count, len(WAVES)))
    waves = np.exp(1j * GRID.coordinates @ WAVES.T)
    return dataset(scale * ((np.exp(1j * phase) * AMPLITUDES) @ waves.T).real)


def dataset(maps: np.ndarray, step: float = 1e-5, on: PupilGrid = GRID) -> xarray.Dataset:
    opd = np.stack([on.spread(one) for one in maps])
    places = {"time": step * np.arange(len(maps)), "y": on.y, "x": on.x}
    shares = {"opd": (("time", "y", "x"), opd), "weight": (("y", "x"), on.weight)}
    return xarray.Dataset(shares, places, {"wavelength": WAVELENGTH})


def left_over(points: np.ndarray, weight: np.ndarray, tilt: bool) -> float:
    """Expected mean square over the pupil, mean, and tilt, removed [m2]."""
    weight = weight / weight.sum()
    basis = np.concatenate([np.ones((len(points), 1)), points], axis=1) if tilt else np.ones((len(points), 1))
    root = np.sqrt(weight)[:, None]
    ortho = np.linalg.qr(root * basis)[0]
    waves = root * np.exp(1j * points @ WAVES.T)
    rest = waves - ortho @ (ortho.T @ waves)
    return float(0.5 * AMPLITUDES**2 @ (np.abs(rest) ** 2).sum(axis=0))


def test_variance_and_aperture_filter_of_two_thousand_draws():
    """Expected: closed forms, within 3 standard errors and 1 %."""
    found = statistics(drawn(2000, 1), apertures=[0.02, 0.04], mode_count=8)
    weight, points = GRID.weight[GRID.lit], GRID.coordinates
    near = np.minimum(Disc(0.01).coverage(*[np.linspace(-0.02, 0.02, 17)] * 2)[GRID.lit], weight / weight.max())
    expected = {
        "opd_rms": left_over(points, weight, True),
        "opd_rms_with_tilt": left_over(points, weight, False),
        "opd_rms_unsteady": 0.5 * (AMPLITUDES**2).sum(),
    }
    for name, square in expected.items():
        value, error = float(found[name]), float(found[f"{name}_error"])
        assert abs(value - np.sqrt(square)) < min(3.0 * error, 1e-2 * np.sqrt(square)), name
    sweep = found.opd_rms_aperture.values
    for k, (where, shares) in enumerate([(points[near > 0], near[near > 0]), (points, weight)]):
        assert abs(sweep[k] - np.sqrt(left_over(where, shares, True))) < 3.0 * float(found.opd_rms_aperture_error[k])
    assert found.opd_std.mean() == pytest.approx(np.sqrt(0.5 * (AMPLITUDES**2).sum()), rel=1e-2)
    assert float(found.opd_rms_steady) < 3.0 * float(found.opd_rms_steady_error)  # there is none
    # Two modes a wave, of one energy each, but for how the pupil mixes the waves.
    assert float(found.pod_share.sum()) == pytest.approx(1.0, abs=1e-9)
    correlation = found.correlation.sel(lag_x=0.0, method="nearest").sel(lag_y=0.0, method="nearest")
    assert float(correlation) == 1.0


def test_two_point_correlation_is_the_waves_own():
    """Expected: sum of A^2 cos(q . lag) over sum of A^2, within 4 of its errors and 1 %; length to its first zero."""
    found = statistics(drawn(1000, 2))
    lag_x, lag_y = np.meshgrid(found.lag_x, found.lag_y)
    lags = np.stack([lag_x, lag_y], axis=-1)
    expected = np.cos(lags @ WAVES.T) @ AMPLITUDES**2 / (AMPLITUDES**2).sum()
    near = np.hypot(lag_x, lag_y) < 0.02
    off = np.abs(found.correlation.values - expected)[near]
    assert off.max() < 0.05 and np.mean(off < 3.0 * found.correlation_error.values[near] + 1e-9) > 0.9
    fine = np.linspace(0.0, 0.04, 4001)
    exact = integral_length(np.cos(np.outer(fine, WAVES[:, 0])) @ AMPLITUDES**2, 1e-5)
    assert float(found.correlation_length_x) == pytest.approx(exact, rel=0.05)  # 2.5 mm pixels, linear between them


def test_the_spectrum_of_a_frozen_wave():
    """Set-up: waves of 8 mm and 20 mm carried at 300 m/s past the pupil.

    Expected: lines at U / wavelength; their area is the variance; Strouhal number D / wavelength.
    """
    step, count, speed = 2e-6, 2048, 300.0
    lengths, heights = np.array([8e-3, 20e-3]), np.array([10e-9, 20e-9])
    time = step * np.arange(count)
    phase = 2.0 * np.pi * (GRID.coordinates[:, 0] - speed * time[:, None])[..., None] / lengths
    found = statistics(dataset(np.cos(phase) @ heights, step), velocity=speed)
    spectrum, frequency = found.spectrum_opd.values, found.frequency.values
    assert np.trapezoid(spectrum, frequency) == pytest.approx(0.5 * (heights**2).sum(), rel=1e-2)
    width = frequency[1]
    for length, height in zip(lengths, heights, strict=True):
        line = np.abs(frequency - speed / length) < 3.0 * width
        assert np.trapezoid(spectrum[line], frequency[line]) == pytest.approx(0.5 * height**2, rel=0.02)
        assert abs(frequency[line][spectrum[line].argmax()] - speed / length) <= width
    np.testing.assert_allclose(found.strouhal, found.frequency * 0.04 / speed, rtol=1e-12)
    # Each travelling wave is two modes of its own energy.
    share = 0.5 * heights**2 / (heights**2).sum()
    np.testing.assert_allclose(np.sort(found.pod_share[:4])[::-1], np.repeat(share[::-1], 2), rtol=0.15)
    assert (found.spectrum_opd_error > 0.0).all()


def test_standard_errors_of_dependent_samples():
    """AR(1), correlation 0.9: the true error of a mean is sqrt(19 / n), so |mean| / error has the rms 1."""
    draw = np.random.default_rng(3)
    ratios = []
    for _ in range(200):
        noise = draw.normal(size=2200)
        walk = np.empty(2200)
        walk[0] = noise[0] / np.sqrt(1.0 - 0.81)
        for k in range(1, 2200):
            walk[k] = 0.9 * walk[k - 1] + noise[k]
        found = mean_of(walk[200:])
        ratios.append(found.value / found.error)
    assert np.sqrt(np.mean(np.square(ratios))) == pytest.approx(0.9, abs=0.25)
    assert found.effective_count == pytest.approx(2000 / 19, rel=0.5)


def test_strehl_ratios_and_jitter():
    """Expected: exact mean of |<exp>|^2 of each map; the large-aperture value beside it; jitter of the tilts."""
    found = drawn(500, 6, scale=6.0)
    opd, weight = found.opd.values[:, GRID.lit], GRID.weight[GRID.lit]
    result = statistics(found)
    exact = np.abs(np.exp(2j * np.pi / WAVELENGTH * opd) @ weight) ** 2
    assert float(result.strehl) == pytest.approx(exact.mean(), rel=1e-12)
    # A series of 500 cannot tell whether its samples are quite independent: up to half of the error more.
    assert 0.9 < float(result.strehl_error) / (exact.std() / np.sqrt(500)) < 1.5
    assert 0.0 < float(result.strehl_large_aperture) < 1.0
    points = GRID.coordinates
    tilt = [np.linalg.lstsq(np.sqrt(weight)[:, None] * np.c_[np.ones(len(points)), points], np.sqrt(weight) * one)[0]
            for one in opd[:50]]  # fmt: skip
    np.testing.assert_allclose(statistics(found.isel(time=slice(50))).boresight_x, np.mean(tilt, axis=0)[1], rtol=1e-9)
    assert float(result.jitter_x) > 0.0


def test_what_has_no_statistics_is_refused():
    good = drawn(20, 10)
    with pytest.raises(TypeError, match="Dataset"):
        statistics(good.opd)
    for bad, options, words in (
        (good.drop_vars("opd"), {}, "opd"),
        (good.assign(opd=good.opd * np.nan), {}, "NaN"),
        (good, {"velocity": -1.0}, "velocity"),
        (good, {"apertures": [0.0]}, "apertures"),
        (good, {"mode_count": 0}, "mode_count"),
        (good, {"segment": 21}, "segment"),
        (good, {"wavelength": 905.0}, "wavelength"),
    ):
        with pytest.raises(ValueError, match=words):
            statistics(bad, **options)
    with pytest.raises(ValueError, match="segment"):
        welch(np.zeros(100), 1.0, 4)


def test_what_a_caller_can_mend_is_told_in_words():
    """A dark snapshot by its number, an aperture wider than the maps, a number with its unit."""
    maps = drawn(20, 4)
    dark = maps.copy(deep=True)
    dark.opd[7] = np.nan
    with pytest.raises(ValueError, match="snapshot 7 has none, one of 1: leave those out"):
        statistics(dark)
    with pytest.raises(ValueError, match="20 m is wider than the maps"):
        statistics(maps, apertures=[0.01, 20.0])
    with pytest.raises(TypeError, match="velocity must be a number of m/s"):
        statistics(maps, velocity="10 m/s")


def test_maps_that_do_not_change_have_no_modes_and_no_correlation():
    places = np.linspace(-0.01, 0.01, 12)
    still = 1e-7 * np.cos(300.0 * places + 0.1) + np.zeros((30, 12, 12))

    def of(opd):
        data = xarray.Dataset(
            {"opd": (("time", "y", "x"), opd)}, {"time": 1e-5 * np.arange(30), "y": places, "x": places}
        )
        return statistics(data)

    found = of(still)
    assert (found.pod_energy == 0.0).all() and (found.pod_coefficient == 0.0).all()
    for name in ("pod_share", "pod_mode", "correlation", *LENGTHS):
        assert np.isnan(found[name]).all(), name
    beaten = of(still + 1e-9 * np.sin(np.arange(30.0))[:, None, None] * places[:, None])
    assert beaten.pod_energy[0] > 0.0 and (beaten.pod_energy[1:] == 0.0).all()
    assert beaten.pod_share[0] == pytest.approx(1.0) and np.isnan(beaten.pod_mode[1:]).all()


def weighted_maps():
    """Maps of tilts and noise in time over a round pupil whose weights grow along x."""
    draw = np.random.default_rng(0)
    axis = (np.arange(12) - 5.5) * 1e-3
    x, y = np.meshgrid(axis, axis)
    lit = np.hypot(x, y) < 6e-3
    opd = 1e-4 * draw.normal(size=(64, 1, 1)) * x + 2e-8 * draw.normal(size=(64, 12, 12)) + 1e-5 * y**2 / 1e-3
    return xarray.Dataset(
        {
            "opd": (("time", "y", "x"), np.where(lit, opd, np.nan)),
            "weight": (("y", "x"), np.where(lit, np.exp(x / 3e-3), 0.0)),
        },
        {"time": 1e-4 * np.arange(64), "y": axis, "x": axis},
        {"wavelength": 633e-9, "remove": "piston"},
    )


@pytest.mark.parametrize(
    "changed",
    [
        lambda data: data.transpose("x", "y", "time"),
        lambda data: data.isel(y=slice(None, None, -1)),
        lambda data: data.isel(x=slice(None, None, -1)),
        lambda data: data.isel(time=np.random.default_rng(1).permutation(64)),
        lambda data: data.assign_coords({n: (n, 1e3 * data[n].values, {"units": "mm"}) for n in "xy"}),
        lambda data: data.assign_coords(time=("time", 1e3 * data.time.values, {"units": "ms since 2020-01-01"})),
        lambda data: data.assign(opd=(data.opd * 1e9).assign_attrs(units="nm")),
    ],
    ids=["transposed", "y descending", "x descending", "times mixed", "mm", "ms", "nm"],
)
def test_the_order_and_the_units_of_a_dataset_change_no_statistic(changed):
    """Set-up: the same maps with axes in another order or direction, or in other units. Expected: the same numbers.

    Weights were taken in the order of the dataset's own axes, lengths along a falling axis were negative.
    """
    expected, found = statistics(weighted_maps()), statistics(changed(weighted_maps()))
    for name in expected.data_vars:
        if name not in ("pod_mode", "pod_coefficient", "pod_mode_error"):  # whose sign is anybody's
            scale = float(np.nanmax(np.abs(expected[name].values), initial=0.0))
            assert found[name].values == pytest.approx(expected[name].values, abs=1e-8 * scale, nan_ok=True), name


def test_a_unit_of_something_else_is_refused():
    data = weighted_maps()
    data["opd"].attrs["units"] = "rad"
    with pytest.raises(ValueError, match="the unit of opd: 'rad' is no unit of a length that is known; give SI units"):
        statistics(data)
