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


def test_coordinates_may_be_rounded_to_single_precision():
    """As most programs write them: 201 nodes from -0.1 m to 0.1 m are up to 4.6e-6 of their spacing off."""
    places = np.linspace(-0.1, 0.1, 201)
    array = xarray.DataArray(
        np.zeros((201, 201)), dims=("y", "z"), coords={"y": places.astype("f4"), "z": places + 5.0}
    )
    found = grid_arguments(array)
    assert found["origin"] == pytest.approx([-0.1, 4.9]) and found["spacing"] == pytest.approx([1e-3, 1e-3], rel=1e-6)
    with pytest.raises(ValueError, match="are not even: node 7 is"):
        grid_arguments(array.assign_coords(y=places + 1e-6 * (np.arange(201) == 7)))
