"""Read VTK's family of files with VTK: .vti .vtr .vts .vtu .vtk .vtkhdf, their parallel, composite forms, and lists.

VTK prints an error and returns what it has read so far. Here every printed error raises ReadError, and counts are
compared with those that the file announces. Runs in the child process of fragile.py.
"""

import json
import math
import os.path
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

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
from aerokernels.process.foreign_files import OwnFilesError, check_own_files, own_file, pieces

LISTS = (".pvd", ".series")
# Formats that a list may name; a list cannot contain another list.
LISTED = (
    ".vti", ".vtr", ".vts", ".vtu", ".vtp", ".vtk", ".pvti", ".pvtr", ".pvts", ".pvtu", ".vtm", ".vtmb", ".vtpd",
    ".vtpc", ".vth", ".vthb", ".vtkhdf",
)  # fmt: skip
DAMAGED = "the file is damaged or of another version: write it again"
NO_LIST = "the list is damaged: write it again"


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a file of VTK's family."""
    suffix = path.suffix.lower()
    if suffix not in LISTS:
        name = {".vtk": "legacy VTK file"}.get(suffix, f"VTK file ({suffix})")
        data, times, chosen = vtk_output(path, suffix, time)
        return replace(vtk_dataset(path, data, name), times=times, time=chosen)
    entries = collection(path)
    times = sorted({entry.time for entry in entries})
    chosen = chosen_time(path, times, time)
    listed = [entry.file for entry in entries if entry.time == chosen]
    for file in listed:  # before any is opened: the process that calls this has checked the list
        check_own_files(file)
    parts = [read(file, None, {}) for file in listed]
    blocks, patches = _boundaries([block for part in parts for block in part.blocks])
    patches = [*patches, *(patch for part in parts for patch in part.patches)]
    said = f"VTK series of {len(times)} times"
    return replace(parts[0], blocks=blocks, patches=patches, times=times, time=chosen, format=said)


def files(path: Path, options: Mapping[str, Any], time: float | None) -> list[Path]:
    """Return the files that `read` opens, at one time or at all: those of a list, and the pieces that they name."""
    waiting = [path]
    if path.suffix.lower() in LISTS:
        waiting += [entry.file for entry in collection(path) if time is None or entry.time == time]
    opened = dict.fromkeys(waiting)
    while waiting:
        named = [file for file in pieces(waiting.pop(0)) if file not in opened]
        waiting += named
        opened |= dict.fromkeys(named)
    return list(opened)


class Entry(NamedTuple):
    """A file of a list, and its time [s]."""

    time: float
    file: Path


def collection(path: Path) -> list[Entry]:
    """Return the files of a list in the order of their times; files of one time in the order of the list.

    ParaView's collections (.pvd) are XML, with `<DataSet timestep="0.5" part="0" file="a_0.vtu"/>` for each file; the
    files of one time are its parts. File series (.vtu.series) are JSON: `{"files": [{"name": "a.vtu", "time": 0.5}]}`.
    """
    result = _of_series(path) if path.suffix.lower() == ".series" else _of_collection(path)
    if not result:
        raise ReadError(path, "it lists no data sets", NO_LIST)
    entries, seen, missing = [], set(), []
    for time, name, part in result:
        if not math.isfinite(time):
            raise ReadError(path, f"it lists {name} at a time that is not a number", NO_LIST)
        plain = name if "\0" in name else os.path.normpath(name)
        if Path(plain).suffix.lower() not in LISTED:
            raise ReadError(path, f"it lists {name!r}, which is not a VTK file", f"take one of {', '.join(LISTED)}")
        try:
            file = own_file(path, plain)
        except OwnFilesError as fault:
            raise ReadError.said(str(fault)) from None
        for key, what in (((time, file), name), ((time, part), f"part {part}")):
            if key in seen:
                raise ReadError(path, f"it lists {what} twice at the time {time:g}", "leave one of the two")
            if key[1] is not None:
                seen.add(key)
        entries.append(Entry(time, file))
        missing += [] if os.path.isfile(file) else [file]
    if missing:
        name = os.path.relpath(missing[0], path.parent)
        what = f"it lists {name}, which is not there ({len(missing)} of {len(entries)} files are missing)"
        raise ReadError(path, what, "restore the files, or take them out of the list")
    return sorted(entries, key=lambda entry: entry.time)


def _of_collection(path: Path) -> list[tuple[float, str, Any]]:
    """Return time, name and part of the entries of a .pvd file; None for parts without a number."""
    try:
        sets = [entry.attrib for entry in ElementTree.parse(path).getroot().iter("DataSet")]
        parts = [(own.get("group", ""), own["part"]) if "part" in own else None for own in sets]
        return [(float(own.get("timestep", 0.0)), own["file"], part) for own, part in zip(sets, parts, strict=True)]
    except KeyError:
        raise ReadError(path, "it is not a list of data sets: one of them names no file", NO_LIST) from None
    except (ElementTree.ParseError, LookupError, ValueError) as fault:
        raise ReadError(path, f"it is not a list of data sets ({fault})", NO_LIST) from None


def _of_series(path: Path) -> list[tuple[float, str, Any]]:
    """Return the same for a file series, which has no parts; without times its files are numbered from 0."""
    try:
        listed = json.loads(path.read_text(encoding="utf-8"))["files"]
        names = [entry["name"] for entry in listed]
        if not all(isinstance(name, str) for name in names):
            raise TypeError("a name that is not a text")
        if not any("time" in entry for entry in listed):
            return [(float(number), name, None) for number, name in enumerate(names)]
        times = [entry["time"] for entry in listed]
        if any(isinstance(time, bool) or not isinstance(time, (int, float)) for time in times):
            raise TypeError("a time that is not a number")
        return [(float(time), name, None) for time, name in zip(times, names, strict=True)]
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError, OverflowError) as fault:
        reason = f"there is no {fault}" if isinstance(fault, KeyError) else str(fault)
        raise ReadError(path, f"it is not a file series ({reason})", NO_LIST) from None


def vtk_dataset(path: Path | str, data, name: str) -> Dataset:
    """Return the contents of a data object of VTK, read from a file or in memory; `name` is that of its format."""
    from aerokernels.flow.reading.checks import check_blocks
    from aerokernels.flow.reading.readers.vtk_cells import joined

    notes: dict[str, None] = {}
    separate = blocks_of(path, data, notes)
    check_blocks(path, separate)
    parts = [joined(block) for block in separate]
    notes |= dict.fromkeys(note for _, note in parts if note is not None)
    blocks, patches = _boundaries([block for block, _ in parts])
    return Dataset(blocks, name, patches=patches, notes=list(notes))


def _boundaries(blocks: list[Block]) -> tuple[list[Block], list[Patch]]:
    """Separate blocks of surfaces, which become patches, from the other blocks, if some blocks have solid cells."""

    def consists_of(block: Block, kinds) -> np.ndarray:
        return np.isin(block.cells.types, kinds) if block.cells is not None else np.zeros(1, bool)

    if not any(min(block.shape) > 1 if block.shape else consists_of(block, SOLID).any() for block in blocks):
        return blocks, []
    kept: list[Block] = []
    patches: list[Patch] = []
    for block in blocks:
        if not consists_of(block, (5, 7, 9)).all():  # triangles, polygons, quadrilaterals
            kept.append(block)
            continue
        assert block.cells is not None
        faces = Polygons(block.points[block.cells.points], block.cells.start)
        patches.append(Patch(block.name or f"surface {len(patches) + 1}", "patch", polygons=faces))
    return kept, patches


def blocks_of(path: Path | str, data, notes: dict[str, None]) -> list[Block]:
    """Return the blocks of a data object, including nested ones, and add notes for the user to `notes`."""
    from vtkmodules.vtkCommonDataModel import vtkCompositeDataSet, vtkDataSet

    if not isinstance(data, vtkCompositeDataSet):
        if not isinstance(data, vtkDataSet):
            raise ReadError(path, f"a {data.GetClassName()} is not a mesh", "give a grid with point or cell data")
        if not data.GetNumberOfPoints():
            raise ReadError(path, "it has no points", DAMAGED)
        return [_block(path, data, "", notes)]
    result = []
    iterator = data.NewIterator()
    iterator.InitTraversal()
    while not iterator.IsDoneWithTraversal():
        own = ""
        if iterator.HasCurrentMetaData():
            own = text_of(iterator.GetCurrentMetaData().Get(vtkCompositeDataSet.NAME()))
        part = iterator.GetCurrentDataObject()
        if isinstance(part, vtkDataSet) and part.GetNumberOfPoints():
            result.append(_block(path, part, own, notes))
        iterator.GoToNextItem()
    if not result:
        raise ReadError(path, "it has no block with points", DAMAGED)
    return result


def _block(path: Path | str, data, name: str, notes: dict[str, None]) -> Block:
    from vtkmodules.vtkCommonDataModel import vtkImageData, vtkRectilinearGrid, vtkStructuredGrid

    from aerokernels.flow.reading.readers.vtk_cells import cells_of

    shape = None
    if isinstance(data, (vtkImageData, vtkRectilinearGrid, vtkStructuredGrid)):
        extent = data.GetExtent()  # GetDimensions has other arguments in other versions of VTK
        shape = (extent[1] - extent[0] + 1, extent[3] - extent[2] + 1, extent[5] - extent[4] + 1)
    point_data = _arrays(path, data.GetPointData(), data.GetNumberOfPoints())
    cell_data = _arrays(path, data.GetCellData(), data.GetNumberOfCells())
    ghosts, point_ghosts = (arrays.pop("vtkGhostType", None) for arrays in (cell_data, point_data))
    if any(own is not None and own.ndim != 1 for own in (ghosts, point_ghosts)):
        raise ReadError(path, "its vtkGhostType has several components", DAMAGED)
    blank = None
    # Flags of cells that vtkDataSetAttributes calls duplicate, refined and hidden, and of hidden points.
    if ghosts is not None and (ghosts.astype(int) & 41).any():
        blank = (ghosts.astype(int) & 41) != 0
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

    if isinstance(data, vtkRectilinearGrid):
        own = data.GetXCoordinates(), data.GetYCoordinates(), data.GetZCoordinates()
        return GridPoints.of([vtk_to_numpy(axis).astype(np.float64) for axis in own])
    if not isinstance(data, vtkImageData):
        return vtk_to_numpy(data.GetPoints().GetData()).astype(np.float64)
    numbers = [
        first + np.arange(count) for first, count in zip(data.GetExtent()[::2], data.GetDimensions(), strict=True)
    ]
    origin, spacing, matrix = data.GetOrigin(), data.GetSpacing(), data.GetDirectionMatrix()
    if matrix.IsIdentity():
        return GridPoints.of([low + own * step for low, own, step in zip(origin, numbers, spacing, strict=True)])
    turn = np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
    return np.array(origin) + (np.asarray(GridPoints(numbers)) * np.array(spacing)) @ turn.T


def _arrays(path: Path | str, attributes, count: int) -> dict[str, np.ndarray]:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    result = {}
    for k in range(attributes.GetNumberOfArrays()):
        array = attributes.GetArray(k)
        if array is None:  # an array of texts
            continue
        values, name = vtk_to_numpy(array), text_of(array.GetName()) or f"array {k}"
        if len(values) != count:
            raise ReadError(path, f"array {name!r} has {len(values)} entries instead of {count}", DAMAGED)
        result[name] = np.array(values)
    return result


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
    elif suffix.startswith(".vth"):
        reader = vtkIOXML.vtkXMLUniformGridAMRReader()
        reader.SetMaximumLevelsToReadByDefault(0)
    else:
        reader = vtkIOXML.vtkXMLGenericDataObjectReader()
    reader.SetFileName(str(path))
    return run(path, reader, time, several=in_hdf5)


def run(path: Path, reader, time: Any = None, several: bool = True) -> tuple[Any, list[float], float | None]:
    """Run a VTK reader on a file: return its output, the file's times, and the one that was read."""
    from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkStringOutputWindow
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline

    window = vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    reader.UpdateInformation()
    information, key = reader.GetOutputInformation(0), Pipeline.TIME_STEPS()
    count = information.Length(key) if information is not None and information.Has(key) else 0
    times = sorted({float(information.Get(key, k)) for k in range(count)})
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


def text_of(said: str | bytes | None) -> str:
    """Return a text of VTK as str; VTK returns bytes for texts that are not UTF-8."""
    return said.decode("utf-8", "replace") if isinstance(said, bytes) else said or ""
