"""Pupils cell by cell and point by point: coverage, grids, Gauss points and maps of the unit square."""

import math

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Mask, Polygon, Rectangle
from aerokernels.pupils import as_unit_vector
from aerokernels.pupils.disc import _ring_gauss, _ring_grid, area_below
from aerokernels.pupils.pixels import _overlap
from aerokernels.pupils.polygon import _ears, _first_crossing, _under_edge
from aerokernels.pupils.square_map import _locate, cumulative

CORNERS = np.array(
    [[-1.0, -0.6], [0.2, -1.1], [1.3, -0.2], [0.4, 0.1], [0.7, 1.0], [-0.8, 0.7]]
)  # one of them re-entrant
VALUES = np.array([[0.0, 0.4, 1.0], [0.7, 0.0, 0.2]])


def inside(corners: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Winding number of a polygon about points."""
    turned = np.zeros(np.shape(x))
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        first, second = complex(*a) - (x + 1j * y), complex(*b) - (x + 1j * y)
        turned += np.angle(second / first)
    return np.abs(turned) > math.pi


def test_cells_of_a_circle_by_fine_rows():
    """The area left of x and below y: chords of ten thousand rows."""
    rows = (np.arange(20_000) + 0.5) / 10_000 - 1.0
    half = np.sqrt(1.0 - rows**2)
    for x in (-1.0, -0.7, 0.0, 0.4, 1.0):
        for y in (-1.0, -0.5, 0.0, 0.3, 0.9, 1.0):
            chord = np.clip(np.minimum(x, half) + half, 0.0, None) * (rows < y)
            assert float(area_below(np.array(x), np.array(y))) == pytest.approx(chord.sum() / 10_000, abs=2e-4)


@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize(
    "pupil",
    [
        Disc(1.2),
        Annulus(1.2, 0.5),
        Rectangle(2.0, 1.4),
        Polygon(CORNERS),
        Polygon(CORNERS[::-1]),
        Mask(VALUES, (0.8, 1.1)),
    ],
)
def test_coverage_is_the_mean_over_a_cell(pupil, power: int):
    """By 300 x 300 points to each of some uneven cells, from beside the pupil to beyond it."""
    x_edges, y_edges = np.array([-1.5, -0.9, -0.2, 0.05, 0.8, 1.6]), np.array([-1.4, -0.55, 0.1, 0.6, 1.5])
    found = pupil.coverage(x_edges, y_edges, power)
    share = (np.arange(300) + 0.5) / 300
    for i in range(4):
        for j in range(5):
            x = x_edges[j] + (x_edges[j + 1] - x_edges[j]) * share
            y = (y_edges[i] + (y_edges[i + 1] - y_edges[i]) * share)[:, None] + 0.0 * x
            x = x + 0.0 * y
            if isinstance(pupil, Polygon):
                value = inside(CORNERS, x, y).astype(float)
            elif isinstance(pupil, Mask):
                column, row = np.floor(x / 0.8 + 1.5).astype(int), np.floor(y / 1.1 + 1.0).astype(int)
                there = (column >= 0) & (column < 3) & (row >= 0) & (row < 2)
                value = np.where(there, VALUES[np.clip(row, 0, 1), np.clip(column, 0, 2)], 0.0)
            elif isinstance(pupil, Rectangle):
                value = ((np.abs(x) < 1.0) & (np.abs(y) < 0.7)).astype(float)
            else:
                radius = np.hypot(x, y)
                value = ((radius < 1.2) & (radius > getattr(pupil, "inner_radius", 0.0))).astype(float)
            assert found[i, j] == pytest.approx((value**power).mean(), abs=6e-3)
            np.testing.assert_array_equal(pupil.transmission(x[:3, :3], y[:3, :3]), value[:3, :3])


def test_sizes_of_pupils():
    ring = Annulus(1.2, 0.5)
    assert ring.area == pytest.approx(math.pi * (1.44 - 0.25)) and ring.inner_ratio == pytest.approx(0.5 / 1.2)
    assert ring.half_extent == (1.2, 1.2) and ring.reach == 1.2 and Disc(1.2).inner_ratio == 0.0
    mask = Mask(VALUES, (0.8, 1.1))
    assert mask.area == pytest.approx(VALUES.sum() * 0.88) and mask.half_extent == pytest.approx((1.2, 1.1))
    assert mask.reach == pytest.approx(math.hypot(1.2, 1.1)) and mask._lit_area == pytest.approx(4 * 0.88)
    shape = Polygon(CORNERS)
    x, y = CORNERS.T
    area = 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    assert shape.area == pytest.approx(area) and Polygon(CORNERS[::-1]).area == pytest.approx(area)
    assert shape.half_extent == pytest.approx((1.3, 1.1)) and shape.reach == pytest.approx(np.hypot(x, y).max())
    # Rims belong to the pupil.
    assert Disc(1.0).transmission(np.array([1.0, 1.001]), np.zeros(2)).tolist() == [1.0, 0.0]
    assert ring.transmission(np.array([0.5, 0.499]), np.zeros(2)).tolist() == [1.0, 0.0]
    assert mask.transmission(np.array([1.2, 1.2001]), np.array([-1.1, 0.0])).tolist() == [1.0, 0.0]


@pytest.mark.parametrize("inner", [0.0, 0.6])
@pytest.mark.parametrize("count", [1, 37, 400])
def test_points_of_rings(inner: float, count: int):
    """Cells' middles in the ring; Gauss points in r^2 on even angles, exact for polynomials."""
    side = max(1, round(math.sqrt(4.0 * count / math.pi / (1.0 - inner**2))))
    middle = (np.arange(side) + 0.5) * 2.0 / side - 1.0
    expected = [(a, b) for a in middle for b in middle if inner**2 <= a * a + b * b <= 1.0]
    found, weight = _ring_grid(count, inner)
    if expected:
        np.testing.assert_allclose(found, expected, atol=1e-15)
        np.testing.assert_allclose(weight, 1.0 / len(expected))
    points, weights = _ring_gauss(count, inner)
    rings = max(1, round(math.sqrt(count / 4.0)))
    angles = max(1, round(count / rings))
    assert len(points) == rings * angles and weights.sum() == pytest.approx(1.0)
    square = (points**2).sum(axis=1)
    for power in range(2 * rings):
        exact = (1.0 - inner ** (2 * power + 2)) / (power + 1) / (1.0 - inner**2)
        assert weights @ square**power == pytest.approx(exact)
    angle = np.sort(np.unique(np.round(np.arctan2(*points.T[::-1]) % (2.0 * math.pi), 9)))
    np.testing.assert_allclose(angle, 2.0 * math.pi * (np.arange(angles) + 0.5) / angles, atol=1e-8)


@pytest.mark.parametrize("pupil", [Polygon(CORNERS), Mask(VALUES, (0.8, 1.1)), Rectangle(2.0, 1.4)])
def test_points_of_a_pupil_have_its_moments(pupil):
    """Gauss points: exactly to third order, by a fine lattice; grids of cells' middles with their weights."""
    place = (np.arange(1200) + 0.5) / 1200 * 3.0 - 1.5
    x, y = np.meshgrid(place, place)
    light = pupil.transmission(x, y)
    points, weight = pupil.flat_sample(300, "gauss", 0)
    points = points * pupil.reach
    for power in ((0, 1), (1, 0), (2, 0), (1, 1), (0, 2), (3, 0), (1, 2)):
        exact = (light * x ** power[0] * y ** power[1]).sum() / light.sum()
        assert weight @ (points[:, 0] ** power[0] * points[:, 1] ** power[1]) == pytest.approx(exact, abs=3e-3)
    grid, weight = pupil.flat_sample(300, "grid", 0)
    width, height = (2.0 * one for one in pupil.half_extent)
    cell = math.sqrt(pupil._lit_area / 300)
    counts = max(1, round(width / cell)), max(1, round(height / cell))
    edges = [np.linspace(-0.5 * size, 0.5 * size, n + 1) for size, n in zip((width, height), counts, strict=True)]
    cover = pupil.coverage(*edges)
    assert len(grid) == (cover > 0.0).sum()
    np.testing.assert_allclose(weight, cover[cover > 0.0] / cover.sum())
    rows, columns = np.nonzero(cover)
    expected = [
        [0.5 * (edges[0][c] + edges[0][c + 1]), 0.5 * (edges[1][r] + edges[1][r + 1])]
        for r, c in zip(rows, columns, strict=True)
    ]
    np.testing.assert_allclose(grid * pupil.reach, expected, atol=1e-12)


@pytest.mark.parametrize("pupil", [Annulus(1.2, 0.5), Polygon(CORNERS), Mask(VALUES, (0.8, 1.1))])
def test_a_map_of_the_square_keeps_shares_of_area(pupil):
    """A fine lattice of the square: as many points in each quarter of the pupil as it has light there."""
    place = (np.arange(500) + 0.5) / 500
    u, v = (axis.ravel() for axis in np.meshgrid(place, place))
    points = pupil.square_map.points(np.stack([u, v], axis=1)) * pupil.reach
    assert (pupil.transmission(*(0.999999 * points.T)) > 0.0).mean() > 0.999
    edges = np.array([-2.0, -0.3, 0.25, 2.0])
    light = pupil.coverage(edges, edges) * np.outer(np.diff(edges), np.diff(edges))
    found, _, _ = np.histogram2d(points[:, 1], points[:, 0], [edges, edges])
    np.testing.assert_allclose(found / len(points), light / light.sum(), atol=4e-3)
    # Corners of the square are points of the pupil, too.
    ends = pupil.square_map.points(np.array([[0.0, 0.0], [1.0 - 1e-12, 1.0 - 1e-12], [0.0, 1.0 - 1e-12]]))
    assert np.isfinite(ends).all() and (np.hypot(*ends.T) <= 1.0 + 1e-9).all()


def test_directions_of_any_size_are_unit_vectors():
    """Squares of such numbers would overflow or vanish."""
    for size in (1e200, 1.0, 1e-200):
        np.testing.assert_allclose(as_unit_vector(size * np.array([3.0, 0.0, -4.0]), "normal"), [0.6, 0.0, -0.8])
    for wrong in ((0.0, 0.0, 0.0), (1.0, 2.0), (math.nan, 0.0, 1.0)):
        with pytest.raises(ValueError, match="normal"):
            as_unit_vector(wrong, "normal")


def test_shares_and_intervals():
    shares = cumulative(np.array([[1.0, 3.0, 0.0], [0.0, 0.0, 0.0]]))
    np.testing.assert_allclose(shares, [[0.0, 0.25, 1.0, 1.0], [0.0, 0.0, 0.0, 0.0]])
    found, place = _locate(np.array([0.0, 0.25, 0.75, 1.0]), np.array([0.0, 0.1, 0.25, 0.5, 0.99, 1.0]))
    assert found.tolist() == [0, 0, 1, 1, 2, 2]
    np.testing.assert_allclose(place, [0.0, 0.4, 0.0, 0.5, 0.96, 1.0])
    overlap = _overlap(np.array([-1.5, -0.5, 0.1, 2.0]), 1.0, 0.5, 4)
    np.testing.assert_allclose(overlap, [[0.5, 0, 0, 0], [0, 0.5 / 0.6, 0.1 / 0.6, 0], [0, 0, 0.4 / 1.9, 0.5 / 1.9]])


def test_edges_and_ears_of_polygons():
    """Areas under an edge, by a fine sum; triangles that fill the polygon; edges that meet."""
    for begin, end in (
        ((0.0, 1.0), (2.0, 3.0)),
        ((2.0, 3.0), (0.0, 1.0)),
        ((0.0, 3.0), (2.0, -1.0)),
        ((0.0, 1.5), (2.0, 1.5)),
        ((1.0, 0.0), (1.0, 2.0)),
    ):
        sign = np.sign(end[0] - begin[0])
        for x in (-0.5, 0.7, 1.6, 2.5):
            for y in (-2.0, 0.5, 1.5, 2.2, 4.0):
                fine = (np.arange(20_000) + 0.5) / 10_000
                rise = np.interp(fine, *zip(*sorted((begin, end)), strict=True)) if sign else 0.0 * fine
                expected = sign * (np.minimum(rise, y) * (fine < x)).sum() / 10_000
                found = _under_edge(np.array(begin), np.array(end), np.array(x), np.array(y))
                assert float(found) == pytest.approx(expected, abs=1e-3)
    ears = _ears(CORNERS)
    assert len(ears) == 4
    cross = lambda a, b: a[0] * b[1] - a[1] * b[0]  # noqa: E731
    areas = [0.5 * cross(CORNERS[b] - CORNERS[a], CORNERS[c] - CORNERS[a]) for a, b, c in ears]
    assert min(areas) > 0.0 and sum(areas) == pytest.approx(Polygon(CORNERS).area)
    assert _first_crossing(CORNERS) is None
    bow = np.array([[0.0, 0.0], [2.0, 1.0], [2.0, 0.0], [0.0, 1.5]])
    assert _first_crossing(bow) == (0, 2)
    touching = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 0.0], [0.0, 2.0]])
    assert _first_crossing(touching) is not None
    along = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [3.0, 1.0], [3.0, 0.0], [4.0, 0.0], [4.0, -1.0], [0.0, -1.0]])
    assert _first_crossing(along) is None  # two edges on one line, apart from each other
