"""Planes within a box, in its faces, and beyond: near ones are asked about at every step, far ones at none."""

import functools

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.engines.field_data import NEAR_BOX, _comes_near
from tests.random_fields import CELL, uniform_field
from tests.slow import first_of

from .backends import ENGINES, OPD_LIMIT, on

CELLS_BEYOND = (-3.0, 0.0, NEAR_BOX - 0.01, NEAR_BOX + 0.01, 40.0)


@functools.cache
def cases(geometry: str):
    """Field, rays, and for each plane what the reference says: one answer for all engines."""
    field = uniform_field(geometry)
    rng = np.random.default_rng(5)
    start = np.c_[rng.uniform(-3e-4, 3e-4, (12, 2)), np.full(12, -1e-3)]
    rays = RayBundle(start, np.c_[rng.normal(0.0, 0.05, (12, 2)), np.ones(12)])
    end = float(field.box[1][2])
    planes = [
        Plane((0.0, 0.0, end + beyond * CELL), normal)
        for beyond in CELLS_BEYOND
        for normal in ((0.0, 0.0, 1.0), (0.2, 0.3, 1.0))
    ]
    return field, rays, [(plane, trace(field, rays, until=plane, backend="reference")) for plane in planes]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", first_of(["planar", "axisymmetric", "volume"]))
def test_rays_end_on_a_plane_wherever_it_lies(engine, geometry):
    """Straight on and askew, from within the last face to far behind it, against the reference."""
    backend = on(engine)
    field, rays, planes = cases(geometry)
    for plane, expected in planes:
        result = trace(field, rays, until=plane, method="adaptive", precision="float64", tolerance=1e-5, **backend)
        assert (result.traced_status == expected.traced_status).all()
        assert np.abs((result.position - plane.point) @ plane.normal)[result.ok].max() < 1e-12
        assert np.abs(result.opd - expected.opd)[expected.ok].max() < OPD_LIMIT["float64"], plane


@pytest.mark.parametrize(
    ("plane", "near"),
    [
        (Plane((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)), True),
        (Plane((0.0, 0.0, 3.1), (0.0, 0.0, -1.0)), True),
        (Plane((0.0, 0.0, 3.3), (0.0, 0.0, 1.0)), False),
        (Plane((0.0, 0.0, -0.3), (0.0, 0.0, 1.0)), False),
        (Plane((0.0, 9.0, 9.0), (0.0, 1.0, 1.0)), False),
        (Plane((0.0, 0.0, 5.0), (0.0, 1.0, 1.0)), True),
        (Plane((9.0, 0.0, 9.0), (1.0, 0.0, 0.0)), True),
    ],
)
def test_a_box_without_end_along_x_is_met_by_planes_across_it(plane: Plane, near: bool):
    """A box of 2 x 3 m, endless along x as those of planar fields are, and a margin of 0.2 m."""
    box = np.array([-np.inf, 0.0, 0.0]), np.array([np.inf, 2.0, 3.0])
    assert _comes_near(plane, box, 0.2) is near
