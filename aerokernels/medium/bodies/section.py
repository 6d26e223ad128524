"""Lines in which a closed surface of triangles crosses the plane x = 0, for drawing a body."""

import numpy as np


def outlines(vertices: np.ndarray, triangles: np.ndarray) -> list[np.ndarray]:
    """Return the closed lines in which a surface crosses the plane x = 0, each as its corners (y, z) [m], shape (n, 2).

    A vertex on the plane counts as lying on its negative side, so that the lines are closed for any surface.

    Args:
        vertices: Corners of the triangles [m], shape (vertex_count, 3).
        triangles: Corners of each triangle, shape (triangle_count, 3); every edge belongs to two of them.
    """
    above = vertices[:, 0] > 0.0
    side = above[triangles]
    cut = triangles[side.any(axis=1) & ~side.all(axis=1)]
    if not len(cut):
        return []
    # Each triangle that is cut joins its two crossed edges.
    edges = np.sort(np.stack([cut, np.roll(cut, -1, axis=1)], axis=-1), axis=-1)  # (cut, 3, 2)
    crossed = above[edges[..., 0]] != above[edges[..., 1]]
    named, number = np.unique(edges[crossed], axis=0, return_inverse=True)
    joined = number.reshape(-1, 2)
    one, other = vertices[named[:, 0]], vertices[named[:, 1]]
    share = one[:, 0] / (one[:, 0] - other[:, 0])
    place = (one + share[:, None] * (other - one))[:, 1:]
    neighbours: list[list[int]] = [[] for _ in named]
    for a, b in joined.tolist():
        neighbours[a].append(b)
        neighbours[b].append(a)
    found, left = [], set(range(len(named)))
    while left:
        line = [left.pop()]
        while onward := [k for k in neighbours[line[-1]] if k in left]:
            line.append(onward[0])
            left.remove(onward[0])
        found.append(place[line])
    return found
