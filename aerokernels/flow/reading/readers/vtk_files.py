"""Read VTK's family of files with VTK: .vti .vtr .vts .vtu .vtk .vtkhdf, their parallel, composite forms, and lists.

VTK prints an error and returns what it has read so far. Here every printed error raises ReadError, and counts are
compared with those that the file announces. Runs in the child process of fragile.py.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import (  # fmt: skip
    CORNERS,
    FLAT,
    LINE,
    SOLID,
    Block,
    Cells,
    Dataset,
    Faces,
    GridPoints,
    Patch,
    Polygons,
    ReadError,
    chosen_time,
)
from aerokernels.flow.reading.readers.high_order import BY_CORNERS, joined, linear_cells
from aerokernels.flow.reading.readers.vtk_collections import SUFFIXES, collection
from aerokernels.flow.reading.readers.vtk_running import DAMAGED, text_of, vtk_output
from aerokernels.flow.reading.volumes.solids import FACES
from aerokernels.process.foreign_files import check_own_files, pieces

NO_OWN_FLOW = 1 | 8 | 32  # flags of cells that vtkDataSetAttributes calls duplicate, refined and hidden
STRUCTURED_ORDER = {11: [0, 1, 3, 2, 4, 5, 7, 6], 8: [0, 1, 3, 2]}  # voxel and pixel corners in hexahedron, quad order
SURFACE = (5, 7, 9)  # triangles, polygons, quadrilaterals
LINEAR = {11: 12, 8: 9}
# Quadratic cells, which list their corners first, and the linear cell of each.
QUADRATIC = {21: 3, 35: 3, 22: 5, 34: 5, 23: 9, 28: 9, 30: 9, 24: 10, 25: 12, 29: 12, 33: 12, 26: 13, 31: 13, 32: 13,
             27: 14, 37: 14}  # fmt: skip
NO_FLOW = (0, 1, 2, 3, 4, 51, 60, 68, 75)  # empty cells, points, lines and curves


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
    cells, parent = (None, None) if shape is not None else _cells(path, data, notes)
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


def _cells(path: Path | str, data, notes: dict[str, None]) -> tuple[Cells | None, np.ndarray | None]:
    """Return the cells, and the file's cell that each came from if high-order cells were divided, else None."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkCommonDataModel import vtkPolyData

    if not data.GetNumberOfCells():
        return None, None
    if isinstance(data, vtkPolyData):
        return _polygons(path, data), None
    array = data.GetCells()
    start = vtk_to_numpy(array.GetOffsetsArray()).astype(np.int64)
    points = vtk_to_numpy(array.GetConnectivityArray()).astype(np.int64)
    kinds = np.array([data.GetCellType(0)]) if len(start) == 2 else vtk_to_numpy(_types(data))
    kinds = kinds.astype(np.uint8)
    if second := _read_by_corners(kinds, np.diff(start)):
        notes[f"{second} of {len(kinds)} cells are of second order: they are read by their corners alone"] = None
    start, points, kinds = _linear(start, points, kinds)
    start, points, kinds, parent = linear_cells(path, start, points, kinds)
    if len(unknown := np.setdiff1d(kinds, [*NO_FLOW, *FLAT, *SOLID])):
        raise ReadError(
            path, f"it has cells of VTK's type {unknown[0]}, which are not read", "write triangles, quadrilaterals, "
            "polygons, tetrahedra, hexahedra, prisms, pyramids or polyhedra"
        )  # fmt: skip
    faces = None
    if (kinds == 42).any():
        if parent is not None:
            raise ReadError(path, "it has polyhedra and cells of high order", "write linear cells")
        faces = _polyhedra(path, data, start, points, kinds)
    return Cells(kinds, start, points, faces), parent


def _types(data):
    from vtkmodules.vtkCommonCore import vtkVersion

    # VTK 9.6 renamed the method.
    named_anew = (vtkVersion.GetVTKMajorVersion(), vtkVersion.GetVTKMinorVersion()) >= (9, 6)
    return data.GetCellTypes() if named_anew else data.GetCellTypesArray()


def _polygons(path: Path | str, data) -> Cells | None:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    array = data.GetPolys()
    count = array.GetNumberOfCells()
    if not count:
        return None
    if count != data.GetNumberOfCells():
        raise ReadError(path, "it mixes polygons with lines or points", "give a surface of polygons, or a grid")
    start = vtk_to_numpy(array.GetOffsetsArray()).astype(np.int64)
    return Cells(np.full(count, 7, np.uint8), start, vtk_to_numpy(array.GetConnectivityArray()).astype(np.int64))


def _linear(start, points, kinds):
    """Convert voxels and pixels to hexahedra and quadrilaterals, and quadratic cells to their corners."""
    for kind, order in STRUCTURED_ORDER.items():
        own = np.flatnonzero(kinds == kind)
        if len(own):
            place = start[own][:, None] + np.array(order)
            points = points.copy()
            points[start[own][:, None] + np.arange(len(order))] = points[place]
            kinds = np.where(kinds == kind, LINEAR[kind], kinds).astype(np.uint8)
    if np.isin(kinds, list(QUADRATIC)).any():
        width = np.diff(start)
        keep = width.copy()
        for kind, plain in QUADRATIC.items():
            keep[kinds == kind] = {LINE: 2, **CORNERS}[plain]
            kinds = np.where(kinds == kind, plain, kinds).astype(np.uint8)
        within = np.arange(len(points)) - np.repeat(start[:-1], width)
        points = points[within < np.repeat(keep, width)]
        start = np.concatenate([[0], np.cumsum(keep)])
    return start, points, kinds


def _read_by_corners(kinds: np.ndarray, width: np.ndarray) -> int:
    """Return how many cells of the flow have points between their corners that are left out."""
    corners = {**{kind: CORNERS.get(plain, 2) for kind, plain in QUADRATIC.items()},
               **{kind: count for kind, (_, count, _) in BY_CORNERS.items()}}  # fmt: skip
    return sum(int(((kinds == kind) & (width > count)).sum()) for kind, count in corners.items() if count > 2)


def _polyhedra(path, data, start: np.ndarray, points: np.ndarray, kinds: np.ndarray) -> Faces:
    """Return the faces of all cells; a face between two cells is listed twice, once for each."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    faces, of_cells = data.GetPolyhedronFaces(), data.GetPolyhedronFaceLocations()
    if faces is None or of_cells is None or of_cells.GetNumberOfCells() != len(kinds):
        raise ReadError(path, "its polyhedra have no faces", DAMAGED)
    begin, flat, first, number = (
        vtk_to_numpy(array).astype(np.int64)
        for own in (faces, of_cells)
        for array in (own.GetOffsetsArray(), own.GetConnectivityArray())
    )
    if len(number) and (number.min() < 0 or number.max() >= len(begin) - 1):
        raise ReadError(path, "its polyhedra name faces that are not there", DAMAGED)
    width = np.diff(begin)[number]
    at = np.arange(width.sum()) + np.repeat(begin[number] - (np.cumsum(width) - width), width)
    widths, corners, owner = [width], [flat[at]], [np.repeat(np.arange(len(kinds)), np.diff(first))]
    for kind, table in FACES.items():
        own = np.flatnonzero(kinds == kind)
        for face in table:
            ring = list(dict.fromkeys(face))  # a triangle names its last corner twice
            corners.append(points[start[own][:, None] + ring].ravel())
            widths.append(np.full(len(own), len(ring)))
            owner.append(own)
    ends = np.concatenate([[0], np.cumsum(np.concatenate(widths))])
    return Faces(ends, np.concatenate(corners), np.concatenate(owner), np.empty(0, np.int64))
