"""Distances at which straight lines in space cross the surface of a body, exact to rounding in float64.

Neighbouring pieces use the same number to tell the side on which a line passes their common corner or edge: no line
passes between two, and a closed surface is crossed an even number of times. The kernels use the same formulas
(engines/warp/kernels/wall.py, crossings.py).
"""

import numpy as np

from aerokernels.medium.bodies.wall_tree import WallTree

# Lines whose direction is within 1e-12 rad of the axis count as parallel to it: A is then below this.
PARALLEL = 1e-24
# Pairs of a line and a segment that are computed together.
BLOCK = 1_000_000  # speed only
LINES = 4096  # lines that descend the tree together; speed only
LEAST_SIDE = 1e-300  # magnitude of e for a line that meets an edge


def as_lines(position, direction) -> tuple[np.ndarray, np.ndarray]:
    """Return a point on each line [m] and its unit vector as float64 arrays, shape (line_count, 3) each."""
    position = np.atleast_2d(np.asarray(position, dtype=np.float64))
    direction = np.atleast_2d(np.asarray(direction, dtype=np.float64))
    shapes_fit = position.shape[1:] == direction.shape[1:] == (3,)
    if not shapes_fit or (np.abs(np.linalg.norm(direction, axis=1) - 1.0) > 1e-9).any():
        raise ValueError("lines need points and unit vectors of shape (n, 3)")
    position, direction = np.broadcast_arrays(position, direction)
    return position, direction


def crossings(start: np.ndarray, end: np.ndarray, geometry: str, position, direction) -> np.ndarray:
    """Return distances along lines [m] at which they cross segments, ascending, shape (line_count, greatest number).

    Rows are padded with infinity. Distances are negative behind a line's point.
    """
    position, direction = as_lines(position, direction)
    function = _planar if geometry == "planar" else _axisymmetric
    block = max(1, BLOCK // max(1, len(start)))  # speed only
    parts = []
    for first in range(0, len(position), block):
        rows = slice(first, first + block)
        results = np.sort(function(start, end, position[rows], direction[rows]), axis=1)
        parts.append(results[:, : np.isfinite(results).sum(axis=1).max(initial=0)])
    result = np.full((len(position), max((part.shape[1] for part in parts), default=0)), np.inf)
    for number, part in enumerate(parts):
        result[number * block : number * block + len(part), : part.shape[1]] = part
    return result


def _planar(start, end, position, direction) -> np.ndarray:
    """Return distances (line_count, w), infinite where there is no crossing."""
    y, z = (position[:, None, k] for k in (1, 2))
    dy, dz = (direction[:, None, k] for k in (1, 2))

    def side(corner):
        return dy * (corner[:, 1] - z) - dz * (corner[:, 0] - y)

    first, second = side(start), side(end)
    crossed = (first > 0.0) != (second > 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = first / (first - second)
        at = start + share[..., None] * (end - start)
        distance = ((at[..., 0] - y) * dy + (at[..., 1] - z) * dz) / (dy * dy + dz * dz)
    return np.where(crossed, distance, np.inf)


def _axisymmetric(start, end, position, direction) -> np.ndarray:
    """Return distances (line_count, 2 w), infinite where there is no crossing.

    At a distance t from its point nearest to the axis a line has R^2 = R0^2 + a t^2 and z = z0 + d t. A corner (r, z)
    is outside the surface that it sweeps if w = d^2 (r^2 - R0^2) - a (z - z0)^2 is positive. A segment whose corners
    differ in that is crossed once; one with both corners inside twice or not at all, and only if it is less steep than
    the line, at the roots of (a dh^2 - d^2 dr^2) t^2 - 2 k dr d t + R0^2 dh^2 - k^2 = 0, k = r1 dh + (z0 - z1) dr.
    """
    x, y, z = position.T[:, :, None]
    dx, dy, d = direction.T[:, :, None]
    a = dx * dx + dy * dy
    parallel = a < PARALLEL
    a = np.where(parallel, 0.0, a)
    with np.errstate(divide="ignore", invalid="ignore"):
        nearest = np.where(parallel, 0.0, -(x * dx + y * dy) / a)
        r0_square = np.where(parallel, x * x + y * y, (x * dy - y * dx) ** 2 / a)
    z0 = z + nearest * d
    (r1, z1), (r2, z2) = start.T, end.T
    h1, h2 = z1 - z0, z2 - z0
    w1, w2 = d * d * (r1 * r1 - r0_square) - a * h1 * h1, d * d * (r2 * r2 - r0_square) - a * h2 * h2
    dr, dh = r2 - r1, z2 - z1
    once = (w1 > 0.0) != (w2 > 0.0)
    steepness = a * dh * dh - d * d * dr * dr
    distance = np.full((2, *w1.shape), np.inf)
    # Most lines cross few segments, so the following is computed only for pairs that may cross.
    line, segment = np.nonzero(once | ((w1 <= 0.0) & (steepness > 0.0)))
    a, d, z, z0, nearest, r0_square = (values[line, 0] for values in (a, d, z, z0, nearest, r0_square))
    r1, z1, z2, dr, dh = (values[segment] for values in (r1, z1, z2, dr, dh))
    h1, w1, once, steepness = (values[line, segment] for values in (h1, w1, once, steepness))

    with np.errstate(divide="ignore", invalid="ignore"):
        # Segments less steep than the line: the roots of the cone's equation.
        k = r1 * dh - h1 * dr
        half = k * dr * d
        constant = r0_square * dh * dh - k * k
        square = half * half - steepness * constant
        root = np.sqrt(np.maximum(square, 0.0))
        larger = half + np.where(half >= 0.0, root, -root)
        one, other = larger / steepness, np.where(larger == 0.0, 0.0, constant / larger)
        low, high = np.minimum(one, other), np.maximum(one, other)
        # A segment crossed once is crossed at the root on the side of the corner inside.
        wants_high = (np.where(w1 > 0.0, dh, -dh) * d) > 0.0
        single = np.where(wants_high, high, low)
        middle = z0 + d * (half / steepness)
        twice = ~once & (w1 <= 0.0) & (square > 0.0) & ((z1 > middle) != (z2 > middle)) & (steepness > 0.0)
        # Segments as steep as the line or steeper: the position along the segment, by a quadratic equation of its own.
        slope = d * d * r1 * dr - a * h1 * dh
        root = np.sqrt(np.maximum(slope * slope + steepness * w1, 0.0))
        rising = np.where(slope > 0.0, -w1 / (slope + root), (root - slope) / -steepness)
        falling = w1 / (root - slope)
        share = np.clip(np.where(w1 > 0.0, falling, rising), 0.0, 1.0)
        steep = (z1 + share * dh - z) / d  # from the line's own point: the point nearest to the axis may be far away
    distance[0, line, segment] = np.where(
        once, np.where(steepness > 0.0, nearest + single, steep), np.where(twice, nearest + low, np.inf)
    )
    distance[1, line, segment] = np.where(twice, nearest + high, np.inf)
    return np.concatenate(list(distance), axis=1)


def axes_across(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors that complete each direction (n, 3) to a frame (T. Duff et al., JCGT 6 (2017) 1)."""
    x, y, z = (direction / np.linalg.norm(direction, axis=1)[:, None]).T
    sign = np.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1), np.stack([b, sign + y * y * a, -y], axis=1)


def triangle_crossings(tree: WallTree, position, direction) -> np.ndarray:
    """Return distances along lines [m] at which they cross the triangles of a tree, as `crossings` does."""
    position, direction = as_lines(position, direction)
    lines, distances = [], []
    for first in range(0, len(position), LINES):
        part = slice(first, first + LINES)
        line, distance = _through(tree, position[part], direction[part])
        lines.append(first + line)
        distances.append(distance)
    line = np.concatenate(lines) if lines else np.empty(0, np.int64)
    distance = np.concatenate(distances) if distances else np.empty(0)
    order = np.lexsort((distance, line))
    line, distance = line[order], distance[order]
    count = np.bincount(line, minlength=len(position))
    result = np.full((len(position), int(count.max(initial=0))), np.inf)
    result[line, np.arange(len(line)) - np.repeat(np.cumsum(count) - count, count)] = distance
    return result


def _through(tree: WallTree, position: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of a line and a distance, found by descending the tree with all lines together."""
    right, up = axes_across(direction)
    square = np.sum(direction * direction, axis=1)
    found_line, found_distance = [], []
    waiting = [(0, np.arange(len(position)))]
    while waiting:
        node, rows = waiting.pop()
        first, last = tree.links[node][1:]
        rows = rows[_pass_box(position[rows], direction[rows], *tree.boxes[node])]
        if not len(rows):
            continue
        if last == first:
            waiting += [(node + 1, rows), (int(tree.links[node + 1][0]), rows)]
            continue
        offset = tree.corners[first:last][None] - position[rows][:, None, None]
        x, y, w = (np.einsum("ntkc,nc->ntk", offset, axis[rows]) for axis in (right, up, direction))
        side = np.stack([edge_side(x, y, 1, 2), edge_side(x, y, 2, 0), edge_side(x, y, 0, 1)], axis=-1)
        positive = side > 0.0
        line, triangle = np.nonzero((positive[..., 0] == positive[..., 1]) & (positive[..., 1] == positive[..., 2]))
        weight, along = side[line, triangle], w[line, triangle]
        found_line.append(rows[line])
        found_distance.append(np.sum(weight * along, axis=1) / (np.sum(weight, axis=1) * square[rows[line]]))
    if not found_line:
        return np.empty(0, np.int64), np.empty(0)
    return np.concatenate(found_line), np.concatenate(found_distance)


def edge_side(x: np.ndarray, y: np.ndarray, a: int, b: int) -> np.ndarray:
    """Return e of the edge from corner a to corner b for each line: positive if the line is on the left, never zero."""
    swap = (x[..., a] > x[..., b]) | ((x[..., a] == x[..., b]) & (y[..., a] > y[..., b]))
    x1, x2 = np.where(swap, x[..., b], x[..., a]), np.where(swap, x[..., a], x[..., b])
    y1, y2 = np.where(swap, y[..., b], y[..., a]), np.where(swap, y[..., a], y[..., b])
    side = x1 * y2 - y1 * x2
    side = np.where(side > 0.0, side, np.minimum(side, -LEAST_SIDE))
    return np.where(swap, -side, side)


def _pass_box(position, direction, low, high) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        one, other = (low - position) / direction, (high - position) / direction
    beside = direction == 0.0
    missed = (beside & ((position < low) | (position > high))).any(axis=1)
    near = np.where(beside, -np.inf, np.minimum(one, other)).max(axis=1)
    far = np.where(beside, np.inf, np.maximum(one, other)).min(axis=1)
    return ~missed & (near <= far)
