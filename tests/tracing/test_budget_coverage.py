"""Does the reported budget cover the error made? Random fields whose true optical paths are known from the formula.

Set-up: 200 fields of aerokernels/validation/field_draws.py, a third of each kind, half of them volumes. Every other
cubic one is met by as many rays as take the way of a million, by leapfrog samples; the others by a few, which go one by
one, as all do on other grids.

Truth: the exact ray of the formula by DOP853 at 1e-10.

Must hold on each engine: at least 95 % of the fields are covered by the reported total, and the median of reported over
true is at most 30. A field counts as covered where the greatest error over its rays is below the budget's total.
"""

import functools

import numpy as np
import pytest

from aerokernels.tracing import Plane, trace
from aerokernels.tracing.leapfrog import LEAST_RAYS
from aerokernels.validation.field_draws import KINDS, draw

from .backends import ENGINES, on

FIELD_COUNT = 200
COMPARED = 24  # rays of a bundle whose truth is known


@functools.cache
def drawn(number: int):
    """A field, its rays, and the true OPD of the first COMPARED of them [m]; once for all engines."""
    case = draw(KINDS[number % 3], bool(number // 3 % 2), number)
    rays = case.rays(LEAST_RAYS if case.field.interpolation == "cubic" and number % 2 else COMPARED, number)
    return case, rays, case.exact_opd(rays[:COMPARED])


@pytest.mark.parametrize("engine", ENGINES)
def test_two_hundred_random_fields(engine):
    backend = on(engine)
    reported, true, methods = [], [], set()
    for number in range(FIELD_COUNT):
        case, rays, exact = drawn(number)
        result = trace(case.field, rays, until=Plane((0.0, 0.0, case.length), (0.0, 0.0, 1.0)), **backend)
        assert result.ok.all()
        methods.add(result.plan.method)
        reported.append(result.error["total"])
        true.append(np.abs(result.opd[:COMPARED] - exact).max())
    assert {"leapfrog", "adaptive"} <= methods
    assert np.mean(np.array(reported) >= true) >= 0.95
    assert np.median(np.array(reported) / true) <= 30.0
