"""Collimated rays along z through a volume, looked up in what each column gathers, against rays that are traced."""

import numpy as np
import pytest

from aerokernels.medium import Body, IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, RayStatus, planning, trace
from aerokernels.tracing.projection_tables import SUBCELLS, projection_tables
from aerokernels.validation.random_fields import noise, uniform_field

from .backends import ENGINES, on

WAVE = 905e-9
CELL = 1e-4
LOW, HIGH = np.array([-12e-4, -11e-4, 0.0]), np.array([12e-4, 11e-4, 28e-4])


def volume(amplitude: float = 3e-4, ambient: float = 1.0003, **changes) -> IndexField:
    """A smooth random field of 25 x 23 x 29 nodes, not zero on any face."""
    return IndexField.from_samples(
        noise((25, 23, 29), amplitude, seed=8),
        **{"origin": LOW, "spacing": (CELL,) * 3, "geometry": "volume", "ambient_index": ambient, **changes},
    )


def bundle(sign: float, start: float, count: int = 3000, half_width: float = 9e-4) -> RayBundle:
    across = np.random.default_rng(4).uniform(-half_width, half_width, (count, 2))
    return RayBundle(np.c_[across, np.full(count, start)], [0.0, 0.0, sign])


def part(rays: RayBundle, every: int) -> RayBundle:
    return RayBundle(rays.position[::every], rays.direction[::every])


def by_tables(field: IndexField, rays: RayBundle, **options):
    """Traced by "auto" as if the tables held the tolerance, whatever they are worth."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "projection_holds", lambda *_: True)
        return trace(field, rays, **options)


def traced(field: IndexField, rays: RayBundle, until):
    """The same rays, traced to rounding."""
    return trace(field, rays, until=until, method="adaptive", tolerance=1e-7, precision="float64")


@pytest.mark.parametrize("shape", [(2, 2, 9), (9, 2, 5), (2, 2, 2)])
def test_a_volume_of_one_cell_across(shape):
    """It has no fourth difference, which is no reason to fail; right to 1e-4 wave."""
    field = IndexField.from_samples(
        noise(shape, 1e-4, seed=3), origin=(0.0, 0.0, 0.0), spacing=(CELL,) * 3, geometry="volume"
    )
    high = field.box[1]
    start = np.random.default_rng(4).uniform(0.0, high, (5000, 3)) * [1.0, 1.0, 0.0]
    rays, stop = RayBundle(start, [0.0, 0.0, 1.0]), Plane(high, (0.0, 0.0, 1.0))
    found = trace(field, rays, until=stop, backend="opencl", outputs=("opd",))
    assert np.abs(found.opd[::50] - traced(field, part(rays, 50), stop).opd).max() < 1e-4 * WAVE


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize(
    ("sign", "start", "until"),
    [
        (1.0, -1e-3, None),
        (-1.0, 4e-3, None),
        (1.0, 0.0, Plane((0, 0, 5e-3), (0, 0, 1))),
        (-1.0, 9e-4, Plane((0, 0, -2e-3), (0, 0, 1))),
        (1.0, 3.3e-4, Plane((0, 0, 17.7e-4), (0, 0, -1))),
        (-1.0, 4e-3, Plane((0, 0, 28e-4 - 1e-5), (0, 0, 1))),
    ],
    ids=["out", "back-out", "beyond", "back-from-inside", "inside", "a-tenth-of-a-cell"],
)
def test_columns_are_as_good_as_traced_rays(engine, precision, sign, start, until):
    """Bends of 3e-4 over some 0.3 mm: second order is 1e-3 of the path, and the missing fourth order far below 1e-6.

    Tolerance: 1e-5 wave and 1e-9 rad in float64 (the second order is splined from columns, 1e-3 of it), a float32
    rounding of the optical path more in float32.
    """
    field, rays = volume(), bundle(sign, start)
    result = by_tables(field, rays, until=until, precision=precision, **on(engine))
    assert result.plan.method == "projection-tables" and "collimated along z" in str(result.plan)
    expected = traced(field, part(rays, 100), until)
    assert result.ok.all() and expected.ok.all()
    loose = 10.0 if precision == "float32" else 1.0
    assert np.abs(result.opd[::100] - expected.opd).max() < 1e-5 * loose * WAVE
    assert np.abs(result.direction[::100] - expected.direction).max() < 1e-8 * loose
    assert np.abs(result.position[::100] - expected.position).max() < 1e-11 * loose
    assert np.abs(result.optical_path[::100] - expected.optical_path).max() < 1e-5 * loose * WAVE
    assert np.abs(result.arc_length[::100] - expected.arc_length).max() < 1e-5 * loose * WAVE
    assert np.abs(np.linalg.norm(result.direction, axis=1) - 1.0).max() < 1e-6


def test_the_first_order_is_exact():
    """A is the integral of the spline itself: against 3 Gauss points a cell, exact for its cubics, to rounding."""
    field = volume()
    tables = projection_tables(field, 1.0, 0.0, 28e-4)
    grid = field.samples
    node, weight = np.polynomial.legendre.leggauss(3)
    z = np.concatenate([(cell + 0.5 + 0.5 * node) * CELL for cell in range(28)])
    column = [3, 7]  # by its node, where the spline over x and y has the weights 1/6, 4/6, 1/6
    points = np.c_[np.tile(grid.origin[:2] + CELL * np.array(column), (len(z), 1)), z]
    expected = np.tile(weight, 28) @ grid.evaluate_potential(points)[0] * 0.5 * CELL / field.ambient_index
    sixths = np.outer([1, 4, 1], [1, 4, 1]) / 36.0
    found = np.sum(sixths * tables.path[column[0] : column[0] + 3, column[1] : column[1] + 3])
    assert found == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("amplitude", [2e-3, 1e-3])
def test_the_third_order_is_in(amplitude):
    """The estimated error is the third order's size, which is in: what is left is less than a tenth of it.

    Nodes are four times finer than the field needs, so that the splines of the second order do not show.
    """
    fine = noise((97, 89, 57), amplitude, seed=8, width=12.0)
    field = IndexField.from_samples(
        fine, origin=LOW, spacing=(CELL / 4, CELL / 4, CELL / 2), geometry="volume", ambient_index=1.3
    )
    tables = projection_tables(field, 1.0, 0.0, 28e-4)
    rays = bundle(1.0, 0.0, count=int(0.2 * fine.size), half_width=6e-4)
    result = by_tables(field, rays, precision="float64")
    assert result.plan.columns
    expected = traced(field, part(rays, 2000), None)
    assert np.abs(result.opd[::2000] - expected.opd).max() < 0.1 * tables.greatest_error


def test_rays_near_a_side_and_past_the_box_are_traced():
    """They are put together with the others, each as it is alone."""
    field = volume()
    rays = bundle(1.0, -1e-3, half_width=14e-4)
    result = by_tables(field, rays)
    alone = trace(field, part(rays, 10), method="adaptive")
    assert result.plan.columns
    assert np.array_equal(result.status[::10], alone.status) and (alone.status == RayStatus.MISSED_FIELD).any()
    assert np.abs(result.opd[::10] - alone.opd).max() < 1e-3 * WAVE


@pytest.mark.parametrize(
    "change",
    ["few rays", "slanted", "two planes", "linear", "strong", "arc length", "slanted plane", "method", "planar"],
)
def test_other_rays_are_traced(change):
    field, rays, until, method = volume(), bundle(1.0, -1e-3), None, "auto"
    if change == "few rays":
        rays = bundle(1.0, -1e-3, count=100)
    elif change == "slanted":
        rays = RayBundle(rays.position, [0.0, 1e-9, 1.0])
    elif change == "two planes":
        rays = RayBundle(rays.position + [[0.0, 0.0, 2e-3 * (k % 2)] for k in range(3000)], [0.0, 0.0, 1.0])
    elif change == "linear":
        field = volume(interpolation="linear")
    elif change == "strong":
        field = volume(0.05)
    elif change == "arc length":
        until = ArcLength(3e-3)
    elif change == "slanted plane":
        until = Plane((0, 0, 4e-3), (0, 1e-3, 1))
    elif change == "method":
        method = "adaptive"
    elif change == "planar":
        field = uniform_field("planar")
    result = trace(field, rays, until=until, method=method)
    assert not result.plan.columns


def test_auto_takes_them_where_the_error_allows():
    field, rays = volume(), bundle(1.0, -1e-3)
    assert trace(field, rays).plan.columns
    for some, tolerance, taken in ((field, 1e-3, True), (field, 1e-12, False), (volume(3e-3), 1e-6, False)):
        reason = planning.why_projection(some, rays, None, "auto", tolerance, WAVE)
        assert (reason is not None) is taken


def test_the_budget_covers_the_error_made():
    field, rays = volume(1e-3), bundle(1.0, -1e-3)
    result = trace(field, rays)
    assert result.plan.columns
    expected = traced(field, part(rays, 100), None)
    made = np.abs(result.opd[::100] - expected.opd).max()
    assert made <= result.error["step"] + result.error["precision"]


def test_a_body_is_never_jumped_over():
    profile = np.array([[0.0, 5e-4], [5e-4, 1e-3], [0.0, 15e-4]])
    assert SUBCELLS >= 1
    field = IndexField.from_samples(
        noise((25, 29), 3e-4), origin=(0.0, 0.0), spacing=(CELL, CELL), geometry="axisymmetric", body=Body(profile)
    )
    assert not trace(field, bundle(1.0, -1e-3)).plan.columns
