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
    with pytest.warns(UserWarning, match=f"the file calls data {kind}: without a reference"):
        assert f"the file calls data {kind}: without a reference" in flow.read(file).provenance


def test_coordinates_of_a_cylinder_are_refused(tmp_path):
    """Expected: their names; a plane of r and z was read as another plane, of x = 0."""
    file = cgns_writer.cgns(tmp_path / "a.cgns", (X, Y), DENSITY, [])
    with h5py.File(file, "r+", track_order=True) as opened:
        grid = opened["Base/Zone/GridCoordinates"]
        for old, new in (("CoordinateX", "CoordinateR"), ("CoordinateY", "CoordinateTheta")):
            del grid[old]
            cgns_writer.node(grid, new, "DataArray_t", X)
    with pytest.raises(ValueError, match=r"zone 'Zone' has the coordinates CoordinateR, CoordinateTheta: write"):
        flow.read(file)


def test_several_solutions_need_to_say_which_counts(tmp_path):
    """Two times without pointers to their solutions are refused: the first counted at both. With them each counts."""
    file = cgns_writer.cgns(tmp_path / "a.cgns", (X, Y), DENSITY, [])
    with h5py.File(file, "r+", track_order=True) as opened:
        base, zone = opened["Base"], opened["Base/Zone"]
        cgns_writer.node(cgns_writer.node(zone, "Later", "FlowSolution_t"), "Density", "DataArray_t", 2.0 * DENSITY)
        times = cgns_writer.node(base, "Times", "BaseIterativeData_t", [2])
        cgns_writer.node(times, "TimeValues", "DataArray_t", np.array([0.5, 1.5]))
    with pytest.raises(ValueError, match=r"zone 'Zone' has Density in Flow and in Later, and no FlowSolutionPointers"):
        flow.read(file)
    with h5py.File(file, "r+", track_order=True) as opened:
        held = cgns_writer.node(opened["Base/Zone"], "ZoneTimes", "ZoneIterativeData_t")
        names = np.frombuffer(b"Flow".ljust(32) + b"Later".ljust(32), np.int8).reshape(2, 32)
        cgns_writer.node(held, "FlowSolutionPointers", "DataArray_t", "text")
        del held["FlowSolutionPointers/ data"]
        held["FlowSolutionPointers"][" data"] = names
    for time, factor in ((0.5, 1.0), (1.5, 2.0)):
        assert flow.read(file, time=time).density.max() == pytest.approx(factor * DENSITY.max())
