"""Volumes one cell thick are planar flows, of every kind of block; what changes across them is a volume."""

import numpy as np
import pytest

from aerokernels import DensityField
from aerokernels.flow import CellDensity, GridDensity, VertexDensity

pv = pytest.importorskip("pyvista")

X, Y = np.linspace(0.0, 1.0, 9) ** 1.2, np.linspace(0.0, 0.5, 6)


def linear(points, across: int):
    """1 + x / 2 + y / 5 in the two coordinates along the plane."""
    along = np.delete(np.asarray(points), across, axis=1)
    return 1.0 + along @ [0.5, 0.2]


def grid(across: int, kind: str, thick: float = 0.05):
    """A grid one cell thick across an axis."""
    axes = [X, Y]
    axes.insert(across, np.array([0.2, 0.2 + thick]))
    made = pv.RectilinearGrid(*axes)
    if kind == "structured":
        made = made.cast_to_structured_grid()
    elif kind == "hexahedra":
        made = made.cast_to_unstructured_grid()
    elif kind == "prisms":
        flat = (
            pv.RectilinearGrid(X, Y, [0.2])
            .cast_to_unstructured_grid()
            .extract_surface(algorithm="dataset_surface")
            .triangulate()
        )
        points, n = np.asarray(flat.points, float), flat.n_points
        corners = flat.faces.reshape(-1, 4)[:, 1:]
        cells = np.column_stack([np.full(len(corners), 6), corners, corners + n])
        both = np.concatenate([points, points + np.array([0.0, 0.0, thick])])
        made = pv.UnstructuredGrid(cells, np.full(len(corners), pv.CellType.WEDGE), both)
    return made


@pytest.mark.parametrize(("kind", "across"), [
    ("even", 2), ("even", 1), ("structured", 0), ("structured", 2), ("hexahedra", 0), ("hexahedra", 1), ("prisms", 2),
])  # fmt: skip
def test_the_plane_is_read(kind, across):
    """Expected: averages over the cells, at their middles, the linear density's; values at points likewise."""
    made = grid(across, kind)
    made.cell_data["rho"] = linear(made.cell_centers().points, across)
    field = DensityField.from_pyvista(made)
    assert isinstance(field, CellDensity) and field.geometry == "planar"
    assert "one cell thick" in field.provenance
    assert len(np.unique(field.mesh.parents) if kind == "prisms" else field.density) == made.n_cells
    middle = field.mesh.cell_centroid
    y, z = middle.T
    here = 1.0 - 0.5 * z + 0.2 * y if across else 1.0 + 0.5 * y + 0.2 * z  # y-z planes keep their axes
    if kind != "prisms":  # whose cells are cut into parts with the average of the whole
        assert np.abs(field.density - here).max() < 1e-6
    del made.cell_data["rho"]
    made.point_data["rho"] = linear(made.points, across)
    assert isinstance(DensityField.from_pyvista(made), VertexDensity)


def test_what_changes_across_stays_a_volume():
    """And what is asked for as one: by its geometry, by a grid, by light that goes across."""
    made = grid(2, "even")
    made.point_data["rho"] = 1.0 + made.points[:, 2]
    assert isinstance(DensityField.from_pyvista(made), GridDensity)
    made.point_data["rho"] = linear(made.points, 2)
    for asked in ({"geometry": "volume"}, {"frame": "z"}, {"spacing": 0.02}):
        assert isinstance(DensityField.from_pyvista(made, **asked), GridDensity)
