"""Fields from labelled arrays: where their nodes lie, whatever the order of their coordinates."""

import numpy as np
import pytest
import xarray

from aerokernels.medium.labelled_grid import grid_arguments


@pytest.mark.parametrize("turned", [False, True])
def test_nodes_lie_where_the_coordinates_say(turned):
    """Coordinates that begin away from zero, in millimetres, ascending or not: origin and spacing in metres."""
    y, z = np.array([3.0, 3.5, 4.0]), np.array([-2.0, -1.0, 0.0, 1.0])
    values = np.arange(12.0).reshape(3, 4)
    array = xarray.DataArray(values, dims=("y", "z"), coords={"y": ("y", y, {"units": "mm"}), "z": ("z", z)})
    found = grid_arguments(array[::-1].T if turned else array)
    assert found["origin"] == pytest.approx([3e-3, -2.0]) and found["spacing"] == pytest.approx([0.5e-3, 1.0])
    assert found["geometry"] == "planar"
    np.testing.assert_array_equal(found["contrast"], values)
    with pytest.raises(ValueError, match=r"are not even: node 1 is 0\.0002 m off"):
        grid_arguments(array.assign_coords(y=("y", [3.0, 3.7, 4.0], {"units": "mm"})))
