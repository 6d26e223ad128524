"""CGNS zones of drawn shapes, walls of volumes of SU2, and readers' children that end while nobody reads."""

import os
import signal
import time

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.flow.reading.formats import load
from aerokernels.process import fragile

from . import cgns_writer
from .test_volumes import cube, linear


@pytest.mark.parametrize("seed", range(6))
def test_cgns_zones_of_drawn_shapes(tmp_path, seed):
    """Set-up: 2 to 6 vertices along two or three axes, values at vertices or cells, ghosts at drawn ends.

    Expected: points and values in the order of VTK, i fastest, without the ghosts.
    """
    h5py = pytest.importorskip("h5py")
    draw = np.random.default_rng(seed)
    counts = draw.integers(2, 7, 2 + seed % 2)
    where = "CellCenter" if draw.random() < 0.5 else "Vertex"
    inner = draw.uniform(1.0, 2.0, (counts - (where == "CellCenter"))[::-1])
    ghosts = draw.integers(0, 3, (len(counts), 2))
    axes = np.meshgrid(*[np.sort(draw.uniform(size=n)) for n in counts], indexing="ij")
    axes = [axis.transpose() for axis in axes]
    padded = np.pad(inner, ghosts[::-1], constant_values=77.0)
    path = cgns_writer.cgns(tmp_path / "a.cgns", axes, padded, [])
    with h5py.File(path, "r+", track_order=True) as file:
        cgns_writer.node(file["Base/Zone/Flow"], "GridLocation", "GridLocation_t", where)
        cgns_writer.node(file["Base/Zone/Flow"], "Rind", "Rind_t", ghosts.ravel())
    (block,) = load(path, None, {}).blocks
    arrays = block.cell_data if where == "CellCenter" else block.point_data
    assert np.array_equal(arrays["Density"], inner.ravel())
    assert np.array_equal(np.asarray(block.points)[:, : len(axes)], np.stack([axis.ravel() for axis in axes], axis=1))


def test_markers_of_walls_in_a_volume_of_su2(tmp_path):
    """Set-up: 5^3 hexahedra without the middle one, whose faces are the marker "body". Expected: a body of that box."""
    points, corners = cube(5)
    middle, rest = corners[62], np.delete(corners, 62, axis=0)
    sides = middle[[(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]]
    lines = ["NDIME= 3", f"NELEM= {len(rest)}", *(f"12 {' '.join(map(str, row))}" for row in rest)]
    lines += [f"NPOIN= {len(points)}", *(" ".join(map(repr, row)) for row in points.tolist())]
    lines += ["NMARK= 1", "MARKER_TAG= body", "MARKER_ELEMS= 6", *(f"9 {' '.join(map(str, side))}" for side in sides)]
    (tmp_path / "mesh.su2").write_text("\n".join(lines))
    table = np.column_stack([np.arange(len(points)), linear(points)])
    np.savetxt(tmp_path / "restart.csv", table, delimiter=",", header='"PointID","Density"', comments="", fmt="%.17g")
    assert flow.contents(tmp_path / "restart.csv").patches == (("body", "wall"),)
    body = flow.read(tmp_path / "restart.csv", spacing=0.1).body
    assert np.array_equal(body.box, [points[middle].min(axis=0), points[middle].max(axis=0)])


def test_a_child_that_ended_is_replaced(tmp_path, readers_child):
    """Set-up: the child that waits for a file is killed. Expected: the next file is read, by another child."""
    xarray = pytest.importorskip("xarray")
    x = np.linspace(0.0, 1.0, 5)
    data = xarray.Dataset({"rho": (("y", "x"), 1.0 + np.add.outer(x, x))}, {"x": x, "y": x})
    data.to_netcdf(tmp_path / "a.nc", engine="scipy")
    before = flow.read(tmp_path / "a.nc").density
    (child,) = {own.process.pid for own in fragile._idle()[-1:]}
    os.kill(child, signal.SIGKILL)
    time.sleep(0.05)
    assert np.array_equal(flow.read(tmp_path / "a.nc").density, before)
    assert child not in {own.process.pid for own in fragile._idle()}
