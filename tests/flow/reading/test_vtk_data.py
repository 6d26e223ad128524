"""VTK's data sets: cells of every kind, holes and pieces, surfaces, series in time; what holds no flow is refused."""

import numpy as np
import pytest
import vtk_writers
import writers

from aerokernels import DensityField, flow
from aerokernels.flow.reading.dataset import ReadError

pytest.importorskip("vtkmodules")
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkIdList, vtkPoints, vtkStringArray
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPolyData, vtkUnstructuredGrid

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
