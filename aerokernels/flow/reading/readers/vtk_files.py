"""Read VTK's family of files with VTK: .vti .vtr .vts .vtu .vtk .vtkhdf, their parallel, composite forms, and lists.

VTK prints an error and returns what it has read so far. Here every printed error raises ReadError, and counts are
compared with those that the file announces. Runs in the child process of fragile.py.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import (
    HDF5_MAGIC,
    SOLID,
    Block,
    Dataset,
    GridPoints,
    Patch,
    Polygons,
    ReadError,
    chosen_time,
)
from aerokernels.flow.reading.readers.vtk_cells import cells_of, joined
from aerokernels.flow.reading.readers.vtk_collections import SUFFIXES, collection
from aerokernels.process.foreign_files import check_own_files, pieces

NO_OWN_FLOW = 1 | 8 | 32  # flags of cells that vtkDataSetAttributes calls duplicate, refined and hidden
SURFACE = (5, 7, 9)  # triangles, polygons, quadrilaterals


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a file of VTK's family."""
    suffix = path.suffix.lower()
    if suffix in SUFFIXES:
        return _series(path, time)
    name = {".vtk": "legacy VTK file"}.get(suffix, f"VTK file ({suffix})")
    data, times, chosen = vtk_output(path, suffix, time)
    return replace(vtk_dataset(path, data, name), times=times, time=chosen)


def files(path: Path, options: Mapping[str, Any], time: float | None) -> list[Path]:
    """Return the files that `read` opens, at one time or at all: those of a list, and the pieces that they name."""
    waiting = [path]
    if path.suffix.lower() in SUFFIXES:
        waiting += [entry.file for entry in collection(path) if time is None or entry.time == time]
    opened = dict.fromkeys(waiting)
    while waiting:
        named = [file for file in pieces(waiting.pop(0)) if file not in opened]
        waiting += named
        opened |= dict.fromkeys(named)
    return list(opened)


def vtk_dataset(path: Path | str, data, name: str) -> Dataset:
    """Return the contents of a data object of VTK, read from a file or in memory; `name` is that of its format."""
    notes: dict[str, None] = {}
    made = [joined(block) for block in blocks_of(path, data, notes)]
    notes |= dict.fromkeys(note for _, note in made if note is not None)
    blocks, patches = _boundaries([block for block, _ in made])
    return Dataset(blocks, name, patches=patches, notes=list(notes))


def _boundaries(blocks: list[Block]) -> tuple[list[Block], list[Patch]]:
    """Separate blocks of surfaces, which become patches, from the other blocks, if some blocks have solid cells."""
    if not any(min(block.shape) > 1 if block.shape else _has(block, SOLID) for block in blocks):
        return blocks, []
    kept: list[Block] = []
    patches: list[Patch] = []
    for block in blocks:
        if block.cells is None or not np.isin(block.cells.types, SURFACE).all():
            kept.append(block)
            continue
        faces = Polygons(block.points[block.cells.points], block.cells.start)
        patches.append(Patch(block.name or f"surface {len(patches) + 1}", "patch", polygons=faces))
    return kept, patches


def _has(block: Block, kinds) -> bool:
    return block.cells is not None and bool(np.isin(block.cells.types, kinds).any())


def _series(path: Path, time) -> Dataset:
    """Read the files of a list that have the chosen time."""
    entries = collection(path)
    times = sorted({entry.time for entry in entries})
    chosen = chosen_time(path, times, time)
    files = [entry.file for entry in entries if entry.time == chosen]
    for file in files:  # before any is opened: the process that calls this has checked the list
        check_own_files(file)
    parts = [read(file, None, {}) for file in files]
    blocks, patches = _boundaries([block for part in parts for block in part.blocks])
    patches = [*patches, *(patch for part in parts for patch in part.patches)]
    said = f"VTK series of {len(times)} times"
    return replace(parts[0], blocks=blocks, patches=patches, times=times, time=chosen, format=said)


def blocks_of(path: Path | str, data, notes: dict[str, None]) -> list[Block]:
    """Return the blocks of a data object, including nested ones, and add notes for the user to `notes`."""
    from vtkmodules.vtkCommonDataModel import vtkCompositeDataSet, vtkDataSet

    if isinstance(data, vtkCompositeDataSet):
        found = []
        iterator = data.NewIterator()
        iterator.InitTraversal()
        while not iterator.IsDoneWithTraversal():
            own = ""
            if iterator.HasCurrentMetaData():
                own = text_of(iterator.GetCurrentMetaData().Get(vtkCompositeDataSet.NAME()))
            part = iterator.GetCurrentDataObject()
            if isinstance(part, vtkDataSet) and part.GetNumberOfPoints():
                found.append(_block(path, part, own, notes))
            iterator.GoToNextItem()
        if not found:
            raise ReadError(path, "it has no block with points", DAMAGED)
        return found
    if not isinstance(data, vtkDataSet):
        raise ReadError(path, f"a {data.GetClassName()} is not a mesh", "give a grid with point or cell data")
    if not data.GetNumberOfPoints():
        raise ReadError(path, "it has no points", DAMAGED)
    return [_block(path, data, "", notes)]


def _block(path: Path | str, data, name: str, notes: dict[str, None]) -> Block:
    from vtkmodules.vtkCommonDataModel import vtkImageData, vtkRectilinearGrid, vtkStructuredGrid

    shape = None
    if isinstance(data, (vtkImageData, vtkRectilinearGrid, vtkStructuredGrid)):
        extent = data.GetExtent()  # GetDimensions has other arguments in other versions of VTK
        shape = (extent[1] - extent[0] + 1, extent[3] - extent[2] + 1, extent[5] - extent[4] + 1)
    point_data = _arrays(path, data.GetPointData(), data.GetNumberOfPoints())
    cell_data = _arrays(path, data.GetCellData(), data.GetNumberOfCells())
    ghosts = cell_data.pop("vtkGhostType", None)
    point_ghosts = point_data.pop("vtkGhostType", None)
    if any(own is not None and own.ndim != 1 for own in (ghosts, point_ghosts)):
        raise ReadError(path, "its vtkGhostType has several components", DAMAGED)
    blank = None
    if ghosts is not None and (ghosts.astype(int) & NO_OWN_FLOW).any():
        blank = (ghosts.astype(int) & NO_OWN_FLOW) != 0
    elif point_ghosts is not None and (point_ghosts.astype(int) & 2).any():
        blank = (point_ghosts.astype(int) & 2) != 0
    cells, parent = (None, None) if shape is not None else cells_of(path, data, notes)
    if parent is not None:
        cell_data = {name: values[parent] for name, values in cell_data.items()}
        blank = blank[parent] if blank is not None and ghosts is not None else blank
    return Block(_points(data), cells, shape, point_data, cell_data, blank, name)


def _points(data) -> np.ndarray:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkImageData, vtkRectilinearGrid

    if isinstance(data, (vtkImageData, vtkRectilinearGrid)) and (axes := _axes(data)) is not None:
        return GridPoints.of(axes)
    if isinstance(data, vtkImageData):
        low, step, count = data.GetExtent()[::2], np.array(data.GetSpacing()), data.GetDimensions()
        nodes = np.meshgrid(*(first + np.arange(n) for first, n in zip(low, count, strict=True)), indexing="ij")
        index = np.stack([axis.ravel(order="F") for axis in nodes], axis=1)
        matrix = data.GetDirectionMatrix()
        turn = np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
        return np.array(data.GetOrigin()) + (index * step) @ turn.T
    return vtk_to_numpy(data.GetPoints().GetData()).astype(np.float64)


def _axes(data) -> list[np.ndarray] | None:
    """Return the coordinates along x, y and z of a grid of VTK; None if it is turned."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkRectilinearGrid

    if isinstance(data, vtkRectilinearGrid):
        own = data.GetXCoordinates(), data.GetYCoordinates(), data.GetZCoordinates()
        return [vtk_to_numpy(axis).astype(np.float64) for axis in own]
    if not data.GetDirectionMatrix().IsIdentity():
        return None
    parts = zip(data.GetOrigin(), data.GetExtent()[::2], data.GetSpacing(), data.GetDimensions(), strict=True)
    return [origin + (first + np.arange(count)) * step for origin, first, step, count in parts]


def _arrays(path: Path | str, attributes, count: int) -> dict[str, np.ndarray]:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    found = {}
    for k in range(attributes.GetNumberOfArrays()):
        array = attributes.GetArray(k)
        if array is None:  # an array of texts
            continue
        values, name = vtk_to_numpy(array), text_of(array.GetName()) or f"array {k}"
        if len(values) != count:
            raise ReadError(path, f"array {name!r} has {len(values)} entries instead of {count}", DAMAGED)
        found[name] = np.array(values)
    return found


DAMAGED = "the file is damaged or of another version: write it again"
READERS = {
    ".vti": "vtkXMLImageDataReader",
    ".vtr": "vtkXMLRectilinearGridReader",
    ".vts": "vtkXMLStructuredGridReader",
    ".vtu": "vtkXMLUnstructuredGridReader",
    ".vtp": "vtkXMLPolyDataReader",
    ".pvti": "vtkXMLPImageDataReader",
    ".pvtr": "vtkXMLPRectilinearGridReader",
    ".pvts": "vtkXMLPStructuredGridReader",
    ".pvtu": "vtkXMLPUnstructuredGridReader",
    ".vtm": "vtkXMLMultiBlockDataReader",
    ".vtmb": "vtkXMLMultiBlockDataReader",
    ".vtpd": "vtkXMLPartitionedDataSetReader",
    ".vtpc": "vtkXMLPartitionedDataSetCollectionReader",
    ".vth": "vtkXMLUniformGridAMRReader",
    ".vthb": "vtkXMLUniformGridAMRReader",
}


def vtk_output(path: Path, suffix: str, time: Any = None) -> tuple[Any, list[float], float | None]:
    """Return the output of VTK's reader for a suffix, the file's times, and the one that was read."""
    from vtkmodules import vtkIOHDF, vtkIOLegacy, vtkIOXML

    reader: Any
    with path.open("rb") as stream:
        in_hdf5 = stream.read(len(HDF5_MAGIC)) == HDF5_MAGIC
    if in_hdf5:
        reader = vtkIOHDF.vtkHDFReader()
        reader.SetMaximumLevelsToReadByDefaultForAMR(0)  # all
    elif suffix == ".vtk":
        reader = vtkIOLegacy.vtkGenericDataObjectReader()
        reader.ReadAllScalarsOn()
        reader.ReadAllVectorsOn()
        reader.ReadAllTensorsOn()
        reader.ReadAllFieldsOn()
    else:
        reader = getattr(vtkIOXML, READERS.get(suffix, "vtkXMLGenericDataObjectReader"))()
        if suffix.startswith(".vth"):
            reader.SetMaximumLevelsToReadByDefault(0)
    reader.SetFileName(str(path))
    return run(path, reader, time, several=in_hdf5)


def run(path: Path, reader, time: Any = None, several: bool = True) -> tuple[Any, list[float], float | None]:
    """Run a VTK reader on a file: return its output, the file's times, and the one that was read."""
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow

    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    reader.UpdateInformation()
    times = _times(reader)
    if len(times) > 1 and not several:
        what = f"it has {len(times)} times in one file"
        raise ReadError(path, what, "write a file for each, and a list of them (.pvd), or .vtkhdf")
    chosen = chosen_time(path, times, time) if times else None
    if chosen is None:
        reader.Update()
    else:
        reader.UpdateTimeStep(chosen)
    said = re.sub(r" ?\(0x[0-9a-f]+\)", "", " ".join(text_of(window.GetOutput()).split()))
    if "ERR" in said or "rror" in said or reader.GetErrorCode():
        what = said.split("): ", 1)[-1][:200] or f"error {reader.GetErrorCode()}"
        raise ReadError(path, f"VTK cannot read it ({what})", DAMAGED)
    data = reader.GetOutputDataObject(0)
    if data is None:
        raise ReadError(path, "VTK finds nothing in it", DAMAGED)
    return data, times, chosen


def _times(reader) -> list[float]:
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

    information, key = reader.GetOutputInformation(0), Pipeline.TIME_STEPS()
    if information is None or not information.Has(key):
        return []
    return sorted({float(information.Get(key, k)) for k in range(information.Length(key))})


def text_of(said: str | bytes | None) -> str:
    """Return a text of VTK as str; VTK returns bytes for texts that are not UTF-8."""
    return said.decode("utf-8", "replace") if isinstance(said, bytes) else said or ""
