"""Straight lines and boxes and lever arms: against lines sampled finely, and closed forms."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.lines import (
    FACES,
    box_size,
    box_span,
    cell_along,
    crossing_of_box,
    cylinder_span,
    face_text,
    slab_span,
)
from aerokernels.tracing.stop import stop_distance
from aerokernels.tracing.straight_lines import lever_arms_of, obliquity

LOW, HIGH, RADIUS = np.array([-1.0, -1.5, 1.0]), np.array([0.75, 2.0, 4.5]), 1.7
GEOMETRIES = ("volume", "planar", "axisymmetric")
STEP, LONGEST = 5e-3, 12.0


def field_of(geometry: str, value=None, counts=(8, 6, 8)) -> IndexField:
    """A box of 1.75 by 3.5 by 3.5 m, or r up to 1.7 m; values of the field's own coordinates, 0 without."""
    axes = [0, 1, 2] if geometry == "volume" else [1, 2]
    low, high = LOW.copy(), HIGH.copy()
    if geometry == "axisymmetric":
        low[1], high[1] = 0.0, RADIUS
    nodes = [np.linspace(low[k], high[k], counts[k]) for k in axes]
    places = np.meshgrid(*nodes, indexing="ij")
    samples = np.zeros(places[0].shape) if value is None else value(*places)
    return IndexField.from_samples(
        samples, origin=low[axes], spacing=[one[1] - one[0] for one in nodes], geometry=geometry
    )


def lines(count: int = 150) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(71)
    start = rng.uniform(-3.0, 6.0, (count, 3))
    heading = rng.uniform(LOW - 0.5, HIGH + 0.5, (count, 3)) - start
    heading[:, 0] += 0.1
    return start, heading / np.linalg.norm(heading, axis=1)[:, None]


def heights(geometry: str, points: np.ndarray) -> np.ndarray:
    """How far points are outside each of FACES [m], negative inside; shape (..., 7)."""
    x, y, z = np.moveaxis(points, -1, 0)
    never = np.full(x.shape, -np.inf)
    sides = [LOW[0] - x, x - HIGH[0], LOW[1] - y, y - HIGH[1]]
    if geometry != "volume":
        sides[:2] = never, never
    if geometry == "axisymmetric":
        sides[2:] = never, never
    round_ = np.hypot(x, y) - RADIUS if geometry == "axisymmetric" else never
    return np.stack([*sides, LOW[2] - z, z - HIGH[2], round_], axis=-1)


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_lines_cross_boxes_where_samples_say(geometry: str):
    """Entry, exit and their faces, of lines sampled every 5 mm; what `crossing_of_box` gives is the same."""
    field, (start, heading) = field_of(geometry), lines()
    span = box_span(field, start, heading)
    t = np.arange(0.0, LONGEST, STEP)
    low, high = (np.asarray(corner)[0 if geometry == "volume" else 1 :] for corner in field.box)
    enter, leave, cosine = crossing_of_box(start, heading, low, high, geometry)
    assert 30 < span.meets.sum() < 150 and (span.entry_face[span.meets] == -1).any()
    for row in range(len(start)):
        outside = heights(geometry, start[row] + t[:, None] * heading[row])
        inside = np.flatnonzero(outside.max(axis=1) <= 0.0)
        if not span.meets[row]:
            assert len(inside) == 0 and enter[row] > leave[row]
            continue
        if not len(inside):
            assert span.leave[row] - span.enter[row] < STEP
            continue
        first, last = inside[[0, -1]]
        assert span.enter[row] == pytest.approx(t[first], abs=1.01 * STEP)
        assert enter[row] == pytest.approx(span.enter[row], rel=1e-12)
        assert leave[row] == pytest.approx(span.leave[row], rel=1e-12)
        if first == 0:
            assert span.entry_face[row] == -1 and span.enter[row] == 0.0
        else:
            assert span.entry_face[row] == outside[first - 1].argmax()
        if last == len(t) - 1:
            continue
        assert span.leave[row] == pytest.approx(t[last], abs=1.01 * STEP)
        face = outside[last + 1].argmax()
        assert span.exit_face[row] == face
        end = start[row] + leave[row] * heading[row]
        expected = abs(heading[row, face // 2]) if face < 6 else abs(end[:2] @ heading[row, :2]) / RADIUS
        assert cosine[row] == pytest.approx(expected, rel=1e-12)
    whole = HIGH - LOW
    whole[:2] = {"volume": whole[:2], "planar": [0.0, whole[1]], "axisymmetric": [2 * RADIUS] * 2}[geometry]
    assert box_size(field) == pytest.approx(np.linalg.norm(whole), rel=1e-14)


def test_lines_along_slabs_and_cylinders():
    """Within, in the face, off it by less and by more than a tolerance; across it the tolerance counts for nothing."""
    place, rate = np.array([0.5, 1.0, 1.05, 1.15, -0.05, -0.15, 2.0, 2.0]), np.array([0, 0, 0, 0, 0, 0, -2.0, 4.0])
    first, last = slab_span(place, rate, 0.0, 1.0, 0.1)
    infinite = np.inf
    assert first.tolist() == [-infinite, -infinite, -infinite, infinite, -infinite, infinite, 0.5, -0.5]
    assert last.tolist() == [infinite, infinite, infinite, -infinite, infinite, -infinite, 1.0, -0.25]
    position = np.array([[3.0, 4.0, 0.0], [3.0, 4.0, 0.0], [-9.0, 3.0, 7.0], [-9.0, 5.1, 7.0], [-9.0, -5.3, 7.0]])
    heading = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.8, 0.0, 0.6], [0.8, 0.0, 0.6], [0.8, 0.0, 0.6]])
    for radius, tolerance, good in (
        (5.0, 0.0, [1, 1, 1, 0, 0]),
        (5.0, 0.2, [1, 1, 1, 1, 0]),
        (4.9, 0.0, [0, 0, 1, 0, 0]),
    ):
        first, last = cylinder_span(position, heading, radius, tolerance)
        assert (first <= last).tolist() == [bool(one) for one in good]
        if good[0]:
            assert np.isneginf(first[:2]).all() and np.isposinf(last[:2]).all()
        half = np.sqrt(radius**2 - 9.0)
        assert (first[2], last[2]) == pytest.approx(((9.0 - half) / 0.8, (9.0 + half) / 0.8))


def test_lines_beside_a_box_by_rounding_touch_it():
    """A line along an edge, outside both faces by 1e-10 of the size, meets the box; one outside by 1e-8 does not."""
    field = field_of("volume")
    size = box_size(field)
    for share, meets in ((1e-10, True), (1e-8, False)):
        aside = np.array([HIGH[0] + share * size, HIGH[1] + share * size, -2.0])
        assert box_span(field, aside[None], np.array([[0.0, 0.0, 1.0]])).meets[0] == meets
        # Past the edge between z and y, at 45 degrees.
        corner = np.array([0.0, HIGH[1] + share * size, HIGH[2] + share * size])
        heading = np.array([0.0, 1.0, -1.0]) / np.sqrt(2.0)
        assert box_span(field, (corner - 2.0 * heading)[None], heading[None]).meets[0] == meets
    assert [face_text(field, face) for face in (0, 3, 4)] == ["x = -1000 mm", "y = 2000 mm", "z = 1000 mm"]
    assert face_text(field_of("axisymmetric"), 6) == "r = 1700 mm" and FACES[6] == "r"


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_lengths_within_a_cell(geometry: str):
    """The least of spacing over component."""
    field, heading = field_of(geometry), lines()[1]
    spacing = {
        "volume": field.spacing,
        "planar": [np.inf, *field.spacing],
        "axisymmetric": [field.spacing[0], field.spacing[0], field.spacing[1]],
    }[geometry]
    expected = np.min(np.asarray(spacing) / np.abs(heading), axis=1)
    assert cell_along(field, heading) == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("until", [None, ArcLength(4.1), Plane((0.2, 0.1, 3.7), (0.2, -0.5, 1.0))])
def test_lever_arms_are_the_greatest_of_each_ray(geometry: str, until):
    """Path in the box up to the stop, way from the entry to the stop, and that times the tangent at the stop."""
    field, (start, heading) = field_of(geometry), lines()
    found = lever_arms_of(field, RayBundle(start, heading), until)
    span = box_span(field, start, heading)
    path, reach, lever = [], [], []
    for row in np.flatnonzero(span.meets):
        enter, leave, stop = span.enter[row], span.leave[row], span.leave[row]
        end = start[row] + leave * heading[row]
        face = span.exit_face[row]
        cosine = abs(heading[row, face // 2]) if face < 6 else abs(end[:2] @ heading[row, :2]) / RADIUS
        if isinstance(until, ArcLength):
            stop, cosine = until.length, 1.0
        elif until is not None:
            cosine = abs(heading[row] @ until.normal)
            stop = ((until.point - start[row]) @ until.normal) / (heading[row] @ until.normal)
            stop = stop if stop > 0.0 else np.inf
        leave = min(leave, stop)
        if not leave > enter or not np.isfinite(leave):
            continue
        path.append(leave - enter)
        reach.append((stop if np.isfinite(stop) else leave) - enter)
        if np.isfinite(stop) and cosine > 0.05:
            lever.append(reach[-1] * np.sqrt(1.0 - cosine**2) / cosine)
    assert (found.path_length, found.reach, found.lever_arm) == pytest.approx((max(path), max(reach), max(lever)))
    away = RayBundle([[0.0, 0.0, 9.0]], [[0.0, 0.0, 1.0]])
    assert lever_arms_of(field, away, until) is None


def test_oblique_stops_turn_displacements_into_path():
    """A ray moved by x across itself meets the plane later by -x n / (d n); a grazing one by no more than the least."""
    until, (_, heading) = Plane((0.0, 0.0, 1.0), (0.3, -0.4, 1.2)), lines()
    found, cosine = obliquity(heading, until), heading @ until.normal
    steep = np.abs(cosine) > 0.05
    assert 0 < steep.sum() < len(steep)
    rng = np.random.default_rng(72)
    move = rng.normal(size=heading.shape)
    move -= np.sum(move * heading, axis=1)[:, None] * heading
    expected = -(move @ until.normal) / np.where(steep, cosine, np.copysign(0.05, cosine))
    assert np.sum(move * found, axis=1) == pytest.approx(expected, rel=1e-9)
    assert np.abs(np.sum(found * heading, axis=1)).max() < 1e-12
    assert not obliquity(heading, None).any() and not obliquity(heading, ArcLength(1.0)).any()


def test_distances_to_stops():
    """Ahead, behind, on and along a plane; a length of arc; none."""
    place, heading = (
        np.array([[0, 0, 1.0], [0, 0, 5.0], [0, 0, 3.0], [0, 0, 1.0]]),
        np.array([[0.6, 0, 0.8]] * 3 + [[1.0, 0, 0]]),
    )
    found = stop_distance(place, heading, Plane((1.0, 2.0, 3.0), (0.0, 0.0, -2.0)))
    assert found.tolist() == [2.5, np.inf, 0.0, np.inf]
    assert stop_distance(place, heading, ArcLength(2.0)).tolist() == [2.0] * 4
    assert stop_distance(place, heading, None).tolist() == [np.inf] * 4
