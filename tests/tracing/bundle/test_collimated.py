"""Collimated rays along z through a volume, a few thousand and as many as are interpolated, against error control."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, RayStatus, trace
from tests.random_fields import noise

from ..backends import ENGINES, WAVE, on

CELL = 1e-4
COUNTS = (6000, 12000)  # by leapfrog, and between lines that are traced
X, Z = np.arange(-12, 13) * CELL, np.arange(41) * CELL
FAR = Plane((0.0, 0.0, 5e-3), (0.0, 0.0, 1.0))
ENVELOPE = np.exp(-(X[:, None, None] ** 2 + X[:, None] ** 2) / 0.7e-3**2 - ((Z - 2e-3) / 0.8e-3) ** 2)
ALTERNATING = np.where(np.arange(len(X)) % 2 == 0, 1.0, -1.0)[:, None, None] * np.ones((1, len(X), len(Z)))
SLIP = np.broadcast_to(1.0 + np.tanh((X[:, None, None] - 0.03e-3) / (0.3 * CELL)), ALTERNATING.shape)
# Contrasts whose bending is nil at every node and greatest between them, and a layer of a third of a cell along z.
ROUGH = {
    "alternating": 1e-4 * ALTERNATING * ENVELOPE,
    "alternating across": 1e-4 * np.swapaxes(ALTERNATING, 0, 1) * ENVELOPE,
    "chequered": 3e-5 * ALTERNATING * np.swapaxes(ALTERNATING, 0, 1) * ENVELOPE,
    "slip line": 1e-5 * SLIP,
}


def volume(contrast: np.ndarray, **changes) -> IndexField:
    options = {"origin": (X[0], X[0], 0.0), "spacing": (CELL,) * 3, "geometry": "volume", **changes}
    return IndexField.from_samples(contrast, **options)


def smooth() -> IndexField:
    """A random field of 25 x 23 x 29 nodes, not zero on any face."""
    return volume(noise((25, 23, 29), 3e-4, seed=8), origin=(-12e-4, -11e-4, 0.0), ambient_index=1.0003)


def bundle(count: int, sign: float = 1.0, start: float = -1e-3, half_width: float = 9e-4) -> RayBundle:
    across = np.random.default_rng(1).uniform(-half_width, half_width, (count, 2))
    return RayBundle(np.c_[across, np.full(count, start)], (0.0, 0.0, sign))


def exact(field: IndexField, rays: RayBundle, until):
    return trace(field, rays, until=until, method="adaptive", precision="float64", tolerance=1e-6)


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("shape", [(2, 2, 9), (9, 2, 5), (2, 2, 2)])
def test_a_volume_of_one_cell_across(shape, count):
    """It has no fourth difference, which is no reason to fail; within the tolerance of 1e-3 wave."""
    field = volume(noise(shape, 1e-4, seed=3), origin=(0.0, 0.0, 0.0))
    high = field.box[1]
    start = np.random.default_rng(4).uniform(0.0, high, (count, 3)) * [1.0, 1.0, 0.0]
    rays, stop = RayBundle(start, [0.0, 0.0, 1.0]), Plane(high, (0.0, 0.0, 1.0))
    found, every = trace(field, rays, until=stop, backend="opencl", outputs=("opd",)), np.arange(0, count, 50)
    truth = exact(field, rays[every], stop)
    assert (found.status[every] == truth.status).all()
    assert np.nanmax(np.abs(found.opd[every] - truth.opd)[truth.ok]) < 1e-3 * WAVE


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize(
    ("sign", "start", "until"),
    [
        (1.0, -1e-3, None),
        (-1.0, 4e-3, None),
        (1.0, 0.0, Plane((0, 0, 5e-3), (0, 0, 1))),
        (-1.0, 9e-4, Plane((0, 0, -2e-3), (0, 0, 1))),
        (1.0, 3.3e-4, Plane((0, 0, 17.7e-4), (0, 0, -1))),
    ],
    ids=["out", "back-out", "beyond", "back-from-inside", "inside"],
)
def test_starts_and_stops_inside_and_outside_of_the_box(engine, count, sign, start, until):
    """OPD and optical path within 1e-3 wave, directions within that over a cell, places within that over 5 mm."""
    field, rays = smooth(), bundle(count, sign, start)
    result, every = trace(field, rays, until=until, **on(engine)), np.arange(0, count, 100)
    truth = exact(field, rays[every], until)
    assert result.ok.all() and truth.ok.all()
    turn = 1e-3 * WAVE / CELL
    assert np.abs(result.opd[every] - truth.opd).max() < 1e-3 * WAVE
    assert np.abs(result.optical_path[every] - truth.optical_path).max() < 1e-3 * WAVE
    assert np.abs(result.direction[every] - truth.direction).max() < turn
    assert np.abs(result.position[every] - truth.position).max() < 5e-3 * turn
    assert np.abs(np.linalg.norm(result.direction, axis=1) - 1.0).max() < 1e-6


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("name", ROUGH)
def test_bending_between_nodes_is_not_passed_over(engine, name, count):
    """1e-3 wave asked for, and directions to that over a cell, 9 urad."""
    field, rays, every = volume(ROUGH[name]), bundle(count), np.arange(0, count, 29)
    result = trace(field, rays, until=FAR, **on(engine))
    truth = exact(field, rays[every], FAR)
    assert result.ok.all()
    assert np.abs(result.opd[every] - truth.opd).max() < 1e-3 * WAVE
    assert np.abs(result.direction[every] - truth.direction).max() < 1e-3 * WAVE / CELL


@pytest.mark.parametrize("count", COUNTS)
def test_rays_near_a_side_and_past_the_box(count):
    """Each is as it is alone."""
    field, rays, every = smooth(), bundle(count, half_width=14e-4), np.arange(0, count, 10)
    result, alone = trace(field, rays), trace(field, rays[every], method="adaptive")
    assert np.array_equal(result.status[every], alone.status) and (alone.status == RayStatus.MISSED_FIELD).any()
    assert np.nanmax(np.abs(result.opd[every] - alone.opd)) < 2e-3 * WAVE
