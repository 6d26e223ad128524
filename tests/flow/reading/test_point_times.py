"""Tables of points at several times, by a column of times."""

from pathlib import Path

import numpy as np
import pytest

from aerokernels import flow

X, Y = (own.ravel() for own in np.meshgrid(np.linspace(0.0, 1.0, 5), np.linspace(-0.5, 0.5, 4), indexing="ij"))
TIMES = (0.0, 2.0, 5.0)


def table(path: Path, name: str, *, order=None, more: dict | None = None, times=TIMES) -> Path:
    """Densities of 1 + x at the first time, 2 + x at the second, and so on."""
    columns = {
        name: np.repeat(times, len(X)),
        "x": np.tile(X, len(times)),
        "y": np.tile(Y, len(times)),
        "rho": np.concatenate([1.0 + k + X for k in range(len(times))]),
        **(more or {}),
    }
    rows = np.column_stack(list(columns.values()))
    rows = rows if order is None else rows[order]
    np.savetxt(path, rows, delimiter=",", header=",".join(columns), comments="")
    return path


@pytest.mark.parametrize(("name", "unit"), [("time", 1.0), ("Time [ms]", 1e-3), ("t", 1.0), ("Flow Time", 1.0)])
def test_a_column_of_times_divides_a_table(name: str, unit: float, tmp_path: Path):
    """Rows in any order. Expected: each time's own points on their grid, all as a series."""
    path = table(tmp_path / "a.csv", name, order=np.random.default_rng(1).permutation(3 * len(X)))
    for time, first in (("first", 1.0), (2.0 * unit, 2.0), (None, 3.0)):
        field = flow.read(path, time=time)
        # Of the mesh [y, z] with z = -x.
        assert np.array_equal(field.density, first - field.mesh.vertices[:, 1]) and field.density.size == len(X)
    with pytest.raises(flow.ReadError, match="there is no time 1000"):
        flow.read(path, time=1000.0)
    series = flow.open_series(path)
    assert np.allclose(series.time, np.array(TIMES) * unit) and [one.density.min() for one in series] == [1.0, 2.0, 3.0]


def test_temperatures_and_times_of_particles_are_arrays_like_any_other(tmp_path: Path):
    """A "t" of points that do not coincide is a temperature; times of single points divide nothing."""
    for name in ("t", "time"):
        values = 300.0 + np.arange(len(X))
        columns = {"x": X, "y": Y, "p": 287.0 * values, name: values, "rho": 1.0 + X}
        rows = np.column_stack(list(columns.values()))
        np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=",".join(columns), comments="")
        assert flow.read(tmp_path / "a.csv").density.size == len(X)
