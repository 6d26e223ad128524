"""Rays on places of measure zero: faces, nodes, edges, corners, and directions exactly along an axis."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, RayStatus, trace

from .checks import (
    CELL,
    PRECISIONS,
    UNIT,
    UP,
    WAVE,
    assert_same_bits,
    keeps_promises,
    linear_square_field,
    random_field,
    slab,
)

FAR = Plane((0.0, 0.0, 10e-3), UP)
# The ends of a ray are float64 positions: a few roundings of the path are in every OPD.
FLOOR = 4.0 * 2.0**-53
# What a ray in a face does hangs on rounding, and each engine rounds in its own way.
pytestmark = pytest.mark.usefixtures("both_backends")


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("geometry", ["volume", "planar"])
def test_rays_along_cell_faces_and_through_nodes(geometry, precision):
    """Rays in the faces between cells, along their edges and through nodes only, against rays 1e-9 of a cell beside.

    Set-up: C2 spline, so a ray and its neighbours 1e-13 m away differ by a gradient times 1e-13 m: nothing. The grid's
    origin is no multiple of the cell, so the face is one only to rounding and the ray may take either side of it.
    Tolerance: the 1e-4 wave asked for, in either ray; of the direction what that is over the length, and a rounding.
    """
    field = random_field(geometry)
    low = field.box[0]
    x = 0.0 if geometry == "planar" else low[0] + 12 * CELL
    face = low[1] + np.arange(3, 26) * CELL
    start = np.c_[np.full(23, x), face, np.full(23, -CELL)]
    across = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, -1.0, 2.0], [1.0, 1.0, 1.0]])
    settings_ = {"until": FAR, "method": "adaptive", "tolerance": 1e-4, "precision": precision}
    for direction in across:
        on = keeps_promises(trace(field, RayBundle(start, [direction]), **settings_), 23)
        assert on.ok.all()
        for offset in (-1e-13, 1e-13):
            near = trace(field, RayBundle(start + np.array([offset, offset, 0.0]), [direction]), **settings_)
            assert np.abs(on.opd - near.opd).max() < 2e-4 * WAVE
            assert np.abs(on.direction - near.direction).max() < 1e-7


@pytest.mark.parametrize("precision", PRECISIONS)
def test_a_ray_along_a_kink_is_as_one_beside_it(precision):
    """Along a node line of a linear field the force jumps; either side may be taken, and the OPD hardly notices.

    The force on the two sides differs by D = 1e-4 / cell at most in this noise; the OPD is of second order in it,
    D^2 L^3 / 24 = 3e-9 m x 1e-3 at most: below the tolerance of 1e-3 wave, which each ray may be off by besides.
    """
    field = random_field("planar", "linear")
    y = field.box[0][1] + np.arange(3, 26) * CELL
    start = np.c_[0.0 * y, y, np.full(23, -CELL)]
    settings_ = {"until": FAR, "method": "adaptive", "precision": precision}
    on, left, right = (
        trace(field, RayBundle(start + np.array([0.0, beside, 0.0]), [UP]), **settings_)
        for beside in (0.0, -1e-9, 1e-9)
    )
    assert keeps_promises(on, 23).ok.all()
    low, high = np.minimum(left.opd, right.opd), np.maximum(left.opd, right.opd)
    assert (on.opd > low - 3e-3 * WAVE).all() and (on.opd < high + 3e-3 * WAVE).all()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("geometry", ["volume", "axisymmetric", "planar"])
def test_a_negative_zero_is_a_zero(geometry, precision):
    """Exactly along each axis, both ways, with +0.0 and -0.0 beside it: the same bits."""
    field = random_field(geometry)
    start = np.array([1.3e-4, 2.7e-4, 1.1e-3])
    for axis, sign in [(2, 1.0), (2, -1.0), (1, 1.0), (1, -1.0), (0, 1.0), (0, -1.0)]:
        plus = np.zeros((1, 3))
        plus[0, axis] = sign
        minus = np.where(plus == 0.0, -0.0, plus)
        until = Plane(start + 8e-3 * plus[0], plus[0])
        first, second = (
            trace(field, RayBundle([start], d), until=until, method="adaptive", precision=precision)
            for d in (plus, minus)
        )
        assert keeps_promises(first, 1).ok.all() and first.evaluation_count[0] > 1
        assert_same_bits(first, second)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize(
    "start", [(-2.0, 0.0, 1.0), (-2.0, -2.0, 1.0), (-2.0, -2.0, 0.0)], ids=["face", "edge", "corner"]
)
def test_starts_on_the_box(start, precision):
    """From a face, an edge, a corner of a constant slab of 4 mm: inward as if from outside, outward at once, along it.

    OPD: contrast x chord inward, 0 outward; a ray that stays in a face or an edge (the box is closed, the force is nil
    but for rounding) has contrast x length. Tolerance: 64 units relative, and the roundings of the ends.
    """
    contrast = 1e-3
    field = slab(contrast)
    point = 1e-3 * np.array(start)
    inward = np.array([1.0, 0.7, 0.4])
    settings_ = {"method": "adaptive", "precision": precision}
    # The chord: the first of the far faces met.
    chord = np.min((np.array([2e-3, 2e-3, 4e-3]) - point) / inward) * np.linalg.norm(inward)
    both = trace(field, RayBundle([point, point - 0.3 * chord * inward], [inward]), **settings_)
    assert keeps_promises(both, 2).ok.all()
    allowed = 64.0 * UNIT[precision] * contrast + FLOOR
    assert np.abs(both.opd - contrast * chord).max() < allowed * chord
    assert both.arc_length[0] == pytest.approx(chord, rel=1e-6)
    outward = trace(field, RayBundle([point], [-inward]), **settings_)
    assert keeps_promises(outward, 1).ok[0]
    assert outward.opd[0] == 0.0 and outward.arc_length[0] == 0.0
    assert outward.position[0] == pytest.approx(point, abs=1e-18)
    for until in (None, Plane((0.0, 0.0, 5e-3), UP)):
        along = trace(field, RayBundle([point], [UP]), until=until, **settings_)
        assert keeps_promises(along, 1).ok[0]
        assert abs(along.opd[0] - contrast * (4e-3 - point[2])) < allowed * 5e-3


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
@pytest.mark.parametrize("distance", [1.0, 1e3, 1e6, 1e9, 1e15, 1e100])
def test_a_start_very_far_away(distance, precision):
    """A ray from 1 m to 1e100 m ahead of a 4 mm box, aimed at its middle along z.

    Along an axis the place across is exact, so the OPD is contrast x 4 mm as far as float64 can tell entry from exit:
    one unit of the distance, and to the last, when it cannot, nothing but a finite number and a status.
    """
    contrast = 1e-3
    result = trace(slab(contrast), RayBundle([[1e-4, 2e-4, -distance]], [UP]), method="adaptive", precision=precision)
    keeps_promises(result, 1)
    if distance <= 1e9:
        off = FLOOR * distance + 64.0 * UNIT[precision] * contrast * 4e-3
        assert result.ok[0]
        assert abs(result.opd[0] - contrast * 4e-3) < off


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("slope", [0.0, 1e-300, 1e-12, 1e-6])
def test_nearly_along_x_in_a_planar_field(slope, precision):
    """A planar field has no end in x: a ray (1, slope, 0) meets its undisturbed end 1.2 mm / slope away, or never.

    The field bends it out of the box within a quarter of a metre. Exactly along x it says STOP_NOT_REACHED, at 1e-300,
    with no number for the undisturbed length, any failure; else it arrives, where the precisions agree: after 55 box
    lengths in noise of 3e-4 to 1e-3 of a path of 0.2 m.
    """
    field = random_field("planar")
    settings_ = {"method": "adaptive", "precision": precision}
    result = trace(field, RayBundle([[0.0, 2e-4, 1e-3]], [[1.0, slope, 0.0]]), **settings_)
    keeps_promises(result, 1)
    if slope == 0.0:
        assert result.status[0] == RayStatus.STOP_NOT_REACHED
    elif slope >= 1e-12:
        assert result.ok[0]
        assert result.arc_length[0] == pytest.approx(0.21864, rel=1e-3)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("gradient", [2.0, 0.2, 2e-3, 2e-6, -0.2])
def test_a_start_on_a_face_that_the_field_pulls_out_of(gradient, precision):
    """Along the top face of n^2 = a^2 + g y, the force pointing out of the box, or (g < 0) into it.

    Expected: the ray leaves at once, keeps its direction and gains nothing, or, pulled inward, follows the parabola.
    A face that is touched only says nothing about which side counts: a tenth of a cell's path may be either. What may
    not be is a failure, or a turn by more than that path gives; signs may be those of rounding.
    """
    ambient = 1.0 if gradient > 0.0 else 2.0
    field = linear_square_field(gradient, ambient=ambient)
    square = ambient**2 + gradient
    rays = RayBundle([[0.0, 1.0, 0.25]], [UP])
    result = trace(field, rays, until=Plane((0, 0, 1.0), UP), method="adaptive", precision=precision)
    assert keeps_promises(result, 1).ok[0]
    if gradient > 0.0:
        blurred = 0.1 / 16.0
        assert -16.0 * UNIT["float64"] <= result.opd[0] < blurred * (np.sqrt(square) - 1.0)
        assert -UNIT["float64"] <= result.direction[0, 1] < blurred * 0.5 * gradient
    else:
        sigma = 0.75 / np.sqrt(square)
        assert result.position[0, 1] == pytest.approx(1.0 + 0.25 * gradient * sigma**2, abs=32.0 * UNIT[precision])


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


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("lift", [1e-2, 3e-3, 1e-3, 3e-4])
@pytest.mark.parametrize("from_height", [0.75, 0.8, 0.9])
def test_a_ray_that_would_come_back_within_a_step(from_height, lift, precision):
    """A parabola that peaks a sixth to 1/200 of a cell above the box: where it crosses the face the ray is free.

    Set-up: n^2 = 4 - 2 y, force -1; T_y^2 = 2 (1 + lift - y), over the face for sigma = 2 sqrt(2 lift), 1 to 6 cells.
    Expected: it leaves with T_y = sqrt(2 lift) and T_z and keeps that direction. Errors: 4e-5, as for reflection.
    """
    field = linear_square_field(-2.0, ambient=2.0)
    climb = np.sqrt(2.0 * (1.0 + lift - from_height))
    index = np.sqrt(4.0 - 2.0 * from_height)
    along = np.sqrt(index**2 - climb**2)
    ray = RayBundle([[0.0, from_height, 0.0]], [[0.0, climb, along]])
    result = trace(field, ray, until=Plane((0, 0, 2.0), UP), method="adaptive", precision=precision)
    assert keeps_promises(result, 1).ok[0]
    leaves = along * (climb - np.sqrt(2.0 * lift))
    if leaves < 1.0:
        slope = np.sqrt(2.0 * lift) / along
        assert result.direction[0, 1] / result.direction[0, 2] == pytest.approx(slope, abs=4e-5)
        assert result.position[0, 1] == pytest.approx(1.0 + (2.0 - leaves) * slope, abs=1e-4)
