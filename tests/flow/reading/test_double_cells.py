"""Cells that occur twice in a two-dimensional file: left out with the same values, refused with others."""

import numpy as np
import pytest
import writers

from aerokernels.flow.reading.dataset import Block, Dataset
from aerokernels.flow.reading.density import Reference
from aerokernels.flow.reading.frame import Frame
from aerokernels.flow.reading.planes.polygon_cells import Polygons
from aerokernels.flow.reading.planes.polygons import merged, quad_mesh
from aerokernels.flow.reading.read import field_of, reading_of


def block(values, where="cell"):
    """The grid of the writers as polygons, in (y, z)."""
    x, y = writers.grid()
    corners = writers.quads()
    points = np.stack([y.ravel(), -x.ravel()], axis=1)
    return Polygons(points, 4 * np.arange(len(corners) + 1), corners.ravel(), values, where)


def test_a_block_that_occurs_twice_counts_once():
    """Set-up: two blocks with the same cells and values, as a list of parts may name one twice. Expected: one."""
    values = np.random.default_rng(0).random(len(writers.quads()))
    alone, expected, _ = quad_mesh(block(values), "planar")
    mesh, found, remark = quad_mesh(merged([block(values), block(values)]), "planar")
    assert remark == f"{len(values)} cells that occur twice were left out"
    assert len(mesh.cells) == len(alone.cells) and (np.sort(found) == np.sort(expected)).all()


def test_a_block_over_another_one_with_other_values_is_refused():
    """Set-up: the same cells with other values, as two times of a flow. One of them was taken, whichever was found."""
    values = np.random.default_rng(0).random(len(writers.quads()))
    with pytest.raises(
        ValueError, match=rf"{len(values)} of {2 * len(values)} cells overlap others, the first is cell"
    ):
        quad_mesh(merged([block(values), block(values + 1.0)]), "planar")


def test_another_cell_on_the_same_side_of_an_edge_is_refused():
    """Set-up: a triangle over the corner of a quadrilateral. Expected: refused with its corners."""
    points = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    polygons = Polygons(points, np.array([0, 4, 7]), np.array([0, 1, 2, 3, 0, 1, 2]), np.array([1.0, 1.0]), "cell")
    with pytest.raises(ValueError, match=r"1 of 2 cells overlap others, the first is cell 1 with corners"):
        quad_mesh(polygons, "planar")


@pytest.mark.parametrize("shape", [(4, 3, 1), (4, 3, 3)], ids=["planar", "volume"])
def test_blocks_on_one_mesh_with_other_densities_are_refused(shape):
    """Set-up: a grid twice, its densities a little other, as two times in one file. Expected: refused, both named.

    Of volumes one of the two was taken.
    """
    axes = np.meshgrid(*[np.linspace(0.0, 1.0, n) ** 1.1 for n in shape], indexing="ij")
    points = np.stack([axis.ravel(order="F") for axis in axes], axis=1)
    first, second = (
        Block(points, None, shape, {"rho": 1.0 + add + points[:, 0]}, name=name)
        for name, add in (("a", 0.0), ("b", 0.1))
    )

    def read(*blocks):
        reading = reading_of("file", Dataset(blocks, "x"), None, Frame(), None, Reference(), None, None, None)
        return field_of(reading)

    assert read(first).density.size
    with pytest.raises(ValueError, match="'a' and 'b' have the same mesh and other densities: several times or cases"):
        read(first, second)


@pytest.mark.parametrize("inner_first", [False, True])
@pytest.mark.parametrize("ratio", [1.0, 4.0], ids=["side by side", "one within the other"])
def test_overlapping_blocks_of_a_plane_are_refused(inner_first, ratio):
    """Set-up: two grids that overlap, as overset ones do; beside each other, and a fine one within the other.

    Expected: refused with the first place. Lines through them met a body that is not there, or missed a third of their
    path, without a word. The same grids beside each other, not matching, are read.
    """

    def sheet(low, high, count, half):
        y, x = np.meshgrid(np.linspace(-half, half, count), np.linspace(low, high, count), indexing="ij")
        points = np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)
        return Block(points, None, (count, count, 1), {"rho": 1.0 + points[:, 0]})

    def read(*blocks):
        reading = reading_of("file", Dataset(blocks, "x"), None, Frame(), None, Reference(), None, None, None)
        return field_of(reading)

    pair = (sheet(0.0, 0.6 * ratio, 9, 1.0), sheet(0.5, 1.0, 17, 1.0 / ratio))
    with pytest.raises(
        ValueError, match=r"cells at the edge of the mesh or of its blocks lie in other cells, the first at y, z"
    ):
        read(*pair[::-1] if inner_first else pair)
    assert read(sheet(0.0, 0.5, 9, 1.0), sheet(0.5, 1.0, 17, 1.0)).density.max() == pytest.approx(2.0)
