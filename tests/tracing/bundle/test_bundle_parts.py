"""Parts of bundles: families, the faces that their lines pass, deviations, the bound of the field between them."""

from itertools import product

import numpy as np
import pytest

from aerokernels import ArcLength, Plane
from aerokernels.medium.grid import local_coordinates
from aerokernels.tracing import RayStatus
from aerokernels.tracing.bundle import family as families
from aerokernels.tracing.bundle.family import Family, some_rows
from aerokernels.tracing.bundle.table import FaceClasses, channels_of, trace_lines, undisturbed_length
from aerokernels.tracing.bundle.tubes import RESOLVED, Roughness, Tubes
from aerokernels.tracing.lines import FACES, box_span

from .box_of_air import UP, field_of

# --- families --------------------------------------------------------------------------------------------------------


def test_ranges_of_parameters_are_rounded_outward():
    """By a hundredth of the extent, to parts of at most a 64th of it that are a power of two; one ray has no range."""
    low, high = np.array([0.123, -3.1]), np.array([0.877, 2.9])
    extent = families._extent(low, high)
    np.testing.assert_allclose(extent, high - low)
    assert families._extent(low, low) is None
    np.testing.assert_allclose(families._extent(low, low + np.array([4.0, 0.0])), [4.0, 4e-3])
    first, last = families._rounded_range(low, high, extent)
    part = np.array([2.0**-6, 2.0**-3])
    for axis in (0, 1):
        assert part[axis] / 2 < extent[axis] / 64 <= part[axis]
        room = 0.01 * extent[axis]
        assert first[axis] <= low[axis] - room < first[axis] + part[axis]
        assert last[axis] - part[axis] < high[axis] + room <= last[axis]
        assert first[axis] % part[axis] == last[axis] % part[axis] == 0.0


def test_rows_that_follow_no_period():
    """All of a few; of many, distinct ones that leave no gap of more than three even shares."""
    assert some_rows(7, 10).tolist() == list(range(7)) and some_rows(10, 10).tolist() == list(range(10))
    rows = some_rows(100_000, 500)
    assert len(rows) == 500 and rows.min() == 0 and rows.max() < 100_000
    assert np.diff(np.append(rows, 100_000)).max() < 3 * 200


def test_a_point_through_which_lines_pass():
    """Found where they all do, not where one misses it by more than half of what is close; a common start is it."""
    apex = np.array([0.3, -0.2, 7.0])
    rng = np.random.default_rng(95)
    position = rng.uniform(-1.0, 1.0, (30, 3))
    way = (apex - position) / np.linalg.norm(apex - position, axis=1)[:, None]
    assert families._apex(position, way, 1e-9) == pytest.approx(apex, abs=1e-10)
    beside = np.cross(way[4], UP) / np.linalg.norm(np.cross(way[4], UP))
    for off, good in ((0.4e-3, True), (0.7e-3, False)):
        moved = position.copy()
        moved[4] += off * beside
        found = families._apex(moved, way, 1e-3)
        assert (found is not None) == good
    start = np.tile(apex, (30, 1))
    assert families._apex(start, way, 1e-9).tolist() == apex.tolist()
    rounded = families._rounded_apex(apex + 1e-9, way, UP, 1e-6)
    assert np.abs(rounded - apex)[:2].max() <= 1e-6 / 8.0 and abs(rounded - apex)[2] <= 1e-6
    assert (families._rounded_apex(apex - 1e-9, way, UP, 1e-6) == rounded).all()


def test_a_plane_in_which_rays_start():
    """Across the axis, tilted, or none; its normal looks along the axis."""
    rng = np.random.default_rng(96)
    flat = np.c_[rng.uniform(-1, 1, (20, 2)), np.full(20, 0.75)]
    point, normal = families._common_plane(flat, UP, 1e-6)
    assert normal.tolist() == [0, 0, 1] and point == pytest.approx([0, 0, 0.75], abs=1e-7)
    tilted = flat + np.outer(flat[:, 0], [0.0, 0.0, -0.5])
    point, normal = families._common_plane(tilted, UP, 1e-6)
    assert normal == pytest.approx(np.array([0.5, 0.0, 1.0]) / np.sqrt(1.25), abs=1e-9)
    assert np.abs((tilted - point) @ normal).max() < 1e-6
    assert families._common_plane(rng.uniform(-1, 1, (20, 3)), UP, 1e-6) is None
    upright = np.c_[np.zeros(20), rng.uniform(-1, 1, (20, 2))]
    assert families._common_plane(upright, UP, 1e-6) is None
    line = np.c_[np.linspace(0.0, 1.0, 9), np.zeros(9), np.full(9, 2.0)]
    assert families._common_plane(line, UP, 1e-6)[1].tolist() == [0, 0, 1]


def test_the_least_of_a_box_along_an_axis():
    """The least of its corners' coordinates; none where the box has no end that way."""
    axis = np.array([0.6, -0.64, 0.48])
    low, high = (np.asarray(one) for one in field_of().box)
    corners = np.array(list(product(*zip(low, high, strict=True))))
    assert families._least_of_box(field_of(), axis) == pytest.approx((corners @ axis).min())
    flat = field_of("planar")
    assert families._least_of_box(flat, axis) == -np.inf
    assert families._least_of_box(flat, np.array([0.0, -0.6, 0.8])) == pytest.approx(-0.6 * 2.0 + 0.8 * 0.5)


# --- faces and traced lines ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("until", [None, Plane((0.0, 0.0, 3.2), (0.0, 0.2, 1.0))])
@pytest.mark.parametrize("geometry", ["volume", "axisymmetric"])
def test_lines_of_one_class_pass_the_same_faces(geometry: str, until):
    """Two lines have one number if, and only if, entry, exit and stop are alike where they matter; -1 near an edge."""
    field = field_of(geometry)
    rng = np.random.default_rng(97)
    start = rng.uniform([-1.5, -1.5, -1.0], [1.5, 2.5, 3.0], (150, 3))
    way = rng.uniform([-1.0, -1.0, 0.5], [1.0, 2.0, 4.5], (150, 3)) - start
    way /= np.linalg.norm(way, axis=1)[:, None]
    matters = np.array([True, False, True, True, True, False, True])
    margin = 0.1
    classes = FaceClasses(field, until, matters, margin)
    assert not classes.are_all_alike
    number, span = classes.numbers(start, way), box_span(field, start, way)
    behind = box_span(field, start - 20.0 * way, way).entry_face
    assert (span.face_behind == behind)[span.meets].all() and set(span.entry_face[span.enter == 0.0]) == {-1}
    low, high = (np.asarray(one) for one in field.box)
    told = []
    for row in range(150):
        enter = ("inside" if span.enter[row] == 0.0 else behind[row]) if matters[behind[row]] else "any"
        leave, near = int(span.exit_face[row]), False
        if not span.meets[row]:
            told.append("beside" if until is not None else -1)
            continue
        end = start[row] + span.leave[row] * way[row]
        depth = [min(end[k] - low[k], high[k] - end[k]) for k in range(3)]
        if geometry == "axisymmetric":
            depth[:2] = high[0] - np.hypot(*end[:2]), np.inf
        depth[0 if FACES[leave] == "r" else leave // 2] = np.inf
        near = min(depth) < margin
        if until is not None:
            stop = ((until.point - start[row]) @ until.normal) / (way[row] @ until.normal)
            if 0.0 <= stop < span.leave[row] - 1e-6:
                leave, near = "stops", False
            elif not matters[leave]:
                leave = "any"
        told.append(-1 if near else (leave, enter))
    kinds = {}
    for row, one in enumerate(told):
        assert (number[row] < 0) == (one == -1)
        if one != -1:
            assert kinds.setdefault(one, number[row]) == number[row]
    assert len(set(kinds.values())) == len(kinds) >= 5 and (-1 in told)
    still = FaceClasses(field, Plane((0, 0, 9), UP), np.zeros(7, bool))
    assert still.are_all_alike and not still.numbers(start, way).any()


@pytest.mark.parametrize("until", [None, Plane((0.0, 0.0, 6.0), (0.1, 0.0, 1.0)), ArcLength(3.0)])
def test_deviations_of_traced_lines(until):
    """OPD, turn, end less the undisturbed one, arc less its length; nothing of rays that failed or have no class."""
    field = field_of()
    family = Family(False, np.array([0.0, 0.0, -1.0]), np.eye(3), -np.ones(2), np.ones(2), None, UP, -np.inf, 1e-6)
    classes = FaceClasses(field, until, np.ones(7, bool))
    parameters = np.random.default_rng(98).uniform(-0.8, 0.8, (12, 2))
    rng = np.random.default_rng(99)
    made = {"direction": rng.normal(size=(12, 3)), "position": rng.normal(size=(12, 3))}
    made |= {
        name: rng.normal(size=12) for name in ("opd", "arc_length", "step_error", "step_count", "evaluation_count")
    }
    made["status"] = np.zeros(12, int) + RayStatus.OK
    made["status"][4] = RayStatus.MAX_STEPS
    traced = trace_lines(family, classes, lambda rays: made, parameters)
    start, way = np.c_[parameters, np.full(12, -1.0)], np.tile(UP, (12, 1))
    length = {0: 5.5, 1: 7.0 - 0.1 * parameters[:, 0], 2: 3.0}[
        0 if until is None else 2 if isinstance(until, ArcLength) else 1
    ]
    assert undisturbed_length(field, start, way, until) == pytest.approx(np.full(12, 0.0) + length)
    end = start + (np.zeros(12) + length)[:, None] * way
    expected = np.c_[made["opd"], made["direction"] - way, made["position"] - end, made["arc_length"] - length]
    expected[4] = np.nan
    np.testing.assert_allclose(traced.values, expected, atol=1e-12)
    np.testing.assert_array_equal(traced.line_class, classes.numbers(start, way))
    np.testing.assert_array_equal(
        traced.costs, np.stack([made[name] for name in ("step_error", "step_count", "evaluation_count")], axis=1)
    )
    sizes = [
        channels_of(frozenset(names))
        for names in (("opd",), ("opd", "direction"), ("position",), ("arc_length", "opd"))
    ]
    assert sizes == [1, 4, 8, 8]


# --- tubes -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("counts_direction", [False, True])
@pytest.mark.parametrize("converges", [False, True])
def test_the_bound_in_even_roughness_is_its_formula(converges: bool, counts_direction: bool):
    """K / 384 s^4 of each axis' derivative along the lines' spacing, and kinks / 8, over the length of the tube.

    Every place of a box of 2 by 3 by 4 m has the same roughness; lines run along z, in steps of half a metre from the
    entry of the first of a block's lines on.
    """
    field = field_of()
    origin = np.array([0.0, 0.5, -8.0]) if converges else np.array([0.0, 0.0, -1.0])
    family = Family(
        converges, origin, np.eye(3), -np.ones(2), np.ones(2), np.array([0.0, 0.0, -1.0]), UP, -np.inf, 1e-6
    )
    root, kink = np.array([0.3, 0.5, 0.7]), np.array([1e-3, 2e-3, 4e-3])
    levels = (np.broadcast_to(np.concatenate([root, kink]), (4, 6, 8, 6)),)
    rough = Roughness(np.array([-1.0, -1.0, 0.5]), np.full(3, 0.5), np.array([0.2, 0.25, 0.4]), levels)
    tubes = Tubes(field, family, Plane((0.0, 0.0, 4.0), UP), rough, counts_direction)
    step = np.array([0.4, 0.35]) / (10.0 if converges else 1.0)
    middle, half = np.array([[0.01, 0.02]]), 1e-4 * np.ones(2)
    found = tubes.missed(middle, half, step, np.zeros(1))
    position, direction = family.rays(middle)
    enter = (0.5 - position[0, 2]) / direction[0, 2]
    expected = 0.0
    for number in range(int(np.ceil(7.0 / direction[0, 2] - 1e-9))):
        place = position[0] + (enter + 0.5 * (number + 0.5)) * direction[0]
        scale = (place[2] + 8.0) / direction[0, 2] if converges else 1.0
        apart = scale * step
        rate = sum(2.0 / 384.0 * (apart[k] * root[k]) ** 4 + kink.sum() / 8.0 for k in (0, 1))
        expected += 0.5 * rate
    assert found[0] == pytest.approx((2.0 if counts_direction else 1.0) * expected, rel=1e-3)
    # Lines nearer than 0.75 cells along both axes show all.
    close = 0.7 * np.array([0.2, 0.25]) / (12.0 if converges else 1.0)
    assert tubes.missed(middle, half, close, np.zeros(1))[0] == 0.0 and RESOLVED == 0.75
    widest = tubes.greatest_spacing(middle, step)
    scale = 12.0 / direction[0, 2] if converges else 1.0
    assert widest[0] == pytest.approx(max(scale * step[0] / 0.2, scale * step[1] / 0.25), rel=1e-3)
    away = np.array([[0.9, 0.9]]) if converges else np.array([[5.0, 0.0]])
    assert tubes.missed(away, half, step, np.zeros(1))[0] == 0.0


def test_lines_toward_an_apex_are_widest_at_their_entry():
    """An apex 20 m ahead: the spacing at z = 0.5 m, in cells; sizes along the field's own axes."""
    field, origin = field_of(), np.array([0.0, 0.5, 20.0])
    family = Family(True, origin, np.eye(3), -np.ones(2), np.ones(2), np.array([0.0, 0.0, -1.0]), UP, -np.inf, 1e-6)
    tubes = Tubes.of(field, family, Plane((0.0, 0.0, 4.0), UP), False)
    middle, step = np.array([[0.01, 0.02]]), np.array([0.03, 0.04])
    direction = family.rays(middle)[1][0]
    found = tubes.greatest_spacing(middle, step)
    scale = 19.5 / direction[2]
    assert found[0] == pytest.approx(max(scale * 0.03 / 0.2, scale * 0.04 / 0.25), rel=1e-9)
    sizes = np.array([[3.0, 4.0, 7.0]])
    assert local_coordinates(sizes, "axisymmetric").tolist() == [[5.0, 7.0]]
    assert local_coordinates(sizes, "planar").tolist() == [[4.0, 7.0]] and local_coordinates(sizes, "volume") is sizes
