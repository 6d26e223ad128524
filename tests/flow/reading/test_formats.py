"""One flow through every format: what is read is what was written, to the last bit where the format keeps it.

Set-up: the files of writers.py, by VTK, h5py, xarray and NumPy, or by hand after the format's description.
Expected: the density at each point, or the average of each cell, is the written one; coordinates follow the frame
z = -x, y = y. Tolerance: equality for float64, 1e-7 relative for float32; averages are compared with the mean over the
corners of the same cell.
"""

import numpy as np
import pytest
import vtk_writers
import writers

from aerokernels import flow


def values_and_truth(field):
    """The field's densities and what was written there."""
    if isinstance(field, flow.CellDensity):
        corners = field.mesh.corners
        return field.density, writers.rho(-corners[..., 1], corners[..., 0]).mean(axis=1)
    at = field.mesh.vertices
    return field.density, writers.rho(-at[:, 1], at[:, 0])


def assert_kept(field, count: int, tolerance: float = 0.0):
    found, expected = values_and_truth(field)
    assert len(found) == count
    assert np.abs(found - expected).max() <= tolerance + 1e-15


POINTS, CELLS = writers.NI * writers.NJ, (writers.NI - 1) * (writers.NJ - 1)


@pytest.mark.parametrize(
    "options",
    [{}, {"records": False}, {"order": ">"}, {"real": "f4"}, {"several": False}, {"text": True}],
    ids=lambda options: "-".join(map(str, options.items())) or "plain",
)
def test_plot3d(tmp_path, options):
    field = flow.read(writers.plot3d(tmp_path / "a", **options))
    assert_kept(field, POINTS, 1e-7 if options.get("real") == "f4" else 0.0)


def test_plot3d_with_blanked_points_has_a_hole_and_a_body_in_it(tmp_path):
    """Set-up: iblank 0 at a block of 4 x 4 points. Expected: the 5 x 5 cells that touch it are no flow but a body."""
    blank = np.ones((writers.NJ, writers.NI), int)
    blank[8:12, 10:14] = 0
    field = flow.read(writers.plot3d(tmp_path / "a", blank=blank))
    assert len(field.mesh.cells) == CELLS - 25
    x, y = writers.grid()
    assert field.body.contains(np.array([[y[10, 12], -x[10, 12]]])).all()
    assert not field.body.contains(np.array([[y[3, 3], -x[3, 3]]])).any()


@pytest.mark.parametrize(
    "options",
    [{}, {"packing": "BLOCK"}, {"in_cells": True}, {"elements": True}, {"elements": True, "in_cells": True}],
    ids=str,
)
def test_tecplot_text(tmp_path, options):
    field = flow.read(writers.tecplot_text(tmp_path / "a.dat", **options))
    assert_kept(field, CELLS if "in_cells" in options else POINTS)
    assert field.mesh.shape is not None  # also of elements, whose rows and columns are found again


@pytest.mark.parametrize(
    "options",
    [{}, {"order": ">"}, {"in_cells": True}, {"elements": True}, {"elements": True, "in_cells": True}],
    ids=str,
)
def test_tecplot_binary(tmp_path, options):
    assert_kept(
        flow.read(writers.tecplot_binary(tmp_path / "a.plt", **options)), CELLS if "in_cells" in options else POINTS
    )


@pytest.mark.parametrize("options", [{}, {"order": ">"}, {"binary": False}], ids=str)
def test_su2(tmp_path, options):
    restart = writers.su2(tmp_path, **options)
    for path, given in ((restart, {}), (tmp_path / "mesh.su2", {}), (restart, {"mesh": tmp_path / "mesh.su2"})):
        field = flow.read(path, **given)
        assert_kept(field, POINTS)
        assert field.body is not None  # the marker is called wall


@pytest.mark.parametrize(("binary", "wedge"), [(False, False), (True, True), (False, True)])
def test_openfoam(tmp_path, binary, wedge):
    """The grid is moved up by 0.02 m; on a wedge the distance from the axis is exact whatever its angle."""
    field = flow.read(writers.foam_wedge(tmp_path / "case", binary=binary, wedge=wedge))
    assert field.geometry == ("axisymmetric" if wedge else "planar")
    corners = field.mesh.corners.mean(axis=1)
    assert np.abs(field.density - writers.rho(-corners[:, 1], corners[:, 0])).max() < 1e-14
    assert field.mesh.shape == (writers.NI, writers.NJ)
    assert field.body.contains(np.array([[0.025, -0.05]])).all()
    assert not field.body.contains(corners).any()


def test_openfoam_times_and_pressure(tmp_path):
    """Set-up: fields p and T at t = 0.25, rho at 0.5. Expected: rho = p / (R T) with R from the molar mass 28."""
    case = writers.foam_wedge(tmp_path / "case")
    early = case / "0.25"
    early.mkdir()
    for name, value in (("p", 1e5), ("T", 300.0)):
        text = f"internalField uniform {value};\nboundaryField {{}}\n".encode()
        (early / name).write_bytes(writers.foam_header("volScalarField", name, False) + text)
    (case / "constant" / "thermophysicalProperties").write_text("mixture { specie { molWeight 28; } }")
    assert flow.contents(case).times == (0.25, 0.5)
    field = flow.read(case, time=0.25)
    assert field.density == pytest.approx(1e5 / (8314.4626 / 28.0 * 300.0), rel=1e-14)
    assert flow.read(case, time="first").density[0] == field.density[0]
    with pytest.raises(flow.ReadError, match=r"no time 0\.3: take one of 0\.25, 0\.5"):
        flow.read(case, time=0.3)


@pytest.mark.parametrize(
    ("end", "text"), [("vti", ""), ("vtr", "-ascii"), ("vts", ""), ("vtu", ""), ("vtk", "-ascii"), ("vtk", "")]
)
def test_vtk(tmp_path, end, text):
    pytest.importorskip("vtkmodules")
    field = flow.read(vtk_writers.vtk_file(tmp_path / f"a.{end}", end + text))
    # VTK writes texts of 8 to 11 digits.
    assert_kept(field, CELLS if end == "vtu" else POINTS, 2e-7 if text else 0.0)


def test_named_arrays(tmp_path):
    x, y = writers.grid()
    np.savez(tmp_path / "a.npz", x=x, y=y, rho=writers.rho(x, y))
    assert_kept(flow.read(tmp_path / "a.npz"), POINTS)
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["grid/x"], file["grid/y"], file["flow/density"] = x, y, writers.rho(x, y)
    assert_kept(flow.read(tmp_path / "a.h5"), POINTS)
    assert_kept(flow.read(tmp_path / "a.h5", density="flow/density", variables={"x": "grid/x", "y": "grid/y"}), POINTS)


@pytest.mark.parametrize("engine", ["h5netcdf", "scipy"])
def test_netcdf_by_its_dimensions(tmp_path, engine):
    """Set-up: a square array of dimensions (time, y, x), lengths in mm: its shape cannot tell which axis is which."""
    xarray = pytest.importorskip("xarray")
    x, y = np.linspace(0.0, 100.0, 12), np.linspace(0.0, 30.0, 12)
    values = writers.rho(*np.meshgrid(1e-3 * x, 1e-3 * y))
    data = xarray.Dataset(
        {"rho": (("time", "y", "x"), np.stack([values + 1.0, values]))},
        {"x": ("x", x, {"units": "mm"}), "y": ("y", y, {"units": "mm"}), "time": [0.0, 0.5]},
    )
    data.to_netcdf(tmp_path / "a.nc", engine=engine)
    assert_kept(flow.read(tmp_path / "a.nc"), 144, 1e-15)
    assert flow.read(tmp_path / "a.nc", time=0.0).density.min() > 1.9
    assert_kept(flow.DensityField.from_xarray(data), 144, 1e-15)


def test_table_of_points(tmp_path):
    """Points on a grid in any order are the grid again; others are joined by triangles, right at the points."""
    x, y = (own.ravel() for own in np.meshgrid(np.linspace(0.0, 0.1, 12), np.linspace(0.0, 0.05, 7)))
    order = np.random.default_rng(1).permutation(x.size)
    table = np.stack([x, y, writers.rho(x, y)], axis=1)[order]
    head = {"delimiter": ",", "header": "x [m],y [m],rho [kg/m3]", "comments": "", "fmt": "%.17g"}
    np.savetxt(tmp_path / "grid.csv", table, **head)
    field = flow.read(tmp_path / "grid.csv")
    assert_kept(field, x.size)
    assert field.mesh.shape == (7, 12)
    x, y = (own.ravel() for own in writers.grid())
    np.savetxt(tmp_path / "cloud.csv", np.stack([x, y, writers.rho(x, y)], axis=1), **head)
    field = flow.read(tmp_path / "cloud.csv")
    inside = np.flatnonzero((x > 0.02) & (x < 0.09) & (y > 0.015) & (y < 0.04))
    at = np.stack([0.0 * x, y, -x], axis=1)[inside]
    assert np.abs(field.density_at(at) - writers.rho(x, y)[inside]).max() < 1e-12


def test_an_su2_mesh_of_zones_with_comments(tmp_path):
    """Set-up: a mesh of two zones, comments and empty lines in its lists, markers between processes, and a restart.

    Expected: the zone that has as many points as the restart is read, and said; the other is another zone.
    """
    restart = writers.su2(tmp_path, binary=False)
    field = flow.read(restart)
    mesh = tmp_path / "mesh.su2"
    own = mesh.read_text().splitlines()
    other = ["NDIME= 2", "NELEM= 1", "% a list", "9 0 1 2 3", "NPOIN= 4", "0 0", "", "1 0", "1 1 % a point", "0 1"]
    shared = ["MARKER_TAG= SEND_RECEIVE", "MARKER_ELEMS= 2", "SEND_TO= 1", "1 0 0", "1 1 0"]
    mesh.write_text("\n".join(["NZONE= 2", "IZONE= 1", *other, *shared, "IZONE= 2", *own]) + "\n")
    again = flow.read(restart)
    assert "zone 2 of 2" in again.provenance and np.array_equal(again.density, field.density)
    assert len(flow.contents(mesh).zones) == 1
    restart.unlink()
    assert len(flow.contents(mesh).zones) == 2


@pytest.mark.parametrize("kind", ["hdf5", "npz"])
def test_ends_of_axes_make_even_cells(tmp_path, kind):
    """Set-up: averages without coordinates, the ends of x and y in attributes, as solvers leave them, or given.

    Expected: each average at the middle of its cell, x along the first axis; ends that decrease are refused.
    """
    values = np.random.default_rng(6).uniform(1.0, 2.0, (5, 3))
    given = {}
    if kind == "hdf5":
        h5py = pytest.importorskip("h5py")
        path = tmp_path / "a.h5"
        with h5py.File(path, "w") as file:
            file["state/density/data"] = values
            file.create_group("grid").attrs.update(xmin=0.0, xmax=0.5, ymin=-0.1, ymax=0.2)
    else:
        path, given = tmp_path / "a.npz", {"variables": {"x": [0.0, 0.5], "y": (-0.1, 0.2)}}
        np.savez(path, density=values)
        with pytest.raises(flow.ReadError, match=r"ends of x are \[1, 0\]: give two numbers that increase"):
            flow.read(path, variables={"x": [1, 0], "y": [0, 1]})
        with pytest.raises(flow.ReadError, match="no coordinates are known"):
            flow.read(path)
    field = flow.read(path, **given)
    x, y = np.meshgrid(0.05 + 0.1 * np.arange(5), -0.05 + 0.1 * np.arange(3), indexing="ij")
    at = np.stack([0.0 * x, y, -x], axis=-1).reshape(-1, 3)
    assert isinstance(field, flow.CellDensity) and "5 x 3 even cells" in field.provenance
    assert np.array_equal(field.density_at(at), values.ravel())
