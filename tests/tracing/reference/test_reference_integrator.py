"""The pieces of the reference engine's integrator, each against its equation, on numbers that no symmetry spares.

Rays are in deviation from p + t d: tangent T = a d + P, potential s = (n^2 - a^2) / 2.
"""

import numpy as np
import pytest
from scipy.integrate import DOP853

from aerokernels.medium import Body, IndexField
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.engines.reference.ends import Ends
from aerokernels.tracing.engines.reference.flight import Flight
from aerokernels.tracing.engines.reference.medium import GridAir
from aerokernels.tracing.engines.reference.steps import Integrator
from tests.random_air import random_air

AMBIENT = 1.3
COUNT = 7
RNG = np.random.default_rng(77)
SPACING, ORIGIN = (0.5, 0.75, 1.0), (-1.0, -1.5, 1.0)
STOPS = {"plane": Plane((0.3, -0.2, 4.0), (0.2, -0.6, -1.0)), "arc": ArcLength(3.7), "none": None}


def field_of(geometry: str = "volume", body: Body | None = None) -> IndexField:
    """Random air of a strong contrast in five cells along each axis."""
    return random_air(
        geometry, 5, lambda random, shape: random.uniform(-0.1, 0.2, shape), (6, 6, 6), ORIGIN, SPACING,
        ambient_index=AMBIENT, body=body,
    )  # fmt: skip


def integrator(geometry: str = "volume", until=None, straight: bool = False, body: Body | None = None) -> Integrator:
    field = field_of(geometry, body)
    return Integrator(GridAir(field), AMBIENT, Ends(field, until), 1e-6, 100, straight)


def flight_in(run: Integrator, count: int = COUNT) -> Flight:
    """Rays in flight inside the field, with deviations and momenta of a tenth."""
    rng = np.random.default_rng(78)
    heading = rng.normal((0.0, 0.0, 2.0), size=(count, 3))
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    along = rng.uniform(0.1, 0.4, count)
    place = rng.uniform([-0.5, 0.1, 1.8], [0.9, 1.4, 4.5], (count, 3))
    side = np.where(np.arange(count) % 2, 1.0, -1.0)
    cell = run.air.cell_at(place, heading)
    q = rng.uniform(-0.05, 0.05, (count, 3))
    start = place - along[:, None] * heading - q
    flight = Flight(start, heading, side, along, rng.uniform(1.0, 3.0, count), rng.uniform(1.0, 2.0, count), cell)
    flight.q[:], flight.momentum[:] = q, rng.uniform(-0.1, 0.1, (count, 3))
    flight.work, flight.stretch, flight.error = rng.uniform(0.0, 0.2, (3, count))
    return flight


def test_turns_are_tangents_minus_first_directions():
    """(a d + P) / |a d + P| - d, of momenta from 1e-9 to 1: to rounding of their own size."""
    run = integrator()
    heading = RNG.normal(size=(COUNT, 3))
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    momentum = RNG.normal(size=(COUNT, 3))
    tangent = AMBIENT * heading + momentum
    expected = tangent / np.linalg.norm(tangent, axis=1)[:, None] - heading
    assert run.turn(heading, momentum) == pytest.approx(expected, rel=1e-12, abs=1e-14)
    across = momentum - np.sum(momentum * heading, axis=1)[:, None] * heading
    small = run.turn(heading, 1e-9 * across)  # to first order P / a; the next term is 1e-18
    assert small == pytest.approx(1e-9 * across / AMBIENT, rel=1e-7, abs=1e-17)


def test_the_right_side_of_the_equations():
    """That is, q' = P, P' = grad s, W' = 2 s, S' = n - a, n = sqrt(a^2 + 2 s); no index below 0."""
    run = integrator()
    momentum, force, potential = RNG.normal(size=(COUNT, 3)), RNG.normal(size=(COUNT, 3)), RNG.uniform(-0.5, 1, COUNT)
    index = np.sqrt(AMBIENT**2 + 2.0 * potential)
    expected = np.c_[momentum, force, 2.0 * potential, index - AMBIENT]
    assert run.slope(momentum, potential, force) == pytest.approx(expected, rel=1e-12, abs=1e-14)
    assert run.index(np.array([-5.0, 0.0])).tolist() == [0.0, AMBIENT]


@pytest.mark.parametrize("straight", [False, True])
def test_places_potentials_and_forces_on_rays(straight: bool):
    """On the ray, or on its undisturbed line and from there linear in q; a ridge takes the force across it away."""
    run = integrator(straight=straight)
    flight = flight_in(run)
    rows = np.array([5, 0, 3])
    line = flight.start[rows] + flight.along[rows, None] * flight.direction[rows]
    place = run.place(flight, rows)
    np.testing.assert_allclose(place, line if straight else line + flight.q[rows], rtol=0, atol=1e-15)
    delta = RNG.uniform(-0.02, 0.02, (3, 3))
    field = field_of()
    contrast, slope = field.evaluate(place + delta)
    potential, force = contrast * (AMBIENT + 0.5 * contrast), (AMBIENT + contrast)[:, None] * slope
    frame = run.air.frame(run.air.cell_at(place, flight.direction[rows]), place)
    run.has_ridges = False
    q = flight.q[rows]
    value, pull = run.sample(frame, rows, delta, q)
    assert pull == pytest.approx(force, rel=1e-9)
    assert value == pytest.approx(potential + np.sum(force * q, axis=1) if straight else potential, rel=1e-9)
    run.has_ridges, run.ridge = True, np.zeros((COUNT, 3))
    run.ridge[0] = normal = np.array([2.0, -1.0, 2.0]) / 3.0
    held = run.sample(frame, rows, delta, q)[1]
    assert held[1] == pytest.approx(force[1] - normal * (normal @ force[1]), rel=1e-9)
    assert held[[0, 2]] == pytest.approx(force[[0, 2]], rel=1e-9)


@pytest.mark.parametrize("straight", [False, True])
def test_momentum_where_a_ray_enters_a_cell(straight: bool):
    """|T| becomes the index there and the heading stays; a straight ray gets the contrast along its first direction."""
    run = integrator(straight=straight)
    flight = flight_in(run)
    before = flight.momentum.copy()
    rows = np.array([4, 1, 6])
    contrast = field_of().contrast_at(run.place(flight, rows))
    run.enter(flight, rows)
    if straight:
        expected = before[rows] + contrast[:, None] * flight.direction[rows]
    else:
        tangent = AMBIENT * flight.direction[rows] + before[rows]
        heading = tangent / np.linalg.norm(tangent, axis=1)[:, None]
        expected = (AMBIENT + contrast)[:, None] * heading - AMBIENT * flight.direction[rows]
    assert flight.momentum[rows] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    np.testing.assert_array_equal(flight.momentum[[0, 2, 3, 5]], before[[0, 2, 3, 5]])


def test_a_drift_is_of_second_order():
    """With a constant force F and s rising by F T: Taylor's series up to h^2 of t, q, P, W and S, either way."""
    run = integrator()
    flight, before = flight_in(run), flight_in(run)
    rows = np.array([2, 6])
    h, potential, force = np.array([0.03, -0.02]), RNG.uniform(-0.2, 0.3, 2), RNG.normal(size=(2, 3))
    run.drift(flight, rows, h, potential, force)
    for k, row in enumerate(rows):
        momentum = before.momentum[row]
        rise = force[k] @ (AMBIENT * before.direction[row] + momentum)
        index = np.sqrt(AMBIENT**2 + 2.0 * potential[k])
        assert flight.along[row] == pytest.approx(before.along[row] + AMBIENT * h[k], rel=1e-13)
        assert flight.q[row] == pytest.approx(before.q[row] + h[k] * momentum + 0.5 * h[k] ** 2 * force[k], rel=1e-12)
        assert flight.momentum[row] == pytest.approx(momentum + h[k] * force[k], rel=1e-12)
        work = before.work[row] + 2.0 * potential[k] * h[k] + 2.0 * rise * h[k] ** 2 / 2.0
        assert flight.work[row] == pytest.approx(work, rel=1e-12)
        stretch = before.stretch[row] + (index - AMBIENT) * h[k] + rise / index * h[k] ** 2 / 2.0
        assert flight.stretch[row] == pytest.approx(stretch, rel=1e-12)
    np.testing.assert_array_equal(flight.q[[0, 1, 3, 4, 5]], before.q[[0, 1, 3, 4, 5]])


def test_errors_of_a_step_are_those_of_the_embedded_formulas():
    """Hairer's e5^2 / sqrt(e5^2 + 0.01 e3^2) of q, P, W and S as optical path: a g, lever arm times g, 1 and a.

    Rounding: an eps of the greatest slope of each, and of the terms whose differences forces are.
    """
    run = integrator()
    flight = flight_in(run)
    rows = np.array([3, 0, 5])
    h, slopes = np.array([0.1, 0.2, 0.05]), RNG.normal(size=(DOP853.n_stages + 1, 3, 8))
    slopes[:, 2, 6] = 0.0  # no error at all of this part
    error, rounding = run.estimate(flight, rows, h, slopes)
    for k, row in enumerate(rows):
        gain, lever = flight.gain[row], flight.lever_arm[row]
        total, floor = 0.0, lever * gain * run.air.force_scale
        for first, last, weight in ((0, 3, AMBIENT * gain), (3, 6, lever * gain), (6, 7, 1.0), (7, 8, AMBIENT)):
            part = slopes[:, k, first:last]
            fifth, third = np.linalg.norm(DOP853.E5 @ part), np.linalg.norm(DOP853.E3 @ part)
            total += weight * (fifth**2 / np.hypot(fifth, 0.1 * third) if fifth > 0.0 else 0.0)
            floor += weight * np.abs(part).max()
        assert error[k] == pytest.approx(h[k] * total, rel=1e-11, abs=0.0)
        assert rounding[k] == pytest.approx(np.finfo(float).eps * h[k] * floor, rel=1e-11, abs=0.0)


@pytest.mark.parametrize("name", list(STOPS))
def test_the_stop_as_a_function_along_a_ray(name: str):
    """Value, rate and curvature against differences along T, with dT = F and n^2 = a^2 + 2 s."""
    run = integrator(until=STOPS[name])
    flight, rows, until = flight_in(run), np.array([1, 2, 5]), STOPS[name]
    force, potential = RNG.normal(size=(3, 3)), RNG.uniform(-0.1, 0.2, 3)
    q, momentum, stretch = flight.q[rows], flight.momentum[rows], flight.stretch[rows]
    tangent, index = AMBIENT * flight.direction[rows] + momentum, np.sqrt(AMBIENT**2 + 2.0 * potential)
    value, rate, curve = run.stop.event(flight, rows, flight.along[rows], q, tangent, force, stretch, index)
    assert value.shape == rate.shape == curve.shape == (3, 1)
    for k, row in enumerate(rows):
        place = flight.start[row] + flight.along[row] * flight.direction[row] + q[k]
        if name == "plane":
            side, normal = flight.side[row], until.normal
            expected = side * np.array([(place - until.point) @ normal, tangent[k] @ normal, force[k] @ normal])
        elif name == "arc":
            # Arc length t + S rises by n over sigma, and n n' = s' = F T.
            expected = flight.along[row] + stretch[k] - 3.7, index[k], force[k] @ tangent[k] / index[k]
        else:
            expected = -np.inf, 0.0, 0.0
        assert (value[k, 0], rate[k, 0], curve[k, 0]) == pytest.approx(tuple(expected), rel=1e-12)


@pytest.mark.parametrize("straight", [False, True])
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_faces_stop_and_wall_as_functions_along_a_ray(geometry: str, straight: bool):
    """At a step of 0: distances from the cell's faces; rates and curvatures are the derivatives over sigma.

    For small h the values at place + h T + h^2 F / 2 differ by rate h + curve h^2 / 2, to third order of h = 1e-4.
    The last two columns are the stop and the wall.
    """
    body = None if geometry == "volume" else Body([[0.0, 7.0], [1.0, 8.0], [0.0, 9.0]], geometry)
    run = integrator(geometry, STOPS["plane"], straight, body)
    flight = flight_in(run, 20)
    rows = np.arange(20)
    place = run.place(flight, rows)
    run.has_ridges = False
    flight.cell = run.air.cell_at(place, flight.direction)
    frame = run.air.frame(flight.cell, place)
    potential, force = run.sample(frame, rows, np.zeros((20, 3)), flight.q)
    wall = np.zeros(20, dtype=int)
    tangent = AMBIENT * flight.direction + flight.momentum

    def at(h):
        q = flight.q + h * flight.momentum + 0.5 * h**2 * force
        momentum, step = flight.momentum + h * force, np.full(20, h)
        return run.events(frame, flight, rows, step, q, momentum, flight.stretch, potential, force, wall)

    value, rate, curve = at(0.0)
    h = 1e-4
    assert at(0.3)[0][:, run.air.face_count] == pytest.approx(  # the stop, where the ray is then
        flight.side
        * (
            (
                flight.start
                + (flight.along + 0.3 * AMBIENT)[:, None] * flight.direction
                + flight.q
                + 0.3 * flight.momentum
                + 0.045 * force
                - STOPS["plane"].point
            )
            @ STOPS["plane"].normal
        ),
        rel=1e-10,
    )
    ahead, behind = at(h)[0], at(-h)[0]
    turning = np.zeros(value.shape, dtype=bool)
    turning[:, : run.air.face_count] = frame.turning()
    kept = ~turning & np.isfinite(value)
    assert kept.mean() > 0.5
    assert ((ahead - behind) / (2 * h))[kept] == pytest.approx(rate[kept], rel=1e-5, abs=1e-5)
    assert ((ahead - 2 * value + behind) / h**2)[kept] == pytest.approx(curve[kept], rel=1e-3, abs=1e-5)
    # The last faces of the grid are those across z.
    line = AMBIENT * flight.direction if straight else tangent
    for column, sense in ((run.air.face_count - 2, -1.0), (run.air.face_count - 1, 1.0)):
        cells = (place[:, 2] - sense * value[:, column] - ORIGIN[2]) / SPACING[2]
        assert cells == pytest.approx(np.round(cells), abs=1e-9)
        assert (value[:, column] <= 0.0).all() and (value[:, column] >= -SPACING[2]).all()
        assert rate[:, column] == pytest.approx(sense * line[:, 2], rel=1e-12)
