"""Straight lines through bodies: every crossing, none twice, at its place; profiles that touch themselves."""

import numpy as np
import pytest

from aerokernels import Body
from aerokernels.medium import SolidBody
from tests.bodies import lines, local, plate, star, stepped

MAKERS = {"star": star, "stepped": stepped, "plate": plate}


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("kind", MAKERS)
def test_crossings_agree_with_inside_and_outside(kind, geometry):
    """Set-up: random bodies of size 1, lines of all directions. Formula: a point is inside after an odd number of them.

    Expected: even numbers in all, the crossing number of the profile says the same, all crossings on the wall within
    1e-14 (rounding; 1e-12 of distance to the wall is left out as grazing).
    """
    rng = np.random.default_rng(3)
    for _ in range(6):
        body = MAKERS[kind](rng, geometry)
        position, direction = lines(rng, 800)
        found = body.crossings(position, direction)
        there = np.isfinite(found)
        assert there.any() and (there.sum(axis=1) % 2 == 0).all()
        assert (np.diff(np.where(there, found, 1e9), axis=1) >= 0.0).all()
        on_wall = local(body, (position[:, None] + np.where(there, found, 0.0)[..., None] * direction[:, None])[there])
        assert np.linalg.norm(on_wall - body.nearest_wall(on_wall), axis=1).max() < 1e-14
        for distance in rng.uniform(-1.5, 1.5, 8):
            points = local(body, position + distance * direction)
            sure = np.abs(body.signed_distance(points)) > 1e-12
            inside = (found < distance).sum(axis=1) % 2 == 1
            assert np.array_equal(inside[sure], body.contains(points)[sure])


def test_a_sphere():
    """Set-up: a polygon of 4000 corners on half a unit circle. Expected: chords of the sphere within its sagitta."""
    angle = np.linspace(0.0, np.pi, 4001)
    profile = np.stack([np.sin(angle), np.cos(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    position, direction = lines(np.random.default_rng(4), 500)
    found = Body(profile).crossings(position, direction)
    middle = -np.sum(position * direction, axis=1)
    square = 1.0 - np.sum((position + middle[:, None] * direction) ** 2, axis=1)
    clear = np.abs(square) > 1e-3
    half = np.sqrt(np.maximum(square, 0.0))
    assert np.array_equal(np.isfinite(found).sum(axis=1)[clear], np.where(square > 0.0, 2, 0)[clear])
    hit = clear & (square > 0.0)
    assert np.abs(found[hit, 0] - (middle - half)[hit]).max() < 1e-5
    assert np.abs(found[hit, 1] - (middle + half)[hit]).max() < 1e-5


def test_lines_along_x_never_cross_a_planar_body():
    square = Body([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]], "planar")
    assert square.crossings([[0.0, 0.5, 0.5]], [1.0, 0.0, 0.0]).shape == (1, 0)


TOUCHING = {
    # name: profile, lines along y at these z, expected crossings
    "figure of eight": ([[0, 0], [1, 1], [1, 0], [0, 1]], 0.25, [0.0, 0.25, 0.75, 1.0]),
    "two squares and a bridge of no width": (
        [[0, 0], [0.3, 0], [0.3, 0.2], [0.6, 0.2], [0.6, 0], [1, 0], [1, 0.5], [0.6, 0.5], [0.6, 0.2], [0.3, 0.2],
         [0.3, 0.5], [0, 0.5]],
        0.2000001,
        [0.0, 0.3, 0.6, 1.0],
    ),
    "a plate with a cut that is closed": (
        [[-1, -0.1], [0.5, -0.1], [0.5, 0.05], [0.5, -0.1], [1, -0.1], [1, 0.1], [-1, 0.1]],
        0.0,
        [-1.0, 1.0],
    ),
    "an edge named twice": ([[0, 0], [1, 0], [1, 1], [1, 0], [1, 1], [0, 1]], 0.5, [0.0, 1.0]),
}  # fmt: skip


@pytest.mark.parametrize("name", TOUCHING)
def test_a_profile_that_touches_itself(name):
    """What has the same on both sides is no wall: a line crosses only where air ends or begins."""
    profile, z, expected = TOUCHING[name]
    body = Body(np.array(profile, dtype=float), "planar")
    found = body.crossings([[0.0, -2.0, z]], [0.0, 1.0, 0.0])[0]
    assert found[np.isfinite(found)] == pytest.approx(np.array(expected) + 2.0, abs=1e-12)


@pytest.mark.parametrize("direction", [[0.0, 0.0, 2.0], [0.0, 0.0, 0.0], [0.0, 1.0]])
def test_lines_need_unit_vectors(direction):
    """A vector of length 2 gave half the distance."""
    for body in (Body([[0, 0], [1, -1], [0, -1]]), SolidBody.of_revolution(Body([[0, 0], [1, -1], [0, -1]]))):
        assert body.crossings([0.0, 0.2, -5.0], [0.0, 0.0, 1.0])[0] == pytest.approx([4.0, 4.8], abs=1e-3)
        with pytest.raises(ValueError, match="lines need points and unit vectors"):
            body.crossings([0.0, 0.2, -5.0], direction)
        for points in ([0.5, 0.5], [[0.5]]):
            with pytest.raises(ValueError, match=r"points must have shape \(n, [23]\), got"):
                body.signed_distance(points)
