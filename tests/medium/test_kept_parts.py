"""Parts of keeping averages: bounds of vertices, walls, cut cells."""

import numpy as np
import pytest
from scipy.sparse import csr_array

from aerokernels import IndexField, QuadMesh
from aerokernels.medium.averages.kept_averages import _bounds, _extremes, _vertices_at, cell_deficits
from aerokernels.medium.averages.vertex_weights import vertex_weights
from aerokernels.medium.mesh_samples import MeshSamples
from aerokernels.medium.refined import _lifted, cut_in_four, has_seam, quarters, refined


def skewed(ni: int = 4, nj: int = 5, geometry: str = "planar") -> QuadMesh:
    y, z = np.meshgrid(np.linspace(0.5, 2.0, ni), np.linspace(0.0, 2.0, nj), indexing="ij")
    return QuadMesh.structured(y + 0.1 * np.sin(3.0 * z), z + 0.1 * y**2, geometry)


def rows_of(matrix) -> list[np.ndarray]:
    return np.split(matrix.indices, matrix.indptr[1:-1])


def test_extremes_over_rows_of_a_matrix():
    """Of the entries of each row; where there are none the value given."""
    matrix = csr_array(np.array([[1.0, 0, 2.0], [0, 0, 0], [0, 3.0, 0]]))
    low, high = _extremes(matrix, np.array([5.0, 1.0, 3.0]), np.array([7.0, 2.0, 9.0]), np.array([0.1, 0.2, 0.3]))
    assert low.tolist() == [3.0, 0.2, 1.0] and high.tolist() == [9.0, 0.2, 2.0]


@pytest.mark.parametrize("vacuum", [-np.inf, -2.0])
def test_bounds_of_vertices(vacuum: float):
    """Beside a shock the range of their cells; elsewhere that of these and their neighbours and a quarter of it more.

    A vertex of one cell takes the wider range. Given values are allowed, but not below a tenth of the density around.
    """
    mesh, rng = skewed(), np.random.default_rng(151)
    weights = vertex_weights(mesh)
    target, values = rng.uniform(1.0, 2.0, 12), rng.uniform(-3.0, 3.0, 20)
    smooth = rng.uniform(size=12) < 0.7
    low, high = _bounds(weights.matrix, weights.transposed, target, smooth, values, vacuum)
    cells_of, vertices_of = rows_of(weights.transposed), rows_of(weights.matrix)
    for vertex, cells in enumerate(cells_of):
        around = set(cells)
        for cell in cells:
            for other in vertices_of[cell]:
                around |= set(cells_of[other])
        wide = [target[list(around)].min(), target[list(around)].max()]
        near = [target[cells].min(), target[cells].max()] if len(cells) > 1 else wide
        more = 0.25 * (wide[1] - wide[0])
        least, most = (wide[0] - more, wide[1] + more) if smooth[cells].all() else near
        least = min(least, values[vertex])
        if np.isfinite(vacuum) and near[0] > vacuum:
            least = max(least, vacuum + 0.1 * (near[0] - vacuum))
        assert low[vertex] == pytest.approx(least, rel=1e-12)
        assert high[vertex] == pytest.approx(max(most, values[vertex]), rel=1e-12)


def test_walls_at_vertices():
    """Points within 1e-8 of the mesh's size of a vertex, several at one by their mean; others count for nothing."""
    mesh = skewed()
    size = np.ptp(mesh.vertices, axis=0).max()
    points = mesh.vertices[[7, 3, 7, 9]] + size * np.array([[0, 0], [0.9e-8, 0], [0, 0], [1.2e-8, 0]])
    vertex, value = _vertices_at(mesh, points, np.array([1.0, 5.0, 2.0, 9.0]))
    assert vertex.tolist() == [3, 7] and value.tolist() == [5.0, 1.5]


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_what_cells_lack_and_of_their_parts(geometry: str):
    """The average less the mean of the interpolant, by quadrature; the parts of a cell share what it lacks."""
    mesh, rng = skewed(geometry=geometry), np.random.default_rng(152)
    average, values = rng.uniform(1.0, 2.0, 12), rng.uniform(1.0, 2.0, 20)
    found = cell_deficits(mesh, average, values)
    node, weight = np.polynomial.legendre.leggauss(3)
    for number, corners in enumerate(mesh.corners):
        total = mean = 0.0
        for a, wa in zip(0.5 * (node + 1), weight, strict=True):
            for b, wb in zip(0.5 * (node + 1), weight, strict=True):
                shape = np.array([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b])
                along = np.array([b - 1, 1 - b, b, -b]) @ corners
                across = np.array([a - 1, -a, a, 1 - a]) @ corners
                share = wa * wb * (along[0] * across[1] - along[1] * across[0])
                share *= (shape @ corners)[0] if geometry == "axisymmetric" else 1.0
                total, mean = total + share, mean + share * (shape @ values[mesh.cells[number]])
        assert found[number] == pytest.approx(average[number] - mean / total, rel=1e-10, abs=1e-13)
    parts = QuadMesh(mesh.vertices, mesh.cells, geometry, parents=np.arange(12) // 2)
    size = mesh.corner_weights.sum(axis=1)
    together = [(size[k : k + 2] @ found[k : k + 2]) / size[k : k + 2].sum() for k in range(0, 12, 2)]
    np.testing.assert_allclose(cell_deficits(parts, average, values), np.repeat(together, 2), rtol=1e-10)


# --- cut cells -------------------------------------------------------------------------------------------------------


def test_points_in_quarters():
    """The part's own bilinear coordinates give the point of the whole cell back."""
    rng = np.random.default_rng(154)
    xi, eta = rng.uniform(size=(2, 100))
    part, u, v = quarters(xi, eta)
    whole = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    middle = 0.5 * (whole + np.roll(whole, -1, axis=0))
    for row in range(100):
        k = part[row]
        corners = np.array([whole[k], middle[k], [0.5, 0.5], middle[k - 1]])
        a, b = u[row], v[row]
        weights = np.array([(1 - a) * (1 - b), a * (1 - b), a * b, (1 - a) * b])
        np.testing.assert_allclose(weights @ corners, [xi[row], eta[row]], atol=1e-12)
    assert set(part) == {0, 1, 2, 3} and (0.0 <= u).all() and (u <= 1.0).all() and (0.0 <= v).all() and (v <= 1.0).all()


@pytest.mark.parametrize("unstructured", [False, True])
def test_cells_cut_in_four_have_a_cubics_values_on_edges(unstructured: bool):
    """Middles of edges by Hermite's cubic, of cells by Coons' patch: from values and gradients, cell by cell."""
    mesh, rng = skewed(), np.random.default_rng(155)
    if unstructured:
        mesh = QuadMesh(mesh.vertices, mesh.cells[rng.permutation(12)], "planar")
    values, gradient = rng.normal(size=20), rng.normal(size=(20, 2))
    fine, found = cut_in_four(mesh, values, gradient)
    np.testing.assert_array_equal(fine.vertices[:20], mesh.vertices)
    np.testing.assert_array_equal(found[:20], values)
    np.testing.assert_array_equal(fine.parents, np.repeat(np.arange(12), 4))
    assert fine.whole is mesh and len(fine.cells) == 48 and len(fine.vertices) == 20 + 31 + 12
    lookup = {tuple(np.round(place, 9)): value for place, value in zip(fine.vertices, found, strict=True)}
    for number, cell in enumerate(mesh.cells):
        edges = []
        for k in range(4):
            a, b = cell[k], cell[(k + 1) % 4]
            step = mesh.vertices[b] - mesh.vertices[a]
            edges.append(0.5 * (values[a] + values[b]) + (gradient[a] - gradient[b]) @ step / 8.0)
            place = 0.5 * (mesh.vertices[a] + mesh.vertices[b])
            assert lookup[tuple(np.round(place, 9))] == pytest.approx(edges[-1], rel=1e-12)
        middle = mesh.vertices[cell].mean(axis=0)
        expected = 0.5 * sum(edges) - values[cell].mean()
        assert lookup[tuple(np.round(middle, 9))] == pytest.approx(expected, rel=1e-12)
        for k, part in enumerate(fine.cells[4 * number : 4 * number + 4]):
            assert part[0] == cell[k]
            np.testing.assert_allclose(fine.vertices[part].mean(axis=0), 0.25 * (
                mesh.vertices[cell[k]] + middle + 0.5 * (mesh.vertices[cell[k]] + mesh.vertices[cell[(k + 1) % 4]])
                + 0.5 * (mesh.vertices[cell[k]] + mesh.vertices[cell[k - 1]])))  # fmt: skip


def test_vertices_that_cut_a_triangle_are_lifted_to_a_quadratic():
    """A triangle in three parts, values of y^2 - y z + 2 z^2 at corners, means in the middles: exact."""

    def quadratic(p):
        return p[..., 0] ** 2 - p[..., 0] * p[..., 1] + 2 * p[..., 1] ** 2

    def slope(p):
        return np.stack([2 * p[..., 0] - p[..., 1], 4 * p[..., 1] - p[..., 0]], axis=-1)

    corner = np.array([[0.0, 0.0], [2.0, 0.3], [0.5, 1.7]])
    middle = 0.5 * (corner + np.roll(corner, -1, axis=0))
    vertices = np.concatenate([corner, middle, corner.mean(axis=0)[None]])
    cells = np.array([[k, 3 + k, 6, 3 + (k - 1) % 3] for k in range(3)])
    mesh = QuadMesh(vertices, cells, "planar", parents=np.zeros(3, int))
    at = quadratic(corner)
    values = np.concatenate([at, 0.5 * (at + np.roll(at, -1)), [at.mean()]])
    lifted = _lifted(mesh, values, slope(vertices))
    np.testing.assert_allclose(lifted, quadratic(vertices), atol=1e-12)
    field = IndexField.from_mesh(mesh, 1e-4 * values)
    fine = refined(field)
    first = MeshSamples(mesh, _lifted(mesh, field.samples.values, field.samples.gradients), "bilinear")
    expected = cut_in_four(mesh, first.values, field.samples.gradients)[1]
    np.testing.assert_allclose(fine.samples.values, expected, rtol=1e-12)
    assert fine.samples.averages is None and not has_seam(mesh) and not has_seam(skewed())


@pytest.mark.parametrize("size", [1e-4, 1e3])
@pytest.mark.parametrize("cut", [True, False])
def test_kept_values_do_not_depend_on_units(cut: bool, size: float):
    """Of a step askew through a mesh: in other lengths the same values, in other densities the same shares."""
    mesh = skewed(9, 10)
    average = 1.0 + np.clip(0.5 + (mesh.cell_centroid @ [1.0, 0.6] - 1.9) / 0.1, 0.0, 1.0)
    kind = "conserving" if cut else "bilinear"
    values, lacks = [], []
    for length, density in ((1.0, 1e-4), (size, 1e-4), (1.0, 1e-4 * 0.01)):
        field = IndexField.from_mesh(
            QuadMesh(length * mesh.vertices, mesh.cells, "planar"), density * average, interpolation=kind
        )
        values.append(field.samples.values / density)
        lacks.append(field.samples.lacking / density)
    for found in values[1:]:
        np.testing.assert_allclose(found, values[0], rtol=2e-6)
    for found in lacks[1:]:
        np.testing.assert_allclose(found, lacks[0], atol=2e-6)
    assert np.abs(lacks[0]).max() > 1e-3
