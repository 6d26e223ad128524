"""Quadrilateral meshes: lookup against brute force, bilinear map and its inverse, areas and centroids, refusals."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import IndexField, QuadMesh
from aerokernels.medium.mesh_cells import bilinear_point, contains, invert_bilinear
from aerokernels.medium.refined import refined


def curvilinear(seed: int = 0, shape=(9, 13), geometry: str = "planar", turned: bool = False) -> QuadMesh:
    """A sheared, stretched, jittered grid; every cell stays convex because the jitter is below a sixth of a cell."""
    rng = np.random.default_rng(seed)
    first, second = np.meshgrid(np.arange(shape[0]) + 1.0, 1.0 * np.arange(shape[1]), indexing="ij")
    first, second = first + rng.uniform(-0.15, 0.15, shape), second + rng.uniform(-0.15, 0.15, shape)
    first, second = first + 0.3 * second, second * (1.0 + 0.02 * second)
    return QuadMesh.structured(*((second, first) if turned else (first, second)), geometry)


def cells_by_brute_force(mesh: QuadMesh, points: np.ndarray) -> np.ndarray:
    """Whether each cell holds each point, shape (point_count, cell_count)."""
    result = np.zeros((len(points), len(mesh.cells)), dtype=bool)
    for cell, corners in enumerate(mesh.corners):
        result[:, cell] = contains(np.broadcast_to(corners, (len(points), 4, 2)), points)
    return result


def assert_lookup_is_right(mesh: QuadMesh, points: np.ndarray) -> None:
    found, holds = mesh.locate(points), cells_by_brute_force(mesh, points)
    assert np.array_equal(found >= 0, holds.any(axis=1))
    rows = np.flatnonzero(found >= 0)
    assert holds[rows, found[rows]].all()


@given(seed=st.integers(0, 10_000), turned=st.booleans(), many=st.sampled_from([(2, 2), (2, 9), (9, 13), (20, 4)]))
@settings(max_examples=25, deadline=None)
def test_bins_find_what_brute_force_finds(seed, turned, many):
    """Points all over the box and around it; also every vertex and points on every edge, which are never lost."""
    mesh = curvilinear(seed, many, turned=turned)
    rng = np.random.default_rng(seed + 1)
    low, high = mesh.box
    margin = 0.2 * (high - low)
    assert_lookup_is_right(mesh, rng.uniform(low - margin, high + margin, (200, 2)))
    assert (mesh.locate(mesh.vertices) >= 0).all()
    share = rng.uniform(0.0, 1.0, (len(mesh.cells), 4, 1))
    on_edges = (1.0 - share) * mesh.corners + share * np.roll(mesh.corners, -1, axis=1)
    assert (mesh.locate(on_edges.reshape(-1, 2)) >= 0).all()


def test_a_point_on_an_edge_belongs_to_the_cell_of_lowest_index():
    """Set-up: unit cells 0 and 1 above each other, 2 and 3 beside them; edges, and the vertex where all four meet."""
    mesh = QuadMesh.structured(*np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], indexing="ij"))
    points = np.array([[0.5, 1.0], [1.0, 0.5], [1.0, 1.5], [1.5, 1.0], [1.0, 1.0]])
    assert mesh.locate(points).tolist() == [0, 0, 1, 2, 0]


def test_a_hair_beyond_the_rim_is_still_found():
    """Rounding puts points of the rim a few units in the last place outside; the slack of 1e-9 edges takes them in."""
    mesh = QuadMesh.structured(*np.meshgrid([0.1, 0.3], [0.1, 0.2, 0.7], indexing="ij"))
    hair = 1e-12
    points = np.array([[0.1 - hair, 0.5], [0.3 + hair, 0.5], [0.2, 0.1 - hair], [0.2, 0.7 + hair], [0.3 + hair] * 2])
    assert (mesh.locate(points) >= 0).all()


convex_quad = st.tuples(
    *[st.floats(0.0, 0.4) for _ in range(8)], st.floats(0.05, 20.0), st.floats(-1.0, 1.0), st.floats(0.0, 6.28)
)


@given(shape=convex_quad, xi=st.floats(0.0, 1.0), eta=st.floats(0.0, 1.0))
@settings(max_examples=200, deadline=None)
def test_bilinear_inverse_round_trip(shape, xi, eta):
    """Any convex cell: corners moved inward by up to 0.4, then stretched, sheared and turned. Rounding: 1e-9."""
    *moved, stretch, shear, turn = shape
    unit = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    inward = 0.5 - unit
    corner = unit + inward * np.reshape(moved, (4, 2))
    corner = corner * [1.0, stretch]
    corner = corner @ np.array([[1.0, 0.0], [shear, 1.0]])
    corner = corner @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    corners = corner[None]
    point, determinant = bilinear_point(corners, np.array([xi]), np.array([eta]))
    edge = np.roll(corner, -1, axis=0) - corner
    onward = np.roll(edge, -1, axis=0)
    convex = (edge[:, 0] * onward[:, 1] - edge[:, 1] * onward[:, 0] > 0.02 * stretch).all()
    if not convex:
        return
    assert determinant[0] > 0.0
    back = invert_bilinear(corners, point)
    assert abs(back[0][0] - xi) < 1e-9 and abs(back[1][0] - eta) < 1e-9


def test_areas_and_centroids():
    """A rectangle r in [1, 3], z in [0, 2], and a ring's volume centroid: <r> = (2/3) (b^3 - a^3) / (b^2 - a^2) = 13/6.

    A trapezoid with corners (0,0), (2,0), (1,1), (0,1): area 3/2, centroid (7/9, 4/9).
    """
    r, z = np.meshgrid([1.0, 3.0], [0.0, 2.0], indexing="ij")
    flat, ring = QuadMesh.structured(r, z, "planar"), QuadMesh.structured(r, z, "axisymmetric")
    areas = flat.corner_weights.sum(), ring.corner_weights.sum()
    assert areas == pytest.approx((4.0, 8.0), rel=1e-14)
    assert flat.cell_centroid[0] == pytest.approx([2.0, 1.0], rel=1e-14)
    assert ring.cell_centroid[0] == pytest.approx([13.0 / 6.0, 1.0], rel=1e-14)
    trapezoid = QuadMesh([[0, 0], [2, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
    assert trapezoid.corner_weights.sum() == pytest.approx(1.5, rel=1e-14)
    assert trapezoid.cell_centroid[0] == pytest.approx([7.0 / 9.0, 4.0 / 9.0], rel=1e-14)
    # The paper's l = sqrt(a b): mean opposite sides a = (2 + 1) / 2, b = (1 + sqrt 2) / 2.
    assert trapezoid.cell_size[0] == pytest.approx(np.sqrt(1.5 * 0.5 * (1.0 + np.sqrt(2.0))), rel=1e-14)


UNIT = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
TWO = [*UNIT, [2.0, 0.0], [2.0, 1.0]]


@pytest.mark.parametrize(
    ("vertices", "cells", "geometry", "message"),
    [
        (UNIT, [[0, 1, 2, 3]], "volume", "'planar' or 'axisymmetric', got 'volume'"),
        ([[0.0, 0.0, 0.0]] * 4, [[0, 1, 2, 3]], "planar", r"\(vertex_count, 2\), got \(4, 3\)"),
        (UNIT, [[0, 1, 2]], "planar", r"\(cell_count, 4\), got int64 \(1, 3\)"),
        (UNIT, [[0.0, 1.0, 2.0, 3.0]], "planar", "whole numbers"),
        (UNIT, np.empty((0, 4), dtype=int), "planar", "cell_count, 4"),
        (UNIT, [[0, 1, 2, 4]], "planar", "vertices 0 to 4, there are 4"),
        (UNIT, [[0, 1, 2, -1]], "planar", "vertices -1 to 2, there are 4"),
        ([[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0]], [[0, 1, 2, 3]], "axisymmetric", "2 vertices.*negative"),
        ([[np.nan, 0.0], [1.0, 0.0], [1.0, np.inf], [0.0, 1.0]], [[0, 1, 2, 3]], "planar", r"2 of 8.*index \(0, 0\)"),
        (TWO, [[0, 1, 2, 3], [1, 2, 5, 4]], "planar", "1 of 2 cells are inverted.*cell 1"),
        (UNIT, [[0, 1, 2, 2]], "planar", r"1 cells have coincident vertices.*cell 0.*\[0, 1, 2, 2\]"),
        ([*UNIT[:3], UNIT[2]], [[0, 1, 2, 3]], "planar", "coincident vertices.*merge"),
        ([[0.0, 0.0], [1.0, 0.0], [0.2, 0.2], [0.0, 1.0]], [[0, 1, 2, 3]], "planar", "not convex.*cell 0"),
        ([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [3.0, 0.0]], [[0, 1, 2, 3]], "planar", "degenerate or not convex"),
        ([[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], [[0, 1, 2, 3]], "planar", "not convex"),
        # The same place twice: two cells that look like neighbours and are not.
        (
            [*UNIT, [1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0]],
            [[0, 1, 2, 3], [4, 5, 6, 7]],
            "planar",
            "2 vertices.*same place.*vertices 1 and 4.*merge",
        ),
    ],
)
def test_what_is_refused(vertices, cells, geometry, message):
    with pytest.raises(ValueError, match=message):
        QuadMesh(vertices, cells, geometry)


@pytest.mark.parametrize("size", [1e-5, 1.0, 1e3])
def test_a_cell_of_any_size_holds_its_edges_and_nothing_beyond(size):
    """Points on an edge, 1e-10 of it beyond (rounding), and 1e-3 of it beyond each edge."""
    cell = size * np.array([[0.0, 0.0], [2.0, 0.0], [2.5, 1.5], [0.5, 1.0]])
    middles, out = 0.5 * (cell + np.roll(cell, -1, axis=0)), np.roll(cell, -1, axis=0) - cell
    normal = np.stack([out[:, 1], -out[:, 0]], axis=1)
    corners = np.repeat(cell[None], 4, axis=0)
    assert contains(corners, middles).all()
    assert contains(corners, middles + 1e-10 * normal).all()
    assert not contains(corners, middles + 1e-3 * normal).any()
    assert contains(corners, middles - 1e-3 * normal).all()


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_cells_cut_in_four_keep_a_parabolas_values(geometry):
    """Values at vertices stay, those between follow from both gradients: exact where a rise is quadratic along an edge.

    Cells of a grid of 3 by 2: 24 quarters; a value of x^2 + 3 x y at every new vertex.
    """
    z, y = np.meshgrid(np.linspace(1.0, 2.0, 3), np.linspace(0.0, 3.0, 4))
    mesh = QuadMesh.structured(y, z, geometry)

    def value(points):
        return 1e-4 * (points[:, 0] ** 2 + 3.0 * points[:, 0] * points[:, 1])

    field = IndexField.from_mesh(mesh, value(mesh.vertices).reshape(y.shape))
    exact = 1e-4 * np.stack([2.0 * mesh.vertices[:, 0] + 3.0 * mesh.vertices[:, 1], 3.0 * mesh.vertices[:, 0]], axis=1)
    field.samples.__dict__["gradients"] = exact
    found = refined(field)
    assert len(found.mesh.cells) == 24 and found.mesh.geometry == geometry
    assert len(found.mesh.vertices) == 7 * 5
    np.testing.assert_allclose(found.samples.values, value(found.mesh.vertices), atol=1e-18)


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_cells_that_lie_in_other_cells_are_refused(geometry: str):
    """Set-up: a coarse sheet of cells and a fine one that overlap, as overset meshes do, or that only touch.

    Expected: refused where they overlap: of two values at a place one would count, without a word.
    """
    coarse, fine = (np.stack(np.meshgrid(np.linspace(1.0, 2.0, n), np.linspace(0.0, 1.0, n), indexing="ij"), axis=-1)
                    for n in (5, 12))  # fmt: skip

    def both(shift: float) -> QuadMesh:
        parts = coarse, fine + np.array([0.013, shift])
        sheets = [QuadMesh.structured(*np.moveaxis(part, -1, 0), geometry) for part in parts]
        cells = np.concatenate([sheets[0].cells, sheets[1].cells + len(sheets[0].vertices)])
        return QuadMesh(np.concatenate([sheet.vertices for sheet in sheets]), cells, geometry)

    assert len(both(1.001).cells) == 16 + 121
    for shift in (0.5, 0.9):
        with pytest.raises(ValueError, match=r"cells at the edge of the mesh or of its blocks lie in other cells, the"):
            both(shift)
