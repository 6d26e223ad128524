"""Parts of vertex values and meshes, each against a plain loop over cells, pairs or faces."""

from itertools import product

import numpy as np
import pytest

from aerokernels import QuadMesh
from aerokernels.medium.averages import vertex_values as made
from aerokernels.medium.averages.vertex_weights import vertex_weights
from aerokernels.medium.bilinear import EDGE_TOLERANCE, bilinear_point, contains, invert_bilinear
from aerokernels.medium.bodies.wall_tree import LEAF, MARGIN, wall_tree


def skewed(ni: int = 6, nj: int = 7, geometry: str = "planar", first: float = 0.5) -> QuadMesh:
    y, z = np.meshgrid(np.linspace(first, first + 1.5, ni), np.linspace(0.0, 2.0, nj) ** 1.3, indexing="ij")
    return QuadMesh.structured(y + 0.1 * np.sin(3.0 * z) * (y > 0.0), z + 0.1 * y**2, geometry)


def unordered(mesh: QuadMesh, seed: int = 0, parents: bool = False) -> QuadMesh:
    order = np.random.default_rng(seed).permutation(len(mesh.cells))
    return QuadMesh(mesh.vertices, mesh.cells[order], mesh.geometry, parents=order // 2 if parents else None)


# --- faces between cells ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("limited", [True, False])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
def test_values_at_faces(count: int, limited: bool):
    """Linear between the centroids, less the fourth-order term between smooth cells, limited to both averages.

    At the ends the two nearest cells are extrapolated, by no more than their difference.
    """
    rng = np.random.default_rng(171 + count)
    average, smooth = rng.uniform(size=(count, 3)), rng.uniform(size=(count, 3)) < 0.7
    centroid = np.stack(np.broadcast_arrays(np.arange(count)[:, None] + 0.3 * rng.uniform(size=(count, 3)),
                                            rng.uniform(size=3)), axis=-1)  # fmt: skip
    face = np.stack(np.broadcast_arrays(np.arange(count + 1)[:, None] - 0.4 + 0.1 * rng.uniform(size=(count + 1, 3)),
                                        rng.uniform(size=3)), axis=-1)  # fmt: skip
    found = made._faces_along_first_axis(average, smooth, centroid, face, False, limited, False)
    assert found.shape == (count + 1, 3)
    for j in range(3):
        f, c, x = average[:, j], centroid[:, j], face[:, j]
        if count == 1:
            assert (found[:, j] == f[0]).all()
            continue
        gap = [np.linalg.norm(c[k + 1] - c[k]) for k in range(count - 1)]
        for k in range(1, count):
            left, right = np.linalg.norm(x[k] - c[k - 1]), np.linalg.norm(c[k] - x[k])
            value = (f[k - 1] * right + f[k] * left) / (left + right)
            if 2 <= k <= count - 2 and smooth[k - 1, j] and smooth[k, j]:
                value -= gap[k - 1] / 12 * ((f[k + 1] - f[k]) / gap[k] - (f[k - 1] - f[k - 2]) / gap[k - 2])
            if limited:
                value = np.clip(value, min(f[k - 1], f[k]), max(f[k - 1], f[k]))
            assert found[k, j] == pytest.approx(value, rel=1e-11)
        for edge, one, two in ((0, 0, 1), (count, count - 1, count - 2)):
            ratio = min(np.linalg.norm(x[edge] - c[one]) / np.linalg.norm(c[two] - c[one]), 1.0)
            assert found[edge, j] == pytest.approx(f[one] - ratio * (f[two] - f[one]), rel=1e-11)


def test_on_the_axis_the_field_is_even():
    """A + b r^2 through two centroids, met at r = 0 exactly, but no further off than their difference."""
    for near, far, share in ((0.3, 1.0, 0.09 / 0.91), (0.8, 1.0, 1.0)):
        centroid = np.array([[[near, 0.5]], [[far, 0.5]], [[2.0, 0.5]]])
        face = np.array([[[0.0, 0.4]], [[0.7, 0.5]], [[1.4, 0.5]], [[2.4, 0.5]]])
        average = np.array([[2.0 + 3.0 * near**2], [2.0 + 3.0 * far**2], [7.0]])
        smooth = np.ones((3, 1), bool)
        found = made._faces_along_first_axis(average, smooth, centroid, face, True, True, False)
        assert found[0, 0] == pytest.approx(average[0, 0] - share * (average[1, 0] - average[0, 0]), rel=1e-12)
        assert share == 1.0 or found[0, 0] == pytest.approx(2.0, rel=1e-12)
        face[0, 0, 0] = 0.1
        off = made._faces_along_first_axis(average, smooth, centroid, face, True, True, False)[0, 0]
        reach = np.hypot(near - 0.1, 0.1) / (far - near)
        assert off == pytest.approx(average[0, 0] - min(reach, 1.0) * (average[1, 0] - average[0, 0]), rel=1e-12)


@pytest.mark.parametrize("edge", [0, 1])
def test_beside_a_shock_the_lesser_change_is_extrapolated(edge: int):
    """Of the first two, in their distance, less the changes along the edge; none where they differ in sign."""
    own = np.array([[1.0, 1.1, 1.05, 0.9], [1.6, 1.0, 1.9, 1.5], [3.0, 1.4, 2.0, 0.2], [3.1, 1.5, 2.0, 0.0]])
    distance = np.array([[1.0, 0.5, 1.0, 2.0], [2.0, 1.0, 0.5, 1.0], [1.0, 1.0, 1.0, 1.0]])
    if edge:
        own, distance = own[::-1], distance[::-1]
    slope = np.diff(own, axis=0) / distance
    found = made._lesser(own, slope, distance, 0 if not edge else 4)
    rows = own if not edge else own[::-1]
    gaps = distance if not edge else distance[::-1]
    for j in range(4):
        change = rows[1, j] - rows[0, j]
        further = (rows[2, j] - rows[1, j]) / gaps[1, j] * gaps[0, j]
        along = max(abs(rows[0, k] - rows[0, j]) for k in (j - 1, j + 1) if 0 <= k < 4)
        size = max(min(abs(change), abs(further)) - along, 0.0)
        assert found[j] == pytest.approx(np.sign(change) * size if change * further > 0.0 else 0.0, abs=1e-12)
    assert (found != 0.0).any() and (found == 0.0).any()
    assert not made._lesser(own[:2], slope[:1], distance[:1], 0).any()


def test_cells_beside_a_shock():
    """A second difference above a twentieth of the range along either direction, and the cells around."""
    average = np.random.default_rng(172).normal(0.0, 0.012, (9, 11)) + np.linspace(0.0, 1.0, 11)
    average[3, 4] += 0.4
    jump, bound = np.zeros((9, 11), bool), 0.05 * np.ptp(average)
    for i, j in product(range(9), range(11)):
        if 0 < i < 8 and abs(average[i - 1, j] - 2 * average[i, j] + average[i + 1, j]) > bound:
            jump[i, j] = True
        if 0 < j < 10 and abs(average[i, j - 1] - 2 * average[i, j] + average[i, j + 1]) > bound:
            jump[i, j] = True
    wide = np.array([[jump[max(i - 1, 0) : i + 2, max(j - 1, 0) : j + 2].any() for j in range(11)] for i in range(9)])
    np.testing.assert_array_equal(made._beside_shock(average), wide)
    assert wide.any() and not wide.all()
    mesh = skewed(10, 12)
    np.testing.assert_array_equal(made.values_and_smooth(mesh, average.ravel())[1], ~wide.ravel())


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_linear_densities_on_skewed_cells(geometry: str):
    """Met at every vertex, by cells in order and without; edges' means at their middles."""
    mesh = skewed(geometry=geometry)
    slope = np.array([2.0, -3.0])
    values, smooth = made.linear_values_and_smooth(mesh, 1.0 + mesh.cell_centroid @ slope)
    np.testing.assert_allclose(values, 1.0 + mesh.vertices @ slope, rtol=1e-10)
    assert smooth.all() and smooth.shape == (30,)
    other, _ = made.linear_values_and_smooth(unordered(mesh), 1.0 + unordered(mesh).cell_centroid @ slope)
    np.testing.assert_allclose(other, 1.0 + mesh.vertices @ slope, rtol=1e-10)
    rows, columns = made.edge_means(mesh, 1.0 + mesh.cell_centroid @ slope)
    vertex = mesh.vertices.reshape(6, 7, 2)
    assert rows.shape == (6, 6) and columns.shape == (5, 7)
    # Along an edge the offset of the centroids is mended by a difference: third order of the offset is left.
    np.testing.assert_allclose(rows, 1.0 + 0.5 * (vertex[:, 1:] + vertex[:, :-1]) @ slope, atol=6e-2)
    np.testing.assert_allclose(columns, 1.0 + 0.5 * (vertex[1:] + vertex[:-1]) @ slope, atol=6e-2)


# --- pairs and slopes ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("parents", [False, True])
def test_pairs_of_vertices_and_cells(parents: bool):
    """Vertices that share a cell, cells of the flow that share a vertex, and which touch: by sets."""
    mesh = unordered(skewed(4, 5), parents=parents)
    owner = mesh.parents if parents else np.arange(len(mesh.cells))
    touching = {(int(v), int(p)) for cell, p in zip(mesh.cells, owner, strict=True) for v in cell}
    vertex, cell = made._touching(mesh)
    assert {(int(a), int(b)) for a, b in zip(vertex, cell, strict=True)} == touching and len(vertex) == len(touching)
    first, second = made._vertex_pairs(mesh)
    expected = {(int(a), int(b)) for one in mesh.cells for a in one for b in one if a != b}
    assert {(int(a), int(b)) for a, b in zip(first, second, strict=True)} == expected and len(first) == len(expected)
    first, second = made._cell_pairs(mesh)
    expected = {(p, q) for v, p in touching for w, q in touching if v == w and p != q}
    assert {(int(a), int(b)) for a, b in zip(first, second, strict=True)} == expected and len(first) == len(expected)


def test_slopes_are_least_squares():
    """Of the differences to neighbours, by inverse distance: NumPy's solution; on a line the shortest one."""
    rng = np.random.default_rng(173)
    points, values = rng.uniform(size=(9, 2)), rng.normal(size=9)
    pairs = np.array([(i, j) for i in range(8) for j in range(8) if i != j and (i + j) % 3])
    pairs = np.concatenate([pairs, [(8, 0)]])
    found = made._least_squares_gradient(points, values, *pairs.T)
    for i in range(9):
        others = pairs[pairs[:, 0] == i, 1]
        step, rise = points[others] - points[i], values[others] - values[i]
        weight = 1.0 / np.linalg.norm(step, axis=1)
        expected = np.linalg.lstsq(step * weight[:, None], rise * weight, rcond=None)[0]
        np.testing.assert_allclose(found[i], expected, rtol=1e-8, atol=1e-10)


@pytest.mark.parametrize("parents", [False, True])
def test_values_at_vertices_of_cells_without_order(parents: bool):
    """Inverse-distance means of linear reconstructions, constant beside shocks, within the stated range."""
    mesh = unordered(skewed(9, 10), parents=parents)
    rng = np.random.default_rng(174)
    count = 36 if parents else 72
    flow = made.of_parents(mesh, mesh.cell_centroid) @ [0.5, 0.3] + 3e-3 * rng.normal(size=count)
    flow[5] += 0.5
    average = flow[mesh.parents] if parents else flow
    found, smooth = made.values_and_smooth(mesh, average)
    centroid = made.of_parents(mesh, mesh.cell_centroid)
    first, second = made._cell_pairs(mesh)
    slope = made._least_squares_gradient(centroid, flow, first, second)
    near = {p: second[first == p] for p in range(count)}
    kinked = [
        any(abs(flow[q] - flow[p] - slope[p] @ (centroid[q] - centroid[p])) > 0.05 * np.ptp(flow) for q in near[p])
        for p in range(count)
    ]
    shock = [kinked[p] or any(kinked[q] for q in near[p]) for p in range(count)]
    assert smooth.tolist() == [not one for one in shock]
    owner = mesh.parents if parents else np.arange(len(mesh.cells))
    cells_of = {v: sorted({int(p) for cell, p in zip(mesh.cells, owner, strict=True) if v in cell}) for v in range(90)}
    edges = {}
    for cell in mesh.cells.tolist():
        for k in range(4):
            edge = frozenset((cell[k], cell[(k + 1) % 4]))
            edges[edge] = edges.get(edge, 0) + 1
    rim = {v for edge, times in edges.items() if times == 1 for v in edge}
    for v, cells in cells_of.items():
        weights, guesses = [], []
        for p in cells:
            reach = mesh.vertices[v] - centroid[p]
            weights.append(1.0 / np.linalg.norm(reach))
            guesses.append(flow[p] + (0.0 if shock[p] else slope[p] @ reach))
        low, high = flow[cells].min(), flow[cells].max()
        low, high = low - (high - low), high + (high - low)
        if v in rim or len(cells) <= 2:
            for p in cells:
                span = np.abs(flow[near[p]] - flow[p]).max()
                low, high = min(low, flow[p] - span), max(high, flow[p] + span)
        expected = np.clip(np.average(guesses, weights=weights), low, high)
        assert found[v] == pytest.approx(expected, rel=1e-10), (v, cells)
    assert any(shock) and (parents or not all(shock))


# --- weights, trees, cells -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("parents", [False, True])
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_weights_of_vertices(geometry: str, parents: bool):
    """Sums over parts of the corners' weights; totals, what averages lack."""
    mesh = unordered(skewed(4, 5, geometry), parents=parents)
    owner = mesh.parents if parents else np.arange(len(mesh.cells))
    count = owner.max() + 1
    dense = np.zeros((count, 20))
    for cell, p, weight in zip(mesh.cells, owner, mesh.corner_weights, strict=True):
        np.add.at(dense, (p, cell), weight)
    found = vertex_weights(mesh)
    np.testing.assert_allclose(found.matrix.toarray(), dense, rtol=1e-12)
    np.testing.assert_allclose(found.transposed.toarray(), dense.T, rtol=1e-12)
    np.testing.assert_allclose(found.cell_total, dense.sum(axis=1))
    np.testing.assert_allclose(found.vertex_total, dense.sum(axis=0))
    belongs = dense > 0.0
    np.testing.assert_array_equal(found.single, belongs.sum(axis=0) == 1)
    rng = np.random.default_rng(175)
    average, values = rng.normal(size=count), rng.normal(size=20)
    np.testing.assert_allclose(found.deficit(average, values), average - dense @ values / dense.sum(axis=1), rtol=1e-9)
    assert vertex_weights(mesh) is found


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", [1, 4, 5, 37])
def test_trees_of_boxes(count: int, dimension: int):
    """Every piece is in one leaf of at most four, in the boxes of all nodes above it; links lead on."""
    corners = np.random.default_rng(count).normal(size=(count, dimension, dimension))
    tree = wall_tree(corners, 2.0 * corners)
    margin = MARGIN * np.ptp(corners.reshape(-1, dimension), axis=0).max()
    assert sorted(map(tuple, tree.corners.reshape(count, -1))) == sorted(map(tuple, corners.reshape(count, -1)))

    def under(node: int) -> tuple[int, int]:
        """The pieces of a node and its descendants; checks boxes and links on the way."""
        following, first, last = tree.links[node]
        if last > first:
            assert following == node + 1 and last - first <= LEAF
        else:
            (one, rows), (two, _) = tree.children(node, np.arange(3))
            assert rows.tolist() == [0, 1, 2] and one == node + 1 and two == tree.links[one][0]
            (first, middle), (again, last) = under(one), under(two)
            assert middle == again and following == tree.links[two][0]
            assert (middle - first) % LEAF == 0 or last - first <= LEAF + 1
        held = tree.corners[first:last].reshape(-1, dimension)
        np.testing.assert_allclose(tree.boxes[node], [held.min(axis=0) - margin, held.max(axis=0) + margin], rtol=1e-12)
        return first, last

    assert under(0) == (0, count) and tree.links[0][0] == len(tree.boxes)
    rows, normals, boxes = tree.kernel_rows
    np.testing.assert_array_equal(normals, 2.0 * rows)
    if dimension == 2:
        np.testing.assert_array_equal(rows, tree.corners.reshape(count, 4))
        np.testing.assert_array_equal(boxes, tree.boxes.reshape(-1, 4))
    else:
        np.testing.assert_array_equal(rows.reshape(count, 3, 4)[..., :3], tree.corners)
        np.testing.assert_array_equal(boxes.reshape(-1, 2, 4)[..., :3], tree.boxes)
        assert not rows[:, 3].any() and not boxes[:, 3].any()


def test_cells_of_a_mesh_one_by_one():
    """Neighbours by shared edges, sizes by the sides, boxes with a tolerance, bins that list what touches them."""
    mesh = unordered(skewed(5, 6))
    sides = {}
    for number, cell in enumerate(mesh.cells.tolist()):
        for k in range(4):
            sides.setdefault(frozenset((cell[k], cell[(k + 1) % 4])), []).append(number)
    for number, cell in enumerate(mesh.cells.tolist()):
        for k in range(4):
            others = [one for one in sides[frozenset((cell[k], cell[(k + 1) % 4]))] if one != number]
            assert mesh.neighbors[number, k] == (others[0] if others else -1)
        a, b, c, d = (np.linalg.norm(mesh.corners[number, (k + 1) % 4] - mesh.corners[number, k]) for k in range(4))
        assert mesh.cell_size[number] == pytest.approx(np.sqrt(0.25 * (a + c) * (b + d)), rel=1e-13)
    low, high = mesh.box
    tolerance = EDGE_TOLERANCE * (high - low)
    np.testing.assert_allclose(mesh.cell_boxes[0].T, mesh.corners.min(axis=1) - tolerance, rtol=1e-14)
    np.testing.assert_allclose(mesh.cell_boxes[1].T, mesh.corners.max(axis=1) + tolerance, rtol=1e-14)
    bins = mesh.bins
    for i, j in product(range(bins.count[0]), range(bins.count[1])):
        begin = bins.origin + bins.size * [i, j]
        first, last = mesh.cell_boxes
        meets = (first.T <= begin + bins.size).all(axis=1) & (last.T >= begin).all(axis=1)
        k = i * bins.count[1] + j
        listed = bins.cell[bins.start[k] : bins.start[k + 1]]
        assert set(np.flatnonzero(meets)) >= set(listed.tolist()) and (np.diff(listed) > 0).all()
        inner = (first.T < begin + bins.size * (1 - 1e-9)).all(axis=1) & (last.T > begin + bins.size * 1e-9).all(axis=1)
        assert set(listed.tolist()) >= set(np.flatnonzero(inner))
    assert skewed().array_shapes == ([(42,), (6, 7)], [(30,), (5, 6)])
    assert mesh.array_shapes == ([(30,)], [(20,)])


def test_points_and_coordinates_in_cells():
    """The bilinear map and its Jacobian by differences, its inverse, and what a cell holds by cross products."""
    rng = np.random.default_rng(176)
    corners = np.array([[0.0, 0.0], [2.0, 0.3], [2.5, 1.9], [0.4, 1.2]]) + 0.2 * rng.normal(size=(50, 4, 2))
    xi, eta = rng.uniform(size=(2, 50))
    points, jacobian = bilinear_point(corners, xi, eta)
    h = 1e-6
    along = (bilinear_point(corners, xi + h, eta)[0] - bilinear_point(corners, xi - h, eta)[0]) / (2 * h)
    across = (bilinear_point(corners, xi, eta + h)[0] - bilinear_point(corners, xi, eta - h)[0]) / (2 * h)
    np.testing.assert_allclose(jacobian, along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0], rtol=1e-8)
    np.testing.assert_allclose(invert_bilinear(corners, points), [xi, eta], atol=1e-10)
    assert contains(corners, points).all()
    around = rng.uniform(-0.5, 3.0, (50, 2))
    inside = np.ones(50, bool)
    for k in range(4):
        a, b = corners[:, k], corners[:, (k + 1) % 4]
        inside &= (b - a)[:, 0] * (around - a)[:, 1] - (b - a)[:, 1] * (around - a)[:, 0] > 0.0
    np.testing.assert_array_equal(contains(corners, around), inside)
    assert 10 < inside.sum() < 40
