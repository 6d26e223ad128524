r"""Distances at which straight lines in space cross the triangles of a surface: watertight, in float64.

With two unit vectors u and v that complete a line's direction d to a right-handed frame, a corner c has the coordinates

    x = u . (c - p),   y = v . (c - p),   w = d . (c - p)

from a point p of the line. The line is on the left of an edge from a to b if e = x_a y_b - y_a x_b is positive. A
triangle is crossed if e has one sign for its three edges, which is the sign of n . d with the outward normal n; these
numbers are the weights of w at the opposite corners. For both triangles at an edge e is computed from the lesser corner
(by x, then y) to the greater one, and zero counts as negative, which is equivalent to an infinitesimal shift of the
line. So no line passes between two triangles, and the number of crossings of a closed surface is even. The kernels
(engines/warp/kernels/crossings.py) use the same formulas.
"""

import numpy as np

from .crossings import as_lines
from .wall_tree import WallTree

LINES = 4096  # lines that descend the tree together; speed only
LEAST_SIDE = 1e-300  # magnitude of e for a line that meets an edge


def axes_across(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors that complete each direction (n, 3) to a frame (T. Duff et al., JCGT 6 (2017) 1)."""
    x, y, z = (direction / np.linalg.norm(direction, axis=1)[:, None]).T
    sign = np.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=1), np.stack([b, sign + y * y * a, -y], axis=1)


def triangle_crossings(tree: WallTree, position, direction) -> np.ndarray:
    """Return distances along lines [m] at which they cross the triangles, ascending, shape (line_count, m).

    Rows are padded with infinity. Distances are negative behind a line's point.

    Args:
        tree: The triangles in their tree of boxes.
        position: A point on each line [m], shape (line_count, 3).
        direction: Unit vectors, shape (line_count, 3).

    Raises:
        ValueError: Directions that are not unit vectors, or other shapes.
    """
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
            waiting += tree.children(node, rows)
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
