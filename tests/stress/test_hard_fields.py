"""Fields that are hard to trace: shocks of no width, foci, a hundred thousand cells, single cells, bad samples."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace

from .checks import CELL, PRECISIONS, UP, assert_same_bits, keeps_promises

pytestmark = pytest.mark.slow

FAR = Plane((0.0, 0.0, 10e-3), UP)
GEOMETRIES = ("volume", "planar", "axisymmetric")
INTERPOLATIONS = ("cubic", "linear", "monotone")


@pytest.mark.filterwarnings("ignore:overflow encountered")
@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("size", [1.0, 1e3, 1e5, 1e10, 1e20, 1e38, 1e160, 1e300])
def test_contrasts_of_any_strength(size, precision):
    """White noise of 1 to 1e300 in a box of 0.8 mm: a ray arrives with numbers that can be, or has a failing status.

    An index of at least half the greatest sample: the spline stays positive, and a path no shorter than the way to the
    plane, 11 mm, so that less is a wrong answer under a good status. At 1 no ray runs out of steps or numbers, though
    some are turned back. Those that never meet the box keep the bits that they have alone.
    """
    samples = size * np.random.default_rng(0).uniform(0.5, 1.0, (9, 9))
    field = IndexField.from_samples(samples, origin=(-4e-4, 0.0), spacing=(CELL, CELL), geometry="planar")
    height = np.linspace(-8e-4, 8e-4, 33)
    start, heading = np.c_[0.0 * height, height, np.full(33, -1e-3)], np.tile([0.0, 0.02, 1.0], (33, 1))
    settings_ = {"until": FAR, "method": "adaptive", "precision": precision, "max_steps": 2000}
    result = keeps_promises(trace(field, RayBundle(start, heading), **settings_), 33)
    beside = np.abs(height) > 5e-4
    assert result.ok[beside].all() and (result.opd[beside] == 0.0).all()
    assert set(result.status_summary()) <= {"OK", "LEFT_DISTURBED_AIR", "STOP_NOT_REACHED"} or size > 1.0
    assert (result.arc_length[result.ok] > 11e-3).all() and (result.optical_path[result.ok] > 11e-3).all()
    some = beside | (np.arange(33) == 16)  # rays none of which meets the box are refused: one that does comes along
    assert_same_bits(result, trace(field, RayBundle(start[some], heading[some]), **settings_), some)
