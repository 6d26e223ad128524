"""Statistics of datasets of maps by hand: about their mean, in any unit, of few pixels and few times."""

import math

import numpy as np
import pytest
import xarray

from aerokernels import Disc, statistics
from aerokernels.series.pupil_grid import MapReader, pupil_grid
from aerokernels.series.statistic_parts import covers_of
from aerokernels.series.uncertainty import deviations_of, standard_errors

WAVELENGTH = 633e-9


def test_statistics_of_maps_about_their_mean():
    """The steady map, its rms and the rest's, about the mean of as many maps as are independent."""
    draw = np.random.default_rng(8)
    grid = pupil_grid(Disc(0.01), 6)
    count = int(grid.lit.sum())
    maps = 1e-7 * draw.normal(size=(20, count)) + 2e-7 * draw.normal(size=count)
    weight = grid.weight[grid.lit]
    given = {
        "opd": (("time", "y", "x"), np.stack([grid.spread(one) for one in maps])),
        "weight": (("y", "x"), grid.weight),
    }
    found = statistics(
        xarray.Dataset(given, {"time": np.arange(20.0), "y": grid.y, "x": grid.x}, {"wavelength": WAVELENGTH})
    )
    mean, left = maps.mean(axis=0), maps - maps.mean(axis=0)
    unsteady = left**2 @ weight
    error, each = standard_errors(maps)
    independent = weight @ each
    spread, off = deviations_of(maps)
    lit = grid.lit
    assert found.attrs["independent_count"] == pytest.approx(independent)
    np.testing.assert_allclose(found.opd_mean.values[lit], mean, rtol=1e-9)
    np.testing.assert_allclose(found.opd_mean_error.values[lit], error, rtol=1e-9)
    np.testing.assert_allclose(found.opd_std.values[lit], spread, rtol=1e-9)
    np.testing.assert_allclose(spread, maps.std(axis=0) * np.sqrt(each / (each - 1.0)), rtol=1e-9)
    np.testing.assert_allclose(found.opd_std_error.values[lit], off, rtol=1e-9)
    noise = np.mean(unsteady - (left @ weight) ** 2) / (independent - 1.0)
    assert float(found.opd_rms_steady) == pytest.approx(math.sqrt(weight @ (mean - weight @ mean) ** 2 - noise))
    assert float(found.opd_rms_steady_error) == pytest.approx(math.sqrt(weight @ error**2))
    corrected = unsteady.mean() * independent / (independent - 1.0)
    assert float(found.opd_rms_unsteady) == pytest.approx(math.sqrt(corrected))
    rms = [MapReader(grid.coordinates, weight, ("piston",), WAVELENGTH)(one) for one in maps]
    squares = np.array([one.rms_without_tilt**2 for one in rms])
    assert float(found.opd_rms) == pytest.approx(math.sqrt(squares.mean()))
    assert float(found.opd_rms_with_tilt) == pytest.approx(math.sqrt(np.mean([one.rms**2 for one in rms])))
    assert float(found.strehl) == pytest.approx(np.mean([one.strehl for one in rms]))
    large = np.exp(-((2.0 * np.pi / WAVELENGTH) ** 2) * squares)
    assert float(found.strehl_large_aperture) == pytest.approx(large.mean())
    for times in (3, 4):
        some = {"opd": (("time", "y", "x"), given["opd"][1][:times]), "weight": given["weight"]}
        places = {"time": np.arange(float(times)), "y": grid.y, "x": grid.x}
        few = statistics(xarray.Dataset(some, places, {"wavelength": WAVELENGTH}))
        assert np.isfinite(few.opd_mean_error.values[lit]).all() == (times == 4)
        assert np.isfinite(float(few.opd_rms_steady_error)) == (times == 4)
        independent = standard_errors(maps[:times])[1] if times == 4 else 3.0
        expected = maps[:times].std(axis=0) * np.sqrt(independent / (independent - 1.0))
        np.testing.assert_allclose(few.opd_std.values[lit], expected, rtol=1e-9)


def test_units_of_times_lengths_and_maps_are_those_stated():
    """Milliseconds, millimetres and micrometres: the numbers of seconds and metres; dates have no unit."""
    draw = np.random.default_rng(10)
    maps, axis, time = 1e-7 * draw.normal(size=(20, 4, 4)), 1e-3 * np.arange(4.0), 2e-3 * np.arange(20.0)
    plain = xarray.Dataset({"opd": (("time", "y", "x"), maps)}, {"time": time, "y": axis, "x": axis})
    stated = xarray.Dataset(
        {"opd": (("time", "y", "x"), 1e6 * maps, {"units": "um"})},
        {
            name: (name, 1e3 * values, {"units": unit})
            for name, values, unit in (("time", time, "ms"), ("y", axis, "mm"), ("x", axis, "mm"))
        },
    )
    dates = plain.assign_coords(time=np.datetime64("2026-01-01") + (1e6 * time).astype("timedelta64[us]"))
    found = [statistics(one, wavelength=WAVELENGTH) for one in (plain, stated, dates)]
    for other in found[1:]:
        for name in ("opd_rms", "boresight_x", "correlation_length_y", "frequency", "spectrum_opd"):
            np.testing.assert_allclose(other[name], found[0][name], rtol=1e-6)
    wrong = stated.assign_coords(time=("time", time, {"units": "mm"}))
    with pytest.raises(ValueError, match="the unit of time"):
        statistics(wrong, wavelength=WAVELENGTH)


def test_three_pixels_are_a_pupil():
    """A plane has three numbers; shares of two columns of pixels in a disc about their middle."""
    draw = np.random.default_rng(9)
    maps = 1e-7 * draw.normal(size=(5, 2, 2))
    maps[:, 1, 1] = np.nan
    places = {"time": np.arange(5.0), "y": [0.0, 1e-3], "x": [0.0, 1e-3]}
    found = statistics(xarray.Dataset({"opd": (("time", "y", "x"), maps)}, places, {"wavelength": WAVELENGTH}))
    assert float(found.opd_rms) < 1e-18 and float(found.opd_rms_with_tilt) > 1e-8
    maps[:, 0, 1] = np.nan
    with pytest.raises(ValueError, match="fewer than 3 pixels"):
        statistics(xarray.Dataset({"opd": (("time", "y", "x"), maps)}, places, {"wavelength": WAVELENGTH}))
    shares = covers_of(np.array([0.0, 1e-3]), np.array([0.0, 2e-3]), np.ones((2, 2), dtype=bool))(2e-3)
    edges = 1e-3 * np.array([-1.0, 0.0, 1.0]), 2e-3 * np.array([-1.0, 0.0, 1.0])
    np.testing.assert_allclose(shares, Disc(1e-3).coverage(*edges).ravel())


@pytest.mark.parametrize("terms", [("piston",), ("piston", "tilt"), ("piston", "tilt", "focus")])
def test_statistics_are_those_of_the_maps_given(terms: tuple[str, ...]):
    """Another wavelength, a part of the pupil, maps without their mean: fitted anew by least squares.

    A dataset's own Strehl ratios and rms, of the whole pupil at its wavelength, were taken for those of the maps.
    """
    draw = np.random.default_rng(12)
    grid = pupil_grid(Disc(0.01), 8)
    x, y = np.meshgrid(grid.x, grid.y)
    amplitude = 1e-7 * draw.normal(size=(20, 5, 1, 1))
    basis = np.stack([x, y, 50.0 * (x**2 + y**2), np.sin(500.0 * x), np.cos(400.0 * (x + y))])
    whole = np.sum(amplitude * basis / np.abs(basis).max(axis=(1, 2), keepdims=True), axis=1)

    def fit(maps: np.ndarray, lit: np.ndarray, terms: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Return coefficients of x and y, and the maps without the terms."""
        columns = [np.ones(lit.sum())]
        columns += [x[lit], y[lit]] if "tilt" in terms else []
        columns += [(x**2 + y**2)[lit]] if "focus" in terms else []
        root = np.sqrt(grid.weight[lit])
        found = np.linalg.lstsq(np.stack(columns, axis=1) * root[:, None], maps[:, lit].T * root[:, None])[0]
        left = np.full(maps.shape, np.nan)
        left[:, lit] = maps[:, lit] - (np.stack(columns, axis=1) @ found).T
        return found[1:3].T, left

    def mean(maps: np.ndarray, lit: np.ndarray) -> np.ndarray:
        return np.average(maps[:, lit], weights=grid.weight[lit], axis=1)

    tilt, flat = fit(whole, grid.lit, ("tilt",))
    opd = fit(whole, grid.lit, terms)[1]
    times = ("time",)
    numbers = {"strehl": np.abs(mean(np.exp(2j * np.pi / WAVELENGTH * opd), grid.lit)) ** 2}
    numbers |= {"boresight_x": tilt[:, 0], "boresight_y": tilt[:, 1]}
    numbers |= {"opd_rms": np.sqrt(mean(flat**2, grid.lit)), "piston": mean(whole, grid.lit)}
    numbers["opd_rms_with_tilt"] = np.sqrt(mean(fit(whole, grid.lit, ("piston",))[1] ** 2, grid.lit))
    dataset = xarray.Dataset(
        {"opd": (("time", "y", "x"), opd), "weight": (("y", "x"), grid.weight)}
        | {name: (times, value) for name, value in numbers.items()},
        {"time": np.arange(20.0), "y": grid.y, "x": grid.x},
        {"wavelength": WAVELENGTH, "remove": ",".join(terms)},
    )
    part = np.abs(x) < 0.006
    steady = dataset.assign(opd=dataset.opd - dataset.opd.mean("time"))
    for data, wavelength in (
        (dataset, WAVELENGTH),
        (dataset, 2.5 * WAVELENGTH),
        (dataset.where(xarray.DataArray(part, dims=("y", "x"))), WAVELENGTH),
        (dataset.isel(x=slice(2, 6)), WAVELENGTH),
        (steady, WAVELENGTH),
    ):
        found = statistics(data, wavelength=wavelength)
        maps = np.full(opd.shape, np.nan)
        there = np.isin(grid.x, data.x)
        maps[:, :, there] = data.opd.values
        lit = np.isfinite(maps).all(axis=0) & grid.lit
        ratio = np.abs(mean(np.exp(2j * np.pi / wavelength * maps), lit)) ** 2
        assert float(found.strehl) == pytest.approx(ratio.mean(), rel=1e-9, abs=0.0)
        level = fit(maps, lit, ("tilt",))[1]
        assert float(found.opd_rms) == pytest.approx(np.sqrt(mean(level**2, lit).mean()), rel=1e-9, abs=0.0)
        if "focus" in terms:
            continue  # a part of the pupil has the tilt of the focus too, which no dataset has
        plane = tilt[:, :1, None] * x + tilt[:, 1:, None] * y if "tilt" in terms else 0.0
        total, left = fit(maps + plane, lit, ("tilt",))[0], fit(maps + plane, lit, ("piston",))[1]
        assert float(found.boresight_x) == pytest.approx(total[:, 0].mean(), rel=1e-9, abs=1e-15)
        assert float(found.opd_rms_with_tilt) == pytest.approx(np.sqrt(mean(left**2, lit).mean()), rel=1e-9, abs=0.0)
