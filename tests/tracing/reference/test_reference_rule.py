"""Steps by a rule in the reference engine: one step by the pair's own fractions, landings, and where a ray is."""

import numpy as np
import pytest

from aerokernels.medium import IndexField, QuadMesh
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.engines.reference.ends import Ends
from aerokernels.tracing.engines.reference.rule import ARC, LAG, PATH, _longitudinal_deficit, _Rule, march
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.tableau import PAIR
from tests.random_air import random_air

AMBIENT = 1.1
ORIGIN, SPACING = np.array([-1.0, -1.5, 1.0]), np.array([0.5, 0.75, 1.1])
LOW, HIGH, RADIUS = ORIGIN, ORIGIN + 5.0 * SPACING, 5.0 * SPACING[1]
PLANE = Plane((0.2, 0.1, 5.0), (0.1, -0.3, -1.0))


def field_of(geometry: str = "volume") -> IndexField:
    return random_air(
        geometry, 61, lambda random, shape: random.uniform(-0.05, 0.1, shape), (6, 6, 6), ORIGIN, SPACING,
        ambient_index=AMBIENT,
    )  # fmt: skip


def rule_of(geometry: str = "volume", until=None, field: IndexField | None = None, step: float = 0.05) -> _Rule:
    """Seven rays from places in the field, as they enter it."""
    field = field or field_of(geometry)
    ends = Ends(field, until)
    rng = np.random.default_rng(62)
    start = rng.uniform([-0.5, 0.1, 1.4], [0.8, 1.2, 2.5], (7, 3))
    heading = rng.normal((0.0, 0.0, 2.0), 1.0, (7, 3))
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    interval = ends.interval(start, heading)
    interval.t_enter[:] = np.linspace(0.0, 0.3, 7)
    flight = ends.flight(start, heading, interval, np.zeros((7, 1), int))
    plan = TracePlan("fixed", "reference", "cpu", "float64", 1000, step, 1e-3, ())
    return _Rule(field, ends, flight, plan)


def test_rays_start_with_the_index_there():
    """Position at the entry, T = n d, path a t, arc t, no lag and no deflection."""
    rule = rule_of()
    place = rule.flight.start + rule.enter[:, None] * rule.flight.direction
    index = AMBIENT + field_of().contrast_at(place)
    expected = np.c_[place, index[:, None] * rule.flight.direction, AMBIENT * rule.enter, rule.enter, 0.0 * rule.enter]
    np.testing.assert_allclose(rule.state, expected, rtol=1e-13)
    assert rule.consistent_gradient and not rule.deflection.any()


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_beyond_the_box_the_field_goes_on_linearly(geometry: str):
    """Inside the field itself; outside value + gradient times the way from the nearest point of the box."""
    rule, field = rule_of(geometry), field_of(geometry)
    rng = np.random.default_rng(63)
    place = rng.uniform(LOW - 0.5, HIGH + 0.5, (200, 3))
    nearest = np.clip(place, LOW, HIGH)
    if geometry == "planar":
        nearest[:, 0] = place[:, 0]
    if geometry == "axisymmetric":
        place[:, :2] *= 1.3
        place[0, :2] = 0.0
        radius = np.hypot(place[:, 0], place[:, 1])
        shrink = np.minimum(1.0, RADIUS / np.maximum(radius, 1e-9))
        nearest = np.c_[place[:, :2] * shrink[:, None], np.clip(place[:, 2], LOW[2], HIGH[2])]
    contrast, gradient = field.evaluate(nearest)
    index, slope = rule.look(place)
    assert (np.abs(nearest - place).max(axis=1) > 0.0).sum() > 20
    np.testing.assert_allclose(slope, gradient, atol=1e-12)
    np.testing.assert_allclose(index, AMBIENT + contrast + np.sum(gradient * (place - nearest), axis=1), rtol=1e-12)


def test_beyond_a_round_box_on_both_sides_of_z_0():
    """The same about an axis, of a box from z = -3 m on: places within r, beyond it and on the axis."""
    samples = np.random.default_rng(67).uniform(-0.05, 0.1, (6, 6))
    field = IndexField.from_samples(
        samples, origin=(0.0, -3.0), spacing=(0.5, 1.1), geometry="axisymmetric", ambient_index=AMBIENT
    )
    rule = rule_of(field=field)
    place = np.random.default_rng(68).uniform([-4.0, -4.0, -4.0], [4.0, 4.0, 4.0], (100, 3))
    place[:3, :2] = 0.0
    radius = np.hypot(place[:, 0], place[:, 1])
    shrink = np.minimum(1.0, 2.5 / np.maximum(radius, 1e-9))
    nearest = np.c_[place[:, :2] * shrink[:, None], np.clip(place[:, 2], -3.0, 2.5)]
    contrast, gradient = field.evaluate(nearest)
    index, slope = rule.look(place)
    np.testing.assert_allclose(slope, gradient, atol=1e-12)
    np.testing.assert_allclose(index, AMBIENT + contrast + np.sum(gradient * (place - nearest), axis=1), rtol=1e-12)


def test_one_step_is_that_of_the_pair():
    """Stage by stage with the pair's fractions; |T| is set to n at the end; the lag integrates n - T d.

    The momentum at the stages for the lag: the cubic through all forces, integrated from 0 to the node.
    """
    rule = rule_of()
    rule.state[:, :3] += [0.0, 0.0, 0.4]
    state, heading, h = rule.state, rule.flight.direction, np.linspace(0.1, 0.3, 7)
    index, gradient = rule.look(state[:, :3])
    after, angle = rule.nystrom(state, heading, index, gradient, h)
    nodes, b, bt = (np.array([float(v) for v in one]) for one in (PAIR.c, PAIR.b, PAIR.bt))
    for row in range(7):
        place, momentum = state[row, :3], state[row, 3:6]
        indices, forces = [], []
        for c, stage in zip(nodes, PAIR.a, strict=True):
            kick = sum((float(w) * f for w, f in zip(stage, forces, strict=False)), np.zeros(3))
            n, slope = rule.look((place + c * h[row] * momentum + h[row] ** 2 * kick)[None])
            indices.append(n[0])
            forces.append(n[0] * slope[0])
        forces = np.array(forces)
        assert after[row, :3] == pytest.approx(place + h[row] * momentum + h[row] ** 2 * b @ forces, rel=1e-13)
        moved = momentum + h[row] * bt @ forces
        assert after[row, 3:6] == pytest.approx(moved * indices[-1] / np.linalg.norm(moved), rel=1e-12)
        assert after[row, PATH] == pytest.approx(state[row, PATH] + h[row] * bt @ np.square(indices), rel=1e-13)
        assert after[row, ARC] == pytest.approx(state[row, ARC] + h[row] * bt @ indices, rel=1e-13)
        cubic = np.polyfit(nodes, forces, 3)
        there = [momentum + h[row] * np.array([np.polyval(np.polyint(column), c) for column in cubic.T]) for c in nodes]
        lag = sum(w * (n - t @ heading[row]) for w, n, t in zip(bt, np.linalg.norm(there, axis=1), there, strict=True))
        # n and |T| of the stages differ by the step's own error; the lag is |across|^2 / (n + ahead).
        ahead = there @ heading[row]
        square = np.sum(np.square(there), axis=1) - ahead**2
        exact = h[row] * np.sum(bt * square / (np.array(indices) + ahead))
        assert after[row, LAG] == pytest.approx(exact, rel=1e-9)
        assert h[row] * lag == pytest.approx(exact, rel=0.2)
        end = momentum + h[row] * forces[-1]
        across = end - (end @ heading[row]) * heading[row]
        assert angle[row] == pytest.approx(np.linalg.norm(across) / AMBIENT, rel=1e-12)


def test_what_the_momentum_along_the_first_direction_lacks():
    """Of momenta of length n: n - T d; where the turn is 1e-9 its square is kept."""
    heading = np.tile([0.6, 0.0, 0.8], (3, 1))
    angle = np.array([0.3, 1e-9, 0.0])
    momentum = 1.5 * (np.cos(angle)[:, None] * heading + np.sin(angle)[:, None] * [0.8, 0.0, -0.6])
    found = _longitudinal_deficit(momentum, heading, np.full(3, 1.5))
    assert found == pytest.approx(3.0 * np.sin(0.5 * angle) ** 2, rel=1e-6, abs=1e-30)
    assert _longitudinal_deficit(np.zeros((1, 3)), heading[:1], np.zeros(1)).tolist() == [0.0]


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_distances_outside_the_box(geometry: str):
    """The greatest excess over any face, negative inside."""
    rule = rule_of(geometry)
    place = np.random.default_rng(64).uniform(LOW - 1.0, HIGH + 1.0, (100, 3))
    excess = [place[:, 2] - HIGH[2], LOW[2] - place[:, 2]]
    if geometry == "axisymmetric":
        excess.append(np.hypot(place[:, 0], place[:, 1]) - RADIUS)
    else:
        excess += [place[:, 1] - HIGH[1], LOW[1] - place[:, 1]]
    if geometry == "volume":
        excess += [place[:, 0] - HIGH[0], LOW[0] - place[:, 0]]
    np.testing.assert_allclose(rule.outside(place), np.max(excess, axis=0), rtol=1e-13)


@pytest.mark.parametrize("until", [PLANE, ArcLength(0.31), None])
def test_last_steps_end_on_the_stop_or_the_box(until):
    """The signed value of the stop; steps of up to 8 m are shortened to the surface that comes first, to rounding."""
    rule = rule_of(until=until)
    rows = np.array([6, 2, 3])
    value = rule.stop_value(rule.state[rows], rows)
    if until is PLANE:
        side = np.where((rule.flight.start[rows] - PLANE.point) @ PLANE.normal > 0.0, -1.0, 1.0)
        expected = side * ((rule.state[rows, :3] - PLANE.point) @ PLANE.normal)
    else:
        expected = rule.state[rows, ARC] - 0.31 if until else [-1.0] * 3
    np.testing.assert_allclose(value, expected, rtol=1e-14)
    assert (np.array(expected) < 0.0).all()
    index, gradient = rule.look(rule.state[rows, :3])
    h, heading = np.array([1.0, 1.2, 1.5]), rule.flight.direction[rows]
    state = rule.state[rows].copy()
    after = rule.nystrom(state, heading, index, gradient, h)[0]
    over = np.stack([rule.outside(after), rule.stop_value(after, rows)], axis=1) > 0.0
    h[~over.any(axis=1)] = 8.0
    after = rule.nystrom(state, heading, index, gradient, h)[0]
    over = np.stack([rule.outside(after), rule.stop_value(after, rows)], axis=1) > 0.0
    assert over.any(axis=1).all()
    rule.land(rows, index, gradient, h, over)
    ended = rule.state[rows]
    outside, stopped = rule.outside(ended), rule.stop_value(ended, rows)
    np.testing.assert_allclose(np.maximum(outside, stopped), 0.0, atol=1e-13)
    np.testing.assert_array_equal(rule.flight.stopped[rows], stopped > outside)
    np.testing.assert_array_equal(rule.flight.left[rows], outside > stopped)
    assert rule.flight.stopped.sum() + rule.flight.left.sum() == 3


@pytest.mark.parametrize("geometry", ["volume", "planar"])
def test_the_papers_step_is_that_of_the_rays_cell(geometry: str):
    """Of the cell that holds the place; beyond the box of the nearest one."""
    rule, field = rule_of(geometry), field_of(geometry)
    place = np.random.default_rng(65).uniform(LOW - 0.3, HIGH + 0.3, (50, 3))
    first = 0 if geometry == "volume" else 1
    for one, found in zip(place, rule.paper_step(place), strict=True):
        cell = [int(np.clip((one[k] - ORIGIN[k]) // SPACING[k], 0, 4)) for k in range(first, 3)]
        assert found == field.samples.paper_step[tuple(cell)]


def test_the_papers_step_on_a_mesh():
    """Of the cell, or the median of all in a gap."""
    y, z = np.meshgrid([0.0, 1.0, 2.5, 3.0], [0.0, 1.0, 1.5, 4.0], indexing="ij")
    values = np.random.default_rng(66).uniform(0.0, 0.1, (4, 4))
    field = IndexField.from_mesh(QuadMesh.structured(y, z, "planar"), values, ambient_index=AMBIENT)
    rule = rule_of(field=field)
    steps = field.samples.paper_step
    found = rule.paper_step(np.array([[0.3, 2.7, 1.2], [0.0, 9.0, 1.0], [0.0, 0.5, 3.0]]))
    assert found.tolist() == [steps[7], np.median(steps), steps[2]]


@pytest.mark.parametrize("until", [PLANE, ArcLength(2.1), None])
def test_marched_rays_are_told_as_deviations(until):
    """In air of one contrast rays are straight: place, path n s, no turn; all have ended, in ceil(s / step) steps."""
    samples = np.full((6, 6, 6), 0.07)
    field = IndexField.from_samples(samples, origin=ORIGIN, spacing=SPACING, geometry="volume", ambient_index=AMBIENT)
    rule = rule_of(until=until, field=field, step=0.43)
    ends, flight = rule.ends, rule.flight
    enter = flight.along.copy()
    turn = march(field, ends, flight, rule.plan)
    leave = ends.span(flight.start, flight.direction)[1]
    stop = np.full(7, np.inf)
    if until is PLANE:
        stop = (PLANE.point - flight.start) @ PLANE.normal / (flight.direction @ PLANE.normal)
        stop = np.where(stop > enter, stop, np.inf)
    elif until:
        stop = np.full(7, 2.1)
    end = np.minimum(leave, stop)
    assert np.abs(turn).max() < 1e-12 and np.abs(flight.q).max() < 1e-12
    np.testing.assert_allclose(flight.along, end, rtol=1e-12)
    np.testing.assert_allclose(flight.work, 0.07 * (end - enter), rtol=1e-11)
    np.testing.assert_array_equal(flight.steps, np.ceil((end - enter) / 0.43))
    np.testing.assert_array_equal(flight.evaluations, 4 * flight.steps)
    np.testing.assert_array_equal(flight.stopped, stop < leave)
    np.testing.assert_array_equal(flight.left, stop > leave)
    assert not flight.hit.any() and not flight.spent.any()


@pytest.mark.parametrize("until", [Plane((0.0, 0.0, 6.0), (0.0, 0.1, 1.0)), ArcLength(2.6)])
def test_marched_rays_bend_as_in_a_linear_index(until):
    """With n = n0 + g y and a weak g = 1e-4 / m: turn, deviation and path to first order; the second is g^2 L^3 / 6."""
    y = ORIGIN[1] + SPACING[1] * np.arange(6)
    samples = np.ascontiguousarray(np.broadcast_to(1e-4 * y[None, :, None], (6, 6, 6)))
    field = IndexField.from_samples(samples, origin=ORIGIN, spacing=SPACING, geometry="volume", ambient_index=AMBIENT)
    rule = rule_of(until=until, field=field, step=0.3)
    turn = march(field, rule.ends, rule.flight, rule.plan)
    flight, enter = rule.flight, np.linspace(0.0, 0.3, 7)
    along, length = flight.along, flight.along - enter
    across = np.array([0.0, 1.0, 0.0]) - flight.direction[:, 1:2] * flight.direction
    middle = (flight.start + 0.5 * (along + enter)[:, None] * flight.direction)[:, 1]
    bend = 1e-4 / (AMBIENT + 1e-4 * middle) * length
    np.testing.assert_allclose(turn, bend[:, None] * across, atol=2e-7)
    np.testing.assert_allclose(flight.q, (0.5 * bend * length)[:, None] * across, atol=2e-7)
    np.testing.assert_allclose(flight.work, 1e-4 * middle * length, atol=3e-7)
    assert flight.stopped.any() and (isinstance(until, Plane) or np.abs(along - 2.6)[flight.stopped].max() < 1e-6)
