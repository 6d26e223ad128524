"""Sums along rays through grids, weight by weight: sheared planes, splines' integrals, and planes' values."""

import math
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from aerokernels.flow import GridMesh
from aerokernels.medium import spline
from aerokernels.series import line_integrals, sheared_products
from aerokernels.series.bending import _sum_to, _window_rows, at_planes, bending
from aerokernels.series.line_integrals import LineIntegrals, NotLinearError, basis_integrals, contracted, main_axis
from aerokernels.series.plane_values import (
    PlaneValues,
    basis_rows,
    nodes_along,
    sparse_rows,
    tensor_rows,
    thinned,
    to_coefficients,
    to_nodes,
)
from aerokernels.series.sheared_products import ShearedProducts


def drawn_out(count: int) -> np.ndarray:
    """The matrix from a row to itself with three nodes more at each end, on the cubics through the last four."""
    found = np.zeros((count + 6, count))
    found[3:-3] = np.eye(count)
    for some, beyond in ((range(4), (-3, -2, -1)), (range(count - 4, count), (count, count + 1, count + 2))):
        for node, k in product(beyond, some):
            found[node + 3, k] = math.prod(Fraction(node - other, k - other) for other in some if other != k)
    return found


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("low", [(-4, 1), (1, -2), (2, 3), (-7, -6)])
@pytest.mark.parametrize("at_once", [1_000_000, 1])
def test_sheared_products_are_sums_over_planes_and_nodes(
    monkeypatch: pytest.MonkeyPatch, axis: int, low: tuple[int, int], at_once: int
):
    """Drifting planes, a few rows of nodes at a time, and lines beyond every edge."""
    monkeypatch.setattr(sheared_products, "AT_ONCE", at_once)
    draw = np.random.default_rng(axis)
    shape = {0: (6, 21, 7), 1: (21, 6, 7), 2: (21, 7, 6)}[axis]
    samples, planes = draw.normal(size=shape), 6
    counts = [n for k, n in enumerate(shape) if k != axis]
    shift = np.stack([np.array([-5, -3, -1, 0, 2, 4]), np.array([3, 2, 1, 0, -1, -2])], axis=1).astype(np.int32)
    blends = [draw.normal(size=(planes, 4)), draw.normal(size=(planes, 1 if low[0] == 2 else 4))]
    weights, size = draw.uniform(0.5, 2.0, planes), np.array([24, 9])
    found = ShearedProducts(axis, counts, shift, blends, weights, np.array(low), size)(samples, 0.3)
    moved = np.moveaxis(samples, axis, 0) - 0.3
    wide = np.einsum("ui,kij,vj->kuv", drawn_out(counts[0]), moved, drawn_out(counts[1]))
    expected = np.zeros(size)
    for k, i, j in product(range(planes), range(4), range(blends[1].shape[1])):
        first, second = (
            np.clip(low[a] + np.arange(size[a]) + shift[k, a] + step, -3, counts[a] + 2) + 3
            for a, step in enumerate((i, j))
        )
        expected += weights[k] * blends[0][k, i] * blends[1][k, j] * wide[k][first[:, None], second]
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    single = ShearedProducts(axis, counts, shift, blends, weights, np.array(low), size)(samples.astype("f4"), 0.3)
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, expected, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("interpolation", ["cubic", "linear"])
def test_integrals_of_basis_functions(interpolation: str):
    """From the first node to a place, by Gauss points in each cell: exact for cubics."""
    count = 6
    places = np.array([0.0, 0.3, 1.0, 2.75, 4.999, 5.0])
    found = basis_integrals(places, count, interpolation)
    support = 4 if interpolation == "cubic" else 2
    point, weight = np.polynomial.legendre.leggauss(3)
    expected = np.zeros((len(places), count + support - 2))
    for row, place in enumerate(places):
        for cell in range(count - 1):
            end = min(max(place - cell, 0.0), 1.0)
            u = 0.5 * end * (point + 1.0)
            if interpolation == "linear":
                basis = np.stack([1.0 - u, u])
            else:
                v = 1.0 - u
                basis = np.stack([v**3, 3.0 * u**3 - 6.0 * u**2 + 4.0, 3.0 * v**3 - 6.0 * v**2 + 4.0, u**3]) / 6.0
            expected[row, cell : cell + support] += basis @ weight * 0.5 * end
    np.testing.assert_allclose(found, expected, atol=1e-14)


@pytest.mark.parametrize("shape", [(4, 5), (4, 5, 6)])
def test_weighted_sums_along_an_axis(shape: tuple[int, ...]):
    samples = np.random.default_rng(1).normal(size=shape)
    for axis, count in enumerate(shape):
        weights = np.arange(1.0, count + 1.0) ** 2
        found = contracted(samples, weights, axis)
        np.testing.assert_allclose(found, np.tensordot(samples, weights, (axis, 0)), rtol=1e-12)
        assert contracted(samples.astype("f4"), weights, axis).dtype == np.float32


def linear_integral(mesh: GridMesh, samples: np.ndarray, start: np.ndarray, along: np.ndarray) -> tuple[float, float]:
    """Integral along a ray of values on planes of nodes, linear between nodes of a plane and between planes; length.

    Zero where a plane is crossed outside the box. From the start, or the face before it, to the far face.
    """
    axis = main_axis(mesh, along)
    space = axis if mesh.geometry == "volume" else 2
    node = mesh.origin[axis] + mesh.spacing[axis] * np.arange(mesh.shape[axis])
    points = start + ((node - start[space]) / along[space])[:, None] * along
    if mesh.geometry == "volume":
        lateral = np.delete(points, axis, axis=1)
    else:
        lateral = points[:, 1:2] if mesh.geometry == "planar" else np.hypot(points[:, :1], points[:, 1:2])
    others = [k for k in range(len(mesh.shape)) if k != axis]
    axes = [mesh.origin[k] + mesh.spacing[k] * np.arange(mesh.shape[k]) for k in others]
    values = [
        RegularGridInterpolator(axes, plane, bounds_error=False, fill_value=0.0)(at[None])[0]
        for plane, at in zip(np.moveaxis(samples, axis, 0), lateral, strict=True)
    ]
    begin = float(np.clip(start[space], node[0], node[-1]))
    end = float(node[-1] if along[space] > 0.0 else node[0])
    knots = np.unique([begin, end, *node[(node > min(begin, end)) & (node < max(begin, end))]])
    return float(np.trapezoid(np.interp(knots, node, values), knots)) / abs(along[space]), abs(end - begin) / abs(
        along[space]
    )


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize(
    "direction",
    [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (0.2, -0.3, 1.0), (0.1, 0.2, -1.0), (0.2, 1.0, 0.3), (-1.0, 0.1, 0.2)],
)
@pytest.mark.parametrize("planes", [False, True])
def test_linear_integrals_plane_by_plane(monkeypatch: pytest.MonkeyPatch, geometry: str, direction, planes: bool):
    """Rays that start before the grid, in it and behind it, leave through its end or a side; by matrix or by plane."""
    if planes:
        monkeypatch.setattr(line_integrals, "MOST_ENTRIES", 0)
    along = np.array(direction) / np.linalg.norm(direction)
    shape, origin, spacing = (7, 9, 8), np.array([-0.3, -0.4, 0.2]), np.array([0.11, 0.09, 0.13])
    if geometry != "volume":
        shape, origin, spacing = shape[1:], origin[1:].copy(), spacing[1:]
    if geometry == "axisymmetric":
        origin[0] = 0.0
    mesh = GridMesh(geometry, origin, spacing, shape)
    draw = np.random.default_rng(3)
    samples = draw.normal(size=shape)
    start = (
        draw.uniform(-0.5, 0.5, (40, 3)) * (0.6, 0.6, 0.0) + (0.0, 0.0, 0.6) - draw.uniform(-0.3, 0.9, (40, 1)) * along
    )
    if geometry != "volume" and abs(along[2]) < 0.7:
        with pytest.raises(NotLinearError, match="across z"):
            LineIntegrals(mesh, start, along, "linear")
        return
    lines = LineIntegrals(mesh, start, along, "linear")
    expected, length = np.array([linear_integral(mesh, samples, one, along) for one in start]).T
    np.testing.assert_allclose(lines.length, length, atol=1e-12)
    np.testing.assert_allclose(lines(samples), expected, atol=1e-12)
    np.testing.assert_allclose(lines(samples, 0.7), expected - 0.7 * length, atol=1e-12)
    np.testing.assert_allclose(lines.path_weights().sum(axis=1), length, atol=1e-12)
    np.testing.assert_allclose((lines.along(samples) * lines.path_weights()).sum(axis=1), expected, atol=1e-12)
    # Inside are rays that enter and leave through the ends.
    space = lines.axis if geometry == "volume" else 2
    low, high = mesh.box
    ends = []
    for face in (np.clip(start[:, space], low[lines.axis], high[lines.axis]), high if along[space] > 0.0 else low):
        face = face if len(face) == 40 else np.full(40, face[lines.axis])
        at = start + ((face - start[:, space]) / along[space])[:, None] * along
        others = [k for k in range(len(shape)) if k != lines.axis]
        cross = (
            at[:, others]
            if geometry == "volume"
            else at[:, 1:2]
            if geometry == "planar"
            else np.hypot(at[:, :1], at[:, 1:2])
        )
        ends.append(((cross >= low[others] - 1e-9) & (cross <= high[others] + 1e-9)).all(axis=1))
    inside = ends[0] & ends[1] & (length > 0.0)
    assert inside.any()
    np.testing.assert_array_equal(lines.inside, inside)


@pytest.mark.parametrize("even", [False, True])
@pytest.mark.parametrize("inverted", [(False, False), (True, False), (False, True)])
@pytest.mark.parametrize("apart", [False, True])
def test_values_of_a_plane_are_rows_of_its_spline(even: bool, inverted: tuple[bool, bool], apart: bool):
    """On a grid of places and at places apart: coefficients by `spline_along`, basis functions one by one."""
    draw = np.random.default_rng(2)
    counts, plane = (9, 7), draw.normal(size=(9, 7))
    if apart:
        places = draw.uniform(0.0, 1.0, (30, 2)) * [8.0, 6.0]
    else:
        places = np.array(list(product([0.0, 0.25, 3.5, 8.0], [0.5, 5.75, 6.0])))
    within = np.arange(len(places)) % 4 > 0
    values = PlaneValues(places, counts, within, "cubic", even, False, inverted)
    coefficients = spline.spline_along(plane, 0, even)
    coefficients = spline.spline_along(coefficients.T, 0, False).T
    if inverted[0]:
        coefficients = spline.spline_along(coefficients[1:-1], 0, even)
    if inverted[1]:
        coefficients = spline.spline_along(coefficients[:, 1:-1].T, 0, False).T
    expected = []
    for place, keep in zip(places, within, strict=True):
        cells = [min(int(one), count - 2) for one, count in zip(place, counts, strict=True)]
        u, v = (
            np.array([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]) / 6.0
            for t in (one - cell for one, cell in zip(place, cells, strict=True))
        )
        part = coefficients[cells[0] : cells[0] + 4, cells[1] : cells[1] + 4]
        expected.append(u @ part @ v if keep else 0.0)
    np.testing.assert_allclose(values(plane), expected, atol=1e-10)
    numbers, matrix = values.rule
    mapped = values.maps[1] @ (values.maps[0] @ plane).T
    if numbers is not None:
        assert (numbers[~within] == -1).all() and matrix is None
        np.testing.assert_allclose(mapped.T.ravel()[numbers[within]], values(plane)[within], atol=1e-12)
    else:
        np.testing.assert_allclose(matrix @ mapped.T.ravel(), values(plane), atol=1e-12)
    assert (numbers is None) == apart


def test_averages_of_cells_along_some_axes():
    """Nodes' values of a matrix along each axis, in the samples' own precision, whichever axis is last."""
    samples = np.random.default_rng(4).normal(size=(6, 7, 8))
    for even in (False, True):
        for axes in ([0], [1], [2], [0, 1, 2]):
            expected = samples
            for axis in axes:
                matrix = to_nodes(samples.shape[axis], "cubic", even and axis == 0)
                expected = np.moveaxis(np.tensordot(matrix, expected, (1, axis)), 0, axis)
            np.testing.assert_allclose(nodes_along(samples, axes, "cubic", even), expected, atol=1e-12)
    assert nodes_along(samples.astype("f4"), [1], "cubic", False).dtype == np.float32
    np.testing.assert_allclose(
        to_coefficients(6, "cubic", False, True),
        to_coefficients(6, "cubic", False, False) @ to_nodes(6, "cubic", False),
        atol=1e-12,
    )
    np.testing.assert_array_equal(to_coefficients(6, "linear", False, False), np.eye(6))


def test_rays_at_45_degrees_are_summed():
    mesh = GridMesh("planar", np.zeros(2), np.ones(2), (5, 5))
    assert main_axis(mesh, np.array([0.0, 1.0, 1.0]) / math.sqrt(2.0)) == 1
    with pytest.raises(NotLinearError, match="across z"):
        main_axis(mesh, np.array([0.0, 1.01, 1.0]))


def test_rows_of_basis_functions():
    """At nodes, between and beyond the ends, where the end's own value is meant."""
    places = np.array([-0.5, 0.0, 1.25, 4.0, 4.5])
    cell, weight = basis_rows(places, 5, "linear")
    np.testing.assert_array_equal(cell, [0, 0, 1, 3, 3])
    np.testing.assert_allclose(weight, [[1, 0], [1, 0], [0.75, 0.25], [0, 1], [0, 1]], atol=1e-15)
    rows = sparse_rows(places, 5, "linear").toarray()
    np.testing.assert_allclose(rows @ np.arange(5.0), [0.0, 0.0, 1.25, 4.0, 4.0])
    pairs = np.array([[0.5, 1.25], [3.0, 0.0], [1.0, 2.0]])
    plane = np.random.default_rng(1).normal(size=(5, 4))
    found = tensor_rows(pairs, (5, 4), "linear", np.array([True, True, False])) @ plane.ravel()
    first = 0.5 * (0.75 * (plane[0, 1] + plane[1, 1]) + 0.25 * (plane[0, 2] + plane[1, 2]))
    np.testing.assert_allclose(found, [first, plane[3, 0], 0.0], atol=1e-15)
    kept = thinned(np.array([[1.0, 2e-13, -0.5e-13], [-2.0, 0.0, 3e-13]])).toarray()
    np.testing.assert_array_equal(kept, [[1.0, 0.0, 0.0], [-2.0, 0.0, 3e-13]])


def test_rays_the_other_way_through_mirrored_air_bend_alike():
    """Planes counted from the other end: the same change of paths, and the same straight ones."""
    shape = (12, 13, 11)
    mesh = GridMesh("volume", np.array([-0.05, -0.06, 0.0]), np.array([9e-3, 1e-2, 8e-3]), shape)
    samples = 1.0 + 0.05 * np.random.default_rng(11).normal(size=shape)
    start = np.array([[0.0, 1e-3, -0.01], [4e-3, -6e-3, -0.02], [-3e-3, 2e-3, 0.02]])
    along, beyond = np.array([0.1, -0.05, 1.0]) / math.sqrt(1.0125), np.array([0.01, 0.02, 0.0])
    mirror, end = np.array([1.0, 1.0, -1.0]), np.array([0.0, 0.0, 0.08])
    found = []
    for values, begin, way in ((samples, start, along), (samples[:, :, ::-1], start * mirror + end, along * mirror)):
        lines = LineIntegrals(mesh, begin, way)
        found.append(bending(lines, np.ascontiguousarray(values), lambda x: 2e-4 * (x - 0.9), beyond))
    assert np.abs(found[0][0]).min() > 0.0
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=1e-9)
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-12)


def test_integrals_to_each_plane_are_trapezoids():
    values, step = np.random.default_rng(5).normal(size=(3, 6, 2)), np.random.default_rng(6).uniform(0.5, 1.5, (3, 6))
    found = _sum_to(values, step)
    for k in range(6):
        expected = (values[:, :k] * step[:, :k, None]).sum(axis=1) + 0.5 * values[:, k] * step[:, k, None]
        np.testing.assert_allclose(found[:, k], expected, atol=1e-12)


@pytest.mark.parametrize("direction", [(0.2, 0.1, 1.0), (1.0, -0.15, 0.1), (0.1, -1.0, 0.2)])
def test_contrasts_and_slopes_where_rays_cross_planes(direction):
    """The spline of each plane and its derivatives, from all of its nodes."""
    along = np.array(direction) / np.linalg.norm(direction)
    shape, spacing = (24, 26, 23), np.array([0.1, 0.12, 0.09])
    mesh = GridMesh("volume", np.zeros(3), spacing, shape)
    draw = np.random.default_rng(7)
    samples = draw.normal(size=shape)
    middle = 0.5 * spacing * (np.array(shape) - 1.0)
    start = middle + draw.uniform(-0.3, 0.3, (11, 3)) - 1.6 * along
    lines = LineIntegrals(mesh, start, along)
    value, gradient = at_planes(lines, samples, lambda x: 2.0 * x + 1.0)
    others = [k for k in range(3) if k != lines.axis]
    for plane, values in enumerate(np.moveaxis(samples, lines.axis, 0)):
        coefficients = spline.spline_along(spline.spline_along(2.0 * values + 1.0, 0, False).T, 0, False).T
        for ray, place in enumerate(lines.crossings()[:, plane]):
            cells = [min(max(int(p), 0), n - 2) for p, n in zip(place, values.shape, strict=True)]
            basis = []
            for p, cell in zip(place, cells, strict=True):
                t = p - cell
                even = [
                    (1 - t) ** 3 / 6.0,
                    t**3 / 2.0 - t**2 + 2.0 / 3.0,
                    -(t**3) / 2.0 + t**2 / 2.0 + t / 2.0 + 1.0 / 6.0,
                    t**3 / 6.0,
                ]
                odd = [-((1 - t) ** 2) / 2.0, 1.5 * t**2 - 2.0 * t, -1.5 * t**2 + t + 0.5, t**2 / 2.0]
                basis.append((np.array(even), np.array(odd)))
            part = coefficients[cells[0] : cells[0] + 4, cells[1] : cells[1] + 4]
            (u, du), (v, dv) = basis
            assert value[ray, plane] == pytest.approx(u @ part @ v, abs=2e-4)
            expected = np.array([du @ part @ v, u @ part @ dv]) / spacing[others]
            np.testing.assert_allclose(gradient[ray, plane], expected, atol=5e-3)
    nodes, weight, slope = _window_rows(np.array([[3.3, 22.9]]), "cubic", to_coefficients(24, "cubic", False, False))
    assert nodes.shape == (1, 2, 20) and nodes[0, 0, 0] == 0 and nodes[0, 1, -1] == 23
    np.testing.assert_allclose(weight.sum(axis=-1), 1.0, atol=1e-4)
    np.testing.assert_allclose((weight * nodes).sum(axis=-1), [[3.3, 22.9]], atol=1e-3)
    np.testing.assert_allclose((slope * nodes).sum(axis=-1), 1.0, atol=1e-3)
