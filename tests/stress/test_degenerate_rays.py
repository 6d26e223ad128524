"""Rays on places of measure zero: faces, nodes, edges, corners, and directions exactly along an axis."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, RayStatus, trace

from .checks import (
    PRECISIONS,
    UNIT,
    UP,
    WAVE,
    keeps_promises,
    linear_square_field,
    slab,
)

FAR = Plane((0.0, 0.0, 10e-3), UP)
# The ends of a ray are float64 positions: a few roundings of the path are in every OPD.
FLOOR = 4.0 * 2.0**-53
# What a ray in a face does hangs on rounding, and each engine rounds in its own way.
pytestmark = pytest.mark.usefixtures("both_backends")


@pytest.mark.parametrize("precision", PRECISIONS)
def test_outside_the_box(precision):
    """Pointing at it, away from it, past a corner: at, a hair inside and a hair outside of it.

    Set-up: the slab; lines along (1, -1, 0) past the edge x = y = 2 mm, at a depth e below it: chord 2 e (a ray at
    depth e / sqrt 2 each way). Expected: OPD contrast x chord, continuous through 0; MISSED_FIELD outside, without an
    OPD. A hair outside or on the edge may be either, but its OPD is nil. Tolerance: places in the field are fractions
    of cells, so a chord is known to 1e-5 of a cell in float32, to 1e-12 and a few roundings of 5 mm in float64.
    """
    contrast = 1e-3
    field = slab(contrast)
    middle = np.array([2e-3, 2e-3, 2e-3])
    depth = np.array([1e-3, 1e-5, 1e-8, 1e-11, 1e-14, 0.0, -1e-14, -1e-11, -1e-6])
    heading = np.array([1.0, -1.0, 0.0]) / np.sqrt(2.0)
    inward = np.array([-1.0, -1.0, 0.0]) / np.sqrt(2.0)
    start = middle + depth[:, None] * inward - 5e-3 * heading
    for until in (None, Plane(middle + 7e-3 * heading, heading)):
        result = trace(field, RayBundle(start, [heading]), until=until, method="adaptive", precision=precision)
        keeps_promises(result, len(depth))
        allowed = contrast * 1e-3 * (1e-5 if precision == "float32" else 1e-12) + FLOOR * 1e-2
        assert np.abs(result.opd - contrast * 2.0 * np.maximum(depth, 0.0)).max() < allowed
        assert result.ok[:4].all()
        expected = RayStatus.MISSED_FIELD if until is None else RayStatus.OK
        assert (result.traced_status[-2:] == expected).all()
    turned = np.tile(-heading - 0.1 * inward, (len(depth), 1))
    turned[0] = heading  # of rays none of which meets the box there is no trace
    away = trace(field, RayBundle(start, turned), method="adaptive", precision=precision)
    assert (keeps_promises(away, len(depth)).status[1:] == RayStatus.MISSED_FIELD).all()
    assert (away.opd[1:] == 0.0).all() and np.array_equal(away.position[1:], start[1:])
    with pytest.raises(ValueError, match="no ray of the bundle meets the field"):
        trace(field, RayBundle(start[1:], turned[1:]), method="adaptive", precision=precision)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("gradient", [0.9, 0.09, 9e-4])
def test_total_reflection_at_grazing_incidence(gradient, precision):
    """A ray enters n^2 = 1 - g y at y = 0 with slope t = 1e-1 to 1e-12, turns at y = t^2 / g and comes out again.

    Formula: sigma = 4 t / g inside, out at z = 4 t cos / g with the slope turned over; path int n^2 = 4 t / g -
    8 t^3 / (3 g), and from there free flight to the plane z = 1: OPD = -8 t^3 / (3 g). Errors: none of the scheme, a
    parabola is exact; rounding, 128 units; where the ray is taken to leave. A slope that is off by e costs e^2 / 2
    over the 1 m: with 1e-3 wave asked for e may be 4e-5.
    """
    slope = np.array([1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 1e-4, 1e-6, 1e-8, 1e-12])
    along = np.sqrt(1.0 - slope**2)
    leaves = 4.0 * slope * along / gradient
    chosen = (slope**2 < gradient) & (leaves < 1.0)
    assert chosen.sum() >= 4
    rays = RayBundle(np.zeros((9, 3)), np.c_[0.0 * slope, slope, along])
    field = linear_square_field(-gradient)
    result = trace(field, rays, until=Plane((0, 0, 1.0), UP), method="adaptive", precision=precision)
    assert keeps_promises(result, 9).ok.all()
    slope, along, leaves = slope[chosen], along[chosen], leaves[chosen]
    assert np.abs(result.direction[chosen, 1] + slope).max() < 4e-5
    assert np.abs(result.position[chosen, 1] + (1.0 - leaves) * slope / along).max() < 4e-5
    opd = -8.0 * slope**3 / (3.0 * gradient)
    assert (np.abs(result.opd[chosen] - opd) < 1e-3 * WAVE - 128.0 * UNIT[precision] * opd).all()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("lift", [-1e-2, -3e-3, -1e-3, -1e-9, 0.0, 1e-9, 1e-3])
def test_a_ray_that_turns_at_its_stop(lift, precision):
    """A ray turns at y = 1/2 in n^2 = 2 - y, a plane at y = 1/2 + lift: crossed, touched or missed.

    Set-up: start (0, 0, 0.1), n = sqrt 2, slope with T_y^2 = 1/2. Expected: below the apex the ray ends on it, OK;
    above, it comes back, leaves the box and flies on away from it: STOP_NOT_REACHED. At 1e-9 or exactly at it, either.
    """
    y = np.arange(17) / 16.0
    field = IndexField.from_samples(
        np.repeat(np.sqrt(2.0 - y)[:, None] - 1.5, 65, axis=1),
        origin=(0.0, 0.0), spacing=(1 / 16, 1 / 16), geometry="planar", ambient_index=1.5,
    )  # fmt: skip
    across = 0.5
    rays = RayBundle([[0.0, 0.0, 0.1]], [[0.0, np.sqrt(across), np.sqrt(2.0 - across)]])
    stop = Plane((0.0, across + lift, 0.0), (0.0, 1.0, 0.0))
    result = keeps_promises(trace(field, rays, until=stop, method="adaptive", precision=precision), 1)
    if abs(lift) > 1e-6:
        assert result.traced_status[0] == (RayStatus.OK if lift < 0.0 else RayStatus.STOP_NOT_REACHED)
    # Touched at an angle of nil, no estimate holds the tolerance.
    reported = (RayStatus.TOLERANCE_NOT_MET,) if abs(lift) < 1e-6 else ()
    assert result.traced_status[0] in (RayStatus.OK, RayStatus.STOP_NOT_REACHED, *reported)
    assert np.isfinite(result.position).all() and np.isfinite(result.opd).all()
    if result.ok[0]:
        assert result.position[0, 1] == pytest.approx(across + lift, abs=1e-12)
        # T_y = sqrt(-lift) at the crossing: z from sigma = 2 (T_y0 - T_y).
        sigma = 2.0 * (np.sqrt(across) - np.sqrt(max(-lift, 0.0)))
        assert result.position[0, 2] == pytest.approx(0.1 + np.sqrt(2.0 - across) * sigma, abs=2e-3)
