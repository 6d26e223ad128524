"""VTK's other forms: .vtkhdf with its times, refined grids (.vth), partitioned sets (.vtpc), times that files state."""

import h5py
import numpy as np
import pytest

from aerokernels import flow

pytest.importorskip("vtkmodules")
from vtkmodules import vtkCommonDataModel, vtkIOXML
from vtkmodules.util.numpy_support import numpy_to_vtk

AT = np.array([[0.3, 0.4, 0.6], [0.55, 0.45, 0.5], [0.2, 0.8, 0.7]])


def linear(points):
    return 1.2 + points @ np.array([0.3, -0.2, 0.1])


def named(values, name: str = "rho"):
    array = numpy_to_vtk(np.asarray(values, np.float64), deep=True)
    array.SetName(name)
    return array


def even(count: int = 4, factor: float = 1.0):
    """A uniform grid of the unit cube with a linear density at its points."""
    grid = vtkCommonDataModel.vtkImageData()
    grid.SetDimensions(count, count, count)
    grid.SetSpacing(*[1.0 / (count - 1)] * 3)
    points = np.array([grid.GetPoint(k) for k in range(count**3)])
    grid.GetPointData().AddArray(named(factor * linear(points)))
    return grid


def write(path, kind: str, data, library=vtkIOXML):
    writer = getattr(library, f"vtkXML{kind}Writer")()
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    assert writer.Write() == 1
    return path


def vtkhdf(path, factors=(1.0,), times=None):
    """An unstructured grid of hexahedra in HDF5 as its file format describes it, with the density at each time."""
    n = 4
    z, y, x = np.meshgrid(*[np.linspace(0.0, 1.0, n)] * 3, indexing="ij")
    points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    index = np.arange(n**3).reshape(n, n, n)
    shifts = [(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 0, 0), (1, 0, 1), (1, 1, 1), (1, 1, 0)]
    cells = np.stack([index[k : k + n - 1, j : j + n - 1, i : i + n - 1].ravel() for k, j, i in shifts], axis=1)
    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs["Version"] = np.array([2, 0])
        root.attrs.create("Type", np.bytes_("UnstructuredGrid"), dtype=h5py.string_dtype("ascii", 16))
        for name, values in (
            ("NumberOfPoints", [len(points)]), ("NumberOfCells", [len(cells)]), ("Points", points),
            ("NumberOfConnectivityIds", [cells.size]), ("Connectivity", cells.ravel()),
            ("Offsets", 8 * np.arange(len(cells) + 1)), ("Types", np.full(len(cells), 12, np.uint8)),
            ("PointData/rho", np.concatenate([factor * linear(points) for factor in factors])),
        ):  # fmt: skip
            root[name] = np.asarray(values)
        if times is not None:
            steps = root.create_group("Steps")
            steps.attrs["NSteps"] = len(times)
            zero = np.zeros(len(times), np.int64)
            for name, values in (
                ("Values", np.array(times)), ("PartOffsets", zero), ("NumberOfParts", zero + 1),
                ("PointOffsets", zero), ("CellOffsets", zero[:, None]), ("ConnectivityIdOffsets", zero[:, None]),
                ("PointDataOffsets/rho", len(points) * np.arange(len(times))),
            ):  # fmt: skip
                steps[name] = values
    return path


@pytest.mark.parametrize("name", ["a.vtkhdf", "a.hdf"])
def test_vtks_own_hdf5_is_read_at_its_times(tmp_path, name):
    """Set-up: three times in one file, on one mesh. Expected: the requested one, by default the latest."""
    path = vtkhdf(tmp_path / name, (1.0, 2.0, 3.0), (0.0, 0.5, 0.7))
    assert flow.contents(path).times == (0.0, 0.5, 0.7)
    for time, factor in (("first", 1.0), (0.5, 2.0), (None, 3.0)):
        assert flow.read(path, time=time).density_at(AT) == pytest.approx(factor * linear(AT))
    with pytest.raises(flow.ReadError, match=r"there is no time 0\.6: take one of 0, 0\.5, 0\.7"):
        flow.read(path, time=0.6)


def test_one_time_that_a_file_states_is_told(tmp_path):
    grid = even()
    grid.GetFieldData().AddArray(named([0.25], "TimeValue"))
    path = write(tmp_path / "a.vti", "ImageData", grid)
    assert "t = 0.25" in flow.read(path, time=0.25).provenance
    with pytest.raises(flow.ReadError, match=r"there is no time 0\.5"):
        flow.read(path, time=0.5)


def test_refined_grids_are_read_with_all_their_levels(tmp_path):
    """Set-up: averages over 4^3 cells and over 4^3 finer ones in their middle, below which the coarse ones are wrong.

    Expected: the linear density, from the finest cells at each place.
    """
    grids = vtkCommonDataModel.vtkOverlappingAMR()
    grids.Initialize([1, 1])
    grids.SetOrigin([0.0, 0.0, 0.0])
    for level, (first, step) in enumerate(((0.0, 0.25), (0.25, 0.125))):
        own = vtkCommonDataModel.vtkUniformGrid()
        own.SetOrigin(*[first] * 3)
        own.SetSpacing(*[step] * 3)
        own.SetDimensions(5, 5, 5)
        middle = first + step * (np.arange(4) + 0.5)
        z, y, x = np.meshgrid(middle, middle, middle, indexing="ij")
        points = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
        wrong = (level == 0) & (np.abs(points - 0.5) < 0.25).all(axis=1)
        own.GetCellData().AddArray(named(np.where(wrong, 99.0, linear(points))))
        low = round(first / step)
        box = vtkCommonDataModel.vtkAMRBox()
        box.SetDimensions([low] * 3, [low + 3] * 3)
        grids.SetSpacing(level, [step] * 3)
        grids.SetAMRBox(level, 0, box)
        grids.SetDataSet(level, 0, own)
    path = write(tmp_path / "a.vth", "UniformGridAMR", grids)
    assert flow.read(path).density_at(AT) == pytest.approx(linear(AT))
