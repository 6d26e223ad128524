"""Single steps of the reference engine: SciPy's own step, what is accepted, the next length, and landings."""

import numpy as np
import pytest
from scipy.integrate import DOP853
from scipy.integrate._ivp.rk import rk_step

from aerokernels import ArcLength, Body, IndexField, Plane
from aerokernels.tracing.engines.reference.ends import Ends
from aerokernels.tracing.engines.reference.flight import Flight
from aerokernels.tracing.engines.reference.medium import GridAir
from aerokernels.tracing.engines.reference.steps import Integrator
from tests.random_air import random_air

AMBIENT = 1.2
UP = Plane((0.0, 0.0, 9.0), (0.0, 0.1, 1.0))


def field_of(geometry: str = "volume", body: Body | None = None, scale: float = 0.05) -> IndexField:
    """Random air in cells of 0.5, 0.75 and 1.1 m."""
    return random_air(
        geometry, 241, lambda random, shape: scale * random.uniform(-1.0, 2.0, shape), (6, 6, 6), (-1.0, -1.5, 1.0),
        (0.5, 0.75, 1.1), ambient_index=AMBIENT, body=body,
    )  # fmt: skip


def started(geometry="volume", until=UP, planned=0.05, tolerance=1e-3, place=None, body=None, heading=None, scale=0.05):
    """An integrator and three rays in the middles of cells, with the state that `run` gives them."""
    field = field_of(geometry, body, scale)
    run = Integrator(GridAir(field), AMBIENT, Ends(field, until), tolerance, 1000, False)
    place = np.array([[0.2, 0.3, 1.5], [-0.3, 1.0, 2.7], [0.8, 0.45, 3.8]]) if place is None else np.atleast_2d(place)
    count = len(place)
    rng = np.random.default_rng(242)
    heading = rng.normal((0.0, 0.0, 1.0), 0.3, (count, 3)) if heading is None else np.tile(heading, (count, 1))
    heading = heading / np.linalg.norm(heading, axis=1)[:, None]
    along = np.full(count, 0.3)
    side, lever, gain = np.ones(count), rng.uniform(1.0, 2.0, count), rng.uniform(1.0, 1.5, count)
    flight = Flight(
        place - along[:, None] * heading, heading, side, along, lever, gain, run.air.cell_at(place, heading)
    )
    contrast = field.contrast_at(place)
    flight.momentum[:] = contrast[:, None] * heading
    run.planned, run.aim = np.full(count, planned), np.full(count, np.nan)
    run.idle, run.ridge, run.has_ridges = np.zeros(count, int), np.zeros((count, 3)), False
    run.cap, run.rejected_error = np.full(count, np.inf), np.full(count, np.inf)
    return run, flight, field


def equations(field: IndexField, start, heading):
    """The right side of q, P, W and S over sigma at the place of a ray's state, from the field itself."""

    def rate(sigma, y):
        place = start + AMBIENT * sigma * heading + y[:3]
        contrast, gradient = field.evaluate(place[None])
        index = AMBIENT + contrast[0]
        return np.concatenate([y[3:6], index * gradient[0], [index**2 - AMBIENT**2, contrast[0]]])

    return rate


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_a_step_is_scipys(geometry: str):
    """State after a step of 0.05 within a cell: by SciPy's `rk_step` with the field's own gradient, to rounding.

    The error estimate is accepted, steps and evaluations are counted, and the next step grows by 0.9 (allowed / error)
    to the power 1 / 8, six times at the most.
    """
    run, flight, field = started(geometry)
    before = flight.q.copy(), flight.momentum.copy()
    run.step(flight, np.arange(3))
    assert flight.steps.tolist() == [1, 1, 1] and flight.evaluations.tolist() == [DOP853.n_stages] * 3
    np.testing.assert_allclose(flight.along, 0.3 + AMBIENT * 0.05, rtol=1e-14)
    for row in range(3):
        rate = equations(field, flight.start[row] + 0.3 * flight.direction[row], flight.direction[row])
        y0 = np.concatenate([before[0][row], before[1][row], [0.0, 0.0]])
        stages = np.empty((DOP853.n_stages + 1, 8))
        y1, _ = rk_step(rate, 0.0, y0, rate(0.0, y0), 0.05, DOP853.A[:12, :12], DOP853.B, DOP853.C[:12], stages)
        found = np.concatenate([flight.q[row], flight.momentum[row], [flight.work[row], flight.stretch[row]]])
        np.testing.assert_allclose(found, y1, rtol=1e-9, atol=1e-15)
        error, rounding = run.estimate(flight, np.array([row]), np.array([0.05]), stages[:, None])
        assert flight.error[row] == pytest.approx(error[0] + rounding[0], rel=1e-4, abs=1e-17)
        allowed = run.tolerance * AMBIENT * 0.05 / run.extent + 32.0 * rounding[0]
        factor = np.clip(0.9 * (allowed / error[0]) ** 0.125, 0.2, 6.0) if error[0] > 0.0 else 6.0
        assert run.planned[row] == pytest.approx(0.05 * factor, rel=1e-4)
    assert np.isinf(run.cap).all() and np.isinf(run.rejected_error).all() and np.isnan(run.aim).all()


def test_a_step_that_is_not_accurate_is_repeated():
    """A tolerance of 1e-15 m over a wide step: nothing moves, the length falls by the same rule, at most to a fifth."""
    run, flight, _ = started(
        planned=0.25, tolerance=1e-15, place=[[0.2, 0.3, 1.25]], heading=[0.0, 0.0, 1.0], scale=0.3
    )
    before = flight.along.copy(), flight.q.copy()
    run.step(flight, np.array([0]))
    assert flight.steps.tolist() == [0] and flight.evaluations.tolist() == [12]
    np.testing.assert_array_equal(flight.along, before[0])
    np.testing.assert_array_equal(flight.q, before[1])
    assert 0.2 * 0.25 <= run.planned[0] <= 0.8 * 0.25 and np.isfinite(run.rejected_error[0])
    again, other, _ = started(planned=0.25, tolerance=1e3, place=[[0.2, 0.3, 1.25]], heading=[0.0, 0.0, 1.0], scale=0.3)
    again.step(other, np.array([0]))
    error = other.error[0]
    allowed = 1e-15 * AMBIENT * 0.25 / run.extent
    factor = max(0.9 * (allowed / error) ** 0.125, 0.2)  # but for rounding in both
    assert run.planned[0] == pytest.approx(0.25 * min(factor, 0.8), rel=0.1)
    assert run.rejected_error[0] == pytest.approx(error / 0.25, rel=1e-2)
    assert again.planned[0] == pytest.approx(6.0 * 0.25) and other.steps.tolist() == [1]


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_steps_end_on_the_faces_of_cells(geometry: str):
    """A planned step far beyond the cell: in a few attempts the ray is on a face and in the cell behind."""
    run, flight, field = started(geometry, planned=9.0)
    cells, rows = flight.cell.copy(), np.arange(3)
    for _ in range(12):
        rows = np.flatnonzero((flight.cell == cells).all(axis=1) & ~flight.left)
        if not len(rows):
            break
        run.step(flight, rows)
    moved = np.abs(flight.cell - cells).sum(axis=1)
    assert (moved <= 1).all() and (moved.sum() + flight.left.sum()) >= 3
    place = run.place(flight, np.arange(3))
    local = field.local_coordinates(place)
    share = (local - field.samples.origin) / field.samples.spacing
    assert (np.abs(share - np.round(share)).min(axis=1) < 1e-13).all()
    assert flight.steps.max() <= 3 and (flight.steps >= 1).all()


def test_steps_end_on_the_stop():
    """Before the face of the cell: a plane across the ray's way, and a length of arc; the ray has stopped there."""
    for until in (Plane((0.0, 0.0, 1.6), (0.0, 0.3, 1.0)), ArcLength(0.45)):
        run, flight, _ = started(until=until, planned=9.0, place=[[0.2, 0.3, 1.3]], heading=[0.05, 0.1, 1.0])
        if isinstance(until, Plane):
            flight.side[:] = -1.0 if (flight.start[0] - until.point) @ until.normal > 0.0 else 1.0
        for _ in range(8):
            if flight.stopped[0]:
                break
            run.step(flight, np.array([0]))
        assert flight.stopped[0] and flight.steps[0] <= 2
        place = run.place(flight, np.array([0]))[0]
        if isinstance(until, Plane):
            assert abs((place - until.point) @ until.normal) < 1e-14
        else:
            assert flight.along[0] + flight.stretch[0] == pytest.approx(0.45, abs=1e-14)


def test_steps_end_on_a_body():
    """A wall across the cell: the ray hits it; one that passes beside the wall flies on."""
    body = Body([[-0.5, 1.55], [0.6, 1.6], [0.6, 1.9], [-0.5, 1.9]], "planar")
    run, flight, _ = started(
        "planar", None, 9.0, place=[[0.0, 0.3, 1.2], [0.0, 0.7, 1.2]], body=body, heading=[0, 0.02, 1.0]
    )
    for _ in range(12):
        rows = np.flatnonzero(~flight.hit & (flight.cell[:, 1] == 0))
        if not len(rows):
            break
        run.step(flight, rows)
    assert flight.hit.tolist() == [True, False] and flight.cell[1].tolist() == [2, 1]
    y, z = run.place(flight, np.array([0]))[0, 1:]
    assert z == pytest.approx(1.55 + (y + 0.5) / 1.1 * 0.05, abs=1e-13)


def test_flights_end_or_are_given_up():
    """Every ray leaves the box; by two steps none does, and all are spent; so they are after 20 attempts a step."""
    run, flight, field = started()
    run.run(flight)
    assert flight.left.all() and not flight.spent.any() and len(flight.going) == 0
    place = run.place(flight, np.arange(3))
    low, high = field.box
    assert np.minimum(np.abs(place - low), np.abs(place - high)).min(axis=1).max() < 1e-12
    assert (flight.attempts >= flight.steps).all() and (flight.steps >= 3).all()
    short, again, _ = started()
    short.max_steps = 2
    short.run(again)
    assert again.spent.all() and (again.steps == 2).all() and not again.left.any()
    stuck, never, _ = started()
    stuck.max_steps = 3
    stuck.step = lambda flight, rows: None
    stuck.run(never)
    assert never.spent.all() and (never.attempts == 20 * 3).all()


def test_tighter_tolerances_take_more_steps_and_err_less():
    """Against 1e-12 m: errors fall with the tolerance and are below what is reported; steps grow."""
    steps, paths, told = [], [], []
    for tolerance in (1e-4, 1e-7, 1e-12):
        run, flight, _ = started(tolerance=tolerance, scale=0.2)
        run.run(flight)
        steps.append(flight.steps.sum())
        paths.append(flight.work - AMBIENT * flight.stretch)
        told.append(flight.error)
    assert steps[0] <= steps[1] < steps[2]
    assert (told[0] <= 1.1e-4).all() and (told[1] <= 1.1e-7).all() and (told[2] < 1e-10).all()
    assert np.abs(paths[1] - paths[2]).max() <= np.abs(paths[0] - paths[2]).max() + 1e-13
