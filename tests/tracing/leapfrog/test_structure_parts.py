"""What bounds structure between samples, part by part: blocks, differences, windows, strides, supports, counts."""

import dataclasses
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import maximum_filter

from aerokernels.medium import Body, IndexField
from aerokernels.process import threads
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane
from aerokernels.tracing.blocks import block_maxima, block_means, greatest_of_neighbors
from aerokernels.tracing.error_limit import SUPPORT_SHARE, left_out
from aerokernels.tracing.leapfrog import missed_on_lines, unresolved
from aerokernels.tracing.leapfrog.high_pass import _held_share, _images, _share_left
from aerokernels.tracing.leapfrog.sample_count import _greatest_cells
from aerokernels.tracing.leapfrog.unresolved import Sampling
from aerokernels.tracing.step_bound import (
    CONES,
    _continued,
    _window,
    block_size,
    potential_at_nodes,
    roughness_of_blocks,
    smooth_step,
)
from aerokernels.tracing.straight_lines import LeverArms, Lines, lines_through, local_range, outermost, outermost_rays
from tests.random_air import random_air

GEOMETRIES = ("volume", "planar", "axisymmetric")
AMBIENT = 1.2


def field_of(geometry: str, counts=(10, 12, 15), interpolation: str = "cubic", seed: int = 81) -> IndexField:
    """Random air on cells of 0.5, 0.7 and 0.9 m."""
    return random_air(
        geometry, seed, lambda random, shape: 1e-2 * random.normal(size=shape), counts, (-2.0, -1.0, 0.0),
        (0.5, 0.7, 0.9), ambient_index=AMBIENT, interpolation=interpolation,
    )  # fmt: skip


# --- blocks ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("block", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("shape", [(2, 9), (8, 3), (10, 13), (5, 4, 7)])
def test_reductions_over_blocks(shape: tuple[int, ...], block: int):
    """The greatest of a block's nodes, those on both its faces; the mean of its cells, the last node repeated."""
    values = np.random.default_rng(82).normal(size=shape)
    blocks = [-(-(count - 1) // block) for count in shape]
    found = block_maxima(values, block)
    assert found.shape == tuple(blocks)
    for place in product(*(range(count) for count in blocks)):
        assert found[place] == values[tuple(slice(k * block, (k + 1) * block + 1) for k in place)].max()
    for axis in range(len(shape)):
        moved = np.moveaxis(values, axis, 0)
        short = block_maxima(values, block, [axis])
        means = block_means(values, block, axis)
        for k in range(blocks[axis]):
            nodes = np.arange(k * block, (k + 1) * block + 1)
            np.testing.assert_array_equal(np.moveaxis(short, axis, 0)[k], moved[nodes[nodes < shape[axis]]].max(axis=0))
            here = moved[np.minimum(nodes, shape[axis] - 1)]
            np.testing.assert_allclose(np.moveaxis(means, axis, 0)[k], (0.5 * (here[1:] + here[:-1])).mean(axis=0))
        for count in (1, 2, 3, 30):
            runs = greatest_of_neighbors(values, count, axis)
            width = min(count, shape[axis])
            expected = [moved[k : k + width].max(axis=0) for k in range(shape[axis] - width + 1)]
            np.testing.assert_array_equal(np.moveaxis(runs, axis, 0), expected)


# --- step bounds -----------------------------------------------------------------------------------------------------


def test_continuations_are_polynomials():
    """Of one, two, three and more values: the polynomial through the first ones, of degree up to 3, ahead of them."""
    for count, degree in ((1, 0), (2, 1), (3, 2), (4, 3), (6, 3)):
        polynomial = np.polynomial.Polynomial(np.random.default_rng(count).normal(size=degree + 1))
        values = np.stack([polynomial(np.arange(count)), 2.0 * polynomial(np.arange(count))], axis=1)
        for more in (1, 2, 3):
            made = _continued(values, more)
            expected = polynomial(np.arange(-more, 0.0))
            assert made == pytest.approx(np.stack([expected, 2.0 * expected], axis=1), rel=1e-12)


@pytest.mark.parametrize("slab", [1, threads.SLAB], ids=["block by block", "all"])
@pytest.mark.parametrize("interpolation", ["cubic", "linear", "monotone"])
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_roughness_of_blocks_is_that_of_differences(geometry: str, interpolation: str, slab: int, monkeypatch):
    """Fourth differences of the coefficients (of samples) with what continues them, over the spacing to the fourth.

    Ends are continued by the cubic through the first four, or mirrored at the axis; kinks are second differences.
    """
    monkeypatch.setattr(threads, "SLAB", slab)
    field = field_of(geometry, (10, 9, 14), interpolation)
    grid = field.samples
    potential = grid.samples * (1.0 + grid.samples / (2.0 * AMBIENT))
    np.testing.assert_allclose(potential_at_nodes(grid), potential, rtol=1e-13)
    block, fourth, second = roughness_of_blocks(grid)
    assert block == 4
    for axis in range(grid.samples.ndim):
        if interpolation == "cubic":
            inner = tuple(slice(None) if a == axis else slice(1, -1) for a in range(grid.samples.ndim))
            values, more = np.moveaxis(grid.coefficients[inner], axis, 0) / AMBIENT, 1
        else:
            values, more = np.moveaxis(potential, axis, 0), 2
        flat = values.reshape(len(values), -1)

        ends = [np.polynomial.polynomial.polyfit(np.arange(4.0), one[:4], 3) for one in (flat, flat[::-1])]
        low, high = (np.polynomial.polynomial.polyval(-np.arange(more, 0.0, -1.0), one).T for one in ends)
        high = high[::-1]
        if geometry == "axisymmetric" and axis == 0:
            low = flat[[3]] if more == 1 else flat[[2, 1]]
        whole = np.concatenate([low, flat, high])
        change = np.abs(np.diff(whole, 4, axis=0)).reshape(-1, *values.shape[1:])
        expected = block_maxima(np.moveaxis(change, 0, axis), 4) / grid.spacing[axis] ** 4
        np.testing.assert_allclose(fourth[axis], expected, rtol=1e-9, atol=1e-12)
        kinks = np.abs(np.diff(whole[1:-1], 2, axis=0)).reshape(-1, *values.shape[1:])
        expected = 0.0 * expected if interpolation == "cubic" else block_maxima(np.moveaxis(kinks, 0, axis), 4)
        np.testing.assert_allclose(second[axis], expected, rtol=1e-9)


def test_blocks_of_great_grids_are_wider():
    """Four cells a side, or twice that until there are at most 300,000: 547 x 547 are, 548 x 548 are not."""
    for shape, block in (((2189, 2189), 4), ((2190, 2190), 8), ((5, 5), 4), ((265, 265, 265), 4), ((266, 266, 266), 8)):
        assert block_size(SimpleNamespace(shape=shape)) == block
        assert np.prod([-(-(count - 1) // block) for count in shape]) <= 300_000


def test_windows_hold_all_that_rays_meet():
    """Rays of a cone from anywhere in a block, between two distances: in the window; none of its edges is too far."""
    size = np.array([0.4, 0.3, 0.5])
    rng = np.random.default_rng(83)
    for cone in (CONES[0], CONES[3], CONES[9], CONES[12]):
        near, far = 1.1, 1.9
        low, high = _window(near, far, size, cone.axis_vector, cone)
        if cone.axis is None:
            way = rng.normal(size=(20000, 3))
            far_low = -np.ceil(far / size)
            np.testing.assert_array_equal([low, high], [far_low, -far_low])
        else:
            way = rng.normal(0.0, np.tan(cone.spread), (20000, 3))
            way[:, cone.axis] = cone.sign
            angle = np.arccos(np.clip((way / np.linalg.norm(way, axis=1)[:, None]) @ cone.axis_vector, -1.0, 1.0))
            way = way[angle <= cone.spread]
            wide = far * np.tan(cone.spread) / size  # to the side, and as a margin along the axis
            ahead = np.sort(np.stack([near, far])[:, None] * cone.axis_vector / size, axis=0)
            np.testing.assert_array_equal(low, np.floor(ahead[0] - wide))
            np.testing.assert_array_equal(high, np.floor(ahead[1] + wide + 1.0))
        way /= np.linalg.norm(way, axis=1)[:, None]
        place = rng.uniform(0.0, 1.0, way.shape) + rng.uniform(near, far, (len(way), 1)) * way / size
        entry = np.floor(place)
        assert (entry >= low).all() and (entry <= high).all()
    assert smooth_step(np.array([7.2, 0.0]), 1e-3)[0] == pytest.approx((1e-3 * 720.0 / 7.2) ** 0.25)
    assert smooth_step(np.array([7.2, 0.0]), 1e-3)[1] == np.inf


# --- what is not resolved --------------------------------------------------------------------------------------------


def test_shares_that_a_spline_holds_and_a_pass_leaves():
    """All images of an oscillation add up to it; known shares at phi H of 0.8, 0.98 and at low edges."""
    for cycles in (0.1, 0.27, 0.5):
        held = [float(_held_share(np.array(abs(cycles + image)))) for image in range(-60, 61)]
        assert sum(held) == pytest.approx(1.0, abs=1e-6)
    assert _held_share(np.array(0.0)) == 1.0
    # In a spline of unit nodes cos(2 pi v k): the projection on cos(2 pi v x), by the exact spline of a long grid.
    x = np.array([0.3, 0.8, 0.92, 0.98, 1.5])
    for edge, power in ((0.92, 24), (0.4, 3)):
        exponent = np.minimum((x / edge) ** 2, 2.0) ** (power / 2)
        assert _share_left(x**2, edge) == pytest.approx(1.0 - np.exp(-exponent), rel=1e-12)
    assert _images(np.array([0.7, 0.3])) == [(0, 1), (0, -2)]
    assert _images(np.array([0.7, 1.34])) == [(1, -1), (1, 1), (1, -2)]
    assert _images(np.array([0.9, 1.36])) == [(0, -1), (1, -1)]


def test_fourth_derivatives_of_one_normal():
    """Of a plane wave along u the derivatives along the axes are u_i^4 times its own: joined (sum |u_i|)^4 times."""
    way, size = np.array([0.2, 0.5, 0.8]), np.array([3.0, 0.0, 7.0])
    joined = unresolved._joined([one**4 * size for one in way])
    assert joined == pytest.approx(way.sum() ** 4 * size)
    assert unresolved._joined([0.0 * size, 0.0 * size]).tolist() == [0.0, 0.0, 0.0]
    rest = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.5]])
    lobes = unresolved._with_lobes(rest, 0)
    assert lobes.tolist() == [[0.15, 1.0, 0.15, 0.0], [0.0, 0.0, 0.075, 0.5]]


def test_the_axis_that_all_rays_run_along():
    """The axis whose least component 1 - (others)^2 is greatest, if it is above 0.7; numbered along the grid."""
    axis = unresolved._main_axis
    assert axis((0.2, 0.3, 1.0), "volume") == 2 and axis((0.2, 0.3, 1.0), "planar") == 1
    assert axis((0.2, 0.3, 1.0), "axisymmetric") == 1 and axis((1.0, 0.3, 0.2), "volume") == 0
    assert axis((1.0, 0.3, 0.2), "planar") is None and axis((0.3, 1.0, 0.2), "planar") == 0
    assert axis((0.3, 1.0, 0.2), "axisymmetric") is None and axis((0.6, 0.6, 0.9), "volume") is None
    limit = np.sqrt(0.51)  # to the side: the least component is 0.7
    assert axis((0.0, 0.999 * limit, 1.0), "volume") == 2 and axis((0.0, 1.001 * limit, 1.0), "volume") is None


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_the_rules_own_bound(geometry: str):
    """1 / 720 (sum (|u_i| H)  G_i^(1/4))^4 of each block, times 1 + 2 A / cell for errors of direction."""
    field = field_of(geometry)
    steep = (0.3, 0.4, 0.9)
    sampling = Sampling(1.7, steep, 0.6)
    block, found = unresolved.missed_in_blocks(field, sampling, by_rule=True)
    fourth = roughness_of_blocks(field.samples)[1]
    share = {"volume": steep, "planar": steep[1:], "axisymmetric": (0.5, 0.9)}[geometry]
    total = sum(u * 1.7 * g**0.25 for u, g in zip(share, fourth, strict=True))
    factor = 1.0 + 2.0 * 0.6 / float(field.samples.spacing.min())
    np.testing.assert_allclose(found, factor * total**4 / 720.0, rtol=1e-10)
    # At an end three samples have up to 8 times the bound; the greatest of the block and its neighbours counts.
    with_ends = Sampling(1.7, steep, 0.6, True, unresolved.EVERYWHERE)
    np.testing.assert_array_equal(unresolved.missed_in_blocks(field, with_ends, by_rule=True)[1], found)
    at_ends = unresolved.missed_at_ends(field, with_ends, by_rule=True)
    np.testing.assert_allclose(at_ends, maximum_filter(3.0 * 7.0 * 1.7 * found, 3, mode="constant"), rtol=1e-12)
    assert block == 4 and unresolved.missed_at_ends(field, sampling, by_rule=True) is None
    # A line is bounded by its blocks: the mean along it times its length, and what its lever arm adds.
    whole = unresolved.missed_in_blocks(field, sampling)[1]
    assert (whole <= found * (1 + 1e-9)).all()


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_blocks_in_which_lines_end(geometry: str):
    """Those that hold a start or an end, and their neighbours, are marked."""
    field = field_of(geometry)
    grid = field.samples
    start, length = np.array([[0.1, 0.4, 1.0], [-0.3, 0.6, 2.0]]), np.array([3.0, 5.0])
    way = np.array([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]])
    lines = Lines(start, way, length, 0.0 * length, 0.0 * length)
    shape = tuple(-(-(count - 1) // 4) for count in grid.shape)
    near = missed_on_lines._blocks_of_ends(lines, geometry, grid.low, block_size(grid) * grid.spacing, shape)
    expected = np.zeros(shape)
    for place in (*start, *(start + length[:, None] * way)):
        local = {"volume": place, "planar": place[1:], "axisymmetric": [np.hypot(*place[:2]), place[2]]}[geometry]
        entry = np.clip((np.array(local) - grid.origin) // (4 * grid.spacing), 0, np.array(shape) - 1).astype(int)
        expected[tuple(slice(max(k - 1, 0), k + 2) for k in entry)] = 1
    np.testing.assert_array_equal(near, expected)
    low, high = local_range(lines, geometry)
    t = np.linspace(0.0, 1.0, 2001)[:, None, None] * length[:, None]
    points = (start + t * way).reshape(-1, 3)
    local = {"volume": points, "planar": points[:, 1:], "axisymmetric": np.c_[np.hypot(*points[:, :2].T), points[:, 2]]}
    assert low == pytest.approx(local[geometry].min(axis=0), abs=1e-6)
    assert high == pytest.approx(local[geometry].max(axis=0), abs=1e-6)


# --- lines, supports, counts -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("until", [None, Plane((0.0, 0.3, 9.0), (0.1, 0.5, 1.0))])
@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_lines_through_a_part_of_a_field(geometry: str, until):
    """From the entry into the part to its end or the stop; lever arms from there to the stop, or the box's end."""
    field = field_of(geometry)
    rng = np.random.default_rng(84)
    position = np.c_[rng.uniform(-1.5, 1.5, (200, 2)), rng.uniform(-4.0, 6.0, 200)]
    direction = rng.normal((0.0, 0.0, 1.0), 0.3, (200, 3))
    rays = RayBundle(position, direction)
    position, direction = rays.position, rays.direction
    low, high = np.array(field.samples.low) + 0.9, np.array(field.samples.high) - 0.8
    if geometry == "axisymmetric":
        low[0] = 0.0
    lines = lines_through(field, rays, until, low, high)

    def ends(lowest, highest, row):
        t = np.arange(0.0, 40.0, 0.01)
        place = position[row] + t[:, None] * direction[row]
        local = place[:, 3 - len(lowest) :]
        if geometry == "axisymmetric":
            local = np.c_[np.hypot(place[:, 0], place[:, 1]), place[:, 2]]
        inside = np.flatnonzero(((local >= lowest) & (local <= highest)).all(axis=1))
        return (t[inside[0]], t[inside[-1]]) if len(inside) else (1.0, 0.0)

    number = 0
    for row in range(200):
        enter, leave = ends(low, high, row)
        stop = np.inf
        if until is not None:
            stop = ((until.point - position[row]) @ until.normal) / (direction[row] @ until.normal)
            leave = min(leave, stop if stop > 0.0 else np.inf)
        if abs(leave - enter) < 0.05:  # told by the samples' distance
            number += bool(
                number < len(lines.start) and (np.abs(lines.direction[number] - direction[row]) == 0.0).all()
            )
            continue
        if leave < enter:
            continue
        assert (lines.direction[number] == direction[row]).all()
        assert lines.start[number] == pytest.approx(position[row] + enter * direction[row], abs=0.011)
        assert lines.length[number] == pytest.approx(leave - enter, abs=0.021)
        if until is not None:
            cosine = abs(direction[row] @ until.normal)
            tangent = np.sqrt(1.0 - cosine**2) / cosine if stop > 0.0 else 0.0
            assert lines.tangent[number] == pytest.approx(tangent, rel=1e-9)
            lever_arm = tangent * (stop - enter) if stop > 0.0 else 0.0
            assert lines.lever_arm[number] == pytest.approx(lever_arm, abs=0.02 * (1.0 + tangent))
        else:
            out = ends(np.asarray(field.samples.low), np.asarray(field.samples.high), row)[1]
            assert lines.lever_arm[number] == pytest.approx(lines.tangent[number] * (out - enter), rel=0.02)
        number += 1
    assert number == len(lines.start) > 40
    every = lines.every(7)
    np.testing.assert_array_equal(every.lever_arm, lines.lever_arm[::7])
    assert len(every.start) == len(every.tangent) == len(every.length) == -(-number // 7)
    rows = outermost_rays(geometry, position, direction, until, low, high)
    for k, vectors in enumerate((position, direction)):
        assert rows[6 * k : 6 * k + 6].tolist() == np.ravel([(c.argmin(), c.argmax()) for c in vectors.T]).tolist()
    rows = rows[12:]
    both = (lines.start, lines.start + lines.length[:, None] * lines.direction)
    kept = [int(np.flatnonzero((lines.direction == direction[row]).all(axis=1))[0]) for row in rows]
    for k, place in enumerate(both):
        local = {"volume": place, "planar": place[:, 1:]}.get(geometry)
        local = np.c_[np.hypot(*place[:, :2].T), place[:, 2]] if local is None else local
        size = local.shape[1]
        chosen = local[kept[2 * size * k : 2 * size * (k + 1)]]
        assert np.diag(chosen[::2]) == pytest.approx(local.min(axis=0), abs=1e-12)
        assert np.diag(chosen[1::2]) == pytest.approx(local.max(axis=0), abs=1e-12)
    assert lines.length[kept[-1]] == pytest.approx(lines.length.max())
    assert outermost(np.array([[1.0, 5.0], [0.0, 7.0], [4.0, 6.0]])).tolist() == [1, 2, 0, 1]


def test_lines_that_begin_in_a_body_are_taken_from_where_they_leave_it():
    """A square from y = 0 to 1, z = 2 to 4: from inside, from ahead of it, beside it, and behind it."""
    field = field_of("planar")
    body = Body([[0.0, 2.0], [1.0, 2.0], [1.0, 4.0], [0.0, 4.0]], "planar")
    field = dataclasses.replace(field, body=body)
    start = np.array([[0.0, 0.5, 3.0], [0.0, 0.5, 1.0], [0.0, 1.5, 3.0], [0.0, 0.5, 5.0]])
    low, high = np.array(field.samples.low), np.array(field.samples.high)
    lines = lines_through(field, RayBundle(start, [0.0, 0.0, 1.0]), None, low, high)
    np.testing.assert_allclose(lines.start[:, 2], [4.0, 1.0, 3.0, 5.0])
    np.testing.assert_allclose(lines.length, high[1] - np.array([4.0, 1.0, 3.0, 5.0]))
    many = RayBundle(np.tile(start, (100, 1)), [0.0, 0.0, 1.0])  # of which some are looked at
    some = lines_through(field, many, None, low, high)
    assert set(np.round(some.start[:, 2], 9)) == {4.0, 1.0, 3.0, 5.0} and 192 <= len(some.start) < 250


@pytest.mark.parametrize("geometry", GEOMETRIES)
def test_what_a_support_may_leave_out(geometry: str):
    """A twentieth of the tolerance over the longest path; slopes over path and lever arm, where these count."""
    field = field_of(geometry)
    size = (np.array(field.samples.high) - field.samples.low) * ([2.0, 1.0] if geometry == "axisymmetric" else 1.0)
    longest = np.linalg.norm(size)
    assert SUPPORT_SHARE == 0.05
    assert left_out(field, 3e-6, None) == pytest.approx((0.05 * 3e-6 / longest, np.inf))
    path = 3.0 * longest
    assert left_out(field, 3e-6, LeverArms(path, path, 0.2)) == pytest.approx((0.05 * 3e-6 / path, np.inf))
    assert left_out(field, 3e-6, LeverArms(0.1, 0.1, 0.2))[0] == pytest.approx(0.05 * 3e-6 / longest)
    found = left_out(field, 3e-6, LeverArms(path, 2.0 * path, 40.0))
    assert found == pytest.approx((0.05 * 3e-6 / path, 0.05 * 3e-6 / (path * 40.0)))
    # Flights of more than twice the path count with the deflection, here the greatest, 0.05 rad.
    found = left_out(field, 3e-6, LeverArms(path, 2.0 * path + 100.0, 40.0))
    assert found[1] == pytest.approx(0.05 * 3e-6 / (path * (40.0 + 100.0 * 0.05)))


def test_cells_on_the_longest_path():
    """The box of the part is met by its nearest faces; of an axisymmetric one it is as wide as its diameter."""
    low, high = np.array([0.5, 1.0, 2.0]), np.array([1.5, 4.0, 7.0])
    direction = np.array([[0.6, 0.0, 0.8], [0.0, 0.6, 0.8], [0.0, 0.0, 1.0], [0.48, 0.6, 0.64]])
    rays = RayBundle(np.zeros((4, 3)), direction)
    field = field_of("volume")
    length = [1.0 / 0.6, 3.0 / 0.6, 5.0, 1.0 / 0.48]
    cells = [s * np.linalg.norm(d / np.array([0.5, 0.7, 0.9])) for s, d in zip(length, direction, strict=True)]
    for row in range(4):
        assert _greatest_cells(field, rays.rows([row]), low, high) == pytest.approx(cells[row], rel=1e-9)
    assert _greatest_cells(field, rays, low, high) == pytest.approx(max(cells), rel=1e-9)
    flat = _greatest_cells(field_of("planar"), rays.rows([1]), low[1:], high[1:])
    assert flat == pytest.approx(cells[1], rel=1e-9)
    round_ = _greatest_cells(field_of("axisymmetric"), rays.rows([3]), np.array([0.0, 2.0]), np.array([1.5, 7.0]))
    expected = min(3.0 / 0.48, 3.0 / 0.6, 5.0 / 0.64) * np.linalg.norm(direction[3] / np.array([0.7, 0.7, 0.9]))
    assert round_ == pytest.approx(expected, rel=1e-9)
    assert _greatest_cells(field, rays, low, low) == 0.0
