"""Volumes one cell thick are planar flows, of every kind of block; what changes across them is a volume."""

import numpy as np
import pytest

from aerokernels import DensityField, flow
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


def test_boundaries_beside_a_volume_are_patches(tmp_path):
    """Set-up: what foamToVTK writes of a planar case: averages one cell thick, and in blocks beside them its boundary.

    Expected: the averages in their plane, the surfaces as patches, of which one may be named as the wall of a body.
    """
    x, y = np.linspace(0.0, 1.0, 9), np.linspace(0.0, 0.5, 6)
    grid = pv.RectilinearGrid(x, y, [0.0, 0.1]).cast_to_unstructured_grid()
    grid.cell_data["rho"] = 1.0 + grid.cell_centers().points @ [0.5, 0.2, 0.0]
    whole = grid.extract_surface(algorithm="dataset_surface")
    at = whole.cell_centers().points[:, 1]
    sides = {
        name: whole.extract_cells(np.flatnonzero(np.abs(at - place) < 1e-9)).extract_surface(
            algorithm="dataset_surface"
        )
        for name, place in (("bottom", 0.0), ("top", 0.5))
    }
    pv.MultiBlock({"internal": grid, "boundary": pv.MultiBlock(sides)}).save(tmp_path / "a.vtm")
    field = flow.read(tmp_path / "a.vtm")
    assert isinstance(field, CellDensity) and field.geometry == "planar" and field.mesh.shape is not None
    points = np.stack([np.zeros(40), field.mesh.cell_centroid[:, 0], field.mesh.cell_centroid[:, 1]], axis=1)
    assert np.abs(field.density_at(points) - (1.0 - 0.5 * points[:, 2] + 0.2 * points[:, 1])).max() < 1e-12
    assert flow.contents(tmp_path / "a.vtm").patches == (("bottom", "patch"), ("top", "patch"))
    assert field.body is None and flow.read(tmp_path / "a.vtm", walls=["bottom"]).body is not None


def test_blocks_that_close_on_themselves(tmp_path):
    """Set-up: two rings of averages, one about the other, each of which closes along a ray, as at an aerofoil's wake.

    Expected: one mesh of all cells, whose rim is the inner and the outer circle, the inner one a body, and the averages
    in their places.
    """
    angle = 2.0 * np.pi * np.arange(25) / 24
    blocks, wanted = pv.MultiBlock(), []
    for name, radius in (("inner", [1.0, 1.3, 1.7, 2.0]), ("outer", [2.0, 2.5, 3.0])):
        r, a = np.meshgrid(radius, angle, indexing="ij")
        x, y = r * np.cos(a), r * np.sin(a)
        x[:, -1], y[:, -1] = x[:, 0], y[:, 0]
        grid = pv.StructuredGrid(x[..., None], y[..., None], 0.0 * x[..., None])
        grid.cell_data["rho"] = 1.0 + 0.1 * np.arange(grid.n_cells) / grid.n_cells
        wanted.append((grid.cell_centers().points, np.asarray(grid.cell_data["rho"])))
        blocks[name] = grid
    blocks.save(tmp_path / "a.vtm")
    field = flow.read(tmp_path / "a.vtm")
    assert isinstance(field, CellDensity) and len(field.density) == 5 * 24 and field.body is not None
    assert (field.mesh.neighbors < 0).sum() == 2 * 24
    for place, density in wanted:
        points = np.stack([0.0 * place[:, 0], place[:, 1], -place[:, 0]], axis=1)
        assert np.abs(field.density_at(points) - density).max() < 1e-12
