"""VTK's data sets: cells of every kind, holes and pieces, surfaces, series in time; what holds no flow is refused."""

import numpy as np
import pytest
import vtk_writers
import writers

from aerokernels import DensityField, flow
from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.readers import vtk_files

pytest.importorskip("vtkmodules")
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkIdList, vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkMultiBlockDataSet, vtkPolyData, vtkTable, vtkUnstructuredGrid

# Corners of the unit cube in the order of a hexahedron, and the middles of its edges in that of a quadratic one.
CORNERS = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)], float)
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
FACES = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]


def points_of(places) -> vtkPoints:
    points = vtkPoints()
    points.SetData(numpy_to_vtk(np.array(places, float), deep=True))
    return points


def named(values, name: str = "rho"):
    array = numpy_to_vtk(np.array(values, float), deep=True)
    array.SetName(name)
    return array


def cubes(kind: int):
    """Two cubes beside one another along x, the first of a kind of VTK's and the second a hexahedron."""
    more = [CORNERS[list(edge)].mean(axis=0) for edge in EDGES] if kind == 25 else []
    data = vtkUnstructuredGrid()
    data.SetPoints(points_of([*CORNERS, *CORNERS[[1, 2, 5, 6]] + [1.0, 0.0, 0.0], *more]))
    if kind == 42:
        stream = vtkIdList()
        for number in (len(FACES), *(n for face in FACES for n in (4, *face))):
            stream.InsertNextId(number)
        data.InsertNextCell(kind, stream)
    else:
        order = {11: [0, 1, 3, 2, 4, 5, 7, 6], 25: [*range(8), *range(12, 24)]}.get(kind, list(range(8)))
        data.InsertNextCell(kind, len(order), order)
    data.InsertNextCell(12, 8, [1, 8, 9, 2, 5, 10, 11, 6])
    data.GetCellData().AddArray(named([1.0, 3.0]))
    return data


@pytest.mark.parametrize("kind", [12, 11, 25, 42], ids=["hexahedron", "voxel", "quadratic", "polyhedron"])
def test_cells_of_every_kind(kind):
    """Averages 1 and 3 over two unit cubes. Expected: 1 and 3 in their far halves, to 1e-12, on a grid of 0.25 m.

    Between them a slope is put where cells know their neighbours.
    """
    field = DensityField.from_pyvista(cubes(kind), spacing=0.25)
    far = np.array([[0.1, 0.4, 0.6], [0.45, 0.9, 0.2], [1.55, 0.1, 0.7], [1.9, 0.6, 0.4]])
    assert field.density_at(far) == pytest.approx([1.0, 1.0, 3.0, 3.0], abs=1e-12)


def test_a_surface_of_polygons_and_its_texts(tmp_path):
    """A surface as of a slice, with an array of texts, which is left out."""
    x, y = writers.grid()
    data = vtkPolyData()
    data.SetPoints(points_of(np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)))
    data.Allocate(len(writers.quads()))
    for quad in writers.quads():
        data.InsertNextCell(7, 4, [int(n) for n in quad])
    words = vtkStringArray()
    words.SetName("words")
    words.SetNumberOfValues(x.size)
    data.GetPointData().AddArray(words)
    data.GetPointData().AddArray(named(writers.rho(x, y).ravel()))
    field = DensityField.from_pyvista(data, geometry="planar")
    middle = [[0.0, float(y[3, 4]), -float(x[3, 4])]]
    assert field.density_at(middle) == pytest.approx(writers.rho(x[3, 4], y[3, 4]), rel=1e-12)
    data.InsertNextCell(3, 2, [0, 1])
    with pytest.raises(ReadError, match="it mixes polygons with lines or points"):
        DensityField.from_pyvista(data)


@pytest.mark.parametrize("where", ["cells", "points"])
def test_hidden_cells_and_points_are_holes(where):
    """Cells that another piece has, and points that are blanked, are no flow: the field is what is around them."""
    data = vtk_writers.vtk_grid(cells=where == "cells")
    attributes = data.GetCellData() if where == "cells" else data.GetPointData()
    ghosts = np.zeros((writers.NJ - 1, writers.NI - 1) if where == "cells" else (writers.NJ, writers.NI), np.uint8)
    ghosts[2:5, 3:6] = 32 if where == "cells" else 2
    attributes.AddArray(marked := numpy_to_vtk(ghosts.ravel(), deep=True))
    marked.SetName("vtkGhostType")
    x, y = writers.grid()
    inside = np.array([y[3:5, 4:6].mean(), -x[3:5, 4:6].mean()])
    open_field = DensityField.from_pyvista(vtk_writers.vtk_grid(cells=where == "cells"))
    holed = DensityField.from_pyvista(data)
    assert open_field.body is None and holed.body is not None
    assert len(holed.mesh.cells) < len(open_field.mesh.cells)
    low, high = holed.body.profile.min(axis=0), holed.body.profile.max(axis=0)
    assert (low < inside).all() and (inside < high).all()


def test_what_holds_no_flow_is_refused(tmp_path):
    empty, table = vtkUnstructuredGrid(), vtkTable()
    for data, told in ((empty, "it has no points"), (table, "a vtkTable is not a mesh")):
        with pytest.raises(ReadError, match=told):
            vtk_files.blocks_of(tmp_path, data, {})
    blocks = vtkMultiBlockDataSet()
    blocks.SetBlock(0, empty)
    with pytest.raises(ReadError, match="it has no block with points"):
        vtk_files.blocks_of(tmp_path, blocks, {})
    blocks.SetBlock(1, vtk_writers.vtk_grid())
    blocks.GetMetaData(1).Set(vtkMultiBlockDataSet.NAME(), "zone")
    assert [block.name for block in vtk_files.blocks_of(tmp_path, blocks, {})] == ["zone"]
    short = vtk_writers.vtk_grid()
    short.GetPointData().AddArray(named([1.0, 2.0], "short"))
    with pytest.raises(ReadError, match=f"array 'short' has 2 entries instead of {writers.NI * writers.NJ}"):
        vtk_files.blocks_of(tmp_path, short, {})


def test_a_series_of_files(tmp_path):
    """Three times in a .pvd. Expected: each by "first", "latest" and its time; another is refused and those named."""
    for k in range(3):
        data = vtk_writers.vtk_grid()
        data.GetPointData().AddArray(named(np.full(writers.NI * writers.NJ, 1.0 + k)))
        vtk_writers.write_vtk(tmp_path / f"{k}.vts", data)
    listed = "".join(f'<DataSet timestep="{0.5 * k}" file="{k}.vts"/>' for k in range(3))
    path = tmp_path / "a.pvd"
    path.write_text(f'<VTKFile type="Collection"><Collection>{listed}</Collection></VTKFile>')
    for time, expected in ((None, 3.0), ("latest", 3.0), ("first", 1.0), (0.5, 2.0)):
        read = vtk_files.read(path, time)
        assert read.blocks[0].point_data["rho"][0] == expected and read.times == [0.0, 0.5, 1.0]
    with pytest.raises(ReadError, match=r"there is no time 0\.7: take one of 0, 0\.5, 1, 'first' or 'latest'"):
        vtk_files.read(path, 0.7)
    with pytest.raises(ValueError, match="time must be 'latest', 'first' or a time in seconds, got 'last'"):
        flow.read(path, time="last")
    for text, told in (
        ("<VTKFile/>", "it lists no data sets"),
        ('<VTKFile><DataSet timestep="0" file="x.vts"/></VTKFile>', "it lists x.vts, which is not there"),
        ('<VTKFile><DataSet timestep="now" file="0.vts"/></VTKFile>', "it is not a list of data sets"),
    ):
        path.write_text(text)
        with pytest.raises(ReadError, match=told):
            vtk_files.read(path)


@pytest.mark.parametrize("name", ["a.csv", "a.vts"])
def test_a_file_of_one_time_has_no_other(tmp_path, name):
    x, y = writers.grid()
    if name == "a.csv":
        rows = "\n".join(
            f"{a},{b},{c}" for a, b, c in zip(x.ravel(), y.ravel(), writers.rho(x, y).ravel(), strict=True)
        )
        (tmp_path / name).write_text(f"x,y,rho\n{rows}\n")
    else:
        vtk_writers.write_vtk(tmp_path / name, vtk_writers.vtk_grid())
    assert flow.read(tmp_path / name, time="latest").ambient_density > 0.0
    with pytest.raises(ReadError, match=r"it has one time only, not t = 3\.0: leave time out"):
        flow.read(tmp_path / name, time=3.0)


@pytest.mark.parametrize("cells", [False, True], ids=["points", "cells"])
def test_an_even_grid_in_single_precision_is_kept(tmp_path, cells):
    """Set-up: a rectilinear grid whose coordinates are float32, offset by five times its size. It was resampled.

    Expected: the file's own nodes, with its densities at points to the last bit.
    """
    from vtkmodules import vtkCommonDataModel
    from vtkmodules.util.numpy_support import numpy_to_vtk

    counts = (40, 30, 20)
    axes = [(0.5 + np.linspace(0.0, 0.1, n)).astype(np.float32) for n in counts]
    grid = vtkCommonDataModel.vtkRectilinearGrid()
    grid.SetDimensions(*counts)
    for put, axis in zip((grid.SetXCoordinates, grid.SetYCoordinates, grid.SetZCoordinates), axes, strict=True):
        put(numpy_to_vtk(axis, deep=1))
    shape = [n - 1 for n in counts] if cells else counts
    density = 1.0 + 0.1 * np.random.default_rng(0).random(shape)
    array = numpy_to_vtk(density.ravel(order="F"), deep=1)
    array.SetName("rho")
    (grid.GetCellData() if cells else grid.GetPointData()).AddArray(array)
    field = flow.read(vtk_writers.write_vtk(tmp_path / "a.vtr", grid))
    assert field.density.shape == counts and "resampled" not in field.provenance
    assert field.spacing == pytest.approx([0.1 / (n - 1) for n in counts], rel=1e-5)
    assert cells or (field.density == density).all()


@pytest.mark.parametrize(("flag", "hidden"), [(1, True), (2, False), (4, False), (8, True), (16, False), (32, True)])
def test_flags_of_cells_that_hold_flow_hide_nothing(flag, hidden):
    """Set-up: one of the flags of VTK's ghost cells on the middle one of three by three cells.

    Expected: duplicate, refined and hidden cells hold no flow of their own. Cells of high connectivity do; they were
    taken for hidden ones, as points with this flag are.
    """
    data = vtkImageData()
    data.SetDimensions(4, 4, 1)
    data.GetPointData().AddArray(named(np.ones(16)))
    flags = numpy_to_vtk(np.where(np.arange(9) == 4, flag, 0).astype(np.uint8), deep=True)
    flags.SetName("vtkGhostType")
    data.GetCellData().AddArray(flags)
    assert len(DensityField.from_pyvista(data).mesh.cells) == (8 if hidden else 9)
