"""Boundary patches of a CGNS file in HDF5: its BC_t nodes, as edges of a plane or faces of a volume.

VTK's reader skips most kinds of boundary conditions, so h5py reads the nodes here: ranges of a structured zone,
elements
of an unstructured zone, given directly or by their points, with a type of their own or a family's.
"""

from collections.abc import Iterator

import numpy as np

from aerokernels.flow.reading.dataset import Patch
from aerokernels.flow.reading.readers.cgns_nodes import POINTS, Node, child, children, data_of, text_of

# Number of corners of CGNS edges, triangles and quadrilaterals; mid-edge points follow the corners.
SURFACE = {3: 2, 4: 2, 5: 3, 6: 3, 7: 4, 8: 4, 9: 4}
MIXED, POLYGONS = 20, 22


def patches_of(root: Node) -> tuple[list[Patch], list[str]]:
    """Return the boundary patches of a file, and notes for the user about them."""
    found, notes = [], []
    for base in children(root, "CGNSBase_t"):
        dimension = int(data_of(base)[0])
        if dimension not in (2, 3):
            continue
        families = {own.name: text_of(kind) for own in children(base, "Family_t")
                    for kind in children(own, "FamilyBC_t")}  # fmt: skip
        for zone in children(base, "Zone_t"):
            points = _points(zone)
            conditions = [own for part in children(zone, "ZoneBC_t") for own in children(part, "BC_t")]
            if points is None or not conditions:
                continue
            even = any(text_of(own) == "Structured" for own in children(zone, "ZoneType_t"))
            elements = None if even else _Elements(zone, dimension)
            for own in conditions:
                corners = _faces_of_range(own, zone, dimension, len(points)) if elements is None else elements.of(own)
                if not len(corners):
                    notes.append(f"boundary patch {own.name} names faces that do not exist")
                    continue
                if corners.min() < 0 or corners.max() >= len(points):  # NumPy would count negative numbers from the end
                    raise ValueError(f"boundary patch {own.name!r} names points that are not there")
                found.append(Patch.of(own.name, _kind(own, families), points[corners]))
    return found, notes


def _points(zone: Node) -> np.ndarray | None:
    for grid in children(zone, "GridCoordinates_t"):
        axes = [child(grid, f"Coordinate{axis}") for axis in "XYZ"]
        if axes[0] is not None and axes[1] is not None:
            own = [np.zeros(1) if axis is None else data_of(axis).astype(np.float64).ravel() for axis in axes]
            return np.stack(np.broadcast_arrays(*own), axis=1)
    return None


def _kind(condition: Node, families: dict[str, str]) -> str:
    """Return "wall" for walls, by the condition's type, its family's type or the family's name; else the type."""
    kind = text_of(condition)
    if kind == "FamilySpecified":
        family = next((text_of(own) for own in children(condition, "FamilyName_t")), "")
        kind = families.get(family, "")
        if kind in ("", "Null", "UserDefined", "FamilySpecified"):
            kind = "wall" if "wall" in family.lower() else family
    return "wall" if kind.startswith("BCWall") else kind or "patch"


def _location(condition: Node) -> str:
    own = child(condition, "GridLocation")
    return "Vertex" if own is None else text_of(own)


def _faces_of_range(condition: Node, zone: Node, dimension: int, point_count: int) -> np.ndarray:
    """Return the corners of the faces in a point range of a structured zone, shape (n, 2) or (n, 4); i is fastest."""
    counts = data_of(zone).reshape(3, dimension)[0].astype(np.int64)  # vertex counts first, as HDF5 orders axes
    if np.prod(counts, dtype=float) != point_count:
        raise ValueError(f"{zone.name!r} announces {' x '.join(map(str, counts))} points and has {point_count}")
    own = child(condition, "PointRange")
    if own is None:
        return np.empty((0, 2), np.int64)
    ends = data_of(own).astype(np.int64).reshape(2, dimension) - 1
    low, high = ends.min(axis=0), ends.max(axis=0)
    flat = np.flatnonzero(low == high)
    location = _location(condition)
    if location != "Vertex":
        letter = {"IFaceCenter": 0, "JFaceCenter": 1, "KFaceCenter": 2}.get(location)
        across = letter if letter is not None else next((a for a in flat if low[a] in (0, counts[a] - 1)), None)
        if across is None or across >= dimension:
            return np.empty((0, 2), np.int64)
        high = high + (np.arange(dimension) != across)
        flat = np.array([across])
    if len(flat) != 1 or (low < 0).any() or (high >= counts).any():
        return np.empty((0, 2), np.int64)
    axes = [np.arange(first, last + 1) for first, last in zip(low, high, strict=True)]
    stride = np.concatenate([[1], np.cumprod(counts)[:-1]])
    index = sum(np.ix_(*axes)[k] * stride[k] for k in range(dimension)).squeeze(axis=int(flat[0]))
    if dimension == 2:
        return np.stack([index[:-1], index[1:]], axis=-1)
    corners = [index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]]
    return np.stack(corners, axis=-1).reshape(-1, 4)


class _Elements:
    """The edges of an unstructured plane, or the faces of a volume, by their element numbers in the file."""

    def __init__(self, zone: Node, dimension: int):
        self.wide = 2 if dimension == 2 else 4
        number, corners = [], []
        for section in children(zone, "Elements_t"):
            for count, own in self._of_section(section):
                number.append(count)
                corners.append(own)
        self.number = np.concatenate(number) if number else np.empty(0, np.int64)
        self.corners = np.concatenate(corners) if corners else np.empty((0, self.wide), np.int64)

    def _of_section(self, section: Node) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        kind = int(data_of(section)[0])
        own, limits = child(section, "ElementConnectivity"), child(section, "ElementRange")
        if own is None or limits is None:
            return
        first, last = (int(v) for v in data_of(limits).ravel())
        flat = data_of(own).astype(np.int64).ravel()
        if not 0 <= last + 1 - first <= len(flat):  # before allocating: a few bytes may announce billions
            raise ValueError(f"{section.name!r} announces elements {first} to {last} in {len(flat)} numbers")
        number = np.arange(first, last + 1)
        if kind in SURFACE:
            yield from self._kept(kind, number, flat.reshape(len(number), POINTS[kind]))
        elif kind in (MIXED, POLYGONS):
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
                    yield from self._kept(code, number[some], flat[begin[some][:, None] + np.arange(POINTS[code])])

    def _kept(self, kind: int, number: np.ndarray, points: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        corners = points[:, : SURFACE[kind]] - 1
        if (corners.shape[1] == 2) != (self.wide == 2):
            return
        short = self.wide - corners.shape[1]
        yield number, np.concatenate([corners, corners[:, -1:].repeat(short, axis=1)], axis=1)

    def of(self, condition: Node) -> np.ndarray:
        """Return the corners of the elements of a condition.

        For a condition given by points these are the elements whose points are all listed.
        """
        ends = child(condition, "PointRange", "ElementRange")
        own = child(condition, "PointList", "ElementList")
        if ends is not None:
            first, last = (int(v) for v in data_of(ends).ravel())
        wanted = np.empty(0, np.int64) if own is None else data_of(own).astype(np.int64).ravel()

        def is_wanted(values: np.ndarray) -> np.ndarray:
            return np.isin(values, wanted) if ends is None else (values >= first) & (values <= last)

        by_element = _location(condition) != "Vertex" or child(condition, "ElementRange", "ElementList") is not None
        held = is_wanted(self.number) if by_element else is_wanted(self.corners + 1).all(axis=1)
        return np.asarray(self.corners[held])
