"""Cells of the reference engine: the plane of a field, pieces of interpolants, faces of cells and what lies behind."""

from fractions import Fraction

import numpy as np
import pytest

from aerokernels.medium import IndexField, QuadMesh
from aerokernels.medium.grid import AXIS_CORE
from aerokernels.tracing.engines.reference.medium import (
    GridAir,
    approach,
    outward,
    plane_motion,
    radius_increment,
)
from aerokernels.tracing.engines.reference.mesh import MeshAir
from tests.random_air import random_air

AMBIENT = 1.2
H = 1e-4


def motions(count: int = 30) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places off the axis, tangents and forces."""
    rng = np.random.default_rng(51)
    return rng.uniform(0.3, 1.2, (count, 3)), rng.normal(size=(count, 3)), rng.normal(size=(count, 3))


@pytest.mark.parametrize("axisymmetric", [False, True])
def test_motion_in_the_plane_of_the_field(axisymmetric: bool):
    """Of places p + h T + h^2 F / 2 at h = 0 and +-1e-4: central differences, within h^2 of the derivatives."""
    place, tangent, force = motions()

    def at(h):
        there = place + h * tangent + 0.5 * h * h * force
        across = np.hypot(there[:, 0], there[:, 1]) if axisymmetric else there[:, 1]
        return np.stack([across, there[:, 2]], axis=1)

    there, velocity, bend = plane_motion(place, tangent, force, axisymmetric)
    np.testing.assert_allclose(there, at(0.0), rtol=1e-14)
    np.testing.assert_allclose(velocity, (at(H) - at(-H)) / (2 * H), atol=1e-6)
    np.testing.assert_allclose(bend, (at(H) - 2 * at(0.0) + at(-H)) / H**2, atol=1e-5)


def test_motion_from_the_axis():
    """A ray on the axis moves outward at its whole speed across it, and has no radial curvature."""
    zero = np.zeros((2, 3))
    there, velocity, bend = plane_motion(
        zero, np.array([[3.0, 4.0, 2.0], [0, 0, 1.0]]), np.tile([1.0, 2.0, 7.0], (2, 1)), True
    )
    assert (
        there.tolist() == [[0, 0], [0, 0]] and velocity.tolist() == [[5, 2], [0, 1]] and bend.tolist() == [[0, 7]] * 2
    )
    np.testing.assert_array_equal(outward(np.array([[3.0, -4.0, 9.0], [0, 0, 5.0]])), [[0.6, -0.8, 0.0], [0, 0, 0]])


def test_closest_approach_to_the_axis():
    """Along a straight line the value is the distance behind its foot; a line along the axis has none."""
    place, tangent, force = motions()
    value, rate, curve = approach(place, tangent, force)
    speed = np.linalg.norm(tangent[:, :2], axis=1)
    foot = place[:, :2] - (value / speed)[:, None] * tangent[:, :2]
    np.testing.assert_allclose(np.sum(foot * tangent[:, :2], axis=1), 0.0, atol=1e-12)

    def ahead(h):
        return np.sum((place + h * tangent)[:, :2] * (tangent + h * force)[:, :2], axis=1) / speed

    np.testing.assert_allclose(rate, (ahead(H) - ahead(-H)) / (2 * H), rtol=1e-7)
    assert not curve.any()
    still = approach(place, tangent * [0.0, 0.0, 1.0], force)
    assert np.isneginf(still[0]).all() and not still[1].any()


def test_changes_of_the_radius_keep_their_digits():
    """Steps of 1e-9 of a radius: in rational numbers by |p + d|^2 - |p|^2 over the sum of both radii, to rounding."""
    place = motions()[0]
    delta = 1e-9 * motions()[1]
    before, after, change = radius_increment(place, delta)
    for row in range(len(place)):
        (x, y), (dx, dy) = ((Fraction(float(v)) for v in one[row, :2]) for one in (place, delta))
        square = (x + dx) ** 2 + (y + dy) ** 2 - x * x - y * y
        exact = float(square) / (np.hypot(float(x), float(y)) + np.hypot(float(x + dx), float(y + dy)))
        assert change[row] == pytest.approx(exact, rel=1e-13, abs=0.0)
    np.testing.assert_allclose(before, np.hypot(place[:, 0], place[:, 1]), rtol=1e-15)
    np.testing.assert_allclose(after, np.hypot(place[:, 0] + delta[:, 0], place[:, 1] + delta[:, 1]), rtol=1e-15)
    assert radius_increment(np.zeros((1, 3)), np.array([[3.0, 4.0, 1.0]]))[2].tolist() == [5.0]


# --- grids -----------------------------------------------------------------------------------------------------------

SPACING, ORIGIN, COUNTS = np.array([0.5, 0.75, 1.1]), np.array([-1.0, -1.5, 1.0]), (6, 5, 7)


def grid_field(geometry: str, interpolation: str = "cubic") -> IndexField:
    return random_air(
        geometry, 52, lambda random, shape: random.uniform(-0.1, 0.2, shape), COUNTS, ORIGIN, SPACING,
        ambient_index=AMBIENT, interpolation=interpolation,
    )  # fmt: skip


def places_in(geometry: str, count: int = 60) -> np.ndarray:
    low, high = ORIGIN, ORIGIN + SPACING * (np.array(COUNTS) - 1)
    place = np.random.default_rng(53).uniform(low, high, (count, 3))
    if geometry == "axisymmetric":
        place[:, :2] *= 0.9
        place[:, :2] -= [0.0, 0.1]
    return place


@pytest.mark.parametrize("interpolation", ["cubic", "linear", "monotone"])
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_pieces_of_a_grid_are_the_field(geometry: str, interpolation: str):
    """Potential and its gradient at place + delta, in the cell that holds it: m (a + m / 2) and n grad m of the field.

    In "linear" cells on the axis within the rounded-off core only the value's cell differs: those are left out.
    """
    field = grid_field(geometry, interpolation)
    air, place = GridAir(field), places_in(geometry)
    ahead = np.tile([0.1, 0.2, 1.0], (len(place), 1))
    cell = air.cell_at(place, ahead)
    delta = 1e-3 * np.random.default_rng(54).normal(size=place.shape)
    delta[np.any(air.cell_at(place + delta, ahead) != cell, axis=1)] = 0.0
    frame = air.frame(cell, place)
    potential, force = frame.sample(delta)
    contrast, gradient = field.evaluate(place + delta)
    np.testing.assert_allclose(potential, contrast * (AMBIENT + 0.5 * contrast), rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(force, (AMBIENT + contrast)[:, None] * gradient, rtol=1e-9, atol=1e-11)
    assert air.size == SPACING[1 if geometry != "volume" else 0]
    assert air.force_scale == np.abs(field.samples.coefficients).max() / air.size
    assert not air.in_gap(cell).any() and not air.jumps and not air.axis_is_kink
    turning = frame.turning()
    assert turning.shape == (60, air.face_count) and not turning[:, 1:].any()
    np.testing.assert_array_equal(turning[:, 0], (cell[:, 0] == 0) & (geometry == "axisymmetric"))


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_faces_of_grid_cells(geometry: str):
    """Distances outside each face of the cell, from the nodes; radial ones to first order where they are small."""
    field = grid_field(geometry)
    air, place = GridAir(field), places_in(geometry)
    zero = np.zeros_like(place)
    cell = air.cell_at(place, np.tile([0.1, 0.2, 1.0], (60, 1)))
    delta = 0.05 * np.random.default_rng(55).normal(size=place.shape)
    value = air.frame(cell, place).faces(delta, np.tile([0.3, 0.4, 1.0], (60, 1)), zero)[0]
    there = place + delta
    if geometry == "axisymmetric":
        there = np.stack([np.hypot(there[:, 0], there[:, 1]), there[:, 2]], axis=1)
    else:
        there = there[:, 1 if geometry == "planar" else 0 :]
    for k in range(air.axes):
        low = field.samples.origin[k] + field.samples.spacing[k] * cell[:, k]
        high = low + field.samples.spacing[k]
        if geometry == "axisymmetric" and k == 0:
            # (r^2 - edge^2) / 2 edge, a quadratic function along straight rays
            outer = (there[:, 0] ** 2 - high**2) / (2 * high)
            inner = np.where(cell[:, 0] == 0, -np.inf, -(there[:, 0] ** 2 - low**2) / (2 * np.where(low > 0, low, 1)))
            kept = cell[:, 0] > 0
            np.testing.assert_allclose(value[:, 1], outer, atol=1e-12)
            np.testing.assert_allclose(value[kept, 0], inner[kept], atol=1e-12)
            approached = (there[:, 0] >= 0) & ~kept
            expected = ((place + delta)[:, :2] @ [0.3, 0.4]) / 0.5
            np.testing.assert_allclose(value[approached, 0], expected[approached], atol=1e-12)
            assert kept.any() and approached.any()
            continue
        np.testing.assert_allclose(value[:, 2 * k], low - there[:, k], atol=1e-12)
        np.testing.assert_allclose(value[:, 2 * k + 1], there[:, k] - high, atol=1e-12)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_cells_on_both_sides_of_faces(geometry: str):
    """A ray on a face enters the cell ahead; behind each face is the neighbour, or nothing; normals are the axes."""
    field = grid_field(geometry)
    air = GridAir(field)
    counts = np.array(field.samples.shape) - 1
    for axis in range(air.axes):
        if geometry == "axisymmetric" and axis == 0:
            continue
        position = 3 - air.axes + axis
        place = np.tile(ORIGIN + 1.5 * SPACING + [0.0, 1.0, 0.0], (2, 1))
        place[:, position] = ORIGIN[position] + 2.0 * SPACING[position]
        heading = np.zeros((2, 3))
        heading[:, position] = [1.0, -1.0]
        assert air.cell_at(place, heading)[:, axis].tolist() == [2, 1]
        place[:, position] = ORIGIN[position] + np.array([0.0, counts[axis]]) * SPACING[position]
        assert air.cell_at(place, -heading)[:, axis].tolist() == [0, counts[axis] - 1]  # none beyond the ends
        cell = np.ones((4, air.axes), dtype=int)
        cell[:, axis] = [0, 0, counts[axis] - 1, counts[axis] - 1]
        face = 2 * axis + np.array([0, 1, 0, 1])
        after, left = air.cross(cell, face, None, None)
        assert left.tolist() == [True, False, False, True]
        assert after[:, axis].tolist() == [0, 1, counts[axis] - 2, counts[axis] - 1]
        others = np.arange(air.axes) != axis
        assert (after[:, others] == 1).all()
        normal = air.normal(cell, face, np.tile([0.6, 0.8, 2.0], (4, 1)))
        np.testing.assert_array_equal(normal, np.tile(np.eye(3)[position], (4, 1)))
    if geometry == "axisymmetric":
        after, left = air.cross(np.array([[0, 2], [1, 2], [counts[0] - 1, 2]]), np.array([0, 0, 1]), None, None)
        assert after[:2, 0].tolist() == [0, 0] and left.tolist() == [False, False, True]
        normal = air.normal(np.zeros((2, 2), int), np.array([0, 1]), np.tile([0.6, -0.8, 2.0], (2, 1)))
        np.testing.assert_allclose(normal, [[0.6, -0.8, 0.0]] * 2)


def test_the_core_of_a_linear_grid_on_the_axis_is_a_cell():
    """Its rim is a face more, and both parts of the first cell have the same row of samples."""
    air = GridAir(grid_field("axisymmetric", "linear"))
    assert air.core == pytest.approx(AXIS_CORE * SPACING[1])
    assert air.edges[0].tolist() == [0.0, AXIS_CORE, 1.0, 2.0, 3.0, 4.0] and air.row[0].tolist() == [0, 0, 1, 2, 3]
    cells = air.cell_at(
        np.array([[0.0, 0.5 * air.core, 2.0], [0.0, 2 * air.core, 2.0], [0.0, 1.0, 2.0]]), np.ones((3, 3))
    )
    assert cells[:, 0].tolist() == [0, 1, 2]


# --- meshes ----------------------------------------------------------------------------------------------------------


def mesh_field(geometry: str, interpolation: str) -> IndexField:
    """Skewed cells of 0.3 m and more, from 0.4 m or from the axis on."""
    y, z = np.meshgrid(np.linspace(0.0, 1.2, 5), np.linspace(1.0, 2.5, 6), indexing="ij")
    rng = np.random.default_rng(56)
    y[1:-1, 1:-1] += 0.06 * rng.uniform(-1, 1, (3, 4))
    z[:, 1:-1] += 0.06 * rng.uniform(-1, 1, (5, 4))
    values = rng.uniform(-0.1, 0.2, (4, 5) if interpolation == "cells" else (5, 6))
    return IndexField.from_mesh(
        QuadMesh.structured(y, z, geometry), values, ambient_index=AMBIENT, interpolation=interpolation
    )


def places_on_mesh(count: int = 60) -> np.ndarray:
    rng = np.random.default_rng(57)
    place = np.c_[rng.uniform(-0.3, 0.3, count), rng.uniform(0.3, 0.9, count), rng.uniform(1.1, 2.4, count)]
    place[: count // 3, :2] *= 0.25  # beside the axis
    return place


@pytest.mark.parametrize("interpolation", ["bilinear", "bilinear-barron", "idw", "cells"])
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_pieces_of_a_mesh_are_the_field(geometry: str, interpolation: str):
    """Potential and force at place + delta in the cell that holds it: m (a + m / 2) and n grad m of the field."""
    field = mesh_field(geometry, interpolation)
    air, place = MeshAir(field), places_on_mesh()
    ahead = np.tile([0.0, 0.0, 1.0], (len(place), 1))
    cell = air.cell_at(place, ahead)
    np.testing.assert_array_equal(cell[:, 0], field.mesh.locate(field.local_coordinates(place)))
    delta = 0.01 * np.random.default_rng(58).normal(size=place.shape)
    delta[air.cell_at(place + delta, ahead)[:, 0] != cell[:, 0]] = 0.0
    frame = air.frame(cell, place)
    potential, force = frame.sample(delta)
    contrast, gradient = field.evaluate(place + delta)
    np.testing.assert_allclose(potential, contrast * (AMBIENT + 0.5 * contrast), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(force, (AMBIENT + contrast)[:, None] * gradient, rtol=1e-8, atol=1e-10)
    assert air.size == field.mesh.cell_size.min()
    assert air.force_scale == np.abs(field.samples.values).max() / air.size
    assert air.jumps == (interpolation == "cells")
    assert air.axis_is_kink == (geometry == "axisymmetric" and interpolation != "cells")
    turning = frame.turning()
    assert turning.shape == (60, 4 if geometry == "planar" else 5) and not turning[:, :4].any() and turning[:, 4:].all()


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_edges_of_mesh_cells(geometry: str):
    """Distances outside the four edges' lines, by cross products; rates and curvatures are their derivatives."""
    field = mesh_field(geometry, "bilinear")
    air, place = MeshAir(field), places_on_mesh()
    tangent, force = np.random.default_rng(59).normal(size=(2, *place.shape))
    cell = air.cell_at(place, tangent)
    frame = air.frame(cell, place)

    def at(h):
        return frame.faces(h * tangent + 0.5 * h * h * force, tangent + h * force, force)

    value, rate, curve = at(0.0)
    there = field.local_coordinates(place)
    for k in range(4):
        a, b = (field.mesh.corners[cell[:, 0], j % 4] for j in (k, k + 1))
        edge, way = b - a, there - a
        inside = (edge[:, 0] * way[:, 1] - edge[:, 1] * way[:, 0]) / np.linalg.norm(edge, axis=1)
        on_axis = (a[:, 0] == 0.0) & (b[:, 0] == 0.0) & (geometry == "axisymmetric")
        np.testing.assert_allclose(value[~on_axis, k], -inside[~on_axis], atol=1e-13)
        assert np.isneginf(value[on_axis, k]).all()
    assert (value[:, :4] <= 1e-12).all()
    kept = np.isfinite(value)
    kept[:, 4:] = False  # the closest approach, tested above
    ahead, behind = at(H)[0], at(-H)[0]
    ahead, behind, here = ahead[kept], behind[kept], value[kept]
    np.testing.assert_allclose((ahead - behind) / (2 * H), rate[kept], atol=1e-6)
    np.testing.assert_allclose((ahead - 2 * here + behind) / H**2, curve[kept], atol=1e-4)


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_what_lies_behind_edges_of_a_mesh(geometry: str):
    """Across each edge of each cell: the cell that holds a point just behind it, or a gap; normals are across it."""
    field = mesh_field(geometry, "bilinear")
    air, mesh = MeshAir(field), field.mesh
    for face in range(4):
        cell = np.arange(len(mesh.cells))[:, None]
        a, b = mesh.corners[:, face], mesh.corners[:, (face + 1) % 4]
        middle, along = 0.5 * (a + b), (b - a) / np.linalg.norm(b - a, axis=1)[:, None]
        out = np.stack([along[:, 1], -along[:, 0]], axis=1)
        place, heading = (np.c_[0.6 * one[:, 0], 0.8 * one[:, 0], one[:, 1]] for one in (middle, out))
        if geometry == "planar":
            place, heading = (np.c_[0.0 * one[:, 0], one] for one in (middle, out))
        after, left = air.cross(cell, np.full(len(cell), face), place, heading)
        expected = mesh.locate(middle + 1e-6 * out)
        if geometry == "axisymmetric":
            expected = np.where(middle[:, 0] == 0.0, cell[:, 0], expected)  # a ray goes on beyond the axis
            np.testing.assert_array_equal(after[middle[:, 0] > 0.0, 0], expected[middle[:, 0] > 0.0])
        else:
            np.testing.assert_array_equal(after[:, 0], expected)
        assert not left.any() and (air.in_gap(after) == (after[:, 0] < 0)).all()
        normal = air.normal(cell, np.full(len(cell), face), place)
        kept = middle[:, 0] > 0.0
        np.testing.assert_allclose(np.abs(np.sum(normal * heading, axis=1))[kept], 1.0, rtol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1)[kept], 1.0, rtol=1e-12)


def test_rays_on_edges_are_in_the_cell_that_they_enter():
    """On the middle of an edge: in the cell ahead, the other one looking back; on the rim looking out in its own."""
    field = mesh_field("planar", "bilinear")
    air, mesh = MeshAir(field), field.mesh
    for face in range(4):
        a, b = mesh.corners[:, face], mesh.corners[:, (face + 1) % 4]
        middle, along = 0.5 * (a + b), b - a
        out = np.stack([along[:, 1], -along[:, 0]], axis=1)
        place, heading = (np.c_[0.0 * one[:, 0], one] for one in (middle, out))
        own, behind = np.arange(len(mesh.cells)), mesh.neighbors[:, face]
        np.testing.assert_array_equal(air.cell_at(place, -heading)[:, 0], own)
        np.testing.assert_array_equal(air.cell_at(place, heading)[:, 0], np.where(behind >= 0, behind, own))


def test_rays_in_a_gap_come_back():
    """From 0.5 m ahead of the mesh and beside it: to the edge that they meet, and the cell behind it."""
    air = MeshAir(mesh_field("planar", "bilinear"))
    place = np.array([[0.0, 0.2, 0.5], [0.0, 1.7, 1.2], [0.0, 0.2, 0.5]])
    heading = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    distance, cell = air.reenter(place, heading)
    assert distance == pytest.approx([0.5, 0.5, np.inf], rel=1e-12)
    behind = (place[:2] + (distance[:2] + 1e-6)[:, None] * heading[:2])[:, 1:]
    assert cell[:2, 0].tolist() == air.mesh.locate(behind).tolist()
