"""What cells beside a shock cannot keep goes to neighbours: rows of cells are kept, within bounds, and not far off."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear
from scipy.sparse import csr_array

from aerokernels.medium import IndexField, QuadMesh, kept_averages
from aerokernels.medium.bounded import least_change
from aerokernels.medium.cell_shares import cell_shares
from aerokernels.medium.row_sums import REACH
from aerokernels.medium.vertex_values import of_parents

from .test_kept_averages import skewed, triangles


def attached_shock(count: int) -> np.ndarray:
    """Averages of a shock from 1 to 2 at 30 degrees to rows that begins at a wall; densities rise on both sides."""
    i, j = np.meshgrid(np.arange(count) + 0.5, np.arange(count) + 0.5, indexing="ij")
    behind = 0.5 + 0.5 * np.tanh(((i - 0.3 * count) * 0.5 - j * 0.87) / 0.5)
    return (1.0 + 0.1 * (i + j) / count + behind).ravel()


def kept(monkeypatch, mesh: QuadMesh, average: np.ndarray, rows: bool):
    """The cut mesh, values, bounds and what each cell lacks, with or without the rows' sums."""
    seen = {}

    def spread(cells, own, found, low, high, shape=None):
        seen["bounds"] = low, high
        return keep(cells, own, found, low, high, shape) if rows else found

    keep = kept_averages.keep_row_sums
    with monkeypatch.context() as patch:
        patch.setattr(kept_averages, "keep_row_sums", spread)
        finer, values, _ = kept_averages.cut_and_kept(mesh, average)
    own = average if mesh.parents is None else of_parents(mesh, average)
    return finer, values, seen["bounds"], cell_shares(finer).lacks(own, values)


def rows_lack(finer: QuadMesh, lacks: np.ndarray, count: int) -> np.ndarray:
    """What rows and columns lack on an average over their area, shape (2 * count,)."""
    area = cell_shares(finer).area.reshape(count, count)
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
    """As above: what single cells lack, rms, not above 1.6 times the least that the bounds allow; none a tenth."""
    mesh = skewed(41, "planar")
    average = attached_shock(40)
    before, lacks = (kept(monkeypatch, mesh, average, rows)[3] for rows in (False, True))
    assert np.sqrt(np.mean(lacks**2)) < 1.6 * np.sqrt(np.mean(before**2))
    assert np.abs(lacks).max() < 0.1


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
    area = cell_shares(mesh).area
    assert abs((area * before).sum()) > 1e-6 * area.sum()
    assert abs((area * lacks).sum()) < 1e-6 * area.sum()
    assert (np.abs(lacks) < 0.25).all()


def test_a_shock_along_a_row_is_left_to_the_columns(monkeypatch):
    """Set-up: a row of 1.1 between 1 and 2, all along. Expected: columns kept, rows as they were, and that told."""
    count = 30
    mesh = skewed(count + 1, "planar")
    average = np.ones((count, count))
    average[:, 14], average[:, 15:] = 1.1, 2.0
    finer, _, _, lacks = kept(monkeypatch, mesh, average.ravel(), True)
    area = cell_shares(finer).area.reshape(count, count)
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
