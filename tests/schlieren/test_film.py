"""Films of series: a lump of gas that passes, whose deflections are those of each snapshot's own picture."""

import numpy as np
import pytest
import xarray

from aerokernels import flow, schlieren
from aerokernels.benches.bench import Bench

TIME = np.array([0.0, 1e-5, 3e-5])
VIEW = {"width": 0.02, "pixel_count": 32}


@pytest.fixture(scope="module")
def series() -> flow.Series:
    y, z = np.meshgrid(np.linspace(-1e-2, 1e-2, 41), np.linspace(-1e-2, 1e-2, 41), indexing="ij")
    # No lump in the first snapshot; then one that moves upstream and grows.
    lumps = [
        1.2 + size * np.exp(-(y**2 + (z - place) ** 2) / (2e-3) ** 2)
        for size, place in ((0.0, 0.0), (0.05, -3e-3), (0.1, 3e-3))
    ]
    grid = {"geometry": "planar", "origin": (-1e-2, -1e-2), "spacing": (5e-4, 5e-4), "ambient_density": 1.2}
    return flow.open_series(lumps, time=TIME, **grid)


def test_each_frame_is_the_picture_of_its_snapshot(series: flow.Series):
    film = schlieren(series, **VIEW)
    assert np.array_equal(film.time, TIME) and len(film.frames) == len(series)
    sensitivity = {frame.sensitivity for frame in film.frames}
    assert len(sensitivity) == 1 and 0.0 < min(sensitivity) < np.inf
    for frame, air in zip(film.frames, series, strict=True):
        own = schlieren(air.index_field(wavelength=905e-9), sensitivity=min(sensitivity), **VIEW)
        assert np.array_equal(frame.intensity, own.intensity) and np.array_equal(frame.opd, own.opd)
    assert np.ptp(film.frames[0].intensity) < 1e-3 < np.ptp(film.frames[1].intensity)
    assert 0.9 < np.ptp(film.frames[2].intensity) <= 1.0  # the strongest snapshot fills the range
    # The lump moves by 6 mm along z, which is the picture's horizontal.
    places = [frame.horizontal[np.nanargmax(frame.opd.max(axis=0))] for frame in film.frames[1:]]
    assert abs(places[1] - places[0]) == pytest.approx(6e-3, abs=1e-3)


def test_a_film_is_a_dataset_over_time(series: flow.Series, tmp_path):
    film = schlieren(series, knife_edge="horizontal", sensitivity=500.0, wavelength=532e-9, **VIEW)
    film.to_xarray().to_netcdf(tmp_path / "film.nc")
    with xarray.open_dataset(tmp_path / "film.nc") as data:
        assert data["intensity"].dims == ("time", "vertical", "horizontal") and data["time"].attrs["units"] == "s"
        assert np.array_equal(data["time"], TIME) and data.attrs["sensitivity_per_rad"] == 500.0
        assert np.array_equal(data["intensity"][2], film.frames[2].intensity)
    assert repr(film).splitlines() == ["SchlierenFilm", "  time: [0.e+00, 1.e-05, 3.e-05] s"]


def test_a_bench_gives_the_film_its_sensitivity(series: flow.Series):
    bench = Bench(1e-3, 1.0)
    film = schlieren(series, bench=bench, **VIEW)
    assert {frame.sensitivity for frame in film.frames} == {bench.sensitivity}
    with pytest.raises(ValueError, match="the bench's source and focal length give it"):
        schlieren(series, bench=bench, sensitivity=500.0, **VIEW)
