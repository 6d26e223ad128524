"""The geometry of the reference tracer, piece by piece: lines through boxes, cones and triangles, and first roots."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.engines.reference.ends import Ends
from aerokernels.tracing.engines.reference.flight import Flight, rising_root
from aerokernels.tracing.engines.reference.steps import Integrator
from aerokernels.tracing.engines.reference.walls import Segments, Triangles

MIDDLE = np.array([0.0, 0.5, 3.0])


def units(count: int) -> np.ndarray:
    """Directions evenly over the sphere, shape (count, 3)."""
    found = np.random.default_rng(count).normal(size=(count, 3))
    return found / np.linalg.norm(found, axis=1, keepdims=True)


def field(geometry: str) -> IndexField:
    """Air without a disturbance in a box of 2 by 3 by 4 m, or r up to 2 m."""
    shape = {"volume": (5, 5, 5), "planar": (5, 5), "axisymmetric": (5, 5)}[geometry]
    origin = {"volume": (-1.0, -1.0, 1.0), "planar": (-1.0, 1.0), "axisymmetric": (0.0, 1.0)}[geometry]
    spacing = {"volume": (0.5, 0.75, 1.0), "planar": (0.75, 1.0), "axisymmetric": (0.5, 1.0)}[geometry]
    return IndexField.from_samples(np.zeros(shape), origin=origin, spacing=spacing, geometry=geometry)


def inside(geometry: str, points: np.ndarray) -> np.ndarray:
    """Whether points lie in its box."""
    x, y, z = np.moveaxis(points, -1, 0)
    within = (z >= 1.0) & (z <= 5.0)
    if geometry == "axisymmetric":
        return within & (np.hypot(x, y) <= 2.0)
    within &= (y >= -1.0) & (y <= 2.0)
    return within & (np.abs(x) <= 1.0) if geometry == "volume" else within


def polynomial_root(v0: float, v1: float, v2: float) -> float:
    """The first rise through zero at or after 0, from all roots; 0 where it begins above and does not come down."""
    if v0 >= 0.0 and (v1 > 0.0 or (v1 == 0.0 and v2 > 0.0)):
        return 0.0
    roots = np.roots([v2, v1, v0]) if v2 != 0.0 else np.array([-v0 / v1]) if v1 != 0.0 else np.zeros(0)
    real = np.sort(roots[np.isreal(roots)].real)
    rising = [root for root in real if root >= 0.0 and v1 + 2.0 * v2 * root > 0.0]
    if not rising:
        return 0.0 if v0 > 0.0 and not real.size and v2 > 0.0 else np.inf
    return rising[0]


def test_the_first_rise_of_a_parabola_through_zero():
    """Random parabolas of all signs, and lines: from all roots by NumPy."""
    v0, v1, v2 = np.random.default_rng(1).normal(size=(3, 400))
    v2[:40] = 0.0
    expected = [polynomial_root(*one) for one in zip(v0, v1, v2, strict=True)]
    np.testing.assert_allclose(rising_root(v0, v1, v2, 0.0), expected, rtol=1e-9)
    assert np.isinf(expected).any() and (np.array(expected) == 0.0).any()
    one = np.array([1.0])
    assert rising_root(np.nan * one, one, one, 0.0)[0] == np.inf
    assert rising_root(0.0 * one, one, one, 0.0)[0] == 0.0 and rising_root(0.0 * one, 0.0 * one, one, 0.0)[0] == 0.0
    # Above and never down: outside, unless it is so by rounding only.
    assert rising_root(1e-9 * one, -1e-9 * one, one, 1e-12)[0] == 0.0
    assert rising_root(1e-9 * one, -1e-9 * one, one, 1e-6)[0] == np.inf


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_lines_enter_and_leave_the_box(geometry):
    """Both ends lie on its surface, between them it is inside and before and behind not; a miss is nowhere inside."""
    ends = Ends(field(geometry), None)
    place, heading = np.random.default_rng(21).normal(0.0, 3.0, (400, 3)) + MIDDLE, units(400)
    heading[:30] = np.repeat(np.eye(3), 10, axis=0) * np.tile([1.0, -1.0], 15)[:, None]
    near, far = ends.span(place, heading)
    met = near <= far
    assert 50 < met.sum() < 350
    steps = np.linspace(-20.0, 20.0, 4001)
    for row in np.flatnonzero(~met):
        assert not inside(geometry, place[row] + steps[:, None] * heading[row]).any()
    finite = met & np.isfinite(near)
    assert (np.isfinite(near[met]) | (geometry == "planar")).all()
    for bound, step in ((near, 1.0), (far, -1.0)):
        within = place[finite] + (bound[finite] + step * 1e-9)[:, None] * heading[finite]
        beyond = place[finite] + (bound[finite] - step * 1e-9)[:, None] * heading[finite]
        long = far[finite] - near[finite] > 1e-6
        assert inside(geometry, within)[long].all() and not inside(geometry, beyond).any()


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_the_cosine_at_which_lines_leave(geometry):
    """Of the face, or the cylinder's side, that the leaving point lies on."""
    ends = Ends(field(geometry), None)
    start, heading = np.random.default_rng(22).uniform(-0.5, 0.5, (200, 3)) + MIDDLE, units(200)
    _, far = ends.span(start, heading)
    place = start + far[:, None] * heading
    expected = np.zeros(200)
    for row, (x, y, z) in enumerate(place):
        if min(abs(z - 1.0), abs(z - 5.0)) < 1e-9:
            expected[row] = abs(heading[row, 2])
        elif geometry == "axisymmetric":
            expected[row] = abs(heading[row, :2] @ [x, y]) / 2.0
        elif min(abs(y + 1.0), abs(y - 2.0)) < 1e-9:
            expected[row] = abs(heading[row, 1])
        else:
            expected[row] = abs(heading[row, 0])
    np.testing.assert_allclose(ends.leaving_cosine(place, heading), expected, rtol=1e-9)


@pytest.mark.parametrize("axisymmetric", [True, False])
def test_lines_meet_walls_where_they_lie_on_them(axisymmetric):
    """Every crossing of a dense sampling is found, lies on its segment, and has the rate of the way outward."""
    start = np.array([[0.2, 0.0], [1.0, 1.0], [1.0, 2.0], [0.4, 2.5], [0.0, 0.7]])
    end = np.array([[1.0, 1.0], [1.0, 2.0], [0.4, 2.5], [0.4, 3.0], [0.2, 0.0]])
    walls = Segments(start, end, axisymmetric)
    assert len(walls) == 5
    place, heading = np.random.default_rng(23).normal(size=(40, 3)) + np.array([0.0, 0.3, 1.2]), units(40)
    root, rate = walls.crossings(place, heading)

    def first(points):
        return np.hypot(points[..., 0], points[..., 1]) if axisymmetric else points[..., 1]

    t = np.linspace(-8.0, 8.0, 8001)
    points = place[:, None] + t[:, None] * heading[:, None]
    for which in range(5):
        step = end[which] - start[which]
        length = np.linalg.norm(step)
        normal = np.array([step[1], -step[0]]) / length
        away = normal[0] * (first(points) - start[which, 0]) + normal[1] * (points[..., 2] - start[which, 1])
        share = ((first(points) - start[which, 0]) * step[0] + (points[..., 2] - start[which, 1]) * step[1]) / length**2
        crossed = (away[:, 1:] * away[:, :-1] < 0.0) & (share[:, 1:] > 1e-3) & (share[:, 1:] < 1.0 - 1e-3)
        for row in range(40):
            found = np.sort(root[row, which][np.isfinite(root[row, which])])
            for at in np.flatnonzero(crossed[row]):
                near = np.argmin(np.abs(found - t[at]))
                assert t[at] - 1e-9 <= found[near] <= t[at + 1] + 1e-9
                column = np.nanargmin(np.abs(root[row, which] - t[at]))
                slope = (away[row, at + 1] - away[row, at]) / (t[at + 1] - t[at])
                assert rate[row, which, column] == pytest.approx(slope, abs=5e-2)
            met = place[row] + found[:, None] * heading[row]
            on = normal[0] * (first(met) - start[which, 0]) + normal[1] * (met[:, 2] - start[which, 1])
            assert np.abs(on).max(initial=0.0) < 1e-8
    distance, which = walls.first_crossing(place, heading, True, 0.0)
    for row in range(40):
        entering = np.where((root[row] >= 0.0) & (rate[row] < 0.0), root[row], np.inf)
        assert distance[row] == entering.min()
        assert not np.isfinite(distance[row]) or which[row] == np.argmin(entering.min(axis=1))
    out, _ = walls.first_crossing(place, heading, False, 0.5)
    leaving = np.where((root >= 0.5) & (rate > 0.0), root, np.inf)
    np.testing.assert_array_equal(out, leaving.min(axis=(1, 2)))


def test_depths_in_walls_and_triangles_grow_inward():
    """A place moved inward by 0.3 m has that depth; rate and curvature are those of its motion."""
    walls = Segments(np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([[2.0, 0.0], [2.0, 2.0]]), False)
    place, tangent, force = np.array([[5.0, 1.0, -0.3]]), np.array([[0.5, 0.2, 0.1]]), np.array([[0.0, 0.4, 0.7]])
    # The left side of a segment along +y is toward +z: outward is -z.
    depth, rate, bend = walls.depth(np.array([0]), place, tangent, force)
    sign = np.sign(depth[0]) * -1.0
    assert (depth[0], rate[0], bend[0]) == pytest.approx((-0.3 * sign, 0.1 * sign, 0.7 * sign))
    depth, rate, bend = walls.depth(np.array([1]), place, tangent, force)
    assert abs(depth[0]) == pytest.approx(1.0) and rate[0] / 0.2 == pytest.approx(bend[0] / 0.4)
    corners = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    triangle = Triangles(corners)
    assert len(triangle) == 1
    depth, rate, bend = triangle.depth(np.array([0]), np.array([[0.2, 0.2, -0.3]]), tangent, force)
    assert (depth[0], rate[0], bend[0]) == pytest.approx((0.3, -0.1, -0.7))


def test_lines_meet_triangles_where_barycentric_shares_say():
    """Random triangles and lines: the solution of corner + u a + v b = place + t d, with u, v, 1 - u - v above 0."""
    corners = np.random.default_rng(24).normal(size=(12, 3, 3))
    triangles = Triangles(corners)
    place, heading = np.random.default_rng(25).normal(size=(60, 3)), units(60)
    root, rate = triangles.crossings(place, heading)
    for row in range(60):
        for which, (a, b, c) in enumerate(corners):
            u, v, t = np.linalg.solve(np.stack([b - a, c - a, -heading[row]], axis=1), place[row] - a)
            normal = np.cross(b - a, c - a)
            assert rate[row, which, 0] == pytest.approx(heading[row] @ normal / np.linalg.norm(normal), rel=1e-9)
            if min(u, v, 1.0 - u - v) > 0.0:
                assert root[row, which, 0] == pytest.approx(t, rel=1e-7, abs=1e-9)
            else:
                assert np.isnan(root[row, which, 0])


def test_how_far_the_stop_is():
    """A plane ahead, behind and along; an arc length: what is left of it."""
    ends = Ends(field("volume"), Plane((0.0, 0.0, 9.0), (0.0, 0.0, -2.0)))
    place = np.array([[0.0, 0.0, 6.0], [0.0, 0.0, 10.0], [0.0, 0.0, 9.0], [1.0, 0.0, 6.0]])
    tangent = np.array([[0.0, 0.6, 0.8], [0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    distance, reaches = ends.distance_to_stop(place, tangent, np.zeros(4), tangent)
    assert reaches.tolist() == [True, False, True, False]
    assert distance[[0, 2]] == pytest.approx([3.75, 0.0])
    by_length = Ends(field("volume"), ArcLength(7.0))
    left, reaches = by_length.distance_to_stop(place, tangent, np.array([1.0, 2.0, 7.0, 8.0]), tangent)
    assert left.tolist() == [6.0, 5.0, 0.0, -1.0] and reaches.all()


@pytest.mark.parametrize("geometry", ["volume", "axisymmetric"])
def test_how_much_further_a_deviated_ray_ends(geometry):
    """Ray ends on the same face, off by q: along its first direction it went f further, f d + q staying on that face.

    Deviations of 1e-9 m, of which the difference of the two distances keeps six digits: they come back in full.
    """
    ends = Ends(field(geometry), None)
    start, heading = np.random.default_rng(26).uniform(-0.5, 0.5, (100, 3)) + MIDDLE, units(100)
    _, stop = ends.span(start, heading)
    cosine = ends.leaving_cosine(start + stop[:, None] * heading, heading)
    q = 1e-9 * np.random.default_rng(27).normal(size=(100, 3))
    q -= np.sum(q * heading, axis=1)[:, None] * heading
    _, ended = ends.span(start + q, heading)
    rough = ended - stop
    found = ends.further(stop, start, heading, q, rough)
    good = cosine > 0.05
    assert np.abs(found - rough)[good].max() < 1e-14 and (found != rough)[good].mean() > 0.9
    plane = Ends(field(geometry), Plane((0.0, 0.0, 7.0), (0.0, 0.6, 0.8)))
    normal = np.array([0.0, 0.6, 0.8])
    steep = np.abs(heading @ normal) > 0.01
    expected = -(q @ normal) / (heading @ normal)
    assert plane.further(stop, start, heading, q, 0.0 * stop)[steep] == pytest.approx(expected[steep], rel=1e-12)


def test_a_flight_begins_undisturbed():
    """All rays are on their way; those that stopped, left, hit, failed or spent their steps are not."""
    three = np.zeros((6, 3))
    flight = Flight(three, three, np.ones(6), np.zeros(6), np.ones(6), np.ones(6), np.zeros(6, int))
    assert flight.going.tolist() == [0, 1, 2, 3, 4, 5]
    for row, name in enumerate(("stopped", "left", "hit", "failed", "spent")):
        getattr(flight, name)[row] = True
    assert flight.going.tolist() == [5]
    assert not (flight.q.any() or flight.momentum.any() or flight.work.any() or flight.steps.any())


@pytest.mark.parametrize("size", [1e-5, 3.0])
def test_rays_that_leave_a_cell_within_a_step_do_so_where_the_cubic_is_highest(size: float):
    """Against the greatest of 2001 points of the cubic through values [m] and rates at both ends of a step.

    Only a face that is neared at first and left at last counts, and none that the step ends on or that is turning.
    Cases within 1e-3 of the tolerance are left out: the points miss 1e-6 of the greatest.
    """
    rng = np.random.default_rng(9)
    count, tolerance = 200, 0.05 * size
    value, value1 = -size * rng.uniform(0.0, 0.4, (2, count, 4))
    h = rng.uniform(0.5, 2.0, count) * size
    rate, rate1 = rng.uniform(-0.5, 1.0, (count, 4)), rng.uniform(-1.0, 0.5, (count, 4))
    turning, lands, chosen = rng.random((count, 4)) < 0.1, rng.random(count) < 0.5, rng.integers(0, 4, count)
    t = np.linspace(0.0, 1.0, 2001)
    shapes = (2 * t**3 - 3 * t**2 + 1, t**3 - 2 * t**2 + t, 3 * t**2 - 2 * t**3, t**3 - t**2)
    expected, clear = np.zeros(count, dtype=bool), np.ones(count, dtype=bool)
    for row in range(count):
        for face in range(4):
            counts = rate[row, face] > 0.0 > rate1[row, face] and not turning[row, face]
            if counts and not (lands[row] and face == chosen[row]):
                ends = value[row, face], h[row] * rate[row, face], value1[row, face], h[row] * rate1[row, face]
                peak = np.max(sum(shape * end for shape, end in zip(shapes, ends, strict=True)))
                expected[row] |= peak > tolerance
                clear[row] &= abs(peak - tolerance) > 1e-3 * size
    given = value, rate, value1, rate1, h, np.full(count, tolerance), turning, lands, chosen
    found = Integrator.bulges(None, *given)
    assert 0.2 < expected.mean() < 0.9 and clear.mean() > 0.9
    np.testing.assert_array_equal(found[clear], expected[clear])
