"""Files of discontinuous elements: Lagrange cells of high order, and points that each element has for itself."""

import numpy as np
import pytest

pytest.importorskip("vtkmodules")

import vtk_writers
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonDataModel import (
    vtkHigherOrderHexahedron,
    vtkHigherOrderQuadrilateral,
    vtkImageData,
)
from vtkmodules.vtkFiltersCore import vtkAppendFilter

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
    cells = np.arange(len(points)).reshape(len(shifts), -1)
    return vtk_writers.vtk_cells(
        points,
        [(QUAD if axes == 2 else HEXAHEDRON, cell) for cell in cells],
        rho=density(points, np.repeat(np.arange(len(shifts)), len(nodes))),
        element=1.0 + np.arange(float(len(shifts))),
    )


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


def side_by_side(ghost: int = 0):
    """Two even grids of 31 x 21 points that meet in a line, in one grid; rho is linear.

    With ghosts each grid goes on into the other by some columns of cells that are flagged, and of which the outer
    points have other values, as where an exchange between processes did not take place.
    """
    append = vtkAppendFilter()
    append.SetOutputPointsPrecision(1)  # double
    for low, first, last in ((0, 0, 30 + ghost), (30 - ghost, 30, 60)):
        grid = vtkImageData()
        grid.SetDimensions(31 + ghost, 21, 1)
        grid.SetOrigin(0.01 * low, 0.0, 0.0)
        grid.SetSpacing(0.01, 0.01, 1.0)
        column = low + np.tile(np.arange(31 + ghost), 21)
        own = (column >= first) & (column <= last) if ghost else np.ones(column.shape, bool)
        inside = (column >= first - (low > 0)) & (column <= last + (low == 0)) if ghost else own
        x, y = 0.01 * column, 0.01 * np.repeat(np.arange(21), 31 + ghost)
        values = numpy_to_vtk(np.where(inside & own, linear(np.stack([x, y, 0.0 * x], 1)), 9.0), deep=True)
        values.SetName("rho")
        grid.GetPointData().AddArray(values)
        cell = low + np.tile(np.arange(30 + ghost), 20)
        flags = numpy_to_vtk(np.where((cell >= first) & (cell < last), 0, 1).astype(np.uint8), deep=True)
        flags.SetName("vtkGhostType")
        grid.GetCellData().AddArray(flags)
        append.AddInputData(grid)
    append.Update()
    return append.GetOutput()


@pytest.mark.parametrize("ghost", [0, 2])
def test_pieces_of_a_partitioned_mesh_are_joined(ghost):
    """Set-up: two pieces with points of their own where they meet, a fiftieth of all, without and with ghost cells.

    Expected: the linear density everywhere. Pieces were refused as damage, and ghosts' values counted in means.
    """
    found = DensityField.from_pyvista(side_by_side(ghost))
    at = np.array([[0.0, 0.07, -x] for x in (0.05, 0.275, 0.295, 0.3, 0.305, 0.325, 0.5)])
    assert found.density_at(at) == pytest.approx(linear(np.stack([-at[:, 2], at[:, 1], at[:, 0]], 1)), rel=1e-12)
    assert found.mesh.corner_weights.sum() == pytest.approx(0.6 * 0.2) and found.body is None


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
