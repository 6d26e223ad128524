"""Fields from labelled arrays: where their nodes lie, whatever the order of their coordinates."""

import numpy as np
import pytest
import xarray

from aerokernels import IndexField
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
    with pytest.raises(ValueError, match=r"is not even: node 1 is 0\.0002 m off"):
        grid_arguments(array.assign_coords(y=("y", [3.0, 3.7, 4.0], {"units": "mm"})))


def test_coordinates_may_be_rounded_to_single_precision():
    """As most programs write them: 201 nodes from -0.1 m to 0.1 m are up to 4.6e-6 of their spacing off."""
    places = np.linspace(-0.1, 0.1, 201)
    array = xarray.DataArray(
        np.zeros((201, 201)), dims=("y", "z"), coords={"y": places.astype("f4"), "z": places + 5.0}
    )
    found = grid_arguments(array)
    assert found["origin"] == pytest.approx([-0.1, 4.9]) and found["spacing"] == pytest.approx([1e-3, 1e-3], rel=1e-6)
    with pytest.raises(ValueError, match="is not even: node 7 is"):
        grid_arguments(array.assign_coords(y=places + 1e-6 * (np.arange(201) == 7)))


@pytest.mark.parametrize(("unit", "factor"), [("1e-6", 1e-6), ("ppm", 1e-6), ("10⁻⁶", 1e-6), ("%", 1e-2), ("1", 1.0)])
def test_the_contrast_may_have_the_unit_of_a_ratio(unit, factor):
    """Refractivities are mostly written in units of 1e-6; they were taken as contrasts of up to 290."""
    values = np.array([[0.0, 10.0, 290.0]] * 3)
    array = xarray.DataArray(values, dims=("y", "z"), coords={"y": [0.0, 1.0, 2.0], "z": [0.0, 1.0, 2.0]})
    field = IndexField.from_xarray(array.assign_attrs(units=unit))
    np.testing.assert_allclose(field.samples.samples, factor * values, rtol=1e-15)


def test_a_unit_of_a_density_is_no_contrast():
    array = xarray.DataArray(np.full((3, 3), 1.2), dims=("y", "z"), coords={"y": [0.0, 1, 2], "z": [0.0, 1, 2]})
    with pytest.raises(ValueError, match=r"'kg/m3' is no unit of a ratio .* DensityField\.from_xarray and index_field"):
        IndexField.from_xarray(array.assign_attrs(units="kg/m3"))


def test_labelled_samples_in_another_order_are_rejected():
    """Files mostly have z, y, x; the axes were taken by position, without a word."""
    array = xarray.DataArray(np.zeros((3, 3, 3)), dims=("z", "y", "x"))
    grid = {"origin": [0.0] * 3, "spacing": [1.0] * 3, "geometry": "volume"}
    with pytest.raises(
        ValueError, match=r"dimensions z, y, x, and a field x, y, z: take contrast\.transpose\('x', 'y'"
    ):
        IndexField.from_samples(array, **grid)
    assert IndexField.from_samples(array.transpose("x", "y", "z"), **grid).samples.shape == (3, 3, 3)
    assert IndexField.from_samples(array.rename(z="a", y="b", x="c"), **grid).samples.shape == (3, 3, 3)
