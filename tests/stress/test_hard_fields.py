"""Fields that are hard to trace: shocks of no width, foci, a hundred thousand cells, single cells, bad samples."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace

from .checks import CELL, PRECISIONS, UNIT, UP, WAVE, assert_same_bits, keeps_promises

pytestmark = pytest.mark.slow

FAR = Plane((0.0, 0.0, 10e-3), UP)
GEOMETRIES = ("volume", "planar", "axisymmetric")
INTERPOLATIONS = ("cubic", "linear", "monotone")


def shock(interpolation: str, slope: float, jump: float = 3e-4) -> IndexField:
    """A jump on a grid of 0.1 mm in y over +-2 mm, z over 4 mm, along z = 2 mm + slope y, between two nodes."""
    y, z = np.meshgrid((np.arange(41) - 20) * CELL, np.arange(41) * CELL, indexing="ij")
    samples = np.where(z - 2.03e-3 > slope * y, jump, 0.0)
    return IndexField.from_samples(
        samples, origin=(-2e-3, 0.0), spacing=(CELL, CELL), geometry="planar", interpolation=interpolation
    )


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("interpolation", INTERPOLATIONS)
def test_square_through_a_shock_of_no_width(interpolation, precision):
    """A jump J between the nodes 20 and 21, met at right angles at 50 places and from 50 starts.

    Formula: every interpolant is odd about the middle of that cell, so OPD = J (4 mm - 2.05 mm), the ray straight.
    Errors: the steps, 1e-3 wave asked for; J^2 terms, J^2 x 1 mm = 1e-4 wave. A jump of one wave is stepped over by
    none: tolerance 1.2e-3 wave.
    """
    jump = 1e-3
    rng = np.random.default_rng(4)
    rays = RayBundle(np.c_[np.zeros(50), rng.uniform(-1.9e-3, 1.9e-3, 50), rng.uniform(-3e-4, 0.0, 50)], [UP])
    result = trace(shock(interpolation, 0.0, jump), rays, until=FAR, method="adaptive", precision=precision)
    assert keeps_promises(result, 50).ok.all()
    assert np.abs(result.opd - jump * 1.95e-3).max() < 1.2e-3 * WAVE
    assert np.abs(result.direction - UP).max() < 64.0 * UNIT[precision] * jump / CELL * 4e-3


@pytest.mark.parametrize("precision", PRECISIONS)
def test_through_many_foci(precision):
    """Meridional rays in n^2 = n0^2 (1 - g^2 y^2) cross the axis together every half pitch: the OPD takes no notice.

    Formula: y = x0 cos(n0 g sigma), sigma = z / beta, beta = n0 sqrt(1 - g^2 x0^2); path n0^2 sigma - n0^2 g^2 x0^2
    (sigma / 2 + sin(2 n0 g sigma) / (4 n0 g)). Stops at, before and behind the foci at 1/4, 3/4 ... pitch. Errors: the
    potential is a parabola that the spline holds; 1e-3 wave asked for; float32: 64 units of the 0.3 mm OPD. No more
    than four steps a cell: a focus is no reason to slow down.
    """
    n0, g, cell = 1.5, 100.0, 0.25e-3
    y = np.arange(-8, 9) * cell
    field = IndexField.from_samples(
        np.repeat((n0 * np.sqrt(1.0 - (g * y) ** 2) - n0)[:, None], 601, axis=1),
        origin=(y[0], 0.0), spacing=(cell, cell), geometry="planar", ambient_index=n0,
    )  # fmt: skip
    x0 = np.array([1.6e-3, 0.8e-3, 0.2e-3, 1e-6, -0.2e-3, -0.8e-3, -1.6e-3])
    rays = RayBundle(np.c_[0.0 * x0, x0, 0.0 * x0], [UP])
    beta = n0 * np.sqrt(1.0 - (g * x0) ** 2)
    quarter = 0.5 * np.pi / g
    for z in (0.9 * quarter, quarter, 1.1 * quarter, 3.0 * quarter, 8.4 * quarter):
        result = trace(field, rays, until=Plane((0, 0, z), UP), method="adaptive", precision=precision)
        assert keeps_promises(result, 7).ok.all()
        sigma = z / beta
        square = x0**2 * (0.5 * sigma + np.sin(2.0 * n0 * g * sigma) / (4.0 * n0 * g))
        opd = n0**2 * sigma - (n0 * g) ** 2 * square - n0 * z
        assert np.abs(result.opd - opd).max() < 1e-3 * WAVE + 64.0 * UNIT[precision] * np.abs(opd).max() + 1e-15
        assert result.step_count.max() < 4.0 * z / cell + 20


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
