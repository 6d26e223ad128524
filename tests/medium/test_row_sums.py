"""What cells beside a shock cannot keep goes to neighbours: rows of cells are kept, within bounds, and not far off."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from scipy.sparse import csr_array

from aerokernels import flow
from aerokernels.medium import IndexField, QuadMesh
from aerokernels.medium.averages import kept_averages
from aerokernels.medium.averages.bounded import least_change
from aerokernels.medium.averages.edge_lines import edge_lines
from aerokernels.medium.averages.row_sums import REACH
from aerokernels.medium.averages.vertex_values import of_parents
from aerokernels.medium.averages.vertex_weights import vertex_weights
from aerokernels.medium.refined import cells_of_four

from .test_kept_averages import skewed, triangles


def attached_shock(count: int) -> np.ndarray:
    """Averages of a shock from 1 to 2 at 30 degrees to rows that begins at a wall; densities rise on both sides."""
    i, j = np.meshgrid(np.arange(count) + 0.5, np.arange(count) + 0.5, indexing="ij")
    behind = 0.5 + 0.5 * np.tanh(((i - 0.3 * count) * 0.5 - j * 0.87) / 0.5)
    return (1.0 + 0.1 * (i + j) / count + behind).ravel()


def kept(monkeypatch, mesh: QuadMesh, average: np.ndarray, rows: bool):
    """The cut mesh, values, bounds and what each cell lacks, with or without the rows' sums."""
    seen = {}

    def spread(cells, own, found, low, high, shape=None, lines=None):
        seen["bounds"] = low, high
        return keep(cells, own, found, low, high, shape, lines) if rows else found

    keep = kept_averages.keep_row_sums
    with monkeypatch.context() as patch:
        patch.setattr(kept_averages, "keep_row_sums", spread)
        finer, values, _ = kept_averages.cut_and_kept(mesh, average)
    own = average if mesh.parents is None else of_parents(mesh, average)
    return finer, values, seen["bounds"], vertex_weights(finer).deficit(own, values)


def rows_lack(finer: QuadMesh, lacks: np.ndarray, count: int) -> np.ndarray:
    """What rows and columns lack on an average over their area, shape (2 * count,)."""
    area = vertex_weights(finer).area.reshape(count, count)
    off = area * lacks.reshape(count, count)
    return np.abs(np.concatenate([off.sum(axis=k) / area.sum(axis=k) for k in (0, 1)]))


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_rows_and_columns_across_a_shock_hold_what_the_file_holds(monkeypatch, geometry):
    """Set-up: a shock that begins at a wall, uneven skewed cells.

    Expected: the mean of the interpolant over every row and every column of cells, by their areas, within 1e-6 of the
    range of that of the averages, where it was off by 3e-5 and more; every value within the bounds that it had, and
    cells more than REACH steps from one that lacked something as they were, to the bit.
    """
    count = 40
    mesh = skewed(count + 1, geometry)
    average = attached_shock(count)
    _, start, (low, high), before = kept(monkeypatch, mesh, average, False)
    finer, values, _, lacks = kept(monkeypatch, mesh, average, True)
    was, now = (rows_lack(finer, x, count) for x in (before, lacks))
    assert was.max() > 3e-5 and now.max() < 1e-6
    assert (values >= low).all() and (values <= high).all()
    far = np.ones((count, count), dtype=bool)
    for i, j in np.argwhere(np.abs(before.reshape(count, count)) > 1e-6):
        x, y = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
        far &= np.abs(x - i) + np.abs(y - j) > REACH
    assert far.sum() > 100
    assert np.array_equal(
        values[finer.cells][far.ravel()[finer.parents]], start[finer.cells][far.ravel()[finer.parents]]
    )


def test_squares_of_what_cells_lack_grow_little(monkeypatch):
    """As above: what single cells lack, rms, below 6e-4 of the range; none a tenth.

    Without lines of edges, for which cells give too, 1.6 times the least that the bounds allow.
    """
    mesh = skewed(41, "planar")
    average = attached_shock(40)
    before, lacks = (kept(monkeypatch, mesh, average, rows)[3] for rows in (False, True))
    assert np.sqrt(np.mean(lacks**2)) < 6e-4 * np.ptp(average) and np.abs(lacks).max() < 0.1
    monkeypatch.setattr(kept_averages, "edge_lines", lambda *given: None)
    rows_alone = kept(monkeypatch, mesh, average, True)[3]
    assert np.sqrt(np.mean(rows_alone**2)) < 1.6 * np.sqrt(np.mean(before**2))


def test_what_bounds_forbid_is_left_to_few_rows(monkeypatch):
    """Set-up: an ideal shock between gases of one density each, askew: they have no room for anything.

    Expected: eight in ten rows and columns within 1e-6, and none off by as much as single cells were.
    """
    mesh = skewed(41, "planar")
    average = 1.0 + np.clip(0.5 + (mesh.cell_centroid @ [1.0, 0.4] - 0.75) / 0.02, 0.0, 1.0)
    before = kept(monkeypatch, mesh, average, False)[3]
    finer, _, _, lacks = kept(monkeypatch, mesh, average, True)
    off = rows_lack(finer, lacks, 40)
    assert np.mean(off < 1e-6) > 0.8 and 1e-6 < off.max() < 0.1 * np.abs(before).max()


def test_triangles_keep_strips(monkeypatch):
    """Set-up: the same in triangles. Expected: the sum over all of them, which lacked more, within 1e-6."""
    count = 24
    mesh = triangles(count + 1, "planar")
    average = np.repeat(np.tile(attached_shock(count), 2), 3)
    before, lacks = (kept(monkeypatch, mesh, average, rows)[3] for rows in (False, True))
    area = vertex_weights(mesh).area
    assert abs((area * before).sum()) > 1e-6 * area.sum()
    assert abs((area * lacks).sum()) < 1e-6 * area.sum()
    assert (np.abs(lacks) < 0.25).all()


def test_a_shock_along_a_row_is_left_to_the_columns(monkeypatch):
    """Set-up: a row of 1.1 between 1 and 2, all along. Expected: columns kept, rows as they were, and that reported."""
    count = 30
    mesh = skewed(count + 1, "planar")
    average = np.ones((count, count))
    average[:, 14], average[:, 15:] = 1.1, 2.0
    finer, _, _, lacks = kept(monkeypatch, mesh, average.ravel(), True)
    area = vertex_weights(finer).area.reshape(count, count)
    lacks = lacks.reshape(count, count)
    assert abs((area * lacks).sum(axis=1) / area.sum(axis=1)).max() < 1e-6
    assert lacks[:, 14].max() < -0.05
    field = IndexField.from_mesh(mesh, 1e-4 * average, interpolation="conserving", ambient_index=1.0)
    assert np.abs(field.samples.lacking).max() > 0.05e-4


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.01, 0.3]))
def test_any_averages_stay_within_bounds(seed, noise):
    """Set-up: a jump with noise of any cell. Expected: finite values, none beyond the averages by more than noise."""
    draw = np.random.default_rng(seed)
    mesh = skewed(int(draw.integers(6, 16)), "planar" if draw.random() < 0.5 else "axisymmetric")
    at = mesh.cell_centroid @ draw.normal(size=2)
    average = 1.0 + (at > np.quantile(at, draw.uniform(0.1, 0.9))) + noise * draw.uniform(-0.5, 0.5, len(at))
    _, values, _ = kept_averages.cut_and_kept(mesh, average)
    assert np.isfinite(values).all()
    span = np.ptp(average)
    assert values.min() > average.min() - 0.5 * span and values.max() < average.max() + 0.5 * span


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_least_change_is_the_bounded_least_squares(seed):
    """Set-up: random equations, some hard and some soft. Formula: scipy's bounded least squares of the stacked system.

    Expected: the same change within 1e-4 of the bounds' width (the two stop at gradients of 1e-8 and 1e-9).
    """
    draw = np.random.default_rng(seed)
    rows, columns = int(draw.integers(1, 8)), int(draw.integers(2, 20))
    matrix = draw.normal(size=(rows, columns)) * (draw.random((rows, columns)) < 0.6)
    give, wanted = 10.0 ** draw.uniform(-3.0, 0.0, rows), draw.normal(size=rows)
    low, high = -draw.random(columns), draw.random(columns)
    low[draw.random(columns) < 0.2] = 0.0
    found = least_change(csr_array(matrix), give, wanted, low, high)
    stacked = np.vstack([np.eye(columns), matrix / np.sqrt(give)[:, None]])
    right = np.concatenate([np.zeros(columns), wanted / np.sqrt(give)])
    exact = lsq_linear(stacked, right, (low - 1e-12, high + 1e-12), tol=1e-13, method="bvls").x
    assert np.abs(found - exact).max() < 1e-4
    assert (found >= low).all() and (found <= high).all()


def test_lines_of_edges_across_an_ideal_shock(monkeypatch):
    """Set-up: exact averages of a plane shock, even cells; 120 lines along z, and what they are without lines of edges.

    Formula: the density's step times the way behind it. Expected: an rms error below 0.6 of that of rows alone, which
    keep a row's mean and leave each line in it open, and below 1e-3 of the rms integral.
    """
    field = flow.plane_shock(4.0, 0.5, length=1.0, spacing=0.02)
    ratio = field.density / field.ambient_density - 1.0
    low, high = field.mesh.box
    y = np.random.default_rng(5).uniform(low[0] + 0.1, high[0] - 0.1, 120)
    z = low[1] + (np.arange(4000) + 0.5) / 4000 * (high[1] - low[1])
    points = np.stack(np.meshgrid(y, z, indexing="ij"), axis=-1).reshape(-1, 2)
    exact = field.solution.density_ratio_at(*points.T) - 1.0

    def error() -> float:
        values = IndexField.from_mesh(field.mesh, 1e-4 * ratio, interpolation="conserving", ambient_index=1.0).samples
        change = (values.evaluate(points)[0] / 1e-4 - exact).reshape(120, -1).mean(axis=1)
        return float(np.sqrt(np.mean(change**2) / np.mean(exact.reshape(120, -1).mean(axis=1) ** 2)))

    found = error()
    monkeypatch.setattr(kept_averages, "edge_lines", lambda *given: None)
    assert found < min(0.6 * error(), 1e-3)


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
def test_edges_of_a_linear_density_have_its_means(geometry):
    """Set-up: averages of 1 + 2 y + 3 z in uneven skewed cells. Expected: that at edges' middles, but for curvature.

    Cells of 1 / 48 of the box's side bend by less than 1e-3 of it, and rims are extrapolated: two rows are left out.
    """
    mesh = skewed(25, geometry)
    slope = np.array([2.0, 3.0])
    average = 1.0 + mesh.cell_centroid @ slope
    lines = edge_lines(cells_of_four(mesh), average)
    off = lines.target - (1.0 + cells_of_four(mesh).vertices[lines.middle] @ slope)
    inner = ((lines.cells // 24 > 1) & (lines.cells // 24 < 22) & (lines.cells % 24 > 1) & (lines.cells % 24 < 22)).all(
        axis=1
    )
    assert inner.sum() > 700 and np.abs(off[inner]).max() < 1e-3
