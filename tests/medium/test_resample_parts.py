"""Parts of resampling and of coarser levels: the points, what is continued into a body, the measure, thinned meshes."""

from importlib import import_module

import numpy as np
import pytest

from aerokernels import Body, IndexField, QuadMesh
from aerokernels.medium.resample_grid import node_counts
from aerokernels.sobol import sobol_points

resampling = import_module("aerokernels.medium.resample")
BODY = Body([[0.3, 0.4], [0.7, 0.4], [0.7, 0.9], [0.3, 0.9]], "planar")


def linear(y, z):
    return 1e-4 * (1.0 + 2.0 * y - 0.7 * z)


def source(body: Body | None = BODY, function=linear, counts=(9, 13), on_mesh: bool = False) -> IndexField:
    """A field from (0, 0) to (1, 1.5)."""
    y, z = np.meshgrid(np.linspace(0.0, 1.0, counts[0]), np.linspace(0.0, 1.5, counts[1]), indexing="ij")
    if on_mesh:
        return IndexField.from_mesh(QuadMesh.structured(y, z, "planar"), function(y, z), body=body)
    step = 1.0 / (counts[0] - 1), 1.5 / (counts[1] - 1)
    return IndexField.from_samples(function(y, z), origin=(0, 0), spacing=step, geometry="planar", body=body)


@pytest.mark.parametrize("on_mesh", [False, True])
def test_points_at_which_a_field_is_compared(on_mesh: bool):
    """Nodes, those in the body with their feet and mirror images, the fade with depth, probes and lines along z."""
    field = source(on_mesh=on_mesh)
    low, step, count = np.array([0.0, 0.0]), np.array([0.1, 0.15]), np.array([11, 11])
    found = resampling._make_points(field, low, low + step * (count - 1), step, count)
    nodes = np.stack(np.meshgrid(0.1 * np.arange(11), 0.15 * np.arange(11), indexing="ij"), axis=-1).reshape(-1, 2)
    assert found.nodes.count == 121 and found.nodes.rows.tolist() == list(range(121))
    np.testing.assert_allclose(found.nodes.points, nodes, atol=1e-14)
    inside = np.flatnonzero(BODY.contains(nodes))
    np.testing.assert_array_equal(found.inside, inside)
    foot = BODY.nearest_wall(nodes[inside])
    depth = np.linalg.norm(foot - nodes[inside], axis=1)
    normal = (foot - nodes[inside]) / np.where(depth > 0.0, depth, 1.0)[:, None]
    assert (depth > 0.1).any() and (depth < 0.1).any()
    np.testing.assert_allclose(found.skin.points, foot + 1e-4 * normal, atol=1e-14)
    ahead = foot + (np.minimum(depth, 0.2) + 1e-4)[:, None] * normal
    np.testing.assert_allclose(found.ahead.points, ahead, atol=1e-14)
    np.testing.assert_allclose(found.fade, np.exp(-np.maximum(depth - 0.1, 0.0) / 0.1))
    probes = np.array([1.0, 1.5]) * sobol_points(4096, 2, seed=1)
    kept = ~BODY.contains(probes)
    np.testing.assert_array_equal(found.probe.rows, np.flatnonzero(kept))
    np.testing.assert_allclose(found.probe.points, probes[kept], atol=1e-14)
    assert found.line_points == 256 and found.length == pytest.approx(1.5 / 256) and found.lines.count == 64 * 256
    across, along = sobol_points(64, 1, seed=2)[:, 0], 1.5 * (np.arange(256) + 0.5) / 256
    lines = np.stack(np.broadcast_arrays(across[:, None], along), axis=-1).reshape(-1, 2)
    kept = ~BODY.contains(lines)
    np.testing.assert_array_equal(found.lines.rows, np.flatnonzero(kept))
    np.testing.assert_allclose(found.lines.points, lines[kept], atol=1e-14)
    fine = resampling._make_points(field, low, np.array([1.0, 1.5]), np.array([0.1, 0.005]), np.array([11, 301]))
    assert fine.line_points == 1200
    finest = resampling._make_points(field, low, np.array([1.0, 1.5]), np.array([0.5, 1.5 / 4000]), np.array([3, 4001]))
    assert finest.line_points == 8192
    # Beyond the field's box there is no air, and lines reach as far as the grid.
    wide = resampling._make_points(field, np.array([-0.5, -1.5]), np.array([1.5, 3.0]), step, np.array([21, 31]))
    assert wide.nodes.count == 21 * 31 and len(wide.nodes.rows) == 121
    assert wide.length == pytest.approx(4.5 / wide.line_points)


def test_lines_through_a_volume_have_four_points_a_cell():
    """Along its last axis, whatever the other two are; they begin at Sobol points of the first two."""
    samples = 1e-4 * np.random.default_rng(143).normal(size=(5, 6, 7))
    field = IndexField.from_samples(samples, origin=(0.0, 1.0, -2.0), spacing=(0.2, 0.4, 0.5), geometry="volume")
    low, high, step = np.array([0.0, 1.0, -2.0]), np.array([0.8, 3.0, 1.0]), np.array([0.2, 0.4, 0.01])
    found = resampling._make_points(field, low, high, step, np.array([5, 6, 301]))
    assert found.line_points == 1200 and found.length == pytest.approx(3.0 / 1200)
    across = low[:2] + (high - low)[:2] * sobol_points(64, 2, seed=2)
    np.testing.assert_allclose(found.lines.points[::1200, :2], across)
    np.testing.assert_allclose(found.lines.points[:1200, 2], -2.0 + 3.0 * (np.arange(1200) + 0.5) / 1200)


def test_values_are_continued_into_a_body():
    """The value at the wall, and the slope ahead of it mirrored, faded with the depth: of a linear field exactly."""
    field = source()
    again = field.resample((0.1, 0.15), interpolation="linear")
    nodes = np.stack(np.meshgrid(0.1 * np.arange(11), 0.15 * np.arange(11), indexing="ij"), axis=-1).reshape(-1, 2)
    inside = BODY.contains(nodes)
    foot = BODY.nearest_wall(nodes)
    depth = np.linalg.norm(foot - nodes, axis=1)
    normal = (foot - nodes) / np.where(depth > 0.0, depth, 1.0)[:, None]
    skin = foot + 1e-4 * normal
    ahead = foot + (np.minimum(depth, 0.2) + 1e-4)[:, None] * normal
    fade = np.exp(-np.maximum(depth - 0.1, 0.0) / 0.1)
    expected = linear(*skin.T) + (linear(*skin.T) - linear(*ahead.T)) * fade
    expected = np.where(inside, expected, linear(*nodes.T))
    np.testing.assert_allclose(again.samples.samples.ravel(), expected, rtol=1e-9)


def test_the_measure_is_of_the_difference():
    """Rms and greatest change at the points, and of sums along lines of value and slope: of two known fields."""
    field = source(None, lambda y, z: 1e-4 * (1.0 + y**2 + 0.5 * y * z))
    other = source(None, lambda y, z: 1e-4 * (1.0 + y**2 + 0.8 * y * z + 0.1 * z))
    low, step, count = np.array([0.0, 0.0]), np.array([0.1, 0.15]), np.array([11, 11])
    points = resampling._make_points(field, low, np.array([1.0, 1.5]), step, count)
    found = resampling._measure(field, other, points)
    y, z = points.probe.points.T
    change = 1e-4 * (0.3 * y * z + 0.1 * z)
    assert found.contrast_rms == pytest.approx(np.sqrt(np.mean(change**2)), rel=1e-5)
    y = sobol_points(64, 1, seed=2)[:, 0]
    path = 1e-4 * (0.3 * y + 0.1) * 1.5**2 / 2.0
    assert found.opd_rms == pytest.approx(np.sqrt(np.mean(path**2)), rel=1e-5)
    assert found.opd_max == pytest.approx(path.max(), rel=1e-5)
    turn = 1e-4 * 0.3 * 1.5**2 / 2.0
    assert found.direction_rms == pytest.approx(turn, rel=1e-4)
    ly, lz = points.lines.points.T
    assert found.contrast_max == pytest.approx(max(change.max(), (1e-4 * (0.3 * ly * lz + 0.1 * lz)).max()), rel=1e-5)
    assert found.source is field and found.spacing == tuple(other.samples.spacing)


def test_a_grid_divides_its_region_evenly():
    """So many cells that none is wider than asked; the last node is on the face, or beyond it by rounding only."""
    field = source(None)
    for step in ((0.3, 0.2), (0.25, 0.1), (0.0999, 0.37)):
        again = field.resample(step, region=((0.0, 0.0), (1.0, 1.5)))
        cells = np.ceil(np.array([1.0, 1.5]) / step - 1e-9)
        np.testing.assert_allclose(again.spacing, np.array([1.0, 1.5]) / cells, rtol=1e-12)
        assert again.samples.shape == tuple(cells.astype(int) + 1)
        assert (again.samples.high >= [1.0, 1.5]).all()
    low, high = np.zeros(2), np.array([1.0, 1.5])
    assert node_counts(field, low, high, np.array([0.25, 0.375])).tolist() == [5, 5]
    with pytest.raises(ValueError, match="fewer than 4 cells"):
        node_counts(field, low, high, np.array([0.34, 0.375]))
    few = source(None, counts=(3, 13))  # its own spacing is as great
    assert node_counts(few, low, high, np.array([0.5, 0.375])).tolist() == [3, 5]
    with pytest.raises(ValueError, match="fewer than 4 cells"):
        node_counts(few, low, high, np.array([0.51, 0.375]))


# --- levels ----------------------------------------------------------------------------------------------------------
