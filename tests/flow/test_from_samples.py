"""`DensityField.from_samples`: the field of an array in memory, and what it refuses."""

import numpy as np
import pytest
import xarray

from aerokernels import DensityField, flow
from aerokernels.medium import Body

GRID = {"origin": (0.0, -0.04), "spacing": (0.01, 0.01), "geometry": "axisymmetric", "ambient_density": 1.2}
R, Z = np.meshgrid(0.01 * np.arange(6), -0.04 + 0.01 * np.arange(5), indexing="ij")
LINEAR = 1.2 + 0.3 * Z - 0.5 * R


def test_it_is_the_grid_of_the_array():
    """A linear density is met anywhere on the grid; outside it the air is ambient; n - 1 is K times the density."""
    body = Body([[0.0, -0.04], [0.005, -0.04], [0.0, -0.03]])
    field = DensityField.from_samples(LINEAR, **GRID, body=body, provenance="a formula")
    assert isinstance(field, flow.GridDensity) and field.geometry == "axisymmetric" and field.provenance == "a formula"
    np.testing.assert_allclose(field.box, [[0.0, -0.04], [0.05, 0.0]])
    points = np.array([[0.012, 0.016, -0.013], [0.0, 0.033, -0.021], [0.2, 0.0, 0.0], [0.0, 0.001, -0.039]])
    expected = [1.2 - 0.3 * 0.013 - 0.5 * 0.02, 1.2 - 0.3 * 0.021 - 0.5 * 0.033, 1.2, np.nan]
    np.testing.assert_allclose(field.density_at(points), expected, rtol=1e-12)
    index = field.index_field(633e-9, constant=2.2e-4, interpolation="linear")
    np.testing.assert_allclose(index.contrast_at(points)[:2], 2.2e-4 * (np.array(expected[:2]) - 1.2), atol=1e-18)
    assert index.body is body


@pytest.mark.parametrize("kind", [np.float32, np.int64])
def test_arrays_of_other_kinds(kind):
    """Of DLPack and of whole numbers; averages of cells keep a field's integral."""
    density = (2 + (np.arange(24).reshape(6, 4) % 3)).astype(kind)
    of_cells = DensityField.from_samples(
        density, origin=(0, 0), spacing=(1e-3, 2e-3), geometry="planar", ambient_density=1.0, cell_averages=True
    )
    np.testing.assert_array_equal(of_cells.density, density)
    assert of_cells.density.dtype == np.float64 and of_cells.cell_averages


def test_it_equals_the_field_of_an_xarray():
    array = xarray.DataArray(LINEAR, dims=("r", "z"), coords={"r": R[:, 0], "z": Z[0]}, attrs={"units": "kg/m3"})
    one = DensityField.from_xarray(array, ambient_density=1.2)
    points = np.random.default_rng(4).uniform([0.0, 0.0, -0.04], [0.05, 0.0, 0.0], (20, 3))
    other = DensityField.from_samples(LINEAR, **GRID)
    np.testing.assert_allclose(one.density_at(points), other.density_at(points), rtol=1e-12)
    with pytest.raises(ValueError, match=r"take density.transpose\('r', 'z'\), or DensityField.from_xarray"):
        DensityField.from_samples(array.T, **GRID)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"density": np.where(LINEAR > 1.19, np.nan, LINEAR)}, "densities on the grid are not finite: the first is"),
        ({"density": 1e3 * LINEAR}, "too great for a gas"),
        ({"density": np.ma.masked_greater(LINEAR, 1.19)}, "are masked"),
        ({"density": LINEAR.astype(complex)}, "real numbers"),
        ({"density": LINEAR[0]}, "cannot have densities of shape"),
        ({"geometry": "conical"}, "geometry"),
        ({"spacing": (0.01, -0.01)}, "spacing must be positive"),
        ({"origin": (0.01, 0.0)}, "starts at r = 0"),
        ({"ambient_density": 0.0}, "ambient_density must be"),
        ({"body": Body([[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]], "planar")}, "the body is planar"),
    ],
)
def test_what_is_refused(change: dict, message: str):
    with pytest.raises((TypeError, ValueError), match=message):
        DensityField.from_samples(**{"density": LINEAR, **GRID, **change})
