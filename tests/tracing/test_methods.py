"""A method is one thing at every ray count, and the plan's method names what ran."""

import numpy as np
import pytest

from aerokernels.focus.estimate import estimate_strehl
from aerokernels.rays import Disc, RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.leapfrog.pilot import LEAST_RAYS
from tests.random_fields import uniform_field
from tests.slow import first_of

from .backends import ENGINES, on

WAVE = 905e-9
FAR = Plane((0.0, 0.0, 5e-3), (0.0, 0.0, 1.0))


def bundle(count: int, slope: float = 0.0) -> RayBundle:
    """Rays from before the box through its middle, all of one direction."""
    across = np.random.default_rng(11).uniform(-0.9e-3, 0.9e-3, (count, 2))
    return RayBundle(np.c_[across, np.full(count, -1e-3)], [0.0, slope, 1.0])


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("geometry", "slope"), first_of([("planar", 0.0), ("volume", 0.03), ("axisymmetric", 0.03)]))
def test_straight_is_the_same_at_every_ray_count(engine, geometry, slope):
    """A contrast of 3e-2 over 4 mm bends rays by some 0.1 rad: full rays differ from straight ones by far more.

    The same rays alone and among 6000 others (more than leapfrog asks for) are the same to the last bit, on
    each engine; and differ from full rays by more than 10 times the tolerance of 1e-3 wave.
    """
    field, rays = uniform_field(geometry, amplitude=3e-2), bundle(max(6000, LEAST_RAYS), slope)
    until = None if geometry == "axisymmetric" else FAR  # other tests take these kernels, too
    options = {"until": until, "precision": "float64", **on(engine)}
    few = rays[np.arange(0, len(rays), 300)]
    many, alone = trace(field, rays, method="straight", **options), trace(field, few, method="straight", **options)
    assert many.plan.method == alone.plan.method == "straight"
    assert not many.plan.sample_count
    assert np.array_equal(many.opd[::300], alone.opd) and np.array_equal(many.direction[::300], alone.direction)
    full = trace(field, few, method="adaptive", **options)
    assert np.abs(full.opd - alone.opd).max() > 0.01 * WAVE


@pytest.mark.parametrize("engine", ENGINES)
def test_straight_of_a_pupil_is_straight_too(engine):
    field, pupil = uniform_field("volume", amplitude=1e-4), Disc(0.8e-3, (0.0, 0.0, -1e-3))
    options = {"method": "straight", "precision": "float64", "allow_truncation": True, **on(engine)}
    for count in (160, 16 * 1024):
        estimate = estimate_strehl(field, pupil, ray_count=count, **options)
        assert estimate.plan.method == "straight"


@pytest.mark.parametrize("engine", ENGINES)
def test_the_plan_names_what_ran(engine):
    """The name, the first word of the plan's text, the summary's entry, and a reason that begins with it."""
    field = uniform_field("volume", amplitude=1e-4)
    oblique, along = bundle(6000, 0.03), bundle(6000)
    for rays, method, options in (
        (oblique, "leapfrog", {}),
        (along, "leapfrog", {}),
        (oblique[np.arange(10)], "adaptive", {}),
        (oblique, "adaptive", {"method": "adaptive"}),
        (oblique, "fixed", {"method": "fixed", "step": 2e-4}),
        (oblique, "paper", {"method": "paper", "precision": "float64", "outputs": None}),
    ):
        plan = trace(field, rays, until=FAR, **{"outputs": "opd", **options}, **on(engine)).plan
        assert plan.method == method == plan.as_dict()["method"]
        assert str(plan).startswith(f"{method} on ")
        assert (plan.sample_count > 0) == (method == "leapfrog")
        assert plan.reasons[0].startswith(f"method {method}: ")
        assert sum(reason.startswith("method ") for reason in plan.reasons) == 1
