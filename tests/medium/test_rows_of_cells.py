"""What an interpolant lacks of rows and columns of cells, reported as a number that equals what lines lack."""

import numpy as np
import pytest

from aerokernels import flow, trace
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane

from .test_kept_averages import means, skewed, triangles


def attached_shock(count: int) -> np.ndarray:
    """Averages of a shock from 1 to 2 at 30 degrees to rows that begins at a wall; densities rise on both sides."""
    i, j = np.meshgrid(np.arange(count) + 0.5, np.arange(count) + 0.5, indexing="ij")
    behind = 0.5 + 0.5 * np.tanh(((i - 0.3 * count) * 0.5 - j * 0.87) / 0.5)
    return (1.0 + 0.1 * (i + j) / count + behind).ravel()


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
