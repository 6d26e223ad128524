"""The flow of writers.py in VTK's data sets, and in files by VTK's own writers."""

from pathlib import Path

import numpy as np
import writers


def vtk_grid(cells: bool = False):
    """The flow as a structured grid of VTK; its density at the points, or averages of cells."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkStructuredGrid

    x, y = writers.grid()
    points = vtkPoints()
    points.SetData(numpy_to_vtk(np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1), deep=True))
    data = vtkStructuredGrid()
    data.SetDimensions(writers.NI, writers.NJ, 1)
    data.SetPoints(points)
    values = numpy_to_vtk((writers.cell_means(writers.rho(x, y)) if cells else writers.rho(x, y)).ravel(), deep=True)
    values.SetName("rho")
    (data.GetCellData() if cells else data.GetPointData()).AddArray(values)
    return data


def vtk_even(three: bool = False):
    """A uniform grid of VTK with `rho`; in three dimensions plus z."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    data = vtkImageData()
    data.SetDimensions(writers.NI, writers.NJ, 5 if three else 1)
    data.SetSpacing(0.003, 0.002, 0.01)
    data.SetOrigin(0.0, 0.01, 0.0)
    axes = 0.01 * np.arange(5 if three else 1), 0.01 + 0.002 * np.arange(writers.NJ), 0.003 * np.arange(writers.NI)
    z, y, x = np.meshgrid(*axes, indexing="ij")
    values = numpy_to_vtk((writers.rho(x, y) + z).ravel(), deep=True)
    values.SetName("rho")
    data.GetPointData().AddArray(values)
    return data


def vtk_cells(points, cells, **arrays):
    """An unstructured grid of points, shape (n, 3), and cells, each VTK's type and its points.

    Arrays by name are values of the points or of the cells, by their lengths.
    """
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints
    from vtkmodules.vtkCommonDataModel import vtkUnstructuredGrid

    data, places = vtkUnstructuredGrid(), vtkPoints()
    places.SetData(numpy_to_vtk(np.asarray(points, np.float64), deep=True))
    data.SetPoints(places)
    for kind, corners in cells:
        data.InsertNextCell(kind, len(corners), [int(k) for k in corners])
    for name, values in arrays.items():
        own = numpy_to_vtk(np.asarray(values, np.float64), deep=True)
        own.SetName(name)
        (data.GetPointData() if len(values) == len(points) else data.GetCellData()).AddArray(own)
    return data


def vtk_unstructured(data):
    """Any grid of VTK as an unstructured one."""
    from vtkmodules.vtkFiltersCore import vtkAppendFilter

    append = vtkAppendFilter()
    append.AddInputData(data)
    append.Update()
    return append.GetOutput()


def write_vtk(path: Path, data, *, text: bool = False) -> Path:
    """Write a data set by VTK's own writer for the end of the name."""
    from vtkmodules import vtkIOLegacy, vtkIOXML

    names = {".vti": "ImageData", ".vtr": "RectilinearGrid", ".vts": "StructuredGrid", ".vtu": "UnstructuredGrid"}
    if path.suffix == ".vtk":
        writer = vtkIOLegacy.vtkDataSetWriter()
        (writer.SetFileTypeToASCII if text else writer.SetFileTypeToBinary)()
    else:
        writer = getattr(vtkIOXML, f"vtkXML{names[path.suffix]}Writer")()
        (writer.SetDataModeToAscii if text else writer.SetDataModeToAppended)()
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    assert writer.Write() == 1
    return path


def vtk_file(path: Path, kind: str = "") -> Path:
    """The flow in a file of VTK's by the end of its name."""
    from vtkmodules.vtkCommonDataModel import vtkRectilinearGrid

    if path.suffix == ".vti":
        data = vtk_even()
    elif path.suffix == ".vtr":
        even = vtk_even()
        data = vtkRectilinearGrid()
        data.SetDimensions(writers.NI, writers.NJ, 1)
        from vtkmodules.util.numpy_support import numpy_to_vtk

        data.SetXCoordinates(numpy_to_vtk(0.003 * np.arange(writers.NI), deep=True))
        data.SetYCoordinates(numpy_to_vtk(0.01 + 0.002 * np.arange(writers.NJ), deep=True))
        data.SetZCoordinates(numpy_to_vtk(np.zeros(1), deep=True))
        data.GetPointData().ShallowCopy(even.GetPointData())
    else:
        data = vtk_grid(cells=path.suffix == ".vtu")
        if path.suffix == ".vtu":
            data = vtk_unstructured(data)
    return write_vtk(path, data, text="ascii" in kind)
