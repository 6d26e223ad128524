"""Cut cells that keep the averages of the flow's: uneven, skewed, triangles, planar and axisymmetric."""

import hypothesis
import numpy as np
import pytest
from hypothesis import strategies as st

from aerokernels import trace
from aerokernels.flow.reading.planes.polygons import Polygons, quad_mesh
from aerokernels.medium import IndexField, QuadMesh
from aerokernels.medium.averages.kept_averages import cut_and_kept
from aerokernels.medium.averages.vertex_values import of_parents
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane

NODE, WEIGHT = np.polynomial.legendre.leggauss(10)


def skewed(count: int, geometry: str) -> QuadMesh:
    """Cells that grow by 4 % from one to the next along one direction, sheared and bent."""
    u, v = np.meshgrid(np.geomspace(1.0, 1.04**count, count) - 1.0, np.linspace(0.0, 1.0, count), indexing="ij")
    u = u / u.max()
    return QuadMesh.structured(0.2 + u + 0.3 * v + 0.1 * u * v, v + 0.1 * np.sin(3.0 * u), geometry)


def triangles(count: int, geometry: str) -> QuadMesh:
    """The same, each cell of which is two triangles, cut into three parts each."""
    mesh = skewed(count, geometry)
    a, b, c, d = mesh.cells.T
    corners = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    start = 3 * np.arange(len(corners) + 1)
    return quad_mesh(Polygons(mesh.vertices, start, corners.ravel(), np.ones(len(corners)), "cell"), geometry)[0]


def averages(mesh: QuadMesh, function) -> np.ndarray:
    """Averages of a function over each cell of the flow, by 10 x 10 Gauss points in each of the mesh's cells."""
    total, size = np.zeros(len(mesh.cells)), np.zeros(len(mesh.cells))
    a, b, c, d = (mesh.corners[:, k] for k in range(4))
    for x, wx in zip(0.5 * (NODE + 1.0), WEIGHT, strict=True):
        for y, wy in zip(0.5 * (NODE + 1.0), WEIGHT, strict=True):
            point = (1 - x) * (1 - y) * a + x * (1 - y) * b + x * y * c + (1 - x) * y * d
            along, across = (1 - y) * (b - a) + y * (c - d), (1 - x) * (d - a) + x * (c - b)
            share = wx * wy * (along[:, 0] * across[:, 1] - along[:, 1] * across[:, 0])
            share = share * (point[:, 0] if mesh.geometry == "axisymmetric" else 1.0)
            total, size = total + share * function(point), size + share
    if mesh.parents is None:
        return total / size
    return (np.bincount(mesh.parents, total) / np.bincount(mesh.parents, size))[mesh.parents]


def means(mesh: QuadMesh, values: np.ndarray) -> np.ndarray:
    """Mean of what is bilinear in each cell of the mesh over each cell of the flow."""
    own = (mesh.corner_weights * values[mesh.cells]).sum(axis=1) / mesh.corner_weights.sum(axis=1)
    return of_parents(mesh, own)


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("made", [skewed, triangles])
def test_the_interpolant_keeps_every_average_of_a_smooth_flow(made, geometry):
    """Set-up: averages of a wave of a height of 2 over some 24 cells of it.

    Expected: means of the interpolant over every cell of the flow, rim and all, within 1e-8 of the file's (1e-6 asked),
    where the interpolant without cutting misses those of quadrilaterals by more than 1e-4.
    """

    def wave(p):
        return 2.0 + np.sin(4.0 * p[:, 0] - 3.0 * p[:, 1])

    mesh = made(24, geometry)
    average = averages(mesh, wave)
    field = IndexField.from_mesh(mesh, 1e-4 * average, interpolation="conserving", ambient_index=1.0 + 1e-6)
    finer, told = field.mesh, of_parents(mesh, average)
    missed = np.abs(means(finer, field.samples.values) / 1e-4 - told)
    assert missed.max() < 1e-8
    assert np.abs(field.samples.lacking_by_cell[1]).max() < 1e-8 * 1e-4
    before = IndexField.from_mesh(mesh, 1e-4 * average, ambient_index=1.0 + 1e-6)
    lacked = np.abs(means(mesh, before.samples.values) / 1e-4 - told).max()
    assert lacked > 1e-4 if mesh.parents is None else lacked < 1e-8
    # Nearer to the flow as well, between the vertices.
    at = finer.cell_centroid[:: len(finer.cells) // 400]
    points = np.concatenate([np.zeros((len(at), 1)), at], axis=1)
    assert np.abs(field.contrast_at(points) / 1e-4 - wave(at)).max() < 0.02


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("made", [skewed, triangles])
@pytest.mark.parametrize("count", [4, 24])
def test_linear_densities_stay_linear(made, geometry, count):
    """Set-up: averages of 1 + 2 y + 3 z. Expected: that at every vertex of the cut cells, rim and all, 1e-12."""

    def linear(p):
        return 1.0 + p @ [2.0, 3.0]

    mesh = made(count, geometry)
    finer, values, _ = cut_and_kept(mesh, averages(mesh, linear))
    assert np.abs(values - linear(finer.vertices)).max() < 1e-12


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_a_shock_has_no_overshoot_and_what_it_lacks_is_told(geometry):
    """Set-up: averages of a step from 1 to 2 askew through uneven cells, which leaves by the rim.

    Expected: values from 1 to 2 with nothing beyond (a hundredth on the rim), cells that no shock touches kept, and
    `lacking_by_cell` what means of the interpolant miss, rms. A cell of 1.1 between 1 and 2 cannot be kept by values
    of that range: it may lack 0.25.
    """
    mesh = skewed(24, geometry)
    fine = mesh.corners.mean(axis=1) @ [1.0, 0.4] - 0.75
    average = 1.0 + np.clip(0.5 + fine / 0.02, 0.0, 1.0)
    field = IndexField.from_mesh(mesh, 1e-4 * average, interpolation="conserving", ambient_index=1.0 + 1e-6)
    values = field.samples.values / 1e-4
    assert values.min() > 0.99 and values.max() < 2.01
    inside = np.ones(len(values), bool)
    of, edge = np.nonzero(field.mesh.neighbors < 0)
    inside[field.mesh.cells[of, edge]] = inside[field.mesh.cells[of, (edge + 1) % 4]] = False
    assert values[inside].min() > 1.0 - 1e-12 and values[inside].max() < 2.0 + 1e-12
    missed = average - means(field.mesh, values)
    told = field.samples.lacking_by_cell[1] / 1e-4
    assert np.sqrt(np.mean(told**2)) > 0.999 * np.sqrt(np.mean(missed**2)) > 1e-3
    assert np.abs(missed[np.abs(fine) > 0.3]).max() < 1e-8 and np.abs(missed).max() < 0.25


def test_no_density_below_a_tenth_of_the_least_about_it():
    """Set-up: averages of a hollow of 1e-3 of the range in one cell. Expected: no value below a tenth of it."""
    mesh = skewed(12, "planar")
    average = 1.0 + np.sum((mesh.corners.mean(axis=1) - [1.0, 0.5]) ** 2, axis=1)
    average = average - average.min() + 1e-3
    values = cut_and_kept(mesh, average, vacuum=0.0)[1]
    assert values.min() >= 1e-4


@pytest.mark.parametrize("share", [0.1, 0.3, 1.0, 3.0])
def test_layers_at_walls(share):
    """Set-up: averages of 1 + exp(-y / d) / 2, d some cells, light along the wall within the first cell, 40 lines.

    Formula: the density at the line's y. Expected: with the wall's values the error is less than half of that without
    them (but for d of a tenth of a cell, which no average shows: there it is reported all the same), and told.
    """
    step, scale = 1.0 / 12.0, 1e-9
    axis = np.linspace(0.0, 1.0, 13)
    mesh = QuadMesh.structured(*np.meshgrid(axis, axis, indexing="ij"))
    d = share * step
    average = np.repeat(0.5 * d / step * (np.exp(-axis[:-1] / d) - np.exp(-axis[1:] / d)), 12)
    walls = np.stack([0.0 * np.linspace(0.0, 1.0, 25), np.linspace(0.0, 1.0, 25)], axis=1), np.full(25, 0.5 * scale)
    y = step * (np.arange(40) + 0.5) / 40
    rays = RayBundle(np.c_[0.0 * y, y, 0.0 * y], [0.0, 0.0, 1.0])
    off = []
    for given in ({}, {"interpolation": "conserving", "walls": walls}):
        field = IndexField.from_mesh(mesh, scale * average, **given)
        result = trace(field, rays, until=Plane((0, 0, 1), (0, 0, 1)), precision="float64")
        error = np.abs(result.opd / scale - 0.5 * np.exp(-y / d))
        off.append(error.max())
    assert np.sqrt(np.mean(error**2)) < result.error["total"] / scale
    assert off[1] < (0.5 if share > 0.2 else 1.0) * off[0]


def test_a_mesh_that_closes_on_itself_is_not_cut():
    angle, r = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 9), [1.0, 2.0], indexing="ij")
    y, z = r * np.cos(angle), r * np.sin(angle)
    y[-1], z[-1] = y[0], z[0]
    with pytest.raises(ValueError, match=r"closes on itself in a seam.*take 'bilinear'"):
        IndexField.from_mesh(QuadMesh.structured(y, z), np.zeros(8), interpolation="conserving")


@hypothesis.settings(max_examples=25, deadline=None)
@hypothesis.given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.01, 0.3]))
def test_any_averages_stay_within_bounds(seed, noise):
    """Set-up: a jump with noise of any cell. Expected: finite values, none beyond the averages by more than noise."""
    draw = np.random.default_rng(seed)
    mesh = skewed(int(draw.integers(6, 16)), "planar" if draw.random() < 0.5 else "axisymmetric")
    at = mesh.cell_centroid @ draw.normal(size=2)
    average = 1.0 + (at > np.quantile(at, draw.uniform(0.1, 0.9))) + noise * draw.uniform(-0.5, 0.5, len(at))
    _, values, _ = cut_and_kept(mesh, average)
    assert np.isfinite(values).all()
    span = np.ptp(average)
    assert values.min() > average.min() - 0.5 * span and values.max() < average.max() + 0.5 * span


def bent(ni: int = 4, nj: int = 5, geometry: str = "planar") -> QuadMesh:
    y, z = np.meshgrid(np.linspace(0.5, 2.0, ni), np.linspace(0.0, 2.0, nj), indexing="ij")
    return QuadMesh.structured(y + 0.1 * np.sin(3.0 * z), z + 0.1 * y**2, geometry)
