"""Both ends of the reference engine's rays: against lines sampled finely, and against sums in a plain loop."""

import numpy as np
import pytest

from aerokernels.medium import Body, IndexField
from aerokernels.tracing import ArcLength, Plane, RayStatus
from aerokernels.tracing.engines.reference.ends import Ends, Interval
from aerokernels.tracing.engines.reference.flight import Flight

AMBIENT = 1.25
LOW, HIGH, RADIUS = np.array([-1.0, -1.0, 1.0]), np.array([1.0, 2.0, 5.0]), 2.2
PROFILES = {"planar": [[-0.4, 2.0], [0.9, 3.0], [0.2, 6.5]], "axisymmetric": [[0.0, 2.0], [0.9, 3.0], [0.0, 6.5]]}
STOPS = {"none": None, "arc": ArcLength(4.3), "plane": Plane((0.2, 0.1, 4.4), (0.3, -0.5, 1.0))}
STEP, LONGEST = 4e-3, 14.0  # of the samples [m]; along x a planar box is endless


def field(geometry: str, with_body: bool) -> IndexField:
    """Air without a disturbance in a box of 2 by 3 by 4 m, or r up to 2.2 m; a body that reaches out of its end."""
    across = {"volume": (0, 1, 2), "planar": (1, 2), "axisymmetric": (1, 2)}[geometry]
    origin, high = LOW.copy(), HIGH.copy()
    if geometry == "axisymmetric":
        origin[1], high[1] = 0.0, RADIUS
    spacing = (high - origin)[list(across)] / 4.0
    body = Body(PROFILES[geometry], geometry) if with_body else None
    return IndexField.from_samples(
        np.zeros((5,) * len(across)), origin=origin[list(across)], spacing=spacing, geometry=geometry,
        ambient_index=AMBIENT, body=body,
    )  # fmt: skip


def within(geometry: str, points: np.ndarray) -> np.ndarray:
    """Whether points lie in the box."""
    x, y, z = np.moveaxis(points, -1, 0)
    good = (z >= 1.0) & (z <= 5.0)
    if geometry == "axisymmetric":
        return good & (np.hypot(x, y) <= RADIUS)
    good &= (y >= -1.0) & (y <= 2.0)
    return good & (np.abs(x) <= 1.0) if geometry == "volume" else good


def rays(count: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """Starts around, in and before the box, directions to places in and around it."""
    rng = np.random.default_rng(31)
    start = rng.uniform([-2.5, -2.5, -1.0], [2.5, 3.5, 7.5], (count, 3))
    heading = rng.uniform([-1.5, -1.5, 0.5], [1.5, 2.5, 6.0], (count, 3)) - start
    return start, heading / np.linalg.norm(heading, axis=1)[:, None]


def sampled(geometry: str, body: Body | None, start, heading, until) -> tuple[float, float, bool, int]:
    """Entry, exit, whether the ray flies through air, and the status, from places STEP apart."""
    t = np.arange(0.0, LONGEST, STEP)
    points = start + t[:, None] * heading
    box = within(geometry, points)
    nothing = RayStatus.MISSED_FIELD if until is None else RayStatus.OK
    if not box.any():
        return np.nan, np.nan, False, nothing
    first, last = np.flatnonzero(box)[[0, -1]]
    stop = np.inf
    if isinstance(until, Plane):
        ahead = ((until.point - start) @ until.normal) / (heading @ until.normal)
        stop = ahead if ahead >= 0.0 else np.inf
    elif until is not None:
        stop = until.length
    if stop <= t[first]:
        return np.nan, np.nan, False, RayStatus.OK
    if body is None:
        return t[first], t[last], True, RayStatus.OK
    across = points[:, 1] if geometry == "planar" else np.hypot(points[:, 0], points[:, 1])
    solid = body.contains(np.stack([across, points[:, 2]], axis=1))
    entries = np.flatnonzero(solid[1 : first + 1] & ~solid[:first])
    if len(entries):
        return t[entries[0]], t[last], True, RayStatus.HIT_BODY
    if not solid[first]:
        return t[first], t[last], True, RayStatus.OK
    free = np.flatnonzero(~solid[first:])
    out = first + free[0] if len(free) else len(t)
    if out > last:
        return t[last], t[last], stop > t[last], RayStatus.INSIDE_BODY if stop > t[last] else RayStatus.OK
    return t[out], t[last], stop > t[out], RayStatus.OK if stop > t[out] or until is not None else nothing


@pytest.mark.parametrize("stop", list(STOPS))
@pytest.mark.parametrize(
    ("geometry", "with_body"),
    [("volume", False), ("planar", False), ("planar", True), ("axisymmetric", False), ("axisymmetric", True)],
)
def test_where_undisturbed_rays_enter_the_air(geometry: str, with_body: bool, stop: str):
    """Entry, exit, whether there is air on the way and why not, against the same lines sampled every 4 mm."""
    ends, until = Ends(field(geometry, with_body), STOPS[stop]), STOPS[stop]
    start, heading = rays()
    found = ends.interval(start, heading)
    told = [sampled(geometry, ends.field.body, *one, until) for one in zip(start, heading, strict=True)]
    enter, leave, meets, status = (np.array(column) for column in zip(*told, strict=True))
    assert {int(one) for one in status} >= ({int(RayStatus.HIT_BODY), int(RayStatus.OK)} if with_body else set())
    np.testing.assert_array_equal(found.status, status)
    np.testing.assert_array_equal(found.meets, meets | (status == RayStatus.INSIDE_BODY))
    assert 20 < meets.sum() < 120
    np.testing.assert_allclose(found.t_enter[meets], enter[meets], rtol=0, atol=1.5 * STEP)
    np.testing.assert_allclose(np.minimum(found.t_exit, LONGEST)[meets], leave[meets], rtol=0, atol=1.5 * STEP)
    if stop == "plane":
        ahead = (until.point - start) @ until.normal / (heading @ until.normal)
        np.testing.assert_array_equal(found.has_stop, ahead > 0.0)
        np.testing.assert_allclose(found.stop[ahead > 0.0], ahead[ahead > 0.0], rtol=1e-12)
    else:
        assert found.has_stop.all()
        expected = until.length if until else leave[meets]
        np.testing.assert_allclose(np.minimum(found.stop, LONGEST)[meets], expected, rtol=0, atol=1.5 * STEP)


def test_ends_that_are_met_exactly():
    """A start on the plane stops at once; a plane along the ray is never met; along x a planar field has no end."""
    ends = Ends(field("planar", False), Plane((0.0, 0.0, 3.0), (0.0, 0.0, 2.0)))
    found = ends.interval(np.array([[0.0, 0.0, 3.0], [0.0, 0.0, 3.0], [0.0, 0.5, 2.0]]), np.eye(3)[[2, 0, 1]])
    assert found.has_stop.tolist() == [True, True, False]
    assert found.stop[:2].tolist() == [0.0, 0.0] and found.meets.tolist() == [False, False, True]
    endless = Ends(field("planar", False), None).interval(
        np.array([[0.0, 0.5, 3.0], [0.0, 5.0, 3.0]]), np.eye(3)[[0, 0]]
    )
    assert endless.status.tolist() == [RayStatus.STOP_NOT_REACHED, RayStatus.MISSED_FIELD]
    assert Ends(field("planar", False), None).extent == pytest.approx(5.0)  # 3 m by 4 m


@pytest.mark.parametrize("stop", list(STOPS))
def test_rays_begin_with_the_lever_arms_of_their_stop(stop: str):
    """Errors of direction count over the box and the way beyond it, errors of position by 1 / cosine at the stop."""
    ends, until = Ends(field("volume", False), STOPS[stop]), STOPS[stop]
    start, heading = rays()
    interval = ends.interval(start, heading)
    rows = np.flatnonzero(interval.meets)
    interval = Interval(*(getattr(interval, name)[rows] for name in Interval.__annotations__))
    start, heading = start[rows], heading[rows]
    cell = np.zeros((len(rows), 3), dtype=int)
    flight = ends.flight(start, heading, interval, cell)
    assert flight.start is start and flight.direction is heading and flight.cell is cell
    np.testing.assert_array_equal(flight.along, interval.t_enter)
    assert flight.along is not interval.t_enter
    extent = np.sqrt(2.0**2 + 3.0**2 + 4.0**2)
    for row in range(len(rows)):
        side, cosine, beyond = 1.0, 1.0, 0.0
        if stop == "plane":
            side = 1.0 if (start[row] - until.point) @ until.normal <= 0.0 else -1.0
            cosine = abs(heading[row] @ until.normal)
        elif stop == "none":
            exit_at = start[row] + interval.t_exit[row] * heading[row]
            off = np.concatenate([np.abs(exit_at - LOW), np.abs(exit_at - HIGH)])
            cosine = abs(heading[row, np.argmin(off) % 3])
        if stop != "none" and interval.has_stop[row]:
            beyond = max(interval.stop[row] - interval.t_exit[row], 0.0)
        sine = np.sqrt(1.0 - cosine**2)
        assert flight.side[row] == side
        assert flight.gain[row] == pytest.approx(1.0 / max(cosine, 1e-3), rel=1e-12)
        assert flight.lever_arm[row] == pytest.approx(extent + (sine + 0.05) * beyond, rel=1e-9)


def deviated(
    ends: Ends, until, size: float = 1e-3, count: int = 60
) -> tuple[Interval, np.ndarray, Flight, np.ndarray, np.ndarray, np.ndarray]:
    """Rays from within the box, all but the first 20 in flight, with deviations of a size; every third is stopped."""
    rng = np.random.default_rng(41)
    start = rng.uniform([-0.8, -0.8, 1.2], [0.8, 1.8, 3.0], (count, 3))
    heading = rng.normal((0.0, 0.0, 3.0), 1.0, (count, 3))
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    interval, rows = ends.interval(start, heading), np.arange(20, count)
    flight = ends.flight(start[rows], heading[rows], Interval(
        *(getattr(interval, name)[rows] for name in Interval.__annotations__)), np.zeros((count - 20, 3), int),
    )  # fmt: skip
    q, turn = size * rng.normal(size=(2, count - 20, 3))
    flight.q[:] = q
    flight.work, flight.stretch, flight.error = size * rng.uniform(1.0, 2.0, (3, count - 20))
    flight.steps, flight.evaluations = rng.integers(1, 50, (2, count - 20))
    flight.along = rng.uniform(0.1, 0.3, count - 20)
    flight.stopped[::3] = True
    if isinstance(until, Plane):  # on the plane with the deviation
        to_plane = (until.point - start[rows] - q) @ until.normal / (heading[rows] @ until.normal)
        flight.along[::3] = to_plane[::3]
    elif isinstance(until, ArcLength):
        flight.along[::3] = until.length - flight.stretch[::3]
    flight.hit[1], flight.spent[4], flight.failed[5] = True, True, True
    return interval, rows, flight, turn, start, heading


@pytest.mark.parametrize("size", [1e-3, 1e-9])
@pytest.mark.parametrize("stop", ["arc", "plane"])
def test_rays_fly_on_to_their_stop(stop: str, size: float):
    """Each ray's results from those of its flight, in a plain loop: T = d + turn after the last step, straight on.

    OPD: W - a S at a length of arc; at a plane W + a (t - t of the undisturbed ray), by the deviation q on the plane:
    t - t' = - q n / d n, whose digits the two distances have lost.
    """
    until = STOPS[stop]
    ends = Ends(field("volume", False), until)
    interval, rows, flight, turn, start, heading = deviated(ends, until, size)
    found = ends.finish(interval, rows, flight, turn, start, heading, False)
    for row in range(len(start)):
        k = row - 20
        along, q, work, stretch, bend, error = 0.0, np.zeros(3), 0.0, 0.0, np.zeros(3), 0.0
        status = RayStatus.OK
        if k >= 0:
            along, q, work, stretch = flight.along[k], flight.q[k], flight.work[k], flight.stretch[k]
            bend, error, status = turn[k], flight.error[k], {1: RayStatus.HIT_BODY, 4: RayStatus.MAX_STEPS,
                5: RayStatus.NOT_FINITE}.get(k, RayStatus.OK)  # fmt: skip
        place, distance = start[row] + along * heading[row] + q, 0.0
        if status == RayStatus.OK and not (k >= 0 and flight.stopped[k]):
            if stop == "arc":
                distance = until.length - along - stretch
            else:
                distance = (until.point - place) @ until.normal / ((heading[row] + bend) @ until.normal)
                if distance < 0.0 or not interval.has_stop[row]:
                    status, distance = RayStatus.STOP_NOT_REACHED, 0.0
        place = place + distance * (heading[row] + bend)
        along += distance
        deviation = q + distance * bend
        ended = status == RayStatus.OK
        opd = work - AMBIENT * stretch
        if stop == "plane" and ended:
            opd = work - AMBIENT * (deviation @ until.normal) / (heading[row] @ until.normal)
            if size == 1e-3:
                assert work + AMBIENT * (along - interval.stop[row]) == pytest.approx(opd, rel=1e-9)
        assert found["status"][row] == status
        assert found["position"][row] == pytest.approx(place, rel=1e-12)
        tangent = heading[row] + bend
        assert found["direction"][row] == pytest.approx(tangent / np.linalg.norm(tangent), rel=1e-13)
        assert found["optical_path"][row] == pytest.approx(AMBIENT * along + work, rel=1e-12)
        assert found["arc_length"][row] == pytest.approx(along + stretch, rel=1e-12)
        assert found["opd"][row] == pytest.approx(opd, rel=1e-11, abs=0.0)
        counts = (flight.steps[k], flight.evaluations[k]) if k >= 0 else (0, 0)
        assert (found["step_count"][row], found["evaluation_count"][row]) == counts
        if k >= 0:  # rounding: four units of the box, and of the deviation by the obliquity of the stop
            error += 4.0 * np.finfo(float).eps * (ends.extent + np.linalg.norm(deviation) * flight.gain[k])
        assert found["step_error"][row] == pytest.approx(error, rel=1e-15, abs=0.0)


@pytest.mark.parametrize("straight", [False, True])
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_rays_end_where_they_leave_the_box(geometry: str, straight: bool):
    """Without a stop: a ray ends on the box, a straight one where its end, beside its line, flies on to it."""
    ends = Ends(field(geometry, False), None)
    interval, rows, flight, turn, start, heading = deviated(ends, None)
    flight.stopped[:] = flight.hit[:] = flight.spent[:] = flight.failed[:] = False
    flight.left[:] = True
    if straight:
        flight.along[:] = interval.stop[rows]
    else:
        flight.along[:] = ends.span(start[rows] + flight.q, heading[rows])[1]
    along = flight.along.copy()
    found = ends.finish(interval, rows, flight, turn, start, heading, straight)
    place = start[rows] + along[:, None] * heading[rows] + flight.q
    if straight:
        more = ends.span(place, heading[rows] + turn)[1]
        along, place = along + more, place + more[:, None] * (heading[rows] + turn)
        assert np.abs(more).max() > 1e-4
    assert (found["status"] == RayStatus.OK).all()
    np.testing.assert_allclose(found["position"][rows], place, rtol=1e-12, atol=1e-12)
    expected = flight.work + AMBIENT * (along - interval.stop[rows])
    np.testing.assert_allclose(found["opd"][rows], expected, rtol=1e-8, atol=1e-14)


def test_rays_that_hit_the_body_ahead_of_the_box_end_there():
    """Along -z onto the tip, 1.5 m behind the box; without a flight nothing else is changed."""
    ends = Ends(field("axisymmetric", True), Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    start, heading = np.array([[0.0, 0.0, 9.0], [1.5, 0.0, 9.0]]), np.array([[0.0, 0.0, -1.0], [0.0, 0.0, -1.0]])
    interval = ends.interval(start, heading)
    assert interval.status.tolist() == [RayStatus.HIT_BODY, RayStatus.OK]
    found = ends.finish(interval, np.zeros(0, int), None, np.zeros((0, 3)), start, heading, True)
    assert found["position"].tolist() == [[0.0, 0.0, 6.5], [1.5, 0.0, 0.0]]
    assert found["arc_length"].tolist() == [2.5, 9.0] and found["opd"].tolist() == [0.0, 0.0]
    assert found["optical_path"] == pytest.approx(AMBIENT * np.array([2.5, 9.0]))
    assert found["status"].tolist() == [RayStatus.HIT_BODY, RayStatus.OK]
