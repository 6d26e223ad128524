"""Volumes one cell thick are planar flows, of every kind of block; what changes across them is a volume."""

import numpy as np
import pytest

from aerokernels.flow import CellDensity, GridDensity, VertexDensity
from aerokernels.flow.reading.dataset import HEXAHEDRON, PRISM, Block, Cells

from . import writers

X, Y = np.linspace(0.0, 1.0, 9) ** 1.2, np.linspace(0.0, 0.5, 6)
ALONG = np.stack([a.ravel() for a in np.meshgrid(X, Y)], axis=1)


def slab(across: int, kind: str, density):
    """A grid one cell thick across an axis, with a density of its points, or of its cells' means."""
    points = np.concatenate([np.insert(ALONG, across, place, axis=1) for place in (0.2, 0.25)])
    corners = np.hstack([writers.quads(9, 6), writers.quads(9, 6) + len(ALONG)])
    if kind == "structured":
        shape = [9, 6]
        shape.insert(2, 2)
        return Block(points, None, tuple(shape), {"rho": density(points)})
    if kind == "prisms":
        corners = np.concatenate([corners[:, [0, 1, 2, 4, 5, 6]], corners[:, [0, 2, 3, 4, 6, 7]]])
    cells = Cells.of_one_type(PRISM if kind == "prisms" else HEXAHEDRON, corners)
    return Block(points, cells, cell_data={"rho": density(points[corners].mean(axis=1))})


@pytest.mark.parametrize("across", [0, 1, 2])
@pytest.mark.parametrize("kind", ["structured", "hexahedra", "prisms"])
def test_the_plane_is_read(kind, across):
    """Expected: the linear density, at the points or averaged over the cells that were there."""

    def linear(points):
        return 1.0 + np.delete(points, across, axis=1) @ [0.5, 0.2]

    field = writers.field([slab(across, kind, linear)])
    assert isinstance(field, VertexDensity if kind == "structured" else CellDensity)
    assert "one cell thick" in field.provenance
    y, z = (field.mesh.vertices if kind == "structured" else field.mesh.cell_centroid).T
    here = 1.0 - 0.5 * z + 0.2 * y if across else 1.0 + 0.5 * y + 0.2 * z  # y-z planes keep their axes
    if kind == "prisms":  # whose cells are cut into parts with the average of the whole
        assert len(np.unique(field.mesh.parents)) == 2 * 8 * 5
    else:
        assert np.abs(field.density.ravel() - here).max() < 1e-12


def test_what_changes_across_stays_a_volume():
    """And what is asked for as one: by its geometry, by a grid, by light that goes across."""
    assert isinstance(writers.field([slab(2, "structured", lambda points: 1.0 + points[:, 2])]), GridDensity)
    for asked in ({"geometry": "volume"}, {"frame": "z"}, {"spacing": 0.02}):
        assert isinstance(
            writers.field([slab(2, "hexahedra", lambda points: 1.0 + points[:, 0])], **asked), GridDensity
        )
