"""Bodies in volumes: lines and points against a box whose faces are known, watertight at vertices and edges."""

import numpy as np
import pytest

from aerokernels.medium import Body, IndexField, SolidBody

CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-0.5, 0.5) for z in (-0.25, 0.25)])
FACES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
TRIANGLES = np.array([(a, b, c) for f in FACES for a, b, c in ((f[0], f[1], f[2]), (f[0], f[2], f[3]))])
HALF = np.array([1.0, 0.5, 0.25])


def turned(seed: int = 3) -> tuple[SolidBody, np.ndarray]:
    """The box turned about the origin, and the rotation."""
    rotation = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    rotation *= np.sign(np.linalg.det(rotation))
    return SolidBody(CORNERS @ rotation.T, TRIANGLES), rotation


def test_lines_cross_a_box_where_its_slabs_say():
    """Set-up: 3000 random lines at a turned box. Expected: both crossings by the slabs of the box, to 1e-13."""
    body, rotation = turned()
    random = np.random.default_rng(4)
    position, direction = random.uniform(-2.0, 2.0, (3000, 3)), random.normal(size=(3000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    p, d = position @ rotation, direction @ rotation
    ends = np.sort(np.stack([(-HALF - p) / d, (HALF - p) / d]), axis=0)
    near, far = ends[0].max(axis=1), ends[1].min(axis=1)
    found = body.crossings(position, direction)
    assert found.shape[1] == 2
    hit = near < far
    assert (np.isfinite(found).all(axis=1) == hit).all() and 300 < hit.sum() < 2700
    assert np.abs(found[hit] - np.stack([near, far], axis=1)[hit]).max() < 1e-13 * 2.0 / np.abs(d[hit]).min()


def test_no_line_slips_through_an_edge_or_a_vertex():
    """Set-up: lines through vertices and points of edges of a body of revolution, from inside. Expected: odd crossings.

    From a point inside every closed surface is crossed an odd number of times ahead, wherever the line is aimed.
    """
    profile = np.array([[0.0, 0.0], [0.7, 0.1], [0.5, 0.6], [0.9, 1.0], [0.0, 1.2]])
    body = SolidBody.of_revolution(Body(profile, "axisymmetric"), 12)
    inside = np.array([0.03, 0.05, 0.4])
    ends = body.surface
    share = np.random.default_rng(1).uniform(0.0, 1.0, (len(ends), 3, 1))
    share[::2] = 0.0  # the vertices themselves
    aims = (ends + share * (np.roll(ends, -1, axis=1) - ends)).reshape(-1, 3)
    direction = (aims - inside) / np.linalg.norm(aims - inside, axis=1)[:, None]
    found = body.crossings(np.broadcast_to(inside, aims.shape), direction)
    ahead = np.count_nonzero(np.isfinite(found) & (found > 0.0), axis=1)
    assert len(aims) > 200 and (ahead % 2 == 1).all()
    assert (np.count_nonzero(np.isfinite(found), axis=1) % 2 == 0).all()


def test_points_inside_and_distances():
    body, rotation = turned()
    local = np.random.default_rng(5).uniform(-1.5, 1.5, (2000, 3))
    outside = np.maximum(np.abs(local) - HALF, 0.0)
    inner = (np.abs(local) - HALF).max(axis=1)
    exact = np.where(inner < 0.0, inner, np.linalg.norm(outside, axis=1))
    points = local @ rotation.T
    assert (body.contains(points) == (inner < 0.0)).all()
    assert np.abs(body.signed_distance(points) - exact).max() < 1e-13


def test_a_body_of_revolution_holds_its_profile():
    """Set-up: a cone with a rounded base, 200 triangles around. Expected: the same points inside but near the wall."""
    flat = Body(np.array([[0.0, 1.0], [0.4, 0.0], [0.2, -0.1], [0.0, -0.1]]), "axisymmetric")
    solid = SolidBody.of_revolution(flat, 200)
    points = np.random.default_rng(6).uniform(-0.6, 1.1, (4000, 3)) - [0.2, 0.2, 0.05]
    local = np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=1)
    differ = solid.contains(points) != flat.contains(local)
    assert np.abs(flat.signed_distance(local[differ])).max(initial=0.0) < 0.4 * (1.0 - np.cos(np.pi / 200))
    assert solid.contains(points).sum() > 50


def test_the_way_round_does_not_matter_and_outlines_are_closed():
    inward = SolidBody(CORNERS, TRIANGLES[:, ::-1])
    assert (np.sort(inward.triangles, axis=1) == np.sort(TRIANGLES, axis=1)).all()
    volume = np.einsum("nk,nk->n", inward.surface[:, 0], np.cross(inward.surface[:, 1], inward.surface[:, 2])).sum()
    assert volume / 6.0 == pytest.approx(1.0 * 2.0 * 0.5, rel=1e-14)
    length = sum(np.linalg.norm(line - np.roll(line, 1, axis=0), axis=1).sum() for line in inward.outlines())
    assert length == pytest.approx(2.0 * (1.0 + 0.5), rel=1e-14)


@pytest.mark.parametrize(
    ("vertices", "triangles", "said"),
    [
        (CORNERS, TRIANGLES[:-1], "not closed: 3 edges"),
        (CORNERS, np.vstack([TRIANGLES[:-1], TRIANGLES[-1:, ::-1]]), "differ in orientation, or overlap"),
        (CORNERS, TRIANGLES + 1, "from 1 to 8 of 8"),
        (np.where(CORNERS == 0.25, np.nan, CORNERS), TRIANGLES, "NaN"),
        (CORNERS[:, :2], TRIANGLES, "shape"),
        (CORNERS, TRIANGLES.astype(float), "numbers of vertices"),
    ],
)
def test_broken_surfaces_are_refused(vertices, triangles, said):
    with pytest.raises(ValueError, match=said):
        SolidBody(vertices, triangles)


def test_the_kinds_of_a_body_and_a_field_agree():
    flat = Body(np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 0.1]]), "planar")
    for body, geometry, shape in ((flat, "volume", (4, 4, 4)), (turned()[0], "planar", (4, 4))):
        with pytest.raises(ValueError, match="must agree"):
            IndexField.from_samples(
                np.zeros(shape), origin=[0.0] * len(shape), spacing=[1.0] * len(shape), geometry=geometry, body=body
            )


def test_the_nearest_wall_is_exact_for_triangles_of_any_size():
    """Set-up: a slender cone and a flat one: points near long triangles are nearer to centroids of others.

    Expected: the distance to the profile, but for the chords of 96 triangles around: below 0.1 (1 - cos(pi / 96)).
    """
    for length, radius in ((1.0, 0.1), (0.02, 0.1)):
        profile = Body(np.array([[0.0, 0.0], [radius, -length], [0.0, -length]]), "axisymmetric")
        solid = SolidBody.of_revolution(profile)
        points = np.random.default_rng(7).uniform([-0.2, -0.2, -1.2], [0.2, 0.2, 0.2], (3000, 3))
        local = np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=1)
        error = np.abs(solid.signed_distance(points) - profile.signed_distance(local))
        assert error.max() < radius * (1.0 - np.cos(np.pi / 96))


def lump(seed: int) -> SolidBody:
    """A body of revolution of random radii with needles for triangles in places, turned at random."""
    rng = np.random.default_rng(seed)
    z = np.cumsum(rng.choice([1e-4, 1e-2, 0.2], 12))
    profile = np.stack([np.r_[0.0, rng.uniform(0.1, 0.5, 10), 0.0], z], axis=1)
    body = SolidBody.of_revolution(Body(profile, "axisymmetric"), 24)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    return SolidBody(body.vertices @ rotation.T, body.triangles)
