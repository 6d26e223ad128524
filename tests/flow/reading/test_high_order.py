"""Files of discontinuous elements: Lagrange cells of high order, and points that each element has for itself."""

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

import vtk_writers
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import (
    vtkHigherOrderHexahedron,
    vtkHigherOrderQuadrilateral,
    vtkMultiBlockDataSet,
    vtkUnstructuredGrid,
)

from aerokernels import DensityField, flow

QUAD, HEXAHEDRON, WEDGE = 70, 72, 73


def lagrange(axes: int, order: int, elements: int, density):
    """elements^axes Lagrange cells of the unit square or cube, each with points of its own, and a density there."""
    place = (vtkHigherOrderQuadrilateral if axes == 2 else vtkHigherOrderHexahedron).PointIndexFromIJK
    nodes = list(np.ndindex(*[order + 1] * axes))
    own = np.empty((len(nodes), 3))
    for index in nodes:
        own[place(*index, [order] * axes)] = [*index, *[0] * (3 - axes)]
    shifts = np.array([[*shift, *[0] * (3 - axes)] for shift in np.ndindex(*[elements] * axes)])
    points = (shifts[:, None] + own / order).reshape(-1, 3) / elements
    grid, at = vtkUnstructuredGrid(), vtkPoints()
    at.SetDataTypeToDouble()
    at.SetData(numpy_to_vtk(points, deep=True))
    grid.SetPoints(at)
    for cell in range(len(shifts)):
        numbers = cell * len(nodes) + np.arange(len(nodes))
        grid.InsertNextCell(QUAD if axes == 2 else HEXAHEDRON, len(nodes), numbers.tolist())
    values = numpy_to_vtk(density(points, np.repeat(np.arange(len(shifts)), len(nodes))), deep=True)
    values.SetName("rho")
    grid.GetPointData().AddArray(values)
    sizes = numpy_to_vtk(1.0 + np.arange(float(len(shifts))), deep=True)
    sizes.SetName("element")
    grid.GetCellData().AddArray(sizes)
    return grid


def linear(points, element=None):
    return 1.2 + points @ np.array([0.3, -0.2, 0.1])


@pytest.mark.parametrize(("axes", "order"), [(2, 3), (3, 2)])
def test_lagrange_cells_keep_the_values_at_their_nodes(tmp_path, axes, order):
    """Set-up: a linear density at the nodes of 3^d elements. Expected: the same between them; a value per element too.

    Each element's own value is in all of its linear parts.
    """
    path = vtk_writers.write_vtk(tmp_path / "a.vtu", lagrange(axes, order, 3, linear))
    found = flow.read(path, frame={"optical": "z", "up": "y"} if axes == 3 else None)
    inside = np.random.default_rng(1).uniform(0.01, 0.99, (200, 3))
    if axes == 2:  # a file in the plane x-y: z runs along -x
        inside[:, 2] = 0.0
        expected = linear(inside)
        inside = np.stack([np.zeros(200), inside[:, 1], -inside[:, 0]], axis=1)
    else:
        expected = linear(inside)
    assert found.density_at(inside) == pytest.approx(expected, rel=1e-12)
    assert "elements that have points of their own" in found.provenance
    if axes == 2:
        by_element = flow.read(path, density="element").density
        assert np.array_equal(np.unique(by_element, return_counts=True)[1], np.full(9, order**2))


def test_values_of_elements_in_one_place_are_averaged(tmp_path):
    """Set-up: 1 and 2 kg/m3 in two halves of a square. Expected: 1.5 where they meet, the halves elsewhere."""

    def halves(points, element):
        return np.where(element < 2, 1.0, 2.0)

    found = flow.read(vtk_writers.write_vtk(tmp_path / "a.vtu", lagrange(2, 2, 2, halves)))
    at = np.array([[0.0, 0.3, -x] for x in (0.1, 0.5, 0.9)])
    assert found.density_at(at) == pytest.approx([1.0, 1.5, 2.0], rel=1e-12)


def test_elements_in_memory_are_read_as_from_a_file(tmp_path):
    """Set-up: elements with points of their own, and a surface beside a volume. Expected: as from their files.

    In memory both were refused for their coincident points.
    """
    grid = lagrange(3, 2, 2, linear)
    grid.GetCellData().RemoveArray("element")
    sheet = lagrange(2, 1, 2, linear)
    sheet.GetCellData().RemoveArray("element")
    both = vtkMultiBlockDataSet()
    for number, own in enumerate((grid, sheet)):
        both.SetBlock(number, own)
    expected = flow.read(vtk_writers.write_vtk(tmp_path / "a.vtu", grid)).density
    for data in (grid, both):
        found = DensityField.from_pyvista(data)
        assert np.array_equal(found.density, expected)
        assert "elements that have points of their own" in found.provenance


@pytest.mark.parametrize(
    ("kind", "count", "message"),
    [
        (WEDGE, 40, "type 73 with 40 points, of high order: write linear cells"),
        (QUAD, 6, "not the same in all directions"),
    ],
)
def test_cells_of_an_order_that_nobody_can_cut_are_refused(tmp_path, kind, count, message):
    grid = lagrange(2, 3, 2, linear)
    grid.GetCellData().RemoveArray("element")
    grid.InsertNextCell(kind, count, list(range(count)))
    with pytest.raises(flow.ReadError, match=message):
        flow.read(vtk_writers.write_vtk(tmp_path / "a.vtu", grid))


def test_polyhedra_without_faces_are_refused(tmp_path):
    """Set-up: a quadrilateral whose type a flipped digit made a polyhedron. Expected: reported as damage."""
    grid = lagrange(2, 1, 2, linear)
    path = vtk_writers.write_vtk(tmp_path / "a.vtu", grid)
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(grid)
    writer.SetDataModeToAscii()
    writer.Write()
    text = path.read_text()
    assert "70 70 70 70" in text
    path.write_text(text.replace("70 70 70 70", "9 42 9 9"))
    with pytest.raises(flow.ReadError, match="its polyhedra have no faces"):
        flow.read(path)
