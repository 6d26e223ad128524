"""Random CGNS, HDF5 and VTK contents as read by their libraries: nodes of a tree, arrays by name, grids in memory.

The walls and units of CGNS nodes, the axes of named arrays, and the blocks and cells of VTK's grids are interpreted by
this package. As in input_draws.py: a consistent answer, or a refusal in one line.
"""

import random
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.checks import check_blocks
from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.readers.cgns import SYMBOLS, WIDTH, units_of
from aerokernels.flow.reading.readers.cgns_nodes import Node
from aerokernels.flow.reading.readers.cgns_walls import patches_of
from aerokernels.flow.reading.readers.named_arrays import arrays_as_dataset
from aerokernels.flow.reading.readers.vtk_files import vtk_dataset

from .flow_draws import check_dataset
from .input_draws import Draw
from .refusals import check_refusal
from .spoiling import ODD_WORDS, REAL, WHOLE

PATH = Path("drawn.cgns")
KINDS = ("i1", "i4", "i8", "f4", "f8", "u8", ">f8", ">i4")
LABELS = ("Zone_t", "BC_t", "DataArray_t", "Elements_t", "IndexRange_t", "DimensionalUnits_t", "x", "")
NAMES = ("CoordinateX", "CoordinateY", "PointRange", "PointList", "ElementRange", "ElementList", "GridLocation",
         "ElementConnectivity", "ElementStartOffset", "Density", "Pressure", "\x1b", "")  # fmt: skip
TEXTS = ("Structured", "Unstructured", "Vertex", "FaceCenter", "IFaceCenter", "KFaceCenter", "EdgeCenter",
         "FamilySpecified", "BCWall", "BCFarfield", "Dimensional", "NormalizedByDimensional", "Null")  # fmt: skip


def _node(name: str, label: str, data: Any = None, *below: Node) -> Node:
    if isinstance(data, str):
        data = np.frombuffer(data.encode(), np.int8)
    made = Node(name, label, None if data is None else np.asarray(data))
    made.below = list(below)
    return made


FACES = ((7, [1, 2, 4, 3, 5, 6, 8, 7]), (20, [7, 1, 2, 4, 3, 5, 1, 2, 5]), (22, [4, 1, 2, 4, 3, 3, 1, 2, 5]))


def _zone(draw: random.Random, dimension: int) -> Node:
    """A zone of two cells, or of one, with three conditions."""
    even, words = draw.random() < 0.5, ["Null", "Meter", "Second", "Kelvin", "Degree"]
    if draw.random() < 0.5:
        words[draw.randrange(5)] = draw.choice([*SYMBOLS[0], *SYMBOLS[1], *SYMBOLS[3], "Null", ""])
    units = _node("DimensionalUnits", "DimensionalUnits_t", "".join(word.ljust(WIDTH) for word in words))
    power = _node("DimensionalExponents", "DimensionalExponents_t", [0.0, 1.0, 0.0, 0.0, 0.0])
    counts = np.array([3, 2, 2][:dimension])
    corners = np.stack(np.meshgrid(*(np.arange(n) for n in counts), indexing="ij"), -1).reshape(-1, dimension) * 1.0
    axes = [_node(f"Coordinate{a}", "DataArray_t", corners[:, k]) for k, a in enumerate("XYZ"[:dimension])]
    if draw.random() < 0.5:
        axes[0].below += [units, power][: draw.choice((1, 2))]
    size = np.array([counts, counts - 1, 0 * counts]) if even else np.array([[len(corners)], [2], [0]])
    ranges = np.array([[1, 1], [1, 2], [1, 2]][:dimension]).T
    kind, flat = (3, [1, 2, 3, 4]) if dimension == 2 else draw.choice(FACES)
    offsets = None
    if kind == 22 and draw.random() < 0.5:
        flat, offsets = [1, 2, 4, 3, 1, 2, 5], _node("ElementStartOffset", "DataArray_t", [0, 4, 7])
    parts = [_node("ElementRange", "IndexRange_t", [1, 2]), _node("ElementConnectivity", "DataArray_t", flat)]
    section = _node("Elements", "Elements_t", [kind, 0], *parts, *([] if offsets is None else [offsets]))
    named = _node("FamilyName", "FamilyName_t", "nose")
    place = ranges if even else [[1], [2]]
    conditions = [
        _node("wall", "BC_t", "BCWall", _node("PointRange", "IndexRange_t", place)),
        _node("list", "BC_t", "BCFarfield", _node("PointList", "IndexArray_t", [1, 2, 3, 4]),
              _node("GridLocation", "GridLocation_t", draw.choice(TEXTS))),
        _node("family", "BC_t", "FamilySpecified", named, _node("ElementRange", "IndexRange_t", [1, 2])),
    ]  # fmt: skip
    density = _node("Density", "DataArray_t", np.ones(len(corners)), units)
    return _node("Zone", "Zone_t", size, _node("ZoneType", "ZoneType_t", "Structured" if even else "Unstructured"),
                 _node("Grid", "GridCoordinates_t", None, *axes), _node("Flow", "FlowSolution_t", None, density),
                 _node("ZoneBC", "ZoneBC_t", None, *conditions), section)  # fmt: skip


def _all(node: Node) -> Iterator[tuple[Node, Node]]:
    """Every node with its parent."""
    for own in node.below:
        yield node, own
        yield from _all(own)


def _other(values: np.ndarray, draw: random.Random) -> np.ndarray:
    """An array with an error in its values, shape or type."""
    way, flat = draw.randrange(7), values.ravel().copy()
    with np.errstate(all="ignore"):
        if way <= 2 and flat.size:
            wild = np.array([draw.choice(WHOLE if flat.dtype.kind in "iu" else REAL)])
            flat[draw.randrange(flat.size)] = wild.astype(flat.dtype)[0]
            return flat.reshape(values.shape)
        if way == 3:
            return np.resize(flat, draw.choice((0, 1, 2, flat.size + 1, max(flat.size - 1, 0), 3)))
        if way == 4:
            return values.T if draw.random() < 0.5 else flat[None]
        if way == 5:
            return values.astype(draw.choice(KINDS))
    return flat[::-1].reshape(values.shape)


def cgns(draw: random.Random, folder: Path) -> bool:
    """The walls and units of a CGNS file's nodes."""
    dimension = draw.choice((2, 2, 3))
    family = _node("nose", "Family_t", None, _node("FamilyBC", "FamilyBC_t", draw.choice(TEXTS)))
    base = _node("Base", "CGNSBase_t", [dimension, dimension], family, _zone(draw, dimension))
    root = _node("", "", None, base)
    for _ in range(draw.choice((0, 1, 1, 2, 3))):
        above, own = draw.choice(list(_all(root)) or [(root, base)])
        way = draw.randrange(9)
        if way == 0 and own in above.below:
            above.below.remove(own)
        elif way == 1:
            own.label = draw.choice(LABELS)
        elif way == 2:
            own.name = draw.choice((*NAMES, draw.choice(ODD_WORDS)))
        elif way == 3:
            above.below.append(own)
        elif way == 4 and own.data is not None:
            own.data = np.frombuffer(draw.choice((*TEXTS, *ODD_WORDS)).encode(), np.int8)
        elif way == 5:
            own.data = None
        elif own.data is not None:
            own.data = _other(own.data, draw)
    try:
        with _in_words():
            patches, notes = patches_of(root)
            length, arrays = units_of(PATH, root)
    except ReadError as fault:
        return check_refusal(fault, PATH)
    count = sum(own.data.size for _, own in _all(root) if own.data is not None)
    for patch in patches:
        corners = patch.edges if patch.polygons is None else patch.polygons.points
        if corners.shape[-1] != 3 or corners.size > 300 * (count + 10):
            raise AssertionError(f"corners of shape {corners.shape}")
    if length is not None and not 0.0 < length < np.inf:
        raise AssertionError(f"a unit of length of {length} m")
    if not all(isinstance(text, str) for text in (*notes, *arrays.values())):
        raise AssertionError(f"texts: {notes} {arrays}")
    return bool(patches)


class _in_words:
    """Turn errors of a reader in a damaged file into a refusal, as `calling.read_here` does."""

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, fault: BaseException | None, trace: Any) -> None:
        if isinstance(fault, MemoryError) or (fault and "Unable to allocate" in str(fault)):
            raise AssertionError(f"asks for more memory than there is: {fault}") from fault
        if isinstance(fault, Exception) and not isinstance(fault, ReadError):
            raise ReadError(PATH, f"it cannot be read ({type(fault).__name__}: {fault})", "write it again") from fault


GIVEN: tuple[dict[str, Any], ...] = (
    {}, {}, {}, {"x": (0.0, 1.0), "y": [0, 2]}, {"x": "y", "y": "x"}, {"r": "p"}, {"x": (1, 0)},
)  # fmt: skip


def arrays(draw: random.Random, folder: Path) -> bool:
    """Arrays by name, with their units and the ends of axes, as HDF5 has them."""
    axes: dict[str, np.ndarray] = {"x": np.arange(3.0), "y": np.arange(4.0)}
    if draw.random() < 0.3:
        axes = {"r": np.arange(3.0), "z": np.arange(4.0)}
    elif draw.random() < 0.3:
        axes["z"] = np.arange(2.0)
    shape = tuple(map(len, axes.values()))
    held = {**axes, "rho": np.full(shape, 1.1)}
    ends: dict[str, tuple[float, float]] = {}
    if draw.random() < 0.3:
        ends = dict.fromkeys(axes, (0.0, 1.0))
        held = {"rho": held["rho"]}
    if draw.random() < 0.3:
        held = {"time": np.arange(2.0), **held, "rho": np.stack([held["rho"]] * 2)}
    units = dict.fromkeys(held, "")
    for _ in range(draw.choice((0, 1, 1, 2, 3))):
        name, way = draw.choice(list(held)), draw.randrange(8)
        if way <= 2:
            held[name] = _other(held[name], draw)
        elif way == 3:
            held[draw.choice(("a/rho", "p", "T", "t", "X [mm]", "", "\x1b", "z", "y"))] = held.pop(name)
        elif way == 4:
            units[name] = draw.choice(("mm", "kg/m3", "s since x", "\x1b[2J", "1e400", "K", *ODD_WORDS))
        elif way == 5 and ends:
            ends[draw.choice((*ends, "z", "r"))] = (draw.choice(REAL), draw.choice(REAL))
        elif way == 6 and len(held) > 1:
            del held[name]
        elif way == 7:
            held[draw.choice(("p", "T", "Mach", "data/values"))] = (
                np.resize(held["rho"], (3, 4)) if "rho" in held else held[name]
            )
    units = {name: units.get(name, "") for name in held}
    variables, time = draw.choice(GIVEN), draw.choice((None, None, "first", 1.0))
    try:
        with _in_words():
            found = arrays_as_dataset(PATH, held, "HDF5", time, {"variables": variables}, units=units, ends=ends)
        return check_dataset(PATH, found)
    except ValueError as fault:
        return check_refusal(fault, PATH)


def vtk(draw: random.Random, folder: Path) -> bool:
    """A grid of VTK, or several, with arrays of any length, type and name."""
    from vtkmodules.vtkCommonDataModel import vtkMultiBlockDataSet

    data: Any = _grid(draw)
    if draw.random() < 0.2:
        several = vtkMultiBlockDataSet()
        several.SetNumberOfBlocks(2)
        several.SetBlock(0, data)
        if draw.random() < 0.5:
            several.SetBlock(1, _grid(draw))
        data = several
    try:
        with _in_words():
            found = vtk_dataset(PATH, data, "VTK")
        check_blocks(PATH, found)
        return check_dataset(PATH, found)
    except ValueError as fault:
        return check_refusal(fault, PATH)


CELLS = {5: 3, 7: 5, 8: 4, 9: 4, 10: 4, 11: 8, 12: 8, 13: 6, 14: 5, 22: 6, 23: 8, 24: 10, 25: 20, 70: 9, 69: 6, 72: 27,
         71: 10, 73: 18, 3: 2, 1: 1, 41: 6, 0: 0, 68: 3}  # fmt: skip


ARRAYS = ("rho", "rho", "p", "T", "density", "vtkGhostType", "vtkGhostType", "Mach", "\x1b", "é")
TYPES = ("f8", "f8", "f4", "i4", "u1")


def _grid(draw: random.Random) -> Any:
    from vtkmodules import vtkCommonDataModel as model
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonCore import vtkPoints

    kind, shape = draw.randrange(5), draw.choice(((3, 2, 1), (3, 3, 1), (2, 3, 3), (3, 1, 2)))
    count = int(np.prod(shape))
    grid = np.stack([axis.ravel(order="F") for axis in np.meshgrid(*map(np.arange, shape), indexing="ij")], 1) * 1.0
    if draw.random() < 0.2:
        grid = np.resize(_other(grid, draw), (draw.choice((count, count, count - 1)), 3)).astype(float)
    data: Any
    if kind == 0:
        data = model.vtkImageData()
        data.SetDimensions(*shape)
        data.SetSpacing(*(draw.choice((1.0, 0.5, 0.0, -1.0, 1e300)) if draw.random() < 0.1 else 1.0 for _ in shape))
    elif kind == 1:
        data = model.vtkRectilinearGrid()
        data.SetDimensions(*shape)
        for n, put in zip(shape, (data.SetXCoordinates, data.SetYCoordinates, data.SetZCoordinates), strict=True):
            put(
                numpy_to_vtk(
                    np.arange(float(n)) if draw.random() < 0.9 else np.arange(n + draw.choice((-1, 1)))[: n + 1] * 1.0,
                    deep=True,
                )
            )
    else:
        data = (model.vtkStructuredGrid, model.vtkUnstructuredGrid, model.vtkPolyData)[kind - 2]()
        points = vtkPoints()
        points.SetData(numpy_to_vtk(np.ascontiguousarray(grid), deep=True))
        data.SetPoints(points)
        if kind == 2:
            data.SetDimensions(*shape)
        else:
            kinds = [draw.choice(list(CELLS)) if kind == 3 else 7 for _ in range(draw.randrange(5))]
            if draw.random() < 0.5:
                kinds = [draw.choice((5, 9, 10, 12)) if kind == 3 else 7] * 2
            number = [CELLS[one] + (draw.random() < 0.03) for one in kinds]
            flat = np.array([draw.randrange(count) for _ in range(sum(number))], np.int64)
            if draw.random() < 0.1 and flat.size:
                flat[draw.randrange(flat.size)] = draw.choice((-1, count, 2**40))
            cells = model.vtkCellArray()
            cells.SetData(
                numpy_to_vtkIdTypeArray(np.concatenate([[0], np.cumsum(number)]).astype(np.int64), deep=True),
                numpy_to_vtkIdTypeArray(flat, deep=True),
            )
            if kind == 3:
                data.SetCells(numpy_to_vtk(np.array(kinds, np.uint8), deep=True), cells)
            else:
                data.SetPolys(cells)
    for attributes, own in ((data.GetPointData(), count), (data.GetCellData(), data.GetNumberOfCells())):
        for _ in range(draw.choice((0, 1, 1, 2))):
            length = own if draw.random() < 0.9 else draw.choice((0, 1, own + 1, own * 2))
            values = np.linspace(1.0, 2.0, length) if draw.random() < 0.8 else np.ones((length, draw.choice((1, 2, 3))))
            values = _other(values, draw) if draw.random() < 0.2 else values
            with suppress(TypeError, KeyError):
                made = numpy_to_vtk(np.ascontiguousarray(values.astype(draw.choice(TYPES))), deep=True)
                made.SetName(draw.choice(ARRAYS))
                attributes.AddArray(made)
    return data


DRAWS: dict[str, Draw] = {"cgns-nodes": cgns, "hdf5-arrays": arrays, "vtk-grids": vtk}
