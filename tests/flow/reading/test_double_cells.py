"""Cells that occur twice in a two-dimensional file: left out with the same values, refused with others."""

import numpy as np
import pytest
import writers

from aerokernels.flow.reading.dataset import Block


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
        return writers.field(list(blocks))

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
        return writers.field(list(blocks))

    pair = (sheet(0.0, 0.6 * ratio, 9, 1.0), sheet(0.5, 1.0, 17, 1.0 / ratio))
    with pytest.raises(
        ValueError, match=r"cells at the edge of the mesh or of its blocks lie in other cells, the first at y, z"
    ):
        read(*pair[::-1] if inner_first else pair)
    assert read(sheet(0.0, 0.5, 9, 1.0), sheet(0.5, 1.0, 17, 1.0)).density.max() == pytest.approx(2.0)
