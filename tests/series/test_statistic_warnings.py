"""What statistics in time say of lost pixels and of uneven times."""

import warnings

import numpy as np
import pytest

from aerokernels import flow, statistics

from .test_statistics import drawn


def test_pixels_that_are_lost_for_a_while_are_in_no_statistic():
    """Set-up: half of the maps has no number in snapshot 7. Expected: a warning of that half, in the result as well.

    Pixels that are left out of all snapshots are left out on purpose.
    """
    maps = drawn(40, 3)
    left = maps.x < 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        part = statistics(maps.where(left))
    lossy = maps.copy(deep=True)
    lossy["opd"] = maps.opd.where((maps.time != maps.time[7]) | left)
    with pytest.warns(UserWarning, match=r"^50 % of the pupil is in no statistic, .* 50 % of it in snapshot 7: "):
        found = statistics(lossy)
    assert float(found.opd_rms) == float(part.opd_rms) and part.attrs["warnings"] == ""
    assert found.attrs["warnings"].startswith("50 % of the pupil")


def test_means_over_snapshots_at_uneven_times_are_not_means_over_time():
    """Set-up: as many snapshots in a hundredth of the time. Expected: the warning, and none where times are even."""
    maps = drawn(40, 3)
    dense = maps.assign_coords(time=np.append(np.arange(20) * 1e-4, 20e-4 + np.arange(20) * 1e-6))
    with pytest.warns(UserWarning, match=r"times are uneven, with steps of 1e-06 to 0\.0001 s"):
        assert "times are uneven" in statistics(dense).attrs["warnings"]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        statistics(dense.interp(time=np.linspace(0.0, 20e-4, 40)))


def test_times_that_are_no_numbers_are_refused_in_words():
    arrays = [np.ones((3, 3))] * 2
    where = {"geometry": "planar", "origin": [0, 0], "spacing": [1, 1], "ambient_density": 1.0}
    with pytest.raises(ValueError, match="time must be numbers of seconds, or dates, one for each snapshot, got"):
        flow.open_series(arrays, time=["0 ms", "1 ms"], **where)
