"""Tables of air that is moved, mirrored or turned: what is predicted of rays before any is traced turns with it.

Numbers that depend on an order of sums are compared to 1e-9 of the greatest.
"""

import numpy as np
import pytest

from aerokernels import IndexField, RayBundle
from aerokernels.tracing.bundle.tubes import roughness_of
from aerokernels.tracing.error_limit import SHARE, error_limit, greatest_path, path_exceeds, support_box
from aerokernels.tracing.leapfrog.missed_on_lines import greatest_error, missed_along
from aerokernels.tracing.leapfrog.unresolved import Sampling, missed_in_blocks
from aerokernels.tracing.step_bound import CONES, cones_of, greatest_turn, step_bound
from aerokernels.tracing.straight_lines import lines_through
from tests.moved_air import BOX, PITCH, PLAIN, Moved, beams, same

WAVE = 905e-9


def test_where_the_field_has_support(changed: Moved):
    samples = np.zeros((17, 21, 25))
    samples[6:9, 9:14, 12:20] = 1e-6 * np.random.default_rng(8).uniform(0.5, 1.0, (3, 5, 8))
    fields = [
        IndexField.from_samples(
            np.ascontiguousarray(by.table(samples)), origin=by.field().samples.low, spacing=(PITCH,) * 3,
            geometry="volume",
        )
        for by in (PLAIN, changed)
    ]  # fmt: skip
    corners = np.array(support_box(fields[0], 1e-2 * WAVE))
    held = PITCH * (np.array([[6.0, 9.0, 12.0], [8.0, 13.0, 19.0]]) - [8.0, 10.0, 12.0])
    assert (corners[0] <= held[0]).all() and (corners[1] >= held[1]).all()
    assert corners[0][2] >= held[0][2] - 8.0 * PITCH and corners[1][0] <= held[1][0] + 8.0 * PITCH  # the others clipped
    moved = np.sort(changed.place(corners), axis=0)
    np.testing.assert_allclose(np.array(support_box(fields[1], 1e-2 * WAVE)), moved, atol=1e-12)


def sampling(by: Moved, spacing: float = 2.0 * PITCH) -> Sampling:
    steep = (0.3, 0.1, 1.0)
    return Sampling(spacing, (steep[1], steep[0], steep[2]) if by.turned else steep, 2e-3)


@pytest.mark.parametrize("by_rule", [False, True])
def test_what_samples_of_a_block_miss(changed: Moved, by_rule: bool):
    """Tables of blocks of four cells, which fill the box, and what lines through them add up."""
    before = missed_in_blocks(PLAIN.field(), sampling(PLAIN), by_rule)[1]
    after = missed_in_blocks(changed.field(), sampling(changed), by_rule)[1]
    assert before.shape == (4, 5, 6) and before.max() > before.min() > 0.0
    same(after, changed.table(before))
    found = []
    for by in (PLAIN, changed):
        field, (position, direction) = by.field(), beams()
        low, high = field.box
        lines = lines_through(field, RayBundle(by.place(position), by.way(direction)), None, low, high)
        one = sampling(by)
        found.append((lines.length, missed_along(field, one, lines), greatest_error(field, one, lines, by_rule)))
    same(found[1][0], found[0][0])
    if 2 not in changed.mirrored:  # lookups lie on edges of blocks along z, which belong to one side
        same(found[1][1], found[0][1])
    assert found[1][2] == pytest.approx(found[0][2], rel=1e-9)
    assert found[0][2] >= 0.3 * found[0][1].max() > 0.0


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
def test_safe_steps(changed: Moved, interpolation: str):
    """Of cones about directions, and of all directions."""
    ways = np.array([[0.0, 0.01, 1.0], [1.0, 0.05, -0.1], [0.1, -1.0, 0.05], [0.5, 0.5, 0.7]])
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    numbers = cones_of(ways, "volume"), cones_of(changed.way(ways), "volume")
    for before, after in zip(*numbers, strict=True):
        assert CONES[before].spread == CONES[after].spread
        same(CONES[after].axis_vector, changed.way(CONES[before].axis_vector))
        tables = [
            step_bound(by.field(interpolation).samples, "volume", 1e-3 * WAVE, CONES[number]).length
            for by, number in ((PLAIN, before), (changed, after))
        ]
        same(tables[1], changed.table(tables[0]))
    assert numbers[0][-1] == 0 and (numbers[0][:-1] > 0).all()


def test_rays_outside_a_cone_look_around():
    """Sines of 0.02 and 0.2 about an axis; in the plane of a flow not along x, about an axis only along it."""
    ways = np.array([[0.0, 0.0, 1.0], [0.0, 0.019, 1.0], [0.0, 0.021, 1.0], [0.0, 0.199, 1.0], [0.0, 0.25, 1.0],
                     [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # fmt: skip
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    for geometry, axes in (("volume", (0, 1, 2)), ("planar", (1, 2)), ("axisymmetric", (2,))):
        found = [CONES[number] for number in cones_of(ways, geometry)]
        assert [cone.axis for cone in found[:5]] == [2, 2, 2, 2, None]
        assert found[0] == found[1] != found[2] == found[3]
        assert [cone.axis for cone in found[5:]] == [axis if axis in axes else None for axis in (0, 1)]
        assert found[6].axis is None or found[6].sign == -1.0


def test_how_rough_the_air_about_a_place_is(changed: Moved):
    rng = np.random.default_rng(2)
    place = BOX * rng.uniform(-0.99, 0.99, (100, 3))
    for width in (PITCH, 6.0 * PITCH):
        wide = np.full((100, 3), width)
        before = roughness_of(PLAIN.field()).at(place, wide)
        after = roughness_of(changed.field()).at(changed.place(place), wide)
        axes = np.r_[0:3, 3:6] if not changed.turned else np.array([1, 0, 2, 4, 3, 5])
        if width == PITCH:  # wider blocks are joined from one corner on
            same(after[:, axes], before)
        assert (before[:, :3].max() > 0.0) and (before[:, 3:] == 0.0).all()
    outside = np.array([[3.0 * BOX[0], 0.0, 0.0], [0.0, 0.0, -3.0 * BOX[2]]])
    assert (roughness_of(PLAIN.field()).at(outside, np.full((2, 3), PITCH)) == 0.0).all()


def test_the_longest_path_of_a_constant():
    """The contrast times the samples of the longest axis times their distance, along each axis in turn."""
    for shape, spacing, expected in (((4, 9, 5), (1e-3, 1e-3, 1e-3), 9e-3), ((4, 9, 5), (5e-3, 1e-3, 1e-3), 2e-2),
                                     ((4, 9, 5), (1e-3, 1e-3, 3e-3), 1.5e-2)):  # fmt: skip
        for sign in (1.0, -1.0):
            field = IndexField.from_samples(
                np.full(shape, sign * 1e-6), origin=(0.0, 0.0, 0.0), spacing=spacing, geometry="volume"
            )
            path = 1e-6 * expected
            assert greatest_path(field) == pytest.approx(path, rel=1e-12)
            assert path_exceeds(field, 0.999 * path) and not path_exceeds(field, 1.001 * path)
            assert error_limit(field, 0.9 * SHARE * path) == 0.9 * SHARE * path
            assert error_limit(field, 2.0 * SHARE * path) == pytest.approx(SHARE * path)
            assert greatest_turn(field.samples) == 0.0


def test_one_strong_line_beside_those_that_are_summed_first_counts():
    """Air in one column of nodes only: all lines are summed where some of them do not tell."""
    for column in ((0, 0), (1, 2), (3, 5)):
        samples = np.zeros((6, 8, 10))
        samples[column] = 1e-6
        field = IndexField.from_samples(samples, origin=(0.0,) * 3, spacing=(1e-3,) * 3, geometry="volume")
        assert greatest_path(field) == pytest.approx(1e-8)
        assert path_exceeds(field, 0.9e-8) and not path_exceeds(field, 1.1e-8)


def test_the_greatest_turn_of_a_constant_slope():
    """Slope over the ambient index times the diagonal; the steepest of the axes counts."""
    y, z = np.meshgrid(1e-3 * np.arange(6), 2e-3 * np.arange(5), indexing="ij")
    for rate in ((3e-4, 1e-4), (1e-4, -3e-4)):
        field = IndexField.from_samples(
            rate[0] * y + rate[1] * z, origin=(0.0, 0.0), spacing=(1e-3, 2e-3), geometry="planar"
        )
        expected = 3e-4 * np.hypot(5e-3, 8e-3) / field.ambient_index
        assert greatest_turn(field.samples) == pytest.approx(expected, rel=1e-9)
