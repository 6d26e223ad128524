"""Air and rays that are moved, mirrored or turned together: predictions made before any ray is traced stay equal.

Numbers that depend on an order of sums are compared to 1e-9 of the greatest.
"""

import numpy as np
import pytest

from aerokernels import IndexField, RayBundle
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.bundle.family import find_family
from aerokernels.tracing.bundle.table import FaceClasses, undisturbed_length
from aerokernels.tracing.lines import FACES, SIDE, box_span, cell_along, crossing_of_box
from aerokernels.tracing.straight_lines import lever_arms_of, obliquity
from tests.moved_air import BOX, PITCH, PLAIN, Moved, beams, same, some_rays

WAVE = 905e-9


def test_boxes_are_crossed_where_they_were(changed: Moved):
    """Entries, exits and faces; by `crossing_of_box` the same, and the cosine with the normal of the face of exit."""
    position, direction = some_rays()
    before = box_span(PLAIN.field(), position, direction)
    p, d = changed.place(position), changed.way(direction)
    after = box_span(changed.field(), p, d)
    same(after.meets, before.meets)
    meets = before.meets & (before.leave > 0.0)
    assert 40 < meets.sum() < 195
    same(after.enter[meets], before.enter[meets])
    same(after.leave[meets], before.leave[meets])
    normal = np.eye(3)[[0, 0, 1, 1, 2, 2]] * np.array([-1.0, 1.0] * 3)[:, None]
    same(normal[after.exit_face[meets]], changed.way(normal[before.exit_face[meets]]))
    outside = meets & (before.entry_face >= 0)
    same(after.entry_face[meets] >= 0, before.entry_face[meets] >= 0)
    same(normal[after.entry_face[outside]], changed.way(normal[before.entry_face[outside]]))
    low, high = changed.field().box
    enter, leave, cosine = crossing_of_box(p[meets], d[meets], low, high, "volume")
    same(np.maximum(enter, 0.0), before.enter[meets])
    same(leave, before.leave[meets])
    same(np.abs(cosine), np.abs((d[meets] * normal[after.exit_face[meets]]).sum(axis=1)))


def test_lines_in_a_cylinder_leave_it_on_its_circle():
    """Where the side is left: r = R there, and the cosine is that with the radius; where an end is: z of that end."""
    radius, half = 8.0 * PITCH, 12.0 * PITCH
    position, direction = some_rays()
    low, high = np.array([0.0, -half]), np.array([radius, half])
    field = IndexField.from_samples(
        np.full((9, 25), 1e-6), origin=(0.0, -half), spacing=(PITCH, PITCH), geometry="axisymmetric"
    )
    span = box_span(field, position, direction)
    rows = np.flatnonzero(span.meets & (span.leave > 0.0))
    enter, leave, cosine = crossing_of_box(position[rows], direction[rows], low, high, "axisymmetric")
    same(leave, span.leave[rows])
    same(np.maximum(enter, 0.0), span.enter[rows])
    place = position[rows] + leave[:, None] * direction[rows]
    side = span.exit_face[rows] == SIDE
    assert 20 < side.sum() < len(rows) - 20
    np.testing.assert_allclose(np.hypot(*place[side, :2].T), radius, rtol=1e-12)
    np.testing.assert_allclose(np.abs(place[~side, 2]), half, rtol=1e-12)
    along = np.where(side, (place[:, :2] * direction[rows, :2]).sum(axis=1) / radius, direction[rows, 2])
    np.testing.assert_allclose(np.abs(cosine), np.abs(along), atol=1e-9)


def test_lever_arms_and_obliquities(changed: Moved):
    """For a slanted plane: a displacement across a ray changes its path as the law of the plane says."""
    position, direction = beams()
    normal = np.array([0.2, -0.3, 0.9]) / np.linalg.norm([0.2, -0.3, 0.9])
    stops = [Plane(by.place([0.0, 0.0, 20.0 * PITCH]), by.way(normal)) for by in (PLAIN, changed)]
    arms = [
        lever_arms_of(by.field(), RayBundle(by.place(position), by.way(direction)), stop)
        for by, stop in zip((PLAIN, changed), stops, strict=True)
    ]
    for name in ("path_length", "reach", "lever_arm"):
        assert getattr(arms[1], name) == pytest.approx(getattr(arms[0], name), rel=1e-9)
    shift = np.cross(direction, np.array([0.3, 0.5, 0.1])) * 1e-4
    reached = ((stops[0].point - position) @ stops[0].normal) / (direction @ stops[0].normal)
    beside = ((stops[0].point - position - shift) @ stops[0].normal) / (direction @ stops[0].normal)
    np.testing.assert_allclose((shift * obliquity(direction, stops[0])).sum(axis=1), beside - reached, atol=1e-15)
    assert (obliquity(direction, ArcLength(1.0)) == 0.0).all()


def test_cells_along_a_direction():
    """The way through a cell is that to the first of its faces."""
    field = IndexField.from_samples(
        np.full((4, 4, 4), 1e-6), origin=(0.0,) * 3, spacing=(1e-3, 2e-3, 3e-3), geometry="volume"
    )
    slanted = np.array([0.6, 0.0, 0.8])
    found = cell_along(field, np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0], slanted]))
    np.testing.assert_allclose(found, [1e-3, 2e-3, 3e-3, 1e-3 / 0.6], rtol=1e-12)


def test_lines_that_leave_near_an_edge_are_of_no_class():
    """Along z, within the margin of a side or not; a stop within the box hides the edge."""
    low, high = PLAIN.field().box
    matters = np.ones(len(FACES), dtype=bool)
    x = np.array([high[0] - 0.5 * PITCH, high[0] - 2.0 * PITCH, 0.0, low[0] + 0.5 * PITCH, low[0] + 2.0 * PITCH, 0, 0])
    y = np.array([0.0, 0.0, high[1] - 0.5 * PITCH, 0.0, 0.0, low[1] + 0.5 * PITCH, low[1] + 2.0 * PITCH])
    position = np.stack([x, y, np.full(7, -14.0 * PITCH)], axis=1)
    up = np.tile([0.0, 0.0, 1.0], (7, 1))
    found = FaceClasses(PLAIN.field(), None, matters, PITCH).numbers(position, up)
    assert (found < 0).tolist() == [True, False, True, True, False, True, False]
    assert len(set(found[[1, 4, 6]].tolist())) == 1
    stopped = FaceClasses(PLAIN.field(), Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), matters, PITCH).numbers(position, up)
    assert (stopped >= 0).all() and len(set(stopped.tolist())) == 1
    aside = FaceClasses(PLAIN.field(), None, matters, PITCH).numbers(position + 5.0 * BOX, up)
    assert (aside < 0).all()


def test_undisturbed_lengths():
    position, direction = beams(20)
    _, high = PLAIN.field().box
    to_face = (high[2] - position[:, 2]) / direction[:, 2]
    np.testing.assert_allclose(undisturbed_length(PLAIN.field(), position, direction, None), to_face, rtol=1e-12)
    plane = Plane((0.0, 0.0, 3.0 * PITCH), (0.0, 0.0, -1.0))
    found = undisturbed_length(PLAIN.field(), position, direction, plane)
    np.testing.assert_allclose(found, 18.0 * PITCH / direction[:, 2], rtol=1e-12)
    assert (undisturbed_length(PLAIN.field(), position, direction, ArcLength(0.02)) == 0.02).all()


@pytest.mark.parametrize("converges", [True, False])
def test_a_family_gives_its_rays_back(converges: bool, changed: Moved):
    """Off the axis: parallel rays from a plane, and rays from one point; the rays of their parameters are they."""
    rng = np.random.default_rng(6)
    middle = PITCH * np.array([2.0, -3.0, -20.0])
    across = PITCH * rng.uniform(-4.0, 4.0, (300, 2))
    if converges:
        position = np.tile(middle, (300, 1))
        direction = np.c_[across / (40.0 * PITCH), np.ones(300)]
    else:
        position, direction = middle + np.c_[across, np.zeros(300)], np.tile([0.02, -0.01, 1.0], (300, 1))
        position[:, 2] -= position[:, :2] @ [0.02, -0.01]
    direction = direction / np.linalg.norm(direction, axis=1)[:, None]
    p, d = changed.place(position), changed.way(direction)
    family = find_family(changed.field(), RayBundle(p, d), None)
    assert not isinstance(family, str), family
    assert family.converges == converges and family.holds_for(p, d).all()
    if converges:
        np.testing.assert_allclose(family.origin, changed.place(middle), atol=2.0 * family.close)
    found = family.parameters(p, d)
    assert ((found >= family.low) & (found <= family.high)).all()
    start, way = family.rays(found)
    np.testing.assert_allclose(start, p, atol=2.0 * family.close)
    np.testing.assert_allclose(way, d, atol=1e-6)
    assert not family.holds_for(p + 0.1 * BOX[0] * np.array([0.3, 0.5, 4.0]), d + 0.1).any()
