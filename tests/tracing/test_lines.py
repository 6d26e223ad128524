"""Straight lines and boxes and lever arms: against lines sampled finely, and closed forms."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.lines import (
    FACES,
    box_size,
    box_span,
    crossing_of_box,
    face_text,
)
from aerokernels.tracing.stop import stop_distance

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
