"""Parts of bodies: triangles and profiles against lines solved one by one, inside and outside by angles, walls."""

import numpy as np
import pytest

from aerokernels.medium import Body, SolidBody

RNG = np.random.default_rng(231)


def lines(count: int = 120, size: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(232)
    position, direction = rng.uniform(-size, size, (count, 3)), rng.normal(size=(count, 3))
    direction[:5] = [[0, 0, 1.0], [0, 1.0, 0], [1e-13, 0, 1.0], [0, 0, -1.0], [0.0, -0.6, 0.8]]
    return position, direction / np.linalg.norm(direction, axis=1)[:, None]


# --- profiles --------------------------------------------------------------------------------------------------------

STAR = np.array([[0.3, -1.0], [1.4, -0.6], [0.7, 0.1], [1.6, 0.9], [0.2, 1.3]])


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_what_a_profile_holds(geometry: str):
    """By the winding angle about each point; distances with that sign; its box, walls and their left side."""
    body = Body(STAR, geometry)
    points = RNG.uniform([0.0, -1.5], [2.0, 1.8], (300, 2))
    steps = STAR[None] - points[:, None]
    angle = np.arctan2(steps[..., 1], steps[..., 0])
    turn = np.diff(np.concatenate([angle, angle[:, :1]], axis=1), axis=1)
    winding = np.round(((turn + np.pi) % (2 * np.pi) - np.pi).sum(axis=1) / (2 * np.pi))
    inside = body.contains(points)
    np.testing.assert_array_equal(inside, winding != 0)
    distance = np.linalg.norm(points - body.nearest_wall(points), axis=1)
    np.testing.assert_allclose(body.signed_distance(points), np.where(inside, -distance, distance))
    np.testing.assert_array_equal(body.box, [STAR.min(axis=0), STAR.max(axis=0)])
    start, end = body.surface
    left = np.stack([-(end - start)[:, 1], (end - start)[:, 0]], axis=1)
    middle = 0.5 * (start + end)
    assert body.contains(middle + 1e-6 * left).all() and not body.contains(middle - 1e-6 * left).any()
    assert len(start) == 5 and {tuple(one) for one in start} == {tuple(one) for one in STAR}
    assert Body(STAR[::-1], geometry).contains(points).tolist() == inside.tolist()


# --- triangles -------------------------------------------------------------------------------------------------------


def tetrahedra() -> SolidBody:
    """Two, apart, the second with its triangles inside out."""
    corners = np.array([[0.0, 0, 0], [1.2, 0.1, 0], [0.2, 1.1, 0.1], [0.3, 0.2, 1.3]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    return SolidBody(
        np.concatenate([corners, corners + np.array([2.0, 0.5, 0.3])]), np.concatenate([faces, faces[:, ::-1] + 4])
    )


def test_lines_cross_triangles_one_by_one():
    """Each triangle by a linear system of three unknowns; inside by shares of the corners; all turned outward."""
    body = tetrahedra()
    position, direction = lines(150, 1.5)
    position += [1.5, 0.5, 0.5]
    found = body.crossings(position, direction)
    total = 0
    for row in range(150):
        hits = []
        for a, b, c in body.surface:
            try:
                u, v, t = np.linalg.solve(np.stack([b - a, c - a, -direction[row]], axis=1), position[row] - a)
            except np.linalg.LinAlgError:
                continue
            if min(u, v, 1.0 - u - v) > 0.0:
                hits.append(t)
        told = found[row][np.isfinite(found[row])]
        np.testing.assert_allclose(told, sorted(hits), atol=1e-9)
        total += len(hits)
    assert total > 40
    points = RNG.uniform([0, 0, 0], [3.2, 1.7, 1.7], (400, 3))
    inside = np.zeros(400, bool)
    for first in (0, 4):
        corners = body.vertices[first : first + 4]
        shares = np.linalg.solve(np.vstack([corners.T, np.ones(4)]), np.c_[points, np.ones(400)].T)
        inside |= (shares > 0.0).all(axis=0)
    np.testing.assert_array_equal(body.contains(points), inside)
    assert 5 < inside.sum() < 200
    distance = np.linalg.norm(points - body.nearest_wall(points), axis=1)
    np.testing.assert_allclose(body.signed_distance(points), np.where(inside, -distance, distance))
    a, b, c = body.surface.swapaxes(0, 1)
    normal = np.cross(b - a, c - a)
    middle = np.concatenate([np.tile(body.vertices[k : k + 4].mean(axis=0), (4, 1)) for k in (0, 4)])
    assert (np.sum(normal * ((a + b + c) / 3.0 - middle), axis=1) > 0.0).all()
    np.testing.assert_array_equal(body.box, [body.vertices.min(axis=0), body.vertices.max(axis=0)])
