"""Nodes of a CGNS file in HDF5, as h5py's groups: their arrays against the sizes of their zones, boundary patches.

By the standard (SIDS) a zone of dimension d has d counts of vertices and d of cells; an unstructured zone has d = 1.
Rind states the rows of ghosts beyond both ends of each axis. VTK's reader allocates by these sizes: of a shorter array
the rest is memory that nobody wrote. It skips most kinds of boundary conditions.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import Patch, ReadError

# Number of points of each type of element.
POINTS = {2: 1, 3: 2, 4: 3, 5: 3, 6: 6, 7: 4, 8: 8, 9: 9, 10: 4, 11: 10, 12: 5, 13: 14, 14: 6, 15: 15, 16: 18, 17: 8,
          18: 20, 19: 27, 21: 13}  # fmt: skip
# Number of corners of edges, triangles and quadrilaterals; mid-edge points follow the corners.
SURFACE = {3: 2, 4: 2, 5: 3, 6: 3, 7: 4, 8: 4, 9: 4}
MIXED, POLYGONS = 20, 22
REMEDY = "write the file again, with each array at its GridLocation and ghosts stated by Rind"


def name_of(node) -> str:
    """Return the name of a node."""
    return str(node.name.rsplit("/", 1)[-1])


def _attribute(node, name: str) -> str:
    value = node.attrs.get(name, b"")
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def children(node, label: str) -> list:
    """Return the children of a node that have a given label."""
    return [own for own in node.values() if hasattr(own, "values") and _attribute(own, "label") == label]


def child(node, *names: str) -> Any:
    """Return the first child with data that has one of these names, or None."""
    return next((node[name] for name in names if " data" in node.get(name, ())), None)


def data_of(node) -> np.ndarray:
    """Return the data of a node, in HDF5's order of axes."""
    if " data" not in node:
        raise ValueError(f"node {name_of(node)!r} has no data")
    return np.asarray(node[" data"][...])


def text_of(node) -> str:
    """Return the data of a node as a text; empty for a node without data."""
    return data_of(node).tobytes().decode("latin-1").strip(" \0") if " data" in node else ""


def first_text(node, label: str, default: str = "") -> str:
    """Return the text of the first child of a node that has a label."""
    return next((text_of(own) for own in children(node, label)), default)


def location_of(node) -> str:
    """Return where the values or the places of a node are."""
    return first_text(node, "GridLocation_t", "Vertex")


def zones_of(root) -> list[tuple[Any, Any]]:
    """Return the zones of a file, each with its base."""
    return [(base, zone) for base in children(root, "CGNSBase_t") for zone in children(base, "Zone_t")]


def array_paths(root, label: str) -> Iterator[list]:
    """Yield the nodes above each array of the zones' parts of a label, from the root to the array itself."""
    for base, zone in zones_of(root):
        for part in children(zone, label):
            for array in children(part, "DataArray_t"):
                yield [root, base, zone, part, array]


def class_of(above: list) -> str:
    """Return the class of an array's data, as the last of its nodes that has one states it; empty if none does."""
    return next((text_of(own) for node in reversed(above) for own in reversed(children(node, "DataClass_t"))), "")


def check_counts(path: Path, root) -> dict[str, int]:
    """Check the shapes of coordinates and solutions, and return the cells of each unstructured zone by its name."""
    counts: dict[str, int] = {}
    for base, zone in zones_of(root):
        at = f"zone {name_of(zone)!r}"
        axes = int(_whole(path, base, 2)[0]) if first_text(zone, "ZoneType_t", "Structured") == "Structured" else 0
        vertices, cells, _ = sizes = _whole(path, zone, 3 * max(axes, 1)).reshape(3, -1)
        alone = (vertices == 1) & (cells == 1)  # along an axis of one vertex some programs count a cell
        if (vertices < 1).any() or (cells < 0).any() or (axes and ((cells != vertices - 1) & ~alone).any()):
            raise ReadError(path, f"{at} states the sizes {sizes.tolist()}", REMEDY)
        if not axes:
            counts[name_of(zone)] = int(cells[0])
        for grid in children(zone, "GridCoordinates_t"):
            _check_arrays(path, at, grid, vertices, "Vertex")
        for section in children(zone, "Elements_t"):
            _check_elements(path, at, section)
        for solution in children(zone, "FlowSolution_t"):
            where = location_of(solution)
            if where not in ("Vertex", "CellCenter"):
                fault = f"{name_of(solution)} of {at} is at {where}"
                raise ReadError(path, fault, "write it at Vertex or CellCenter")
            if any(name in solution for name in ("PointList", "PointRange")):
                fault = f"{name_of(solution)} of {at} is at a list of places, not at all of them"
                raise ReadError(path, fault, "write the whole solution")
            _check_arrays(path, at, solution, vertices if where == "Vertex" else cells, where)
    return counts


def _check_elements(path: Path, at: str, section) -> None:
    """Check that a section has the corners of the elements that it announces."""
    own, start = child(section, "ElementConnectivity"), child(section, "ElementStartOffset")
    limits = child(section, "ElementRange")
    if own is None or limits is None:
        raise ReadError(path, f"section {name_of(section)!r} of {at} has no elements", REMEDY)
    first, last = _whole(path, limits, 2)
    kind, held = int(_whole(path, section, 2)[0]), own[" data"].size
    if kind in POINTS:
        wanted = POINTS[kind] * int(last + 1 - first)
    elif start is not None:
        wanted = int(_whole(path, start, int(last + 2 - first))[-1])
    else:  # before CGNS 4 each polygon begins with its number of corners, and each mixed element with its type
        return
    if held != wanted:
        fault = f"section {name_of(section)!r} of {at} has {held} corners, elements {first} to {last} {wanted}"
        raise ReadError(path, fault, REMEDY)


def _check_arrays(path: Path, at: str, holder, counts: np.ndarray, where: str) -> None:
    ghosts = np.zeros(2 * len(counts), np.int64)
    for rind in children(holder, "Rind_t"):
        ghosts = _whole(path, rind, len(ghosts))
    if (ghosts < 0).any() or (len(counts) == 1 and ghosts.any()):  # VTK reads no ghosts of unstructured zones
        fault = f"{name_of(holder)} of {at} has the Rind {ghosts.tolist()}"
        raise ReadError(path, fault, "write the zone without its ghosts")
    wanted = tuple(int(own) for own in (counts + ghosts[::2] + ghosts[1::2])[::-1])  # HDF5 has the last axis first
    for array in children(holder, "DataArray_t"):
        data = array.get(" data")
        name, held = f"{name_of(array)} in {name_of(holder)}", getattr(data, "shape", ())
        if held != wanted:
            more = f" and Rind {ghosts.tolist()}" if ghosts.any() else ""
            fault = f"{name} of {at} has the shape {held}, and {where} with the zone's sizes{more} is {wanted}"
            raise ReadError(path, fault, REMEDY)
        # VTK reads an array by the type that its node states, into room for the type that it has in HDF5.
        if (kind := data.dtype.str[1:].upper().replace("F", "R")) != _attribute(array, "type"):
            fault = f"{name} is of {data.dtype} ({kind}), and its type is {_attribute(array, 'type')!r}"
            raise ReadError(path, fault, REMEDY)


def _whole(path: Path, node, count: int) -> np.ndarray:
    """Return the whole numbers of a node."""
    result = data_of(node).ravel() if " data" in node else np.empty(0)
    if len(result) != count or result.dtype.kind not in "iu":
        fault = f"node {name_of(node)!r} ({_attribute(node, 'label')}) has no {count} whole numbers"
        raise ReadError(path, fault, REMEDY)
    return result.astype(np.int64)


def patches_of(root) -> tuple[list[Patch], list[str]]:
    """Return the boundary patches of a file, edges of a plane or faces of a volume, and notes about them."""
    result, notes = [], []
    for base, zone in zones_of(root):
        dimension = int(data_of(base)[0])
        points = _points(zone)
        conditions = [own for part in children(zone, "ZoneBC_t") for own in children(part, "BC_t")]
        if dimension not in (2, 3) or points is None or not conditions:
            continue
        families = {name_of(own): first_text(own, "FamilyBC_t") for own in children(base, "Family_t")}
        even = first_text(zone, "ZoneType_t") == "Structured"
        elements = None if even else _elements(zone, 2 if dimension == 2 else 4)
        for own in conditions:
            if elements is None:
                corners = _faces_of_range(own, zone, dimension, len(points))
            else:
                corners = _listed(own, *elements)
            if not len(corners):
                notes.append(f"boundary patch {name_of(own)} names faces that do not exist")
                continue
            if corners.min() < 0 or corners.max() >= len(points):  # NumPy would count negative numbers from the end
                raise ValueError(f"boundary patch {name_of(own)!r} names points that are not there")
            result.append(Patch.of(name_of(own), _kind(own, families), points[corners]))
    return result, notes


def _points(zone) -> np.ndarray | None:
    for grid in children(zone, "GridCoordinates_t"):
        axes = [child(grid, f"Coordinate{axis}") for axis in "XYZ"]
        if axes[0] is not None and axes[1] is not None:
            own = [np.zeros(1) if axis is None else data_of(axis).astype(np.float64).ravel() for axis in axes]
            return np.stack(np.broadcast_arrays(*own), axis=1)
    return None


def _kind(condition, families: dict[str, str]) -> str:
    """Return "wall" for walls, by the condition's type, its family's type or the family's name; else the type."""
    kind = text_of(condition)
    if kind == "FamilySpecified":
        family = first_text(condition, "FamilyName_t")
        kind = families.get(family, "")
        if kind in ("", "Null", "UserDefined", "FamilySpecified"):
            kind = "wall" if "wall" in family.lower() else family
    return "wall" if kind.startswith("BCWall") else kind or "patch"


def _faces_of_range(condition, zone, dimension: int, point_count: int) -> np.ndarray:
    """Return the corners of the faces in a point range of a structured zone, shape (n, 2) or (n, 4); i is fastest."""
    counts = data_of(zone).reshape(3, dimension)[0].astype(np.int64)  # vertex counts first, as HDF5 orders axes
    if np.prod(counts, dtype=float) != point_count:
        raise ValueError(f"{zone.name!r} announces {' x '.join(map(str, counts))} points and has {point_count}")
    own, none = child(condition, "PointRange"), np.empty((0, 2), np.int64)
    if own is None:
        return none
    ends = data_of(own).astype(np.int64).reshape(2, dimension) - 1
    low, high = ends.min(axis=0), ends.max(axis=0)
    flat = np.flatnonzero(low == high)
    location = location_of(condition)
    if location != "Vertex":
        letter = {"IFaceCenter": 0, "JFaceCenter": 1, "KFaceCenter": 2}.get(location)
        across = letter if letter is not None else next((a for a in flat if low[a] in (0, counts[a] - 1)), None)
        if across is None or across >= dimension:
            return none
        high = high + (np.arange(dimension) != across)
        flat = np.array([across])
    if len(flat) != 1 or (low < 0).any() or (high >= counts).any():
        return none
    axes = [np.arange(first, last + 1) for first, last in zip(low, high, strict=True)]
    stride = np.concatenate([[1], np.cumprod(counts)[:-1]])
    index = sum(np.ix_(*axes)[k] * stride[k] for k in range(dimension)).squeeze(axis=int(flat[0]))
    if dimension == 2:
        return np.stack([index[:-1], index[1:]], axis=-1)
    corners = [index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]]
    return np.stack(corners, axis=-1).reshape(-1, 4)


def _elements(zone, wide: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers and the corners of a zone's edges (wide = 2), or of its faces (4), shape (n, wide)."""
    numbers, corners = [np.empty(0, np.int64)], [np.empty((0, wide), np.int64)]
    for section in children(zone, "Elements_t"):
        for kind, number, points in _of_section(section):
            own = points[:, : SURFACE[kind]] - 1
            if (own.shape[1] == 2) == (wide == 2):
                numbers.append(number)
                corners.append(np.concatenate([own, own[:, -1:].repeat(wide - own.shape[1], axis=1)], axis=1))
    return np.concatenate(numbers), np.concatenate(corners)


def _of_section(section) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
    """Yield type, numbers and points of the surface elements in a section."""
    kind = int(data_of(section)[0])
    own, limits = child(section, "ElementConnectivity"), child(section, "ElementRange")
    if own is None or limits is None or kind not in (*SURFACE, MIXED, POLYGONS):
        return
    first, last = (int(v) for v in data_of(limits).ravel())
    flat = data_of(own).astype(np.int64).ravel()
    if not 0 <= last + 1 - first <= len(flat):  # before allocating: a few bytes may announce billions
        raise ValueError(f"{name_of(section)!r} announces elements {first} to {last} in {len(flat)} numbers")
    number = np.arange(first, last + 1)
    if kind in SURFACE:
        yield kind, number, flat.reshape(len(number), POINTS[kind])
        return
    offsets = child(section, "ElementStartOffset")
    # Before CGNS 4 each polygon is preceded by its number of corners, as each mixed element is by its type.
    if kind == POLYGONS and offsets is not None:
        start = data_of(offsets).astype(np.int64)
        kinds, begin = np.diff(start), start[:-1]
    else:
        begin = np.empty(len(number), np.int64)
        at = 0
        for k in range(len(number)):
            begin[k] = at + 1
            at += 1 + (POINTS[int(flat[at])] if kind == MIXED else int(flat[at]))
        kinds = flat[begin - 1]
    for each in np.unique(kinds):
        code = int(each) if kind == MIXED else {2: 3, 3: 5, 4: 7}.get(int(each), 0)
        if code in SURFACE:
            some = np.flatnonzero(kinds == each)
            yield code, number[some], flat[begin[some][:, None] + np.arange(POINTS[code])]


def _listed(condition, number: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the corners of the elements of a condition: by their numbers, or those whose points are all listed."""
    ends = child(condition, "PointRange", "ElementRange")
    own = child(condition, "PointList", "ElementList")
    if ends is not None:
        first, last = (int(v) for v in data_of(ends).ravel())
    wanted = np.empty(0, np.int64) if own is None else data_of(own).astype(np.int64).ravel()

    def is_wanted(values: np.ndarray) -> np.ndarray:
        return np.isin(values, wanted) if ends is None else (values >= first) & (values <= last)

    by_element = location_of(condition) != "Vertex" or child(condition, "ElementRange", "ElementList") is not None
    return np.asarray(corners[is_wanted(number) if by_element else is_wanted(corners + 1).all(axis=1)])
