"""Parts of bundles: lattices and patches, roughness at every width, distances from bodies."""

from itertools import product

import numpy as np
import pytest

from aerokernels import Plane
from aerokernels.medium import Body
from aerokernels.tracing.bundle.family import Family
from aerokernels.tracing.bundle.lattice import WINDOW, Lattice, finer, hermite_weights, no_lines, patches, slope_matrix
from aerokernels.tracing.bundle.refine import _block_of, _middles, _occupied
from aerokernels.tracing.bundle.table import Traced, map_of
from aerokernels.tracing.bundle.tubes import Clearance, Distances, _halved, distances_of, roughness_of
from aerokernels.tracing.step_bound import roughness_of_blocks

from .box_of_air import UP, field_of

# --- lattices and patches --------------------------------------------------------------------------------------------


def test_a_coarsest_lattice_has_about_square_cells():
    """Two blocks each way on a square, 8 at the most along a strip; halved, it keeps the nodes that both share."""
    for extent, blocks in (((3.0, 3.0), (2, 2)), ((3.0, 1.0), (3, 1)), ((1.0, 9.0), (1, 6)), ((100.0, 1.0), (8, 1))):
        low = np.array([0.3, -0.7])
        made = Lattice.coarsest(low, low + extent)
        assert made.blocks == blocks and made.row.shape == tuple(4 * count + 1 for count in blocks)
        np.testing.assert_allclose(made.step * 4 * np.array(blocks), extent)
        last = np.array(made.row.shape) - 1
        np.testing.assert_allclose(made.parameters(np.array([[0, 0], last])), [low, low + extent])
    lattice = Lattice.empty(np.zeros(2), np.array([0.5, 0.25]), (2, 1), no_lines())
    nodes = np.array([[0, 0], [3, 2], [8, 4]])
    values = np.arange(24.0).reshape(3, 8)
    lattice.put(nodes, Traced(values, np.array([5, 6, 7]), np.arange(9.0).reshape(3, 3)))
    fine = lattice.halved()
    assert fine.blocks == (4, 2) and fine.step.tolist() == [0.25, 0.125] and np.count_nonzero(fine.row) == 3
    rows = fine.row[tuple(2 * nodes.T)]
    np.testing.assert_array_equal(fine.lines.values[rows], values)
    assert fine.lines.line_class[rows].tolist() == [5, 6, 7]
    again = Lattice.empty(np.zeros(2), np.array([0.5, 0.25]), (2, 1), no_lines())
    again.take_over(fine)
    np.testing.assert_array_equal(again.row, lattice.row)
    np.testing.assert_array_equal(again.lines.costs, lattice.lines.costs)
    # Of the second block along the first axis all nodes but the two that were traced.
    missing = lattice.missing(np.array([[1, 0]]))
    expected = [(i, j) for i in range(4, 9) for j in range(5) if (i, j) != (8, 4)]
    assert [tuple(node) for node in missing.tolist()] == expected
    assert np.isnan(lattice.lines.values[lattice.row[1, 1]]).all()


def filled(blocks: tuple[int, int], value) -> Lattice:
    """A lattice of which every node holds a function of its parameters, in one class."""
    lattice = Lattice.empty(np.array([0.2, -0.3]), np.array([0.1, 0.15]), blocks, no_lines())
    nodes = np.argwhere(lattice.row == 0)
    u, v = lattice.parameters(nodes).T
    costs = np.c_[u + v, np.arange(len(nodes)), -np.arange(len(nodes))]
    lattice.put(
        nodes, Traced(np.stack([(k + 1.0) * value(u, v) for k in range(8)], axis=1), 0 * nodes[:, 0] + 3, costs)
    )
    return lattice


def test_what_blocks_hold():
    """Classes, costs and whether all nodes are good, block by block, from slices of the arrays."""
    lattice = filled((3, 2), lambda u, v: u * v)
    lines, row_of = lattice.lines, lattice.row
    lines.values[row_of[5, 6]] = np.nan
    lines.line_class[row_of[9:, :4]] = 4
    lines.line_class[row_of[9, 8]] = -1
    blocks = np.argwhere(np.ones((3, 2), bool))
    uniform, costs = lattice.are_uniform(blocks), lattice.block_costs(blocks)
    for row, (i, j) in enumerate(blocks):
        part = slice(4 * i, 4 * i + 5), slice(4 * j, 4 * j + 5)
        there = lines.line_class[row_of[part]]
        one_class = len(set(there.ravel())) == 1 and there.min() >= 0
        assert uniform[row] == (one_class and np.isfinite(lines.values[row_of[part]]).all())
        np.testing.assert_array_equal(costs[row], lines.costs[row_of[part]].max(axis=(0, 1)))
        assert lattice.block_classes(blocks)[row] == there[0, 0]
    assert uniform.any() and not uniform.all()
    low, half = lattice.low, 2.0 * lattice.step
    middle, found = _middles(lattice, blocks)
    np.testing.assert_allclose(middle, low + (2 * blocks + 1) * half)
    np.testing.assert_allclose(found, half)
    inside = middle + 0.99 * half * [1.0, -1.0]
    np.testing.assert_array_equal(_block_of(lattice, inside), blocks)
    np.testing.assert_array_equal(_block_of(lattice, low + np.array([[-9.0, 9.0]])), [[0, 1]])
    np.testing.assert_array_equal(_occupied(lattice, inside[[4, 1, 1]]), blocks[[1, 4]])


def test_patches_of_a_lattice_are_exact_for_cubics():
    """Products of cubics come back at all nodes of half the step, with nodes beside a block or without: surplus 0.

    A node off by d on the finer lattice is reported as d over the scale, an untraced one as 0, one that failed as
    infinite.
    """

    def cubic(u, v):
        return (1.0 - u + 2 * u**2 - u**3) * (0.5 + v - 0.3 * v**3)

    lattice, blocks = filled((3, 2), cubic), np.argwhere(np.ones((3, 2), bool))
    made = lattice.patches(blocks, 4)
    assert made.shape == (6, 5, 5, 4, 4)
    for row, (i, j) in enumerate(blocks):
        nodes = np.argwhere(np.ones((9, 9), bool))
        u, v = (lattice.low + lattice.step * (4 * np.array([i, j]) + 0.5 * nodes)).T
        for channel in range(4):
            expected = (channel + 1) * cubic(u, v).reshape(9, 9)
            np.testing.assert_allclose(finer(made)[row, ..., channel], expected, rtol=1e-11)
    fine = filled((6, 4), cubic)
    fine.step = 0.5 * lattice.step
    nodes = np.argwhere(fine.row)
    u, v = fine.parameters(nodes).T
    fine.lines.values[fine.row[tuple(nodes.T)]] = np.stack([(k + 1.0) * cubic(u, v) for k in range(8)], axis=1)
    scale = np.linspace(1.0, 2.0, 8)
    fine.lines.values[fine.row[3, 5], 2] += 0.06
    fine.lines.values[fine.row[21, 13]] = np.nan
    fine.row[10, 10] = 0
    surplus = lattice.surplus(blocks, made, fine, scale)
    expected = np.zeros((6, 9, 9))
    expected[0, 3, 5] = 0.06 / scale[2]
    expected[5, 5, 5] = np.inf
    np.testing.assert_allclose(surplus, expected, atol=1e-10)
    # A quarter sees its own nodes and two beyond: of the fine lattice's block (a, b) those from 4 a - 2 to 4 a + 6.
    quarters = np.argwhere(np.ones((6, 4), bool))
    spread = lattice.spread(blocks, surplus, fine, quarters)
    sees = [abs(3 - 4 * a - 2) <= 4 and abs(5 - 4 * b - 2) <= 4 for a, b in quarters]
    np.testing.assert_allclose(spread, np.where(sees, 0.06 / scale[2], 0.0), atol=1e-10)


def test_surplus_is_seen_two_nodes_beyond_each_quarter():
    """Of random surplus at the nodes of some blocks: the greatest from node 4 a - 2 to 4 a + 6, none infinite."""
    lattice, fine = filled((3, 2), lambda u, v: u * v), filled((6, 4), lambda u, v: u * v)
    blocks, rng = np.array([[0, 1], [2, 0]]), np.random.default_rng(90)
    surplus = rng.uniform(size=(2, 9, 9))
    surplus[0, 4, 4] = np.inf
    table = np.zeros((25, 17))
    for (i, j), one in zip(blocks, surplus, strict=True):
        part = slice(8 * i, 8 * i + 9), slice(8 * j, 8 * j + 9)
        table[part] = np.maximum(table[part], np.where(np.isfinite(one), one, 0.0))
    quarters = np.argwhere(np.ones((6, 4), bool))
    found = lattice.spread(blocks, surplus, fine, quarters)
    for (a, b), one in zip(quarters, found, strict=True):
        assert one == table[max(4 * a - 2, 0) : 4 * a + 7, max(4 * b - 2, 0) : 4 * b + 7].max()


def test_slopes_of_patches_use_the_nearest_five_nodes():
    """Exact for quartics and off for quintics by the product of distances; the weights are Hermite's."""
    place = np.arange(WINDOW) - 2.0
    for low, high in product((False, True), repeat=2):
        matrix = slope_matrix(low, high)
        for power in range(5):
            expected = power * np.arange(5.0) ** max(power - 1, 0) if power else np.zeros(5)
            np.testing.assert_allclose(matrix @ place**power, expected, atol=1e-9)
        for node in range(5):
            first = min(max(node - 2, -2 if low else 0), 2 if high else 0)
            used = np.arange(first, first + 5)
            np.testing.assert_array_equal(np.flatnonzero(matrix[node]), [k + 2 for k in used if matrix[node, k + 2]])
            assert set(np.flatnonzero(np.abs(matrix[node]) > 1e-12) - 2) <= set(used)
            others = np.prod([node - k for k in used if k != node], dtype=float)
            assert matrix[node] @ place**5 - 5.0 * node**4 == pytest.approx(-others, abs=1e-8)
    u = np.array([0.0, 0.3, 1.0])
    for power in range(4):
        ends = [0.0**power, power * 0.0 ** max(power - 1, 0) if power else 0.0, 1.0, float(power)]
        np.testing.assert_allclose(ends @ hermite_weights(u), u**power, atol=1e-14)


def test_patches_of_one_window():
    """Value, slopes per cell along both axes, and the mixed slope by the block's own nodes: of x^3 y^2 + 2 x y."""
    place = np.arange(WINDOW) - 2.0
    x, y = np.meshgrid(place, place, indexing="ij")
    window = (x**3 * y**2 + 2 * x * y)[None, :, :, None]
    for beside in (True, False):
        usable = np.full((1, WINDOW, WINDOW), beside)
        usable[:, 2:7, 2:7] = True
        made = patches(np.where(usable[..., None], window, 0.0), usable)[0, ..., 0]
        a, b = x[2:7, 2:7], y[2:7, 2:7]
        for kind, expected in enumerate(
            (a**3 * b**2 + 2 * a * b, 3 * a**2 * b**2 + 2 * b, 2 * a**3 * b + 2 * a, 6 * a**2 * b + 2)
        ):
            np.testing.assert_allclose(made[..., kind], expected, atol=1e-8)


def test_nodes_beside_a_block_count_on_the_side_where_they_are():
    """Beyond one end of one axis only: slopes along it use them there, and those along the other axis do not."""
    window = np.random.default_rng(100).normal(size=(1, WINDOW, WINDOW, 1))
    for axis, is_high in product((0, 1), (False, True)):
        usable = np.zeros((1, WINDOW, WINDOW), bool)
        rows = slice(2, 9) if is_high else slice(0, 7)
        usable[:, rows, 2:7] = True
        usable = usable if axis == 0 else usable.swapaxes(1, 2)
        made = patches(np.where(usable[..., None], window, 0.0), usable)[0, ..., 0]
        inner = window[0, 2:7, 2:7, 0]
        lines = np.moveaxis(window[0, :, :, 0], axis, 0)[:, 2:7]
        expected = np.moveaxis(
            slope_matrix(not is_high, is_high) @ np.where(np.moveaxis(usable[0], axis, 0)[:, 2:7], lines, 0.0), 0, axis
        )
        np.testing.assert_allclose(made[..., 1 + axis], expected, atol=1e-12)
        own = slope_matrix(False, False)[:, 2:7]
        other = own @ inner if axis == 1 else inner @ own.T
        np.testing.assert_allclose(made[..., 2 - axis], other, atol=1e-12)


def test_the_map_of_blocks_of_several_widths():
    """Places of each level's blocks, numbered in the order given."""
    made = map_of((4, 8), [(2, np.array([[0, 3], [1, 0]])), (1, np.array([[0, 0], [1, 1]]))])
    expected = np.full((4, 8), -1)
    expected[0:2, 6:8], expected[2:4, 0:2], expected[0, 0], expected[1, 1] = 0, 1, 2, 3
    np.testing.assert_array_equal(made, expected)


# --- roughness and distances -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
@pytest.mark.parametrize("geometry", ["volume", "planar"])
def test_roughness_within_a_width(geometry: str, interpolation: str):
    """At least the greatest of any block that a tube of that width meets, and no more than nearby; 0 outside."""
    field = field_of(geometry, interpolation)
    found = roughness_of(field)
    _, fourth, kink = roughness_of_blocks(field.samples)
    table = np.stack([*(part**0.25 for part in fourth), *kink], axis=-1)
    np.testing.assert_allclose(found.size, 4 * np.array(field.samples.spacing))
    np.testing.assert_array_equal(found.cell, field.samples.spacing)
    rng = np.random.default_rng(92)
    low, high = np.array(field.samples.low), np.array(field.samples.high)
    place = rng.uniform(low, high, (60, len(low)))
    for width in (0.02, 1.5, 2.5, 50.0):
        rough = found.at(place, np.full(place.shape, width))
        for one, got in zip(place, rough, strict=True):
            first = np.maximum(np.floor((one - width - low) / found.size), 0).astype(int)
            last = np.minimum(np.floor((one + width - low) / found.size), np.array(table.shape[:-1]) - 1).astype(int)
            met = table[tuple(slice(a, b + 1) for a, b in zip(first, last, strict=True))]
            assert (got >= met.reshape(-1, met.shape[-1]).max(axis=0)).all()
            level = max(int(np.ceil(np.log2(np.max(width / found.size)))), 0)
            wide = found.size * 2.0 ** min(level, len(found.levels) - 1)
            entry = np.floor((one - low) / wide)
            first = np.maximum((entry - 1) * wide / found.size + 0.5, 0).astype(int)
            last = ((entry + 2) * wide / found.size + 0.5).astype(int)
            met = table[tuple(slice(a, b) for a, b in zip(first, last, strict=True))]
            np.testing.assert_allclose(got, met.reshape(-1, met.shape[-1]).max(axis=0), rtol=1e-12)
    outside = np.stack([low - 1.01 * found.size, high + 2.5 * found.size])
    assert not found.at(outside, np.full(outside.shape, 0.01)).any()
    beside = low[None] - 0.5 * found.size  # a block beside may have rough neighbours
    assert found.at(beside, np.full(beside.shape, 0.01)).max() > 0.0


def test_halved_tables_hold_the_greatest_of_pairs():
    """Two by two, what is over alone."""
    table = np.random.default_rng(93).uniform(size=(5, 4, 2))
    half = _halved(table)
    assert half.shape == (3, 2, 2)
    for i, j in product(range(3), range(2)):
        np.testing.assert_array_equal(half[i, j], table[2 * i : 2 * i + 2, 2 * j : 2 * j + 2].max(axis=(0, 1)))


def test_distances_from_a_body_are_never_too_great():
    """In the table the distance at the nearest place less the way to it; outside at least the way to the table."""
    body = Body([[0.5, 1.0], [1.5, 1.5], [0.5, 2.0]], "planar")
    field = field_of("planar", body=body)
    found = distances_of(field)
    assert found.table.shape == (192, 192)
    low, high = np.array(field.samples.low), np.array(field.samples.high)
    np.testing.assert_allclose([found.low, found.low + 191 * found.step], [low, high])
    place = np.random.default_rng(94).uniform(low - 2.0, high + 2.0, (300, 2))
    exact, bound = body.signed_distance(place), found.at_least(place)
    assert (bound <= np.maximum(exact, 0.0) + 1e-12).all() and (exact < 0.0).any()
    inside = ((place >= low) & (place <= high)).all(axis=1)
    assert (exact - bound)[inside].max() < 2.0 * np.linalg.norm(0.5 * found.step)
    beyond = np.linalg.norm(np.maximum(np.maximum(low - place, place - high), 0.0), axis=1)
    assert (bound >= beyond).all()
    table = Distances(np.array([1.0, 2.0]), np.array([0.5, 1.0]), np.array([[3.0, 4.0], [5.0, 6.0]]))
    assert table.at_least(np.array([[1.1, 2.0], [1.5, 3.0], [1.5, 8.0]])) == pytest.approx([2.9, 6.0, 5.0])


@pytest.mark.parametrize("converges", [False, True])
def test_blocks_that_stay_clear_of_a_body(converges: bool):
    """Tubes of lines along z beside a body at 0.5 < y: clear where their width and bend leave a gap, and not inside."""
    body = Body([[0.5, 1.0], [1.5, 1.5], [0.5, 2.0]], "planar")
    field = field_of("planar", body=body)
    origin = np.array([0.0, 0.0, -40.0]) if converges else np.array([0.0, 0.0, -1.0])
    scale = 45.0 if converges else 1.0  # metres per unit where the lines end
    family = Family(
        converges, origin, np.eye(3), -np.ones(2), np.ones(2), np.array([0.0, 0.0, -1.0]), UP, -np.inf, 1e-6
    )
    clearance = Clearance(field, family, Plane((0.0, 0.0, 5.0), UP))
    room = 0.5 * float(distances_of(field).step.max())
    for gap, bent, width, clear in (
        (0.4, 0.0, 0.2, True), (0.4, 0.25, 0.2, False), (0.4, 0.1, 0.2, True), (0.1, 0.0, 0.2, False),
        (0.4, 0.0, 0.45, False), (-0.5, 0.0, 0.01, False), (-1.6, 0.0, 0.3, True),
    ):  # fmt: skip
        at_body = 41.5 if converges else 1.0
        middle = np.array([[0.0, (0.5 - gap) / at_body]])
        half = np.array([0.0, width / scale])
        found = clearance.of_blocks(middle, half, bent)
        assert found[0] == clear, (gap, bent, width, room)
