"""The body of a two-dimensional flow: a closed profile, from the edges of its walls or from a hole in its mesh."""

import numpy as np

from aerokernels.medium import Body, QuadMesh

CLOSE = 1e-9  # of the field's size: closer points are the same


def wall_body(edges: np.ndarray, mesh: QuadMesh) -> Body | None:
    """Return the body that the walls bound, or None if they bound nothing.

    A closed wall is the body's outline. A wall that ends on the edge of the field is closed behind it: on the axis of
    symmetry, or along the side of the field behind the wall.

    `edges` are both ends of each edge of the walls [m], shape (edge_count, 2, 2).

    Raises:
        ValueError: Walls that branch, and outlines that `Body` rejects.
    """
    size = float(max(np.ptp(mesh.vertices, axis=0).max(), 1e-300))
    outlines = []
    for chain in chains(edges, CLOSE * size):
        closed = np.linalg.norm(chain[0] - chain[-1]) <= CLOSE * size
        outline = chain[:-1] if closed else _closed_behind(chain, mesh)
        if abs(_area(outline)) > 1e-9 * size**2:
            outlines.append(outline)
    return _joined(outlines, mesh.geometry)


def hole_body(mesh: QuadMesh) -> Body | None:
    """Return the body in the holes of a mesh, or None if it has none."""
    behind = mesh.neighbors
    cell, side = np.nonzero(behind < 0)
    ends = np.stack([mesh.cells[cell, side], mesh.cells[cell, (side + 1) % 4]], axis=1)
    size = float(max(np.ptp(mesh.vertices, axis=0).max(), 1e-300))
    edges = _without_seams(mesh.vertices[ends], CLOSE * size)
    try:
        found = chains(edges, CLOSE * size)
    except ValueError:  # cells that touch in a corner only: holes are ambiguous there
        return None
    loops = [chain[:-1] for chain in found if len(chain) > 3 and np.linalg.norm(chain[0] - chain[-1]) <= CLOSE * size]
    if len(loops) < 2:
        return None
    loops.sort(key=lambda loop: -abs(_area(loop)))
    return _joined(loops[1:], mesh.geometry)


def _without_seams(edges: np.ndarray, near: float) -> np.ndarray:
    """Return edges without those that occur twice, as along the seam of a grid that closes on itself."""
    place = np.round(edges / near).astype(np.int64).reshape(len(edges), 2, 2)
    swap = (place[:, 0, 0] > place[:, 1, 0]) | ((place[:, 0, 0] == place[:, 1, 0]) & (place[:, 0, 1] > place[:, 1, 1]))
    place[swap] = place[swap][:, ::-1]
    _, same, count = np.unique(place.reshape(len(edges), 4), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(edges[count[same.ravel()] == 1])


def chains(edges: np.ndarray, near: float) -> list[np.ndarray]:
    """Join edges end to end: return the points of each chain, shape (k, 2); a closed chain ends where it begins.

    Raises:
        ValueError: More than two edges that end at one point.
    """
    ends = edges.reshape(-1, 2)
    _, first, point = np.unique(np.round(ends / near).astype(np.int64), axis=0, return_index=True, return_inverse=True)
    places, pairs = ends[first], point.reshape(-1, 2)
    pairs = np.unique(np.sort(pairs[pairs[:, 0] != pairs[:, 1]], axis=1), axis=0)
    touching: dict[int, list[int]] = {}
    for number, pair in enumerate(pairs.tolist()):
        for end in pair:
            touching.setdefault(end, []).append(number)
    if touching and max(len(own) for own in touching.values()) > 2:
        crowded = next(end for end, own in touching.items() if len(own) > 2)
        raise ValueError(f"the walls branch at {places[crowded].tolist()}: a wall has two ends")
    free, found = set(range(len(pairs))), []
    open_ends = [end for end, own in touching.items() if len(own) == 1]
    for begin in [*open_ends, *touching]:
        chain = [begin]
        while (following := next((n for n in touching[chain[-1]] if n in free), None)) is not None:
            free.discard(following)
            one, other = pairs[following].tolist()
            chain.append(other if one == chain[-1] else one)
        if len(chain) > 1:
            found.append(places[chain])
    return found


def _closed_behind(chain: np.ndarray, mesh: QuadMesh) -> np.ndarray:
    """Return an open wall closed on the side of the solid."""
    low, high = mesh.box
    if mesh.geometry == "axisymmetric":
        # A wall that faces inward, such as a nozzle's, has its solid outside.
        if _fluid_is_beyond(chain, mesh, np.array([1.0, 0.0])):
            ends = [[0.0, point[1]] for point in (chain[-1], chain[0]) if point[0] > 0.0]
            return np.vstack([chain, np.array(ends).reshape(-1, 2)])
        outer = float(high[0] + 0.1 * (high[0] - low[0]))
        return np.vstack([chain, [outer, chain[-1, 1]], [outer, chain[0, 1]]])
    extent = np.ptp(chain, axis=0)
    across = int(np.argmin(extent)) if extent.min() < 1e-9 * extent.max() else 0
    side = np.eye(2)[across]
    beyond = _fluid_is_beyond(chain, mesh, side)
    edge = float(low[across] if beyond else high[across])
    if extent[across] < 1e-9 * float(np.ptp(mesh.vertices, axis=0).max()):  # a straight wall: give it depth
        edge += (-0.1 if beyond else 0.1) * float(high[across] - low[across])
    feet = []
    for point in (chain[-1], chain[0]):
        foot = point.copy()
        foot[across] = edge
        if abs(foot[across] - point[across]) > 0.0:
            feet.append(foot)
    return np.vstack([chain, *feet])


def _fluid_is_beyond(chain: np.ndarray, mesh: QuadMesh, side: np.ndarray) -> bool:
    """Return whether the flow is on the side of a wall to which a direction points."""
    step = np.diff(chain, axis=0)
    middle, length = 0.5 * (chain[1:] + chain[:-1]), np.linalg.norm(step, axis=1)
    reach = 0.05 * float(np.median(length))
    steep = np.abs(step @ side) < 0.999 * length
    middle = middle[steep] if steep.any() else middle
    ahead, back = mesh.locate(middle + reach * side) >= 0, mesh.locate(middle - reach * side) >= 0
    return int(ahead.sum()) >= int(back.sum())


def _joined(outlines: list[np.ndarray], geometry: str) -> Body | None:
    """Return one profile of all outlines; each further one is connected by a bridge of no width, there and back."""
    if not outlines:
        return None
    profile = outlines[0]
    for other in outlines[1:]:
        profile = np.vstack([profile, profile[:1], other, other[:1]])
    return Body(profile, geometry)


def _area(outline: np.ndarray) -> float:
    first, second = outline.T
    return float(0.5 * np.sum(first * np.roll(second, -1) - np.roll(first, -1) * second))
