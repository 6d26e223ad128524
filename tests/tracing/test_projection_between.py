"""What bending adds to collimated rays between a grid's columns: bounded, looked at, refused where it is unknown."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, collimated, planning, trace
from aerokernels.tracing import projection_tables as projection
from aerokernels.tracing.collimated import find_projection, projection_holds

from .backends import ENGINES, WAVE, on

CELL = 1e-4
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
SMOOTH = 1e-4 * ENVELOPE


def volume(contrast: np.ndarray) -> IndexField:
    return IndexField.from_samples(contrast, origin=(X[0], X[0], 0.0), spacing=(CELL,) * 3, geometry="volume")


def bundle(count: int = 6000) -> RayBundle:
    across = np.random.default_rng(1).uniform(-0.9e-3, 0.9e-3, (count, 2))
    return RayBundle(np.c_[across, np.full(count, -1e-3)], (0.0, 0.0, 1.0))


def exact(field: IndexField, rays: RayBundle):
    return trace(field, rays, until=FAR, method="adaptive", precision="float64", tolerance=1e-6)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ROUGH)
def test_bending_between_nodes_is_not_passed_over(engine, name):
    """Against error control: 1e-3 wave asked for, and directions to that over a cell, 9 urad.

    By tables that look at the columns alone 0.02 to 0.1 wave and 300 urad.
    """
    field, rays = volume(ROUGH[name]), bundle()
    result = trace(field, rays, until=FAR, **on(engine))
    part = RayBundle(rays.position[::29], rays.direction[::29])
    truth = exact(field, part)
    assert result.ok.all()
    assert np.abs(result.opd[::29] - truth.opd).max() < 1e-3 * WAVE
    assert np.abs(result.direction[::29] - truth.direction).max() < 1e-3 * WAVE / CELL


@pytest.mark.parametrize("name", ROUGH)
def test_the_bound_and_what_is_found_between_columns_hold(name):
    """Tables that are taken all the same err in the middles of cells and edges by what was found there."""
    field, budget = volume(ROUGH[name]), 1e-3 * WAVE
    places = np.arange(-16, 17) * 0.5 * CELL
    x, y = (part.ravel() for part in np.meshgrid(places, places, indexing="ij"))
    places = np.repeat(np.c_[x, y, np.full(len(x), -1e-3)], 6, axis=0)
    rays = RayBundle(places, (0.0, 0.0, 1.0))
    columns = find_projection(field, rays, FAR)
    assert columns is not None and not projection_holds(field, columns, budget)
    found = projection.between_projections(field, 1.0, columns.first, columns.last)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(planning, "projection_holds", lambda *_: True)
        by_tables = trace(field, rays, until=FAR, precision="float64")
    assert by_tables.plan.columns
    part = RayBundle(rays.position[::6], rays.direction[::6])
    error = np.abs(by_tables.opd[::6] - exact(field, part).opd).max()
    assert 0.3 * found.path < error < 1.1 * found.path
    assert error < columns.tables.between_bound


def test_smooth_columns_are_taken_without_a_second_look(monkeypatch):
    """Seven cells wide: the bound is below 2 % of the tolerance, so that nothing is gathered between columns."""
    looked: list[IndexField] = []

    def between_projections(field, *rest):
        looked.append(field)
        return projection.between_projections(field, *rest)

    monkeypatch.setattr(collimated, "between_projections", between_projections)
    field, rays = volume(SMOOTH), bundle()
    result = trace(field, rays, until=FAR)
    columns = find_projection(field, rays, FAR)
    assert result.plan.columns and columns is not None
    assert columns.tables.between_bound < 2e-5 * WAVE
    assert not looked
    rough = volume(ROUGH[next(iter(ROUGH))])
    trace(rough, rays, until=FAR)
    assert looked == [rough]
