"""Cells of every type of VTK: those of the flow are read or refused; none is left out silently."""

import numpy as np
import pytest
import vtk_writers

from aerokernels import flow

pytest.importorskip("vtkmodules")

# Corners and mid-edge points of a triangle and of a quadrilateral that share an edge, at the unit square's side.
POINTS = [(0, 0), (1, 0), (0, 1), (0.5, 0), (0.5, 0.5), (0, 0.5), (0.3, 0.3), (1, 1), (1, 0.5), (0.5, 1)]


def written(path, cells):
    """An unstructured grid of the points above with cells of a type and its points each, density 1, 2, ... in them."""
    points = [(x, y, 0.0) for x, y in POINTS]
    return vtk_writers.write_vtk(path, vtk_writers.vtk_cells(points, cells, rho=1.0 + np.arange(len(cells))))


def area(field) -> float:
    """The area of the field's mesh [m2]."""
    y, z = np.moveaxis(field.mesh.corners, -1, 0)
    return abs(float((y * np.roll(z, -1, axis=1) - z * np.roll(y, -1, axis=1)).sum())) / 2.0


@pytest.mark.parametrize("kind", [22, 34], ids=["quadratic", "biquadratic"])
def test_triangles_with_mid_edge_nodes_are_read_by_their_corners(tmp_path, kind):
    """The nodes that are left lay where the cut of triangles puts points of its own, and the file was refused."""
    corners = [0, 1, 2, 3, 4, 5, 6] if kind == 34 else [0, 1, 2, 3, 4, 5]
    field = flow.read(written(tmp_path / "a.vtu", [(kind, corners), (22, [1, 7, 2, 8, 9, 4])]))
    assert sorted(set(field.density.tolist())) == [1.0, 2.0]
    assert area(field) == pytest.approx(1.0)
    assert "2 of 2 cells are of second order: they are read by their corners alone" in field.provenance


@pytest.mark.parametrize(("kind", "corners"), [(6, [0, 1, 2, 7]), (36, [0, 1, 2, 3, 4, 5])], ids=["strip", "polygon"])
def test_cells_that_are_not_read_are_refused(tmp_path, kind, corners):
    file = written(tmp_path / "a.vtu", [(kind, corners), (5, [1, 7, 2])])
    with pytest.raises(ValueError, match=f"it has cells of VTK's type {kind}, which are not read"):
        flow.read(file)


def test_lines_beside_the_flow_are_left_out(tmp_path):
    file = written(tmp_path / "a.vtu", [(5, [0, 1, 2]), (5, [1, 7, 2]), (4, [0, 1, 7]), (35, [0, 1, 3, 4])])
    assert sorted(set(flow.read(file).density.tolist())) == [1.0, 2.0]
