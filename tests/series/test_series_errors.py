"""Errors of a series' numbers: told for all snapshots from few, and within the truth of Fourier modes."""

import numpy as np
import pytest
import xarray

from aerokernels import Annulus, Disc, Rectangle, flow, optical_series, statistics
from aerokernels.series.pupil_grid import pupil_grid

from .fourier import WAVELENGTH, Fourier

NUMBERS = ("strehl", "boresight_x", "boresight_y", "piston", "opd_rms", "opd_rms_with_tilt")


def opened(seed: int, nodes: int, count: int = 1, strength=lambda k: 1.0) -> flow.Series:
    """Modes of random phases in a box of 0.1 m; `strength` of each snapshot."""
    step, arrays = 0.1 / (nodes - 1), []
    for k in range(count):
        field = Fourier.random(seed, wavenumber=150.0, amplitude=0.01)
        field.mean = 0.0
        arrays.append(1.0 + strength(k) * field.on_grid((-0.05, -0.05, 0.0), step, (nodes,) * 3, 2e-5 * k))
    grid = {"geometry": "volume", "origin": (-0.05, -0.05, 0.0), "spacing": (step,) * 3}
    return flow.open_series(arrays, time=1e-5 * np.arange(count), ambient_density=1.0, **grid)


@pytest.mark.parametrize(("seed", "direction"), [(0, (0.0, 0.0, 1.0)), (1, (0.15, -0.1, 1.0))])
def test_errors_cover_the_truth(seed: int, direction):
    """25 nodes a side and 48 pixels against 97 nodes and 144 pixels."""
    pupil = Disc(0.02, (0.0, 0.0, 0.0))
    options = {"direction": np.array(direction) / np.linalg.norm(direction), "tolerance": 1e-3}
    found = optical_series(opened(seed, 25), pupil, pixel_count=48, **options).isel(time=0)
    true = optical_series(opened(seed, 97), pupil, pixel_count=144, **options).isel(time=0)
    ratio = {name: float(found[f"{name}_error"] / abs(found[name] - true[name])) for name in NUMBERS}
    assert min(ratio.values()) > 1.0, ratio
    assert np.median(list(ratio.values())) < 30.0, ratio
    told = float(found.error)
    off = found.opd.values - true.opd.values[1::3, 1::3]  # at the same places
    assert np.mean(np.abs(off[np.isfinite(off)]) < told) > 0.8 and told < 10.0 * np.nanstd(off)


def test_each_snapshot_has_the_errors_of_the_nearest():
    """20 snapshots of which the seventh to the ninth are three times as strong: those, and those after, have others."""
    series = opened(5, 17, 20, lambda k: 3.0 if 7 <= k < 10 else 1.0)
    found = optical_series(series, Disc(0.02), pixel_count=24)
    error = found.error.values
    assert np.isfinite(error).all() and np.unique(error).size == 3  # at 0, 7 and 10
    assert (error[:4] == error[0]).all() and (error[5:9] == error[7]).all() and (error[10:] == error[10]).all()
    assert error[7] == pytest.approx(3.0 * error[0], rel=0.4)
    own = found.strehl_error.values
    assert np.unique(own).size > 4  # the part of the pixels is each one's own


@pytest.mark.parametrize(
    ("pupil", "count"), [(Disc(0.01), 23), (Annulus(0.01, 0.004), 16), (Rectangle(0.02, 0.013), 32)]
)
def test_pixels_tell_slopes_and_rms_of_a_smooth_map(pupil, count: int):
    """Coma, focus and tilt against the same on 16 times the pixels."""

    def told(count: int):
        grid = pupil_grid(pupil, count)
        reader = grid.reader(np.ones(len(grid.points), dtype=bool), ("piston", "tilt"), WAVELENGTH)
        x, y = grid.coordinates.T / 0.01
        opd = WAVELENGTH * (0.1 * (3.0 * (x**2 + y**2) - 2.0) * x + 0.08 * (x**2 + y**2) + 0.3 * y)
        return reader(opd).numbers, reader.sampling(opd, reader(opd))

    (found, error), (true, _) = told(count), told(16 * count)
    floor = np.array([1e-6, 1e-10, 1e-10, 1e-13, 1e-13, 1e-13])
    assert (np.abs(found - true) <= error + floor).all()
    assert (error < 100.0 * np.abs(found - true) + 100.0 * floor).all()


def test_statistics_have_the_errors_of_their_maps():
    """Numbers that do not vary in time have no other error: half of the snapshots' own, which cover 95 of 100 cases."""
    series = opened(6, 17)
    one = optical_series(series, Disc(0.02), pixel_count=24)
    maps = xarray.concat([one.assign_coords(time=[1e-5 * k]) for k in range(8)], "time", data_vars="minimal")
    found, alone = statistics(maps), statistics(maps.drop_vars("error"))
    for name in ("strehl", "opd_rms", "opd_rms_with_tilt", "boresight_x", "boresight_y"):
        assert float(alone[f"{name}_error"]) == 0.0
        assert float(found[f"{name}_error"]) == pytest.approx(0.5 * float(one[f"{name}_error"][0])), name
    assert float(found.opd_mean_error.max()) == pytest.approx(0.5 * float(one.error[0]))
    share = float(one.opd_rms_error[0] / one.opd_rms[0])
    assert float(found.opd_rms_aperture_error[-1]) == pytest.approx(
        0.5 * share * float(found.opd_rms_aperture[-1]), rel=1e-6
    )
    ratio = float(found.strehl_large_aperture)
    assert float(found.strehl_large_aperture_error) == pytest.approx(-share * ratio * np.log(ratio), rel=1e-6)
    other = statistics(maps, wavelength=2.0 * WAVELENGTH)
    assert 0.0 < float(other.strehl_error) < 0.5 * float(found.strehl_error)
