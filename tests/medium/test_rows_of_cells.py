"""What an interpolant lacks of rows and columns of cells, reported as a number that equals what lines lack."""

import numpy as np
import pytest

from aerokernels import flow, trace
from aerokernels.medium import IndexField, QuadMesh
from aerokernels.medium.averages.rows_of_cells import averages_lacking
from aerokernels.medium.averages.vertex_values import of_parents
from aerokernels.medium.averages.vertex_weights import vertex_weights
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane

from .test_kept_averages import means, skewed, triangles


def attached_shock(count: int) -> np.ndarray:
    """Averages of a shock from 1 to 2 at 30 degrees to rows that begins at a wall; densities rise on both sides."""
    i, j = np.meshgrid(np.arange(count) + 0.5, np.arange(count) + 0.5, indexing="ij")
    behind = 0.5 + 0.5 * np.tanh(((i - 0.3 * count) * 0.5 - j * 0.87) / 0.5)
    return (1.0 + 0.1 * (i + j) / count + behind).ravel()


def without_order(mesh: QuadMesh) -> QuadMesh:
    """The same cells as a file lists them that has no rows: shuffled, and each begun at another corner."""
    draw = np.random.default_rng(2)
    cells = mesh.cells[draw.permutation(len(mesh.cells))]
    return QuadMesh(mesh.vertices, [np.roll(cell, draw.integers(4)) for cell in cells], mesh.geometry)


def beside_a_step(count: int) -> tuple[QuadMesh, np.ndarray]:
    """An attached shock over a step: uneven skewed cells, a corner of them left out, so that no array holds them."""
    mesh = skewed(count + 1, "planar")
    rows, columns = np.divmod(np.arange(count**2), count)
    kept = (rows < 0.7 * count) | (columns > 0.3 * count)
    used, cells = np.unique(mesh.cells[kept], return_inverse=True)
    return QuadMesh(mesh.vertices[used], cells.reshape(-1, 4)), attached_shock(count)[kept]


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("interpolation", ["bilinear", "conserving"])
def test_rows_columns_and_cells_by_their_definition(geometry, interpolation):
    """Set-up: a shock that begins at a wall. Formula: sums over rows and columns of the array of cells, by areas."""
    count, scale = 24, 1e-4
    mesh, average = skewed(count + 1, geometry), attached_shock(count)
    field = IndexField.from_mesh(mesh, scale * average, interpolation=interpolation, ambient_index=1.0)
    lacks = (average - means(field.mesh, field.samples.values) / scale) / np.ptp(average)
    area, lacks = mesh.cell_area.reshape(count, count), lacks.reshape(count, count)
    rows = [np.abs((area * lacks).sum(axis=k) / area.sum(axis=k)) for k in (0, 1)]
    told = field.averages_lacking
    assert told.rows_max == pytest.approx(np.max(rows), rel=1e-9, abs=1e-14)
    weight = [area.sum(axis=k) for k in (0, 1)]
    assert told.rows_rms == pytest.approx(np.sqrt(np.average(np.square(rows), weights=weight)), rel=1e-9, abs=1e-14)
    assert told.cells_max == pytest.approx(np.abs(lacks).max(), rel=1e-9)
    assert told.cells_rms == pytest.approx(np.sqrt(np.average(lacks**2, weights=area)), rel=1e-9)
    assert told.keeps_rows is (interpolation == "conserving")
    assert (told.rows_max > 1e-4) is (interpolation == "bilinear")


def test_lines_that_fill_a_row_lack_what_is_told():
    """Set-up: averages of a wedge's exact flow on even cells, two lines at Gauss's points of each row of cells.

    Formula: what is bilinear has its mean over a row at these two. Expected: the OPD through the cells themselves less
    that through the interpolant, in the worst of rows that meet no body, is the path that is reported of such rows; the
    density is taken 1e-9 times, so that rays are straight.
    """
    exact = flow.wedge(5.0, 0.26, length=1.0, spacing=0.05)
    contrast = 1e-9 * (exact.density / exact.ambient_density - 1.0)
    ni, nj = (n - 1 for n in exact.mesh.shape)
    y = np.unique(exact.mesh.vertices[:, 0])
    at = np.concatenate([y[:-1] + share * np.diff(y) for share in (0.5 - 0.5 / 3**0.5, 0.5 + 0.5 / 3**0.5)])
    rays = RayBundle(np.c_[0.0 * at, at, 0.0 * at + exact.mesh.box[0][1]], [0.0, 0.0, 1.0])
    until = Plane((0, 0, exact.mesh.box[1][1]), (0, 0, 1))
    opd = []
    for interpolation in ("cells", "bilinear"):
        field = IndexField.from_mesh(exact.mesh, contrast, interpolation=interpolation, ambient_index=1.0)
        opd.append(trace(field, rays, until=until, precision="float64", backend="reference").opd.reshape(2, ni))
    along = np.abs((opd[0] - opd[1]).mean(axis=0))
    told = field.averages_lacking
    columns = (contrast.reshape(ni, nj) - means(field.mesh, field.samples.values).reshape(ni, nj)).mean(axis=0)
    across = np.abs(columns) * np.ptp(y)
    assert told.row_path == pytest.approx(max(along.max(), across.max()), rel=1e-4)
    assert along.max() > 1e-3 * np.ptp(contrast)


def test_rows_are_found_in_cells_of_no_order():
    mesh, average = skewed(25, "planar"), attached_shock(24)
    shuffled = without_order(mesh)
    own = [
        int(np.flatnonzero((np.sort(mesh.cells, axis=1) == np.sort(cell)).all(axis=1))[0]) for cell in shuffled.cells
    ]
    field = IndexField.from_mesh(mesh, average, ambient_index=1.0)
    there = averages_lacking(shuffled, average[own], field.samples.values)
    here = field.averages_lacking
    for name in ("rows_max", "rows_rms", "row_path", "cells_max", "cells_rms"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), rel=1e-9)


def test_rows_over_a_step_lack_little():
    """Set-up: a shock over a step, blocks that no array holds, whose cells lack up to more than 1e-3 of the range.

    Expected: every row and column within 3e-4 of the range, where "bilinear" lacks more than 1e-2.
    """
    mesh, average = beside_a_step(40)
    field = IndexField.from_mesh(mesh, 1e-4 * average, interpolation="conserving", ambient_index=1.0)
    lacks = vertex_weights(field.mesh).deficit(of_parents(field.mesh, field.samples.averages), field.samples.values)
    assert np.abs(lacks).max() > 1e-3 * np.ptp(field.samples.averages)
    assert 1e-6 < field.averages_lacking.rows_max < 3e-4
    assert IndexField.from_mesh(mesh, 1e-4 * average, ambient_index=1.0).averages_lacking.rows_max > 1e-2


def test_triangles_have_no_rows():
    mesh = triangles(13, "planar")
    told = IndexField.from_mesh(mesh, np.repeat(np.tile(attached_shock(12), 2), 3), ambient_index=1.0).averages_lacking
    assert told.rows_max is told.rows_rms is told.row_path is None and not told.keeps_rows
    assert told.cells_max >= told.cells_rms > 0.0 and "single cells" in told.in_words()


def test_nothing_is_told_of_values_at_points_and_of_air_at_rest():
    mesh = skewed(9, "planar")
    assert IndexField.from_mesh(mesh, np.zeros(81)).averages_lacking is None
    assert (
        IndexField.from_samples(np.zeros((9, 9)), origin=(0, 0), spacing=(1, 1), geometry="planar").averages_lacking
        is None
    )
    still = IndexField.from_mesh(mesh, np.full(64, 1e-4)).averages_lacking
    assert still.keeps_rows and still.cells_max < 1e-12
