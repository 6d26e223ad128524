"""Vertex values from finite-volume cell averages, and gradients at vertices.

Averages become values at faces, one mesh direction after the other, by the fourth-order finite-volume formula, linear
between centroids minus (d1 / 12) [(f_(i+2) - f_(i+1)) / d2 - (f_i - f_(i-1)) / d0]; beside a captured shock without the
second term, which keeps line integrals across it exact. Gradients are the paper's eq 7, divided by the mesh's metric.
"""

import numpy as np

from aerokernels.derived import cached_on
from aerokernels.medium.mesh import QuadMesh

# Row k: derivative at the k-th of five consecutive nodes; row 2 is eq 7.
FIVE_POINT = (
    np.array(
        [
            [-25.0, 48.0, -36.0, 16.0, -3.0],
            [-3.0, -10.0, 18.0, -6.0, 1.0],
            [1.0, -8.0, 0.0, 8.0, -1.0],
            [-1.0, 6.0, -18.0, 10.0, 3.0],
            [3.0, -16.0, 36.0, -48.0, 25.0],
        ]
    )
    / 12.0
)
# A second difference above this fraction of the field's whole range counts as a captured shock; those of smooth flow
# resolved by twenty cells or more are below it.
SHOCK_SHARE = 0.05


def vertex_values(mesh: QuadMesh, average: np.ndarray) -> np.ndarray:
    """Return vertex values, shape (vertex_count,), from cell averages, shape (cell_count,)."""
    return values_and_smooth(mesh, average)[0]


def values_and_smooth(mesh: QuadMesh, average: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return vertex values, and which of the flow's cells neither contain nor touch a captured shock."""
    if mesh.shape is None:
        return _unstructured_vertex_values(mesh, average)
    smooth = ~_beside_shock(average.reshape(mesh.shape[0] - 1, mesh.shape[1] - 1))
    return _along_both_axes(mesh, average, smooth), smooth.ravel()


def _along_both_axes(mesh: QuadMesh, average, smooth, limited: bool = True, lesser: bool = False) -> np.ndarray:
    """Return vertex values on a structured mesh, computed one direction after the other."""
    ni, nj = mesh.shape or (0, 0)
    vertex = mesh.vertices.reshape(ni, nj, 2)
    centroid = mesh.cell_centroid.reshape(ni - 1, nj - 1, 2)
    face = 0.5 * (vertex[:, :-1] + vertex[:, 1:])
    on_axis = mesh.geometry == "axisymmetric"
    average = average.reshape(ni - 1, nj - 1)
    at_face = _faces_along_first_axis(average, smooth, centroid, face, on_axis, limited, lesser)
    smooth = np.pad(smooth, ((1, 0), (0, 0)), mode="edge") & np.pad(smooth, ((0, 1), (0, 0)), mode="edge")
    places = face.swapaxes(0, 1), vertex.swapaxes(0, 1)
    return np.asarray(_faces_along_first_axis(at_face.T, smooth.T, *places, on_axis, limited, lesser).T.ravel())


def linear_values_and_smooth(mesh: QuadMesh, average: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As `values_and_smooth`, but exact for linear densities on skewed and uneven cells too.

    The formula applied to the coordinates of the centroids shows by how much it misses the vertices.
    """
    if mesh.shape is None or min(mesh.shape) < 3:
        return _unstructured_vertex_values(mesh, average)
    slope, shock, *_ = _slopes(mesh, mesh.cell_centroid, average)
    smooth = ~shock.reshape(mesh.shape[0] - 1, mesh.shape[1] - 1)
    values = _along_both_axes(mesh, average, smooth, lesser=True)
    vertex, cell = mesh.cells.ravel(), np.repeat(np.arange(len(average)), 4)
    count = np.bincount(vertex, minlength=len(values))
    for axis in (0, 1):
        place = _along_both_axes(mesh, mesh.cell_centroid[:, axis], smooth, limited=False)
        missed = mesh.vertices[:, axis] - place
        values = values + missed * np.bincount(vertex, slope[cell, axis], len(values)) / count
    return values, ~shock


def _beside_shock(average: np.ndarray) -> np.ndarray:
    """Return which cells of a structured mesh contain a jump along either direction, or touch a cell that does."""
    jump = np.zeros(average.shape, dtype=bool)
    bound = SHOCK_SHARE * np.ptp(average)
    jump[1:-1] |= np.abs(np.diff(average, 2, axis=0)) > bound
    jump[:, 1:-1] |= np.abs(np.diff(average, 2, axis=1)) > bound
    for axis in (0, 1):
        moved = np.moveaxis(jump, axis, 0)
        wider = moved.copy()
        wider[1:] |= moved[:-1]
        wider[:-1] |= moved[1:]
        jump = np.moveaxis(wider, 0, axis)
    return jump


def _faces_along_first_axis(average, smooth, centroid, face, on_axis: bool, limited, lesser) -> np.ndarray:
    """Return values at the n + 1 faces of n cells along axis 0, of higher order only between smooth cells."""
    count = len(average)
    result = np.empty((count + 1, *average.shape[1:]))
    if count == 1:
        result[:] = average
        return result
    distance = np.linalg.norm(np.diff(centroid, axis=0), axis=-1)
    slope = np.diff(average, axis=0) / distance
    ahead = np.linalg.norm(centroid[1:] - face[1:-1], axis=-1)
    behind = np.linalg.norm(centroid[:-1] - face[1:-1], axis=-1)
    inner = (average[:-1] * ahead + average[1:] * behind) / (ahead + behind)
    curvature = distance[1:-1] / 12.0 * (slope[2:] - slope[:-2])
    inner[1:-1] -= np.where(smooth[1:-2] & smooth[2:-1], curvature, 0.0)
    if limited:
        inner = np.clip(inner, np.minimum(average[:-1], average[1:]), np.maximum(average[:-1], average[1:]))
    result[1:-1] = inner
    for edge, first, second in ((0, 0, 1), (count, count - 1, count - 2)):
        reach = np.linalg.norm(face[edge] - centroid[first], axis=-1)
        ratio = np.minimum(reach / np.linalg.norm(centroid[second] - centroid[first], axis=-1), 1.0)
        if on_axis:
            radius, near, far = face[edge, ..., 0], centroid[first, ..., 0], centroid[second, ..., 0]
            even = near**2 / np.maximum(far**2 - near**2, 1e-300)
            ratio = np.where((radius == 0.0) & (far > near), np.minimum(even, 1.0), ratio)
        change = average[second] - average[first]
        if lesser and limited:
            change = np.where(smooth[first], change, _lesser(average, slope, distance, edge))
        result[edge] = average[first] - ratio * change
    return result


def _lesser(average, slope, distance, edge: int) -> np.ndarray:
    """Return the change from the edge's cell to the next: the smaller of the first two, minus changes along the edge.

    So a layer along a wall is extrapolated to the wall, and a shock that leaves through the edge is not.
    """
    own = average if edge == 0 else average[::-1]
    change = own[1] - own[0]
    if len(own) < 3:
        return np.zeros_like(change)
    near, far = (0, 1) if edge == 0 else (-1, -2)
    further = slope[far] * distance[near] * (1.0 if edge == 0 else -1.0)
    step, along = np.abs(np.diff(own[0])), np.zeros_like(change)
    along[1:] = step
    along[:-1] = np.maximum(along[:-1], step)
    size = np.maximum(np.minimum(np.abs(change), np.abs(further)) - along, 0.0)
    return np.where(change * further > 0.0, np.sign(change) * size, 0.0)


def vertex_gradients(mesh: QuadMesh, values: np.ndarray) -> np.ndarray:
    """Return gradients at the vertices [1/m], shape (vertex_count, 2)."""
    if mesh.shape is None or min(mesh.shape) < 5:
        gradient = _least_squares_gradient(mesh.vertices, values, *_vertex_pairs(mesh))
    else:
        ni, nj = mesh.shape
        columns = [mesh.vertices[:, 0], mesh.vertices[:, 1], values]
        along = [_five_point(c.reshape(ni, nj), 0) for c in columns]
        across = [_five_point(c.reshape(ni, nj), 1) for c in columns]
        determinant = along[0] * across[1] - along[1] * across[0]
        first = (along[2] * across[1] - across[2] * along[1]) / determinant
        second = (across[2] * along[0] - along[2] * across[0]) / determinant
        gradient = np.stack([first.ravel(), second.ravel()], axis=1)
    if mesh.geometry == "axisymmetric":
        gradient[mesh.vertices[:, 0] == 0.0, 0] = 0.0
    return gradient


def _five_point(array: np.ndarray, axis: int) -> np.ndarray:
    moved = np.moveaxis(array, axis, 0)
    result = np.empty_like(moved)
    count = len(moved)
    result[2:-2] = sum(c * moved[k : count - 4 + k] for k, c in enumerate(FIVE_POINT[2]))
    for row in (0, 1):
        result[row] = np.tensordot(FIVE_POINT[row], moved[:5], axes=1)
        result[count - 1 - row] = np.tensordot(FIVE_POINT[4 - row], moved[-5:], axes=1)
    return np.moveaxis(result, 0, axis)


@cached_on("mesh")
def _vertex_pairs(mesh: QuadMesh) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of different vertices that share a cell, each pair in both orders."""
    from scipy.sparse import csr_matrix

    # Cells share edges, which count once, but no diagonals. The matrix sorts the pairs.
    cell, edge = np.nonzero(mesh.neighbors < np.arange(len(mesh.cells))[:, None])
    pairs = [(mesh.cells[cell, edge], mesh.cells[cell, (edge + 1) % 4])]
    pairs += [(mesh.cells[:, k], mesh.cells[:, k + 2]) for k in (0, 1)]
    one, other = (np.concatenate(side) for side in zip(*pairs, strict=True))
    shape = (len(mesh.vertices), len(mesh.vertices))
    joins = csr_matrix(
        (np.ones(2 * len(one), dtype=np.int8), (np.concatenate([one, other]), np.concatenate([other, one]))), shape
    )
    joins.sum_duplicates()
    return np.repeat(np.arange(shape[0]), np.diff(joins.indptr)), joins.indices


def _touching(mesh: QuadMesh) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of a vertex and a flow's cell with that vertex: vertices, and cells."""
    if mesh.parents is None:
        return mesh.cells.ravel(), np.repeat(np.arange(len(mesh.cells)), 4)
    count = int(mesh.parents.max()) + 1
    key = np.unique(mesh.cells.ravel().astype(np.int64) * count + np.repeat(mesh.parents, 4))
    return key // count, key % count


def _cell_pairs(mesh: QuadMesh) -> tuple[np.ndarray, np.ndarray]:
    """Return all pairs of different flow's cells that share a vertex, each pair in both orders."""
    from scipy.sparse import csr_matrix

    vertex, cell = _touching(mesh)
    count = int(cell.max()) + 1
    touches = csr_matrix((np.ones(len(cell)), (cell, vertex)), shape=(count, len(mesh.vertices)))
    first, second = (touches @ touches.T).nonzero()
    key = np.unique((first.astype(np.int64) * count + second)[first != second])
    return key // count, key % count


def of_parents(mesh: QuadMesh, values: np.ndarray) -> np.ndarray:
    """Return means of values of a mesh's cells over the flow's cells of which they are parts."""
    if mesh.parents is None:
        return values
    size = mesh.corner_weights.sum(axis=1)
    whole = np.bincount(mesh.parents, size)
    if values.ndim == 1:
        return np.asarray(np.bincount(mesh.parents, size * values) / whole)
    return np.stack([np.bincount(mesh.parents, size * column) / whole for column in values.T], axis=1)


def _least_squares_gradient(points, values, first, second) -> np.ndarray:
    """Return the least-squares gradient of the differences to neighbours, weighted by inverse squared distance."""
    step = points[second] - points[first]
    rise = values[second] - values[first]
    weight = 1.0 / np.sum(step**2, axis=1)
    (y, z), count = step.T, len(points)
    yy, yz, zz, right_y, right_z = (
        np.bincount(first, weight * own, count) for own in (y * y, y * z, z * z, y * rise, z * rise)
    )
    # Most systems of two equations are solved as they are; where neighbours are nearly on a line, by singular values.
    determinant = yy * zz - yz * yz
    flat = ~(determinant > 1e-4 * (yy + zz) ** 2)
    divisor = np.where(flat, 1.0, determinant)
    result = np.stack([(zz * right_y - yz * right_z) / divisor, (yy * right_z - yz * right_y) / divisor], axis=1)
    normal = np.stack([yy, yz, yz, zz], axis=1)[flat].reshape(-1, 2, 2)
    right = np.stack([right_y, right_z], axis=1)[flat]
    result[flat] = (np.linalg.pinv(normal) @ right[..., None])[..., 0]
    return result


def _slopes(mesh: QuadMesh, centroid: np.ndarray, average: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the slope in each flow's cell (zero beside a shock), which cells those are, and pairs of neighbours."""
    slope, first, second = np.zeros((len(average), 2)), np.empty(0, int), np.empty(0, int)
    shock = np.zeros(len(average), dtype=bool)
    if len(average) > 1:
        first, second = _cell_pairs(mesh)
        slope = _least_squares_gradient(centroid, average, first, second)
        rise = np.sum(slope[first] * (centroid[second] - centroid[first]), axis=1)
        missed = np.abs(average[second] - average[first] - rise) > SHOCK_SHARE * np.ptp(average)
        shock = np.bincount(first, missed, len(average)) > 0
        shock |= np.bincount(first, shock[second], len(average)) > 0
        slope[shock] = 0.0
    return slope, shock, first, second


def _unstructured_vertex_values(mesh: QuadMesh, average: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return inverse-distance means, at vertices, of linear reconstructions in their cells (constant beside shocks)."""
    centroid, average = of_parents(mesh, mesh.cell_centroid), of_parents(mesh, average)
    slope, shock, first, second = _slopes(mesh, centroid, average)
    vertex, cell = _touching(mesh)
    reach = mesh.vertices[vertex] - centroid[cell]
    guess = average[cell] + np.sum(slope[cell] * reach, axis=1)
    weight = 1.0 / np.maximum(np.linalg.norm(reach, axis=1), 1e-300)
    count = len(mesh.vertices)
    total = np.bincount(vertex, weight, count)
    value = np.bincount(vertex, weight * guess, count) / np.where(total > 0, total, 1.0)
    low, high = np.full(count, np.inf), np.full(count, -np.inf)
    np.minimum.at(low, vertex, average[cell])
    np.maximum.at(high, vertex, average[cell])
    # A vertex may exceed the range of its cells on either side by the width of that range.
    low, high = low - (high - low), high + (high - low)
    if len(average) > 1:  # at the mesh's edge, and in cells and edges, it may exceed a cell by that cell's differences
        span = np.zeros(len(average))
        np.maximum.at(span, first, np.abs(average[second] - average[first]))
        rim = np.bincount(vertex, minlength=count) <= 2
        of, edge = np.nonzero(mesh.neighbors < 0)
        rim[mesh.cells[of, edge]] = rim[mesh.cells[of, (edge + 1) % 4]] = True
        on_rim = rim[vertex]
        vertex, cell = vertex[on_rim], cell[on_rim]
        np.minimum.at(low, vertex, (average - span)[cell])
        np.maximum.at(high, vertex, (average + span)[cell])
    return np.clip(value, low, high), ~shock
