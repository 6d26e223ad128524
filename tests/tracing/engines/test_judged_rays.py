"""Kernels judge each ray by its own error, before any is traced again."""

import numpy as np
import pytest

from aerokernels.tracing import Plane, RayStatus
from aerokernels.tracing.launch import launch
from aerokernels.tracing.planning import plan_bundle
from tests.random_fields import uniform_field
from tests.small_fields import oblique_rays

from ..backends import ENGINES, WAVE, on

UNTIL = Plane((0.0, 0.0, 10e-3), (0.0, 0.2, 1.0))


def judged(engine: str, precision: str, tolerance: float, max_steps: int | None = None):
    """Status and error of 64 rays as the kernel leaves them."""
    field, rays = uniform_field("volume"), oblique_rays(64)
    choices = {"backend": None, "device": None} | on(engine)
    plan = plan_bundle(
        field,
        rays,
        UNTIL,
        method="adaptive",
        step=None,
        wavelength=WAVE,
        precision=precision,
        tolerance=tolerance,
        max_steps=max_steps,
        path_length=None,
        **choices,
    )
    found = launch(field, rays, plan, UNTIL, WAVE, frozenset({"opd", "step_error"}))
    return np.asarray(found["status"]), np.asarray(found["step_error"])


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_ray_above_the_tolerance_says_so(precision: str, engine: str):
    """TOLERANCE_NOT_MET exactly where the ray's own estimate is above the tolerance; OK elsewhere."""
    seen = set()
    for tolerance in (1e-3, 1e-5, 1e-6, 1e-7):
        status, error = judged(engine, precision, tolerance)
        late = ~(error <= tolerance * WAVE)
        assert (status[late] == RayStatus.TOLERANCE_NOT_MET).all() and (status[~late] == RayStatus.OK).all()
        seen |= set(late.tolist())
    assert seen == {False, True}


@pytest.mark.parametrize("engine", ENGINES)
def test_a_ray_that_float32_keeps_from_ending_is_left_to_float64(engine: str):
    """Three steps are not enough: float32 leaves the ray to another attempt, with no bound on its error."""
    status, error = judged(engine, "float32", 1e-4, max_steps=3)
    assert (status == RayStatus.TOLERANCE_NOT_MET).all() and np.isinf(error).all()
    status, _ = judged(engine, "float64", 1e-4, max_steps=3)
    assert (status == RayStatus.MAX_STEPS).all()
