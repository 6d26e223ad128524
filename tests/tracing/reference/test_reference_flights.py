"""What the reference engine does beside its steps: gaps, walls, kinks on the axis, ridges, accepted steps."""

import numpy as np
import pytest

from aerokernels import ArcLength, Body, IndexField, Plane, QuadMesh
from aerokernels.tracing.engines.reference.ends import Ends, Walls, walls_of
from aerokernels.tracing.engines.reference.flight import Flight
from aerokernels.tracing.engines.reference.medium import GridAir
from aerokernels.tracing.engines.reference.mesh import MeshAir
from aerokernels.tracing.engines.reference.steps import Integrator

AMBIENT = 1.2


def mesh_field(geometry: str = "planar", body: Body | None = None) -> IndexField:
    """A parallelogram: y from 0 to 1.2, z from 1 + 0.3 y to 2.5 + 0.3 y, so that its box has two gaps."""
    y, z = np.meshgrid(np.linspace(0.0, 1.2, 5), np.linspace(1.0, 2.5, 6), indexing="ij")
    values = np.random.default_rng(191).uniform(-0.05, 0.1, (5, 6))
    mesh = QuadMesh.structured(y, z + 0.3 * y, geometry)
    return IndexField.from_mesh(mesh, values, ambient_index=AMBIENT, body=body)


def on_mesh(until=None, body: Body | None = None, geometry: str = "planar") -> Integrator:
    field = mesh_field(geometry, body)
    return Integrator(MeshAir(field), AMBIENT, Ends(field, until), 1e-6, 50, False)


def flight_at(run: Integrator, place, heading, first=None, along: float = 0.25, side: float = 1.0) -> Flight:
    """Rays at places with headings, whose first directions are others; deviations fit."""
    place, heading = np.atleast_2d(place).astype(float), np.atleast_2d(heading).astype(float)
    heading = heading / np.linalg.norm(heading, axis=1)[:, None]
    first = heading if first is None else np.broadcast_to(first, heading.shape) / np.linalg.norm(first)
    count, q = len(place), np.full(place.shape, 0.01)
    start = place - q - along * first
    ones = np.ones(count)
    cell = run.air.cell_at(place, heading)
    flight = Flight(start, first, side * ones, along * ones, ones, ones, cell)
    flight.q[:], flight.momentum[:] = q, AMBIENT * heading - AMBIENT * first
    return flight


@pytest.mark.parametrize("bent", [False, True])
def test_straight_flights_through_gaps(bent: bool):
    """To the cell ahead, the end of the box, the stop or the body, whichever comes first; |T| is then the index."""
    place, up = np.array([0.3, 0.9, 1.05]), np.array([0.0, 0.2, 1.0])
    first = [0.1, -0.1, 1.0] if bent else up
    slope = 0.2
    to_cell = (1.0 + 0.3 * 0.9 - 1.05) / (1.0 - 0.3 * slope)  # along z, per unit of z
    scale = np.linalg.norm(up)
    body = Body([[0.5, 1.1], [1.1, 1.1], [1.1, 1.13], [0.5, 1.13]], "planar")
    for until, walls, heading, distance, ends in (
        (None, None, up, to_cell * scale, "cell"),
        (None, None, -up, 0.05 * scale, "left"),
        (Plane((0.0, 0.0, 1.1), (0.0, 0.0, -2.0)), None, up, 0.05 * scale, "stopped"),
        (Plane((0.0, 0.0, 1.9), (0.0, 0.0, 1.0)), None, up, to_cell * scale, "cell"),
        (ArcLength(0.3), None, up, 0.05, "stopped"),
        (ArcLength(9.0), None, up, to_cell * scale, "cell"),
        (None, body, up, 0.05 * scale, "hit"),
    ):
        run = on_mesh(until, walls)
        side = -1.0 if isinstance(until, Plane) and until.normal[2] < 0.0 else 1.0
        flight = flight_at(run, place, heading, first if heading is up else -np.array(first), side=side)
        if isinstance(until, ArcLength):
            flight.stretch[:] = 0.0
        assert run.air.in_gap(flight.cell).all()
        before = flight.along.copy()
        rows = np.array([0])
        way = heading / np.linalg.norm(heading)
        run.stop.glide(run, flight, rows)
        along = float(flight.along[0] - before[0])
        assert along == pytest.approx(distance, rel=1e-9)
        end = flight.start[0] + flight.along[0] * flight.direction[0] + flight.q[0]
        np.testing.assert_allclose(end, place + along * way, atol=1e-12)
        told = {"left": flight.left[0], "stopped": flight.stopped[0], "hit": flight.hit[0]}
        assert [name for name, one in told.items() if one] == ([] if ends == "cell" else [ends])
        assert flight.steps[0] == 1 and not flight.spent[0]
        tangent = AMBIENT * flight.direction[0] + flight.momentum[0]
        np.testing.assert_allclose(tangent / np.linalg.norm(tangent), way, atol=1e-12)
        size = AMBIENT
        if ends == "cell":
            assert flight.cell[0, 0] == run.air.mesh.locate((end + 1e-6 * way)[None, 1:])[0]
            size = AMBIENT + mesh_field().contrast_at((end + 1e-12 * way)[None])[0]
        assert np.linalg.norm(tangent) == pytest.approx(size, rel=1e-9)


def test_a_gap_without_an_end_is_given_up():
    """Along x a planar box has no end, no stop and no cell."""
    run = on_mesh()
    flight = flight_at(run, [0.3, 0.9, 1.05], [1.0, 0.0, 0.0])
    before = flight.q.copy()
    run.stop.glide(run, flight, np.array([0]))
    assert flight.spent.tolist() == [True] and flight.along[0] == 0.25
    np.testing.assert_array_equal(flight.q, before)


def grid_field(interpolation: str = "linear") -> IndexField:
    """Around an axis: r up to 2 m, z from 0 to 4 m."""
    samples = np.random.default_rng(192).uniform(-0.05, 0.1, (5, 6))
    return IndexField.from_samples(
        samples, origin=(0.0, 0.0), spacing=(0.5, 0.8), geometry="axisymmetric", ambient_index=AMBIENT,
        interpolation=interpolation,
    )  # fmt: skip


def test_rays_hop_over_a_kink_on_the_axis():
    """Those that are nearer than 1e-7 cells to it and run straight for it before all else; others aim short."""
    run = on_mesh(geometry="axisymmetric")
    assert run.air.axis_is_kink
    size, count = run.air.size, 6
    turning = np.zeros((count, run.air.face_count), bool)
    turning[:, 4] = True
    before = 1e-7 * size * np.array([0.5, 0.5, 2.0, 0.5, 1e6, 0.5])
    aside = 1e-7 * size * np.array([0.001, 0.02, 0.001, 0.001, 0.001, 0.001])
    place = np.c_[aside, -before, np.ones(count)]
    value = np.full(turning.shape, -1.0)
    value[:, 4] = -before
    root = np.full(turning.shape, np.inf)
    root[:, 4] = before
    root[3, 1] = 0.5 * before[3]  # another face comes first
    tolerance = np.full(count, 1e-16)
    tolerance[5] = before[5]  # within rounding of the axis
    given = root.copy()
    found = run.hops(value, turning, place, tolerance, root)
    assert found.tolist() == [True, False, False, False, False, False]
    short = (aside < 1e-3 * before) & ~np.array([True, False, False, True, False, False])
    np.testing.assert_allclose(root[:, 4], np.where(short, 0.999, 1.0) * given[:, 4], rtol=1e-12)
    smooth = Integrator(GridAir(grid_field()), AMBIENT, Ends(grid_field(), None), 1e-6, 50, False)
    assert not smooth.hops(value, turning, place, tolerance, root).any()
    assert smooth.least == pytest.approx(1e-7 * 0.5 / AMBIENT) and run.least == pytest.approx(1e-11 * size / AMBIENT)


def test_over_the_axis_a_ray_flies_straight():
    """As a drift without force, which counts as a step."""
    run = on_mesh()
    flight, again = (flight_at(run, [[0.1, 0.5, 1.7]] * 3, [[0.0, 0.1, 1.0]] * 3, [0.05, 0.0, 1.0]) for _ in range(2))
    h, potential = np.array([0.02, 0.03]), np.array([0.1, 0.2])
    run.over_axis(flight, np.array([0, 2]), h, potential)
    run.drift(again, np.array([0, 2]), h, potential, np.zeros((2, 3)))
    for name in ("along", "q", "momentum", "work", "stretch"):
        np.testing.assert_array_equal(getattr(flight, name), getattr(again, name))
    assert flight.steps.tolist() == [1, 0, 1]
    np.testing.assert_allclose(flight.work[[0, 2]], 2.0 * potential * h)


def test_rays_that_are_driven_back_to_a_ridge_are_held_on_it():
    """After eight faces without a step between them: no momentum across the face, and its normal is kept."""
    run = on_mesh()
    count = 3
    flight = flight_at(run, [[0.0, 0.5, 1.7]] * count, [[0.0, 0.3, 1.0]] * count, [0.0, 0.0, 1.0])
    run.idle, run.ridge, run.has_ridges = np.array([7, 6, 5]), np.zeros((count, 3)), False
    momentum = flight.momentum.copy()
    rows, chosen = np.arange(count), np.array([1, 1, 1])
    run.hold(flight, rows, chosen, np.array([True, True, False]))
    normal = run.air.normal(flight.cell[:1], chosen[:1], run.place(flight, rows[:1]))[0]
    assert run.idle.tolist() == [0, 7, 0] and run.has_ridges
    np.testing.assert_allclose(run.ridge[0], normal)
    np.testing.assert_allclose(flight.momentum[0], momentum[0] - normal * (normal @ momentum[0]), atol=1e-15)
    np.testing.assert_array_equal(flight.momentum[1:], momentum[1:])
    run.hold(flight, rows, chosen, np.array([False, True, True]))
    assert not run.ridge[0].any() and run.ridge[1].any() and run.idle.tolist() == [0, 0, 1]


def test_accepted_steps_move_rays_and_end_them():
    """Counts, errors and state of accepted ones; those that land fly the rest, and stop, hit, cross or leave."""
    field = grid_field("cubic")
    run = Integrator(GridAir(field), AMBIENT, Ends(field, Plane((0, 0, 3.9), (0, 0, 1))), 1e-6, 50, False)
    count = 5
    place = np.tile([0.3, 0.7, 1.2], (count, 1))
    flight = flight_at(run, place, [[0.0, 0.1, 1.0]] * count, [0.05, 0.0, 1.0])
    run.idle, run.ridge, run.has_ridges = np.zeros(count, int), np.zeros((count, 3)), False
    flight.cell[4] = [3, 4]  # the last along z
    before = {name: getattr(flight, name).copy() for name in ("along", "q", "cell", "error", "steps")}
    rng = np.random.default_rng(193)
    y, h, miss = rng.uniform(0.01, 0.02, (count, 8)), rng.uniform(0.1, 0.2, count), rng.uniform(1e-3, 2e-3, count)
    accept = np.array([True, True, False, True, True])
    lands = np.array([False, True, True, True, True])
    chosen = np.array([3, 4, 3, 3, 3])  # 4: the stop; 3: the upper face along z
    potential, force, error = rng.uniform(size=count), rng.normal(size=(count, 3)), rng.uniform(size=count)
    turning = np.zeros((count, 5), bool)
    run.accept(flight, np.arange(count), accept, lands, chosen, h, y, potential, force, miss, error, turning)
    assert flight.steps.tolist() == [1, 1, 0, 1, 1]
    np.testing.assert_allclose(flight.error, before["error"] + np.where(accept, error, 0.0))
    rest = np.where(accept & lands, miss, 0.0)
    np.testing.assert_allclose(flight.along, before["along"] + AMBIENT * np.where(accept, h + rest, 0.0))
    q = y[:, :3] + rest[:, None] * y[:, 3:6] + 0.5 * rest[:, None] ** 2 * force
    np.testing.assert_allclose(flight.q, np.where(accept[:, None], q, before["q"]))
    np.testing.assert_allclose(flight.momentum[accept], (y[:, 3:6] + rest[:, None] * force)[accept])
    np.testing.assert_allclose(flight.work[0], y[0, 6])
    np.testing.assert_allclose(flight.stretch[0], y[0, 7])
    assert flight.stopped.tolist() == [False, True, False, False, False]
    assert flight.left.tolist() == [False] * 4 + [True] and not flight.hit.any()
    np.testing.assert_array_equal(flight.cell[3], before["cell"][3] + [0, 1])
    np.testing.assert_array_equal(flight.cell[:3], before["cell"][:3])
    turning[3, 3] = True  # the closest approach to the axis is the end of no cell
    again = flight_at(run, place, [[0.0, 0.1, 1.0]] * count, [0.05, 0.0, 1.0])
    run.accept(again, np.arange(count), accept, lands, chosen, h, y, potential, force, miss, error, turning)
    np.testing.assert_array_equal(again.cell[3], before["cell"][3])


def test_walls_are_ahead_of_rays():
    """The nearest wall along the tangent, and whether the ends of steps lie inside; a clockwise profile is turned."""
    corners = np.array([[0.5, 1.4], [1.0, 1.4], [1.0, 2.0], [0.5, 2.0]])
    for profile in (corners, corners[::-1]):
        body = Body(profile, "planar")
        run = on_mesh(None, body)
        flight = flight_at(run, [[0.2, 0.7, 1.25], [0.2, 0.2, 1.25]], [[0.0, 0.1, 1.0]] * 2, [0.05, 0.0, 1.0])
        wall, distance = run.nearest_wall(flight, np.arange(2))
        assert distance[0] == pytest.approx(0.15 * np.sqrt(1.01), rel=1e-9) and distance[1] == np.inf
        walls = walls_of(body)
        assert isinstance(walls, Walls) and walls_of(None) is None
        met = walls.start[wall[0]], walls.start[wall[0]] + walls.step[wall[0]]
        assert met[0][1] == met[1][1] == 1.4
        np.testing.assert_allclose(walls.normal[wall[0]], [0.0, -1.0], atol=1e-12)
        y = np.concatenate([flight.q + 0.2 * flight.momentum, np.zeros((2, 5))], axis=1)
        ends = flight.start + (flight.along + AMBIENT * 0.2)[:, None] * flight.direction + y[:, :3]
        inside = body.contains(ends[:, 1:])
        assert inside.tolist() == [True, False]
        np.testing.assert_array_equal(run.in_body(flight, np.arange(2), np.full(2, 0.2), y), inside)
    assert on_mesh().nearest_wall(flight, np.arange(2)) == (None, None)
