"""Jumps of a mesh's gradient at the edges of its cells, by hand."""

import numpy as np
import pytest

from aerokernels.medium import IndexField, QuadMesh


def two_squares(interpolation: str) -> IndexField:
    """Squares of 1 mm with slopes along y of 1e-4 and 4e-4 per mm."""
    y, z = np.meshgrid([0.0, 1e-3, 2e-3], [0.0, 1e-3], indexing="ij")
    mesh = QuadMesh.structured(y, z, "planar")
    return IndexField.from_mesh(mesh, np.repeat([[0.0], [1e-4], [5e-4]], 2, axis=1), interpolation=interpolation)


@pytest.mark.parametrize(("interpolation", "jump"), [("bilinear", 0.3), ("bilinear-barron", 0.0)])
def test_a_jump_belongs_to_both_cells_of_its_edge(interpolation: str, jump: float):
    field = two_squares(interpolation)
    kinks = field.samples.kinks
    assert kinks.shape == (2, 4)
    shared = field.mesh.neighbors >= 0
    assert shared.sum() == 2
    assert kinks[shared] == pytest.approx([jump, jump], rel=1e-6, abs=1e-15)
    assert (kinks[~shared] == 0.0).all()


def test_a_linear_field_on_bent_cells_has_no_kinks():
    draw = np.random.default_rng(4)
    y, z = np.meshgrid(np.linspace(0.0, 1.0, 6), np.linspace(0.0, 1.0, 7), indexing="ij")
    y, z = y + 0.02 * draw.normal(size=y.shape), z + 0.02 * draw.normal(size=y.shape)
    field = IndexField.from_mesh(QuadMesh.structured(y, z, "planar"), 1e-4 * (2.0 * y - z))
    assert field.samples.kinks.max() < 1e-15
    turned = IndexField.from_mesh(QuadMesh.structured(y, z, "planar"), 1e-4 * y * y)
    assert turned.samples.kinks.max() > 1e-6
