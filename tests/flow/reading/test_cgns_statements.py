"""What CGNS files state of their whole flow: an axis of symmetry, non-dimensional data."""

import numpy as np
import pytest

from aerokernels import flow

pytest.importorskip("h5py")
pytest.importorskip("vtkmodules")
import cgns_writer
import h5py

Y, X = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(0.0, 2.0, 9), indexing="ij")
DENSITY = 1.0 + 0.1 * Y + 0.01 * X


def symmetric(path, point, vector):
    """A plane whose base has an Axisymmetry_t."""
    cgns_writer.cgns(path, (X, Y), DENSITY, [], more=[("Axis", "Axisymmetry_t")])
    with h5py.File(path, "r+", track_order=True) as file:
        own = file["Base/Axis"]
        cgns_writer.node(own, "AxisymmetryReferencePoint", "DataArray_t", np.array(point, np.float32))
        cgns_writer.node(own, "AxisymmetryAxisVector", "DataArray_t", np.array(vector, np.float32))
    return path


@pytest.mark.parametrize(("vector", "radius", "along"), [([1.0, 0.0], 1.0, "-x"), ([0.0, 1.0], 2.0, "-y")])
def test_an_axis_of_symmetry_makes_the_flow_axisymmetric(tmp_path, vector, radius, along):
    """Set-up: a plane of x up to 2 and y up to 1 about x or y. Expected: r up to 1 or 2. It was read as planar."""
    field = flow.read(symmetric(tmp_path / "a.cgns", [0.0, 0.0], vector))
    assert field.mesh.geometry == "axisymmetric"
    assert f"axisymmetric, z along {along} of the file" in field.provenance
    assert field.mesh.vertices[:, 0].max() == pytest.approx(radius)


def test_an_axis_beside_the_origin_is_refused(tmp_path):
    with pytest.raises(
        ValueError, match=r"its axis of symmetry goes through \[0.5, -1.0, 0.0\] along \[1.0, 0.0, 0.0\]"
    ):
        flow.read(symmetric(tmp_path / "a.cgns", [0.5, -1.0], [1.0, 0.0]))


def test_non_dimensional_data_are_noted(tmp_path):
    kind = "NormalizedByUnknownDimensional"
    file = cgns_writer.cgns(tmp_path / "a.cgns", (X, Y), DENSITY, [], more=[("C", "DataClass_t", kind)])
    assert f"the file calls data {kind}: without a reference" in flow.read(file).provenance
