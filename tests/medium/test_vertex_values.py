"""Finite-volume averages to vertex values, line integrals through shocks, and the node gradients of eq 7."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import IndexField, QuadMesh, flow
from aerokernels.medium.averages.kept_averages import cell_deficits, conserving_values
from aerokernels.medium.averages.vertex_values import vertex_gradients, vertex_values
from tests.fitted_order import fitted_order

WAVELENGTH = 905e-9


def curvilinear(count: int, geometry: str = "planar") -> QuadMesh:
    a, b = np.meshgrid(np.linspace(0.0, 1.0, count), np.linspace(0.0, 1.0, count), indexing="ij")
    return QuadMesh.structured(0.5 + a + 0.1 * np.sin(2.0 * b + a), b + 0.15 * np.cos(1.5 * a) * b + 0.1 * a, geometry)


def rectangular(first, second, geometry: str = "planar") -> QuadMesh:
    return QuadMesh.structured(*np.meshgrid(first, second, indexing="ij"), geometry)


def shuffled(mesh: QuadMesh, *cell_arrays, seed: int = 0):
    """The same mesh with its cells in another order, as an unstructured one."""
    order = np.random.default_rng(seed).permutation(len(mesh.cells))
    return QuadMesh(mesh.vertices, mesh.cells[order], mesh.geometry), *(a.ravel()[order] for a in cell_arrays)


def averages(mesh: QuadMesh, function) -> np.ndarray:
    """Cell averages (of the volume if axisymmetric) by 4 x 4 Gauss points in the bilinear map."""
    node, weight = np.polynomial.legendre.leggauss(4)
    a, b, c, d = (mesh.corners[:, k] for k in range(4))
    total, volume = 0.0, 0.0
    for x, wx in zip(0.5 * (node + 1.0), weight, strict=True):
        for y, wy in zip(0.5 * (node + 1.0), weight, strict=True):
            point = (1 - x) * (1 - y) * a + x * (1 - y) * b + x * y * c + (1 - x) * y * d
            along, across = (1 - y) * (b - a) + y * (c - d), (1 - x) * (d - a) + x * (c - b)
            share = wx * wy * np.abs(along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0])
            share = share * (point[:, 0] if mesh.geometry == "axisymmetric" else 1.0)
            total, volume = total + share * function(point), volume + share
    return total / volume


def wave(points):
    return np.sin(points @ [4.0, -3.0] + 0.2)


# --- cell averages ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("unstructured", [False, True])
@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_order_on_a_smooth_curvilinear_mesh(geometry, unstructured):
    """Vertex values from averages converge with order 2 or better in the rms, edges included."""
    counts, errors = (17, 33, 65, 129), []
    for count in counts:
        mesh = curvilinear(count, geometry)
        average = averages(mesh, wave)
        if unstructured:
            mesh, average = shuffled(mesh, average)
        errors.append(np.sqrt(np.mean((vertex_values(mesh, average) - wave(mesh.vertices)) ** 2)))
    assert fitted_order(1.0 / (np.array(counts) - 1.0), errors) > 1.8


@pytest.mark.parametrize("unstructured", [False, True])
def test_linear_fields_are_reproduced_on_stretched_meshes(unstructured):
    """Cells growing by 10 and by 7 % a row: exact at inner vertices (structured: everywhere); rounding 1e-13."""
    mesh = rectangular(np.cumsum(1.1 ** np.arange(12)) / 20.0, np.cumsum(1.07 ** np.arange(15)) / 20.0)
    exact = 0.3 + mesh.vertices @ [2.0, -1.0]
    average = 0.3 + mesh.cell_centroid @ [2.0, -1.0]
    if unstructured:
        mesh, average = shuffled(mesh, average)
    assert np.abs(vertex_values(mesh, average) - exact).reshape(12, 15)[1:-1, 1:-1].max() < 1e-13


def test_a_field_even_in_r_is_met_on_the_axis():
    """With 1 - r^2, cells of h = 1/32: on the axis the parabola through two centroids; error of order h^2 = 1e-3."""
    mesh = rectangular(np.linspace(0.0, 1.0, 33), np.linspace(0.0, 1.0, 5), "axisymmetric")
    found = vertex_values(mesh, averages(mesh, lambda p: 1.0 - p[:, 0] ** 2)).reshape(33, 5)
    assert np.abs(found[0] - 1.0).max() < 1e-3


@given(seed=st.integers(0, 10_000), kind=st.sampled_from(["noise", "two levels", "sorted"]))
@settings(max_examples=60, deadline=None)
def test_no_new_extrema_inside(seed, kind):
    """An inner vertex stays within the range of the four cells around it, whatever the data."""
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(2, 12, 2))
    noise = rng.uniform(-1.0, 1.0, shape)
    average = {"noise": noise, "two levels": np.sign(noise), "sorted": np.sort(np.sort(noise, axis=0), axis=1)}[kind]
    mesh = rectangular(np.arange(shape[0] + 1.0), np.cumsum(rng.uniform(0.5, 1.5, shape[1] + 1)))
    found = vertex_values(mesh, average.ravel()).reshape(shape[0] + 1, shape[1] + 1)[1:-1, 1:-1]
    around = [average[:-1, :-1], average[1:, :-1], average[:-1, 1:], average[1:, 1:]]
    assert (found >= np.min(around, axis=0) - 1e-14).all() and (found <= np.max(around, axis=0) + 1e-14).all()


# --- an unresolved shock ---------------------------------------------------------------------------------------------

CELL, JUMP = 1e-3, 0.4 * WAVELENGTH / 1e-3


def shock_averages(y: np.ndarray, z: np.ndarray, slope: float, at: float) -> np.ndarray:
    """Averages of JUMP below the line z = at + slope y: exact in z, 400 midpoints in y (error (slope / 400)^2)."""
    fraction = (np.arange(400) + 0.5) / 400
    line = at + slope * (y[:-1, None] + np.diff(y)[:, None] * fraction)
    filled = np.clip((line[:, None, :] - z[None, :-1, None]) / np.diff(z)[None, :, None], 0.0, 1.0)
    return JUMP * filled.mean(axis=2)


def along_z(field: IndexField, y: float, z_high: float, piece: float) -> float:
    """Optical path difference along z [m]: the midpoint of each piece, exact for what is linear in the piece."""
    z = np.arange(piece / 2.0, z_high, piece)
    return float(piece * field.contrast_at(np.stack([0.0 * z, np.full_like(z, y), z], axis=1)).sum())


@pytest.mark.parametrize("slope", [0.0, 0.02, 0.3, 0.577, 2.0])
@pytest.mark.parametrize("unstructured", [False, True])
def test_line_integral_through_an_unresolved_shock(slope, unstructured):
    """Decision 5: cell averages keep the optical path through a captured shock, samples at nodes do not.

    Set-up: a step of 3.62e-4 in contrast (0.4 wave per 1 mm cell) along z = z0 + slope y, for twelve z0 and four y.
    Formula: OPD = step (z0 + slope y). Expected: within 2e-4 wave from averages, whatever z0; from samples at nodes
    the shock sits half-way between two of them, off by up to half a cell, 0.2 wave. Error of the averages' own
    quadrature: 1e-5 of 0.4 wave.
    """
    y, z = CELL * np.arange(11), CELL * np.arange(61)
    mesh = rectangular(y, z)
    rng = np.random.default_rng(0)
    from_averages, from_nodes = [], []
    for at in rng.uniform(0.02, 0.022, 12):
        average = shock_averages(y, z, slope, at)
        nodal = JUMP * (mesh.vertices[:, 1] < at + slope * mesh.vertices[:, 0])
        cut, values = shuffled(mesh, average) if unstructured else (mesh, average)
        for field, found in (
            (IndexField.from_mesh(cut, values), from_averages),
            (IndexField.from_mesh(mesh, nodal), from_nodes),
        ):
            for place in rng.uniform(3 * CELL, 7 * CELL, 4):
                found.append((along_z(field, place, z[-1], CELL / 2) - JUMP * (at + slope * place)) / WAVELENGTH)
    assert np.abs(from_averages).max() < 2e-4
    assert 0.1 < np.abs(from_nodes).max() < 0.21


def test_an_unstructured_copy_of_the_shipped_field_agrees():
    """Shuffled cells have no directions to reconstruct along: values agree to the second order of both.

    Rms difference below 0.5 % of the whole range, and on the line of sight along r = 3 mm below 1e-3 wave.
    """
    density = flow.shipped("mach3")
    mesh, average = shuffled(density.mesh, density.density)
    field, again = density.index_field(), replace(density, mesh=mesh, density=average).index_field()
    difference = again.samples.values - field.samples.values
    assert np.sqrt(np.mean(difference**2)) < 0.005 * np.ptp(field.samples.values)
    z = np.linspace(0.0, field.box[1][2], 4001)
    points = np.stack([0.0 * z, np.full_like(z, 3e-3), z], axis=1)
    change = np.mean(again.contrast_at(points) - field.contrast_at(points)) * z[-1]
    assert abs(change) < 1e-3 * WAVELENGTH


# --- keeping the averages -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_what_is_lacking_falls_fast(geometry):
    """Set-up: averages of a field that rises along both directions of a curvilinear mesh.

    Expected: away from the rim what the interpolant lacks of them falls faster than with order 2.4, and is below 1 / 20
    of what values that are right at the vertices lack, which falls with order 2.
    """
    counts, errors, before = (17, 33, 65), [], []

    def rising(p):
        return np.exp(p[:, 0] + 0.5 * p[:, 1])

    for count in counts:
        mesh = curvilinear(count, geometry)
        average = averages(mesh, rising)
        for values, found in ((conserving_values(mesh, average), errors), (rising(mesh.vertices), before)):
            lacks = cell_deficits(mesh, average, values).reshape(count - 1, count - 1)[3:-3, 3:-3]
            found.append(np.sqrt(np.mean(lacks**2)))
    spacings = 1.0 / (np.array(counts) - 1.0)
    assert fitted_order(spacings, errors) > 2.4 and abs(fitted_order(spacings, before) - 2.0) < 0.2
    assert (np.array(errors) < 0.05 * np.array(before)).all()


def test_parents_that_are_none_are_refused():
    mesh = rectangular(np.arange(3.0), np.arange(3.0))
    for parents in ([0, 0, 1], [0.0, 0.0, 1.0, 1.0], [0, 0, -1, 1]):
        with pytest.raises(ValueError, match="parents"):
            QuadMesh(mesh.vertices, mesh.cells, parents=np.array(parents))


# --- node gradients, eq 7 --------------------------------------------------------------------------------------------


def test_eq_7_is_exact_for_polynomials_of_degree_4_up_to_the_edges():
    """Uniform mesh, a product of quartics: central and one-sided forms differentiate it exactly; rounding 1e-11."""
    mesh = rectangular(np.linspace(0.0, 1.0, 6), np.linspace(-1.0, 1.0, 8))
    p, q = np.polynomial.Polynomial([1, -2, 3, 1, -2]), np.polynomial.Polynomial([0.5, 1, 1, -3, 2])
    y, z = mesh.vertices.T
    gradient = vertex_gradients(mesh, p(y) * q(z))
    assert np.abs(gradient[:, 0] - p.deriv()(y) * q(z)).max() < 1e-11
    assert np.abs(gradient[:, 1] - p(y) * q.deriv()(z)).max() < 1e-11
