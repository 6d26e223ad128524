"""Polynomials of cubes, high passes and lookups of missed structure, and the choice of a bundle's lines, exactly."""

from itertools import product

import numpy as np
import pytest

from aerokernels import IndexField, Plane
from aerokernels.medium.spline import weights
from aerokernels.tracing.blocks import block_maxima, block_means
from aerokernels.tracing.bundle.family import Family
from aerokernels.tracing.bundle.lattice import Lattice, hermite_weights
from aerokernels.tracing.bundle.refine import Limits, Refinement
from aerokernels.tracing.bundle.table import FaceClasses, Traced
from aerokernels.tracing.bundle.tubes import Tubes
from aerokernels.tracing.leapfrog import cube_polynomials as cubes
from aerokernels.tracing.leapfrog import missed_on_lines, unresolved
from aerokernels.tracing.leapfrog.high_pass import _held_share, high_pass
from aerokernels.tracing.leapfrog.unresolved import Sampling
from aerokernels.tracing.straight_lines import Lines
from tests.random_air import random_air

UP = np.array([0.0, 0.0, 1.0])


def field_of(geometry: str = "volume", counts=(10, 12, 15), samples=None, seed: int = 181) -> IndexField:
    """Cells of 0.5, 0.7 and 0.9 m; random air unless `samples` are given."""
    return random_air(
        geometry, seed, lambda random, shape: 1e-2 * random.normal(size=shape) if samples is None else samples, counts,
        (-2.0, -1.0, 0.0), (0.5, 0.7, 0.9), ambient_index=1.2,
    )  # fmt: skip


# --- cubes -----------------------------------------------------------------------------------------------------------


def spline_at(window: np.ndarray, place: np.ndarray, slope: int | None = None) -> np.ndarray:
    """The spline of a window of 5 x 5 x 5 coefficients, or a slope per cell, at places (n, 3) in cells."""
    found = np.zeros(len(place))
    for row, point in enumerate(place):
        cell = np.minimum(point.astype(int), 1)
        factors = [weights("cubic", np.array(point[k] - cell[k]))[int(k == slope)] for k in range(3)]
        part = window[tuple(slice(c, c + 4) for c in cell)]
        found[row] = np.einsum("abc,a,b,c", part, *factors)
    return found


@pytest.mark.parametrize("inside", [(2, 2, 2), (1, 2, 2), (2, 1, 1)])
def test_a_cube_has_the_polynomial_of_least_squares(inside: tuple[int, int, int]):
    """Over its cells in the grid, by Gauss points; deviations at nodes and middles, of value and of slope per metre."""
    window, spacing = np.random.default_rng(182).normal(size=(5, 5, 5)), np.array([0.5, 0.7, 0.9])
    operators, points = cubes._operators(inside, spacing)
    made = window.ravel() @ operators.astype(float)
    gauss, share = np.polynomial.legendre.leggauss(4)
    axes = [(np.arange(n)[:, None] + 0.5 * (gauss + 1)).ravel() for n in inside]
    place = np.array(list(product(*axes)))
    weight = np.array([np.prod(one) for one in product(*(np.tile(share, n) for n in inside))])
    powers = np.array(cubes.POWERS)

    def terms(at):
        return ((at - 1.0)[:, None, :] ** powers).prod(axis=2)  # from -1 to 1 over two cells

    root = np.sqrt(weight)
    expected = np.linalg.lstsq(terms(place) * root[:, None], spline_at(window, place) * root, rcond=None)[0]
    np.testing.assert_allclose(made[:20], expected, atol=2e-5)
    nodes = np.array(list(product(*(np.arange(n + 1.0) for n in inside))))
    middles = np.array(list(product(*(np.arange(n) + 0.5 for n in inside))))
    tested = np.concatenate([nodes, middles])
    assert points == len(tested)
    np.testing.assert_allclose(made[20 : 20 + points], spline_at(window, tested) - terms(tested) @ expected, atol=3e-5)
    rest = made[20 + points :].reshape(3, points)
    for axis in range(3):
        rate = powers[:, axis] * (tested[:, None, axis] - 1.0) ** np.maximum(powers[:, axis] - 1, 0)
        others = np.delete((tested - 1.0)[:, None, :] ** powers, axis, axis=2).prod(axis=2)
        off = (spline_at(window, tested, axis) - (rate * others) @ expected) / spacing[axis]
        np.testing.assert_allclose(rest[axis], off, atol=2e-4)


def test_rows_of_a_table_are_packed():
    """Ten whole floats, ten halves rounded to the nearest, and two bounds rounded up: no bound is lost."""
    rng = np.random.default_rng(183)
    numbers, value, slope = rng.normal(size=(20, 7)).astype(np.float32), rng.uniform(size=7), rng.uniform(size=7)
    packed = cubes._packed(numbers, value, slope)
    assert packed.shape == (7, 16) and cubes.WHOLE == 10 and packed.dtype == np.float32
    np.testing.assert_array_equal(packed[:, :10], numbers[:10].T)
    bits = np.ascontiguousarray(packed[:, 10:]).view(np.uint32)
    halves = np.stack([bits << np.uint32(16), bits & np.uint32(0xFFFF0000)], axis=-1).reshape(7, 12).view(np.float32)
    np.testing.assert_allclose(halves[:, :10], numbers[10:].T, rtol=2.0**-8)
    off = np.abs(halves[:, :10] - numbers[10:].T).sum(axis=1)
    for k, bound in ((10, value), (11, slope)):
        assert (halves[:, k] >= bound.astype(np.float32)).all() and (halves[:, k] <= bound * (1.0 + 2.0**-7)).all()
    value, cut = cubes._value_bound(numbers, np.abs(rng.normal(size=(5, 7))))
    np.testing.assert_allclose(cut, 2.0**-8 * np.abs(numbers[10:]).sum(axis=0), rtol=1e-6)
    assert (off <= cut).all() and off.max() > 0.2 * cut.max()
    assert cubes._parts(6) == [(slice(0, 3), 2)] and cubes._parts(7) == [(slice(0, 3), 2), (slice(3, 4), 1)]
    assert cubes._parts(1) == [(slice(0, 1), 1)]


def test_tables_that_may_be_made():
    """Of cubic volumes, where four bytes of each of 16 numbers of a cube fit the memory."""
    grid = field_of().samples  # 9, 11 and 14 cells: 5 x 6 x 7 cubes
    needed = 4.0 * 16 * 5 * 6 * 7
    assert cubes.may_have_cubes(grid, needed) and not cubes.may_have_cubes(grid, needed - 1)
    assert not cubes.may_have_cubes(field_of("planar").samples, 1e12)
    assert not cubes.may_have_cubes(field_of().with_interpolation("linear").samples, 1e12)
    assert cubes.cube_polynomials(grid).shape == (5, 6, 7, 16)


def test_deviations_along_lines_are_means_over_cubes():
    """Of 24 places of each line: the bound of the whole cube that holds it, times the line's length."""
    grid = field_of().samples
    start, length = np.array([[-1.7, -0.8, 0.3], [0.4, 3.9, 8.9]]), np.array([7.0, 5.0])
    way = np.array([[0.28, 0.0, 0.96], [0.0, -0.6, -0.8]])
    found = cubes.approximate_deviation(grid, Lines(start, way, length, 0 * length, 0 * length))
    operators, points = cubes._operators((2, 2, 2), grid.spacing)
    for row in range(2):
        total = 0.0
        for k in range(24):
            place = start[row] + (k + 0.5) / 24 * length[row] * way[row]
            cube = np.clip((place - grid.origin) / (2 * grid.spacing), 0, np.array([4, 5, 7]) - 1).astype(int)
            window = grid.coefficients[tuple(slice(2 * c, 2 * c + 5) for c in cube)]
            made = window.ravel().astype(np.float32) @ operators
            total += 1.5 * np.abs(made[20 : 20 + points]).max() + 2.0**-8 * np.abs(made[10:20]).sum()
        assert found[row] == pytest.approx(total / 24 * length[row], rel=1e-4)


# --- high passes -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("edge", [0.92, 0.4])
@pytest.mark.parametrize("rate", [0.7, 1.0, 1.3, 2.2])
def test_a_cosine_along_the_rays_is_passed_by_its_share(rate: float, edge: float):
    """Its own share and those of its images that count, each by 1 - exp(-(phi H / edge)^p); the rest as its own."""
    count = 15
    for k in (1, 5, 9, 14):
        wave = np.cos(np.pi * k * np.arange(count) / (count - 1))
        field = field_of("planar", samples=np.broadcast_to(1e-3 * wave, (12, count)))
        grid = field.samples
        potential = grid.samples * (1.0 + grid.samples / 2.4)
        found = high_pass(grid, np.array([0.0, 1.0]), rate * 0.9, edge, True)
        # All cosines of the potential, which is not quite one: each by its share.
        cosines = np.cos(np.pi * np.outer(np.arange(count), np.arange(count)) / (count - 1))
        amount = np.linalg.solve(cosines, potential[0])
        v = np.arange(count) / (2.0 * (count - 1))
        images = ([-1] if rate > 0.8 else []) + ([1, -2] if rate < 1.35 else [])

        def left(at):
            return 1.0 - np.exp(-(np.minimum((rate * at / edge) ** 2, 2.0) ** (12 if edge > 0.5 else 1.5)))

        share, rest = np.zeros(count), np.ones(count)
        for image in images:
            held = _held_share(np.abs(v + image)) if rate > 0.8 else np.ones(count)
            share, rest = share + held * left(np.abs(v + image)), rest - held
        share = share + rest * left(v)
        np.testing.assert_allclose(found[3], cosines @ (share * amount), atol=1e-15)
        assert np.ptp(found, axis=0).max() < 1e-15
    none = high_pass(grid, np.array([0.0, 1e-4]), 0.9, 0.92, False)
    assert not none.any() and none.dtype == np.float32


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_lookups_along_rays(geometry: str):
    """The greatest of three blocks across the rays, means over three along them and a tenth; summed along lines."""
    field = field_of(geometry, (26, 28, 47))
    steep = (0.1, 0.3, 1.0)
    sampling = Sampling(1.5, steep, 0.4)
    block, missed = unresolved.missed_in_blocks(field, sampling)
    assert block == 4
    found = unresolved.lookup_table(field, sampling)[1]
    expected = missed
    across = {"volume": (0.1, 0.3), "planar": (0.3,), "axisymmetric": (np.hypot(0.1, 0.3),)}[geometry]
    for axis, steepness in enumerate(across):
        assert 0.05 < steepness < 0.5
        moved = np.moveaxis(expected, axis, 0)
        edge = np.zeros_like(moved[:1])
        whole = np.concatenate([edge, moved, edge])
        expected = np.moveaxis(np.max([whole[:-2], whole[1:-1], whole[2:]], axis=0), 0, axis)
    padded = np.concatenate([expected[..., :1], expected, expected[..., -1:]], axis=-1)
    expected = 1.1 * (padded[..., :-2] + padded[..., 1:-1] + padded[..., 2:]) / 3.0
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    start = np.array([[0.2, 0.3, 0.4], [-0.3, 0.5, 2.0]])
    way, length = np.array([[0.0, 0.28, 0.96], [0.0, 0.0, 1.0]]), np.array([20.0, 11.0])
    lines = Lines(start, way, length, np.array([0.7, 0.0]), np.zeros(2))
    size = 4 * np.array(field.samples.spacing)
    count = int(np.ceil(20.0 / (1.5 * size.min())))
    for row, got in enumerate(missed_on_lines.missed_along(field, sampling, lines)):
        total = 0.0
        for k in range(count):
            place = start[row] + (k + 0.5) / count * length[row] * way[row]
            local = {"volume": place, "planar": place[1:], "axisymmetric": [np.hypot(*place[:2]), place[2]]}[geometry]
            entry = np.clip(np.floor((np.array(local) - field.samples.low) / size), 0, np.array(found.shape) - 1)
            total += found[tuple(entry.astype(int))]
        factor = 1.0 + 2.0 / min(field.samples.spacing) * lines.lever_arm[row]
        assert got == pytest.approx(total * length[row] / count * factor, rel=1e-9)


def test_means_along_rays_in_blocks():
    """Along the main axis the mean, across it the greatest: of each mean for level rays, before it for steep ones."""
    grid = field_of("planar", (1, 14, 20)).samples
    size = np.abs(np.random.default_rng(184).normal(size=grid.shape))
    level, steep, none = (Sampling(1.0, one, 0.0) for one in ((0.0, 0.2, 1.0), (0.0, 0.3, 1.0), (0.0, 1.0, 1.0)))
    found = unresolved._by_blocks(grid, "planar", level, size.__getitem__)
    np.testing.assert_allclose(found, block_maxima(block_means(size, 4, 1), 4, [0]))
    found = unresolved._by_blocks(grid, "planar", steep, size.__getitem__)
    np.testing.assert_allclose(found, block_means(block_maxima(size, 4, [0]), 4, 1))
    np.testing.assert_allclose(unresolved._by_blocks(grid, "planar", none, size.__getitem__), block_maxima(size, 4))
    ends = np.random.default_rng(185).integers(0, 2, (4, 5)).astype(np.uint8)
    given = Sampling(1.0, (0.0, 0.2, 1.0), 0.0, True, np.packbits(ends).tobytes())
    np.testing.assert_array_equal(unresolved._ends_of(grid, given), ends)
    assert not unresolved._ends_of(grid, level).any() and unresolved._ends_of(grid, level).shape == (4, 5)


# --- bundles ---------------------------------------------------------------------------------------------------------


class Lines2:
    """A smooth, or a kinked, OPD of each line's start, in place of a trace; counts the rays."""

    def __init__(self, law):
        self.law, self.count = law, 0

    def __call__(self, rays):
        self.count += rays.ray_count
        x, y, _ = rays.position.T
        zero = np.zeros(rays.ray_count)
        arrays = {"opd": self.law(x, y), "direction": rays.direction, "position": rays.position + 9.0 * rays.direction}
        arrays |= {
            "arc_length": zero + 9.0,
            "step_error": zero + 1e-9,
            "step_count": zero + 7,
            "evaluation_count": zero + 21,
        }
        return arrays | {"status": np.zeros(rays.ray_count, int)}


def refined(law, limit: float, rays: int = 10**7, channels: int = 1):
    low, high, until = np.array([-1.0, -2.0]), np.array([1.0, 2.0]), Plane((0.0, 0.0, 9.0), UP)
    family = Family(False, np.zeros(3), np.eye(3), low, high, np.zeros(3), UP, -np.inf, 1e-6)
    still = field_of(samples=np.zeros((10, 12, 15)))
    classes, tracer = FaceClasses(still, until, np.zeros(7, bool)), Lines2(law)
    tubes = Tubes.of(still, family, until, False)
    work = Refinement(family, classes, tracer, tubes, None, Limits(limit, np.full(8, limit)), channels)
    counted = np.random.default_rng(186).uniform([-1.0, -2.0], [1.0, 2.0], (20000, 2))
    return work, tracer, work.run(counted, rays / 20000), counted


def delivered(table, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values of the patches at parameters, by the header of the block on the map; nan where there is none."""
    place = ((parameters - table.family.low) * table.rate).astype(int)
    number = table.map[tuple(np.minimum(place, np.array(table.map.shape) - 1).T)]
    found = np.full(len(parameters), np.nan)
    for row in np.flatnonzero(number >= 0):
        head, values = table.header[number[row]], table.values[number[row]]
        u, v = (parameters[row] - head[:2]) * head[2:4]
        assert -1e-9 <= min(u, v) and max(u, v) <= 4.0 + 1e-9
        i, j = min(int(u), 3), min(int(v), 3)
        a, b = hermite_weights(np.array(u - i)), hermite_weights(np.array(v - j))
        total = 0.0
        for p, q in product(range(2), range(2)):
            node = values[i + p, j + q, :, 0].astype(float)
            total += a[2 * p] * b[2 * q] * node[0] + a[2 * p + 1] * b[2 * q] * node[1]
            total += a[2 * p] * b[2 * q + 1] * node[2] + a[2 * p + 1] * b[2 * q + 1] * node[3]
        found[row] = total
    return found, number


@pytest.mark.parametrize("limit", [1e-3, 1e-5, 1e-8])
def test_smooth_bundles_are_interpolated_within_the_limit(limit: float):
    """Everywhere, from fewer lines the laxer the limit is; costs of the lines are in the headers."""

    def law(x, y):
        return np.sin(2.0 * x + 0.3) * np.cos(1.3 * y)

    work, tracer, table, counted = refined(law, limit)
    found, number = delivered(table, counted[:400])
    assert np.isfinite(found).all()
    assert np.abs(found - law(*counted[:400].T)).max() <= limit
    assert table.traced == tracer.count == work.traced and not table.refused
    assert 0.0 < table.error <= 1.5 * limit
    np.testing.assert_array_equal(table.header[:, 4], 0.0)
    np.testing.assert_array_equal(table.header[:, 6:], np.tile([7.0, 21.0], (len(table.header), 1)))
    assert (table.header[:, 5] > 1e-9).all() and (table.header[:, 5] <= 1e-9 + 1.1 * limit).all()
    assert set(number) <= set(range(len(table.header)))


def test_laxer_limits_take_fewer_lines():
    """And lines are traced once each."""

    def law(x, y):
        return np.sin(2.0 * x + 0.3) * np.cos(1.3 * y)

    traced = [refined(law, limit)[2].traced for limit in (1e-3, 1e-6, 1e-9)]
    assert traced[0] <= traced[1] < traced[2]


def test_rays_at_a_kink_are_traced_one_by_one():
    """|x - 0.3|: blocks that hold the kink are refused for rough results, about as many rays as lie in them."""
    rays = 10**6
    _, tracer, table, counted = refined(lambda x, y: np.abs(x - 0.3) + 0.1 * y, 1e-6, rays)
    found, number = delivered(table, counted)
    good = number >= 0
    assert np.abs(found - (np.abs(counted[:, 0] - 0.3) + 0.1 * counted[:, 1]))[good].max() <= 1e-6
    assert set(table.refused) == {"rough results"}
    assert table.refused["rough results"] == pytest.approx(rays * (~good).mean(), rel=1e-9)
    left = counted[~good, 0]
    assert 0.0 < (~good).mean() < 0.6 and left.min() < 0.3 < left.max()
    few = refined(lambda x, y: np.abs(x - 0.3) + 0.1 * y, 1e-6, 20000)[2]  # for which no more lines pay
    assert few.traced <= tracer.count


def test_nothing_smooth_has_no_table():
    """Noise: no block is accepted, and no table is made; all rays are refused."""
    rng = np.random.default_rng(187)
    work, _, table, _ = refined(lambda x, y: rng.normal(size=x.shape), 1e-6, 20000)
    assert table is None and sum(work.refused.values()) == pytest.approx(20000.0)


def test_the_greatest_displacement_of_lines():
    """Of the three numbers of the end point, of either sign, of lines that were traced; 0 where none was."""
    lattice = Lattice.coarsest(np.zeros(2), np.ones(2))
    assert lattice.bent == 0.0
    values = np.array([[9.0, 8.0, 7.0, 6.0, 1.0, -3.0, 2.0, 5.0], [9.0, 8.0, 7.0, 6.0, 1.0, 0.5, -2.5, -5.0]])
    lattice.put(np.array([(1, 2), (3, 3)]), Traced(values, np.zeros(2, int), np.zeros((2, 3))))
    assert lattice.bent == 3.0
