"""What every reader of a flow file returns: points, cells, arrays and boundary patches, in the file's own frame.

A reader knows its format and nothing of optics. The stages after it (density, frame, plane or volume, body) know
nothing of formats. The classes of this module are all that readers and later stages share.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, cast

import numpy as np

from aerokernels.process.foreign_files import HDF5_MAGIC as HDF5_MAGIC

DAMAGED = "the file is damaged: write it again"
UNFINISHED = "the file is damaged or was not written to its end: write it again"


def whole_number(word: str) -> int | None:
    """Return the value of a word of at most 18 ASCII digits; None for any other word."""
    return int(word) if word.isascii() and word.isdigit() and len(word) <= 18 else None


class ReadError(ValueError):
    """A flow file that cannot be used. The message gives the file, the place in it and the remedy, on one line."""

    def __init__(self, path, fault: str, remedy: str):
        """Compose the message of file, fault and remedy."""
        words = f"{path}: {fault}"
        if len(words) > 5000:  # names in a file may be of any length
            words = f"{words[:2500]} ... {words[-2500:]}"
        super().__init__(" ".join(f"{words}: {remedy[:5000]}".split()))

    def __reduce__(self):
        """Pickle as the message, so that the error can travel between processes."""
        return ReadError.said, (str(self),)

    @staticmethod
    def said(message: str) -> "ReadError":
        """Return the error with a complete message."""
        error = ReadError.__new__(ReadError)
        ValueError.__init__(error, message)
        return error


def chosen_time(path, times: Sequence[float], asked) -> float | None:
    """Return the requested one of a file's ascending times; None if the file has no times and none was requested."""
    if asked in (None, "latest", "first"):
        return (times[0] if asked == "first" else times[-1]) if times else None
    if not times:
        raise ReadError(path, f"it has one time only, not t = {asked!r}", "leave time out")
    wanted = float(asked)  # a number, or the text of one: `formats.checked_time` rejects others
    nearest = min(times, key=lambda value: abs(value - wanted))
    if not abs(nearest - wanted) <= 2.0**-24 * abs(wanted):  # many programs write times in single precision
        some = ", ".join(f"{value:g}" for value in times[:8]) + (", ..." if len(times) > 8 else "")
        raise ReadError(path, f"there is no time {asked!r}", f"take one of {some}, 'first' or 'latest'")
    return nearest


GREATEST_COORDINATE = 1e12  # in any unit: a greater number is damaged data


class GridPoints:
    """The points of a volume's grid along x, y and z, x fastest, by its axes; `numpy.asarray` makes all of them.

    Coordinates of each point take six times the memory of a float32 array on them.
    """

    def __init__(self, axes: Sequence[np.ndarray]):
        """Store the coordinates along x, y and z, float64, each of at least three nodes."""
        self.axes = tuple(axes)

    @staticmethod
    def of(axes: Sequence[np.ndarray]) -> np.ndarray:
        """Return the points of a grid: as `GridPoints` where they fill a volume, in the place of an array."""
        extent = np.array([np.ptp(axis) if len(axis) > 2 else 0.0 for axis in axes])
        points = GridPoints(axes)
        return cast(np.ndarray, points) if extent.min() > 1e-3 * extent.max() else np.asarray(points)

    def __len__(self) -> int:
        """Number of points."""
        return math.prod(map(len, self.axes))

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        """Return all points, shape (n, 3)."""
        grid = np.empty((*map(len, self.axes[::-1]), 3))
        for number, axis in enumerate(self.axes):
            grid[..., number] = axis.reshape(-1, *[1] * number)
        return grid.reshape(-1, 3)

    def edges(self) -> list[np.ndarray]:
        """Return the points on the three edges from the first point, along x, y and z, each of shape (n, 3)."""
        return [
            np.stack([axis if k == number else np.full(len(axis), own[0]) for k, own in enumerate(self.axes)], axis=1)
            for number, axis in enumerate(self.axes)
        ]


def grid_of(points: Any) -> GridPoints | None:
    """Return points that are those of a grid; None for an array."""
    return points if isinstance(points, GridPoints) else None


def check_points(path, points: np.ndarray, name: str = "") -> None:
    """Check that coordinates are finite and below GREATEST_COORDINATE."""
    if (grid := grid_of(points)) and all((np.abs(axis) < GREATEST_COORDINATE).all() for axis in grid.axes):
        return
    points = np.asarray(points)
    with np.errstate(invalid="ignore"):
        bad = ~(np.abs(points) < GREATEST_COORDINATE).all(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        where = f" of {name!r}" if name else ""
        raise ReadError(
            path,
            f"{int(bad.sum())} of {len(points)} points{where} have no proper place, the first is point {first} at "
            f"{points[first].tolist()}",
            DAMAGED,
        )


# Cell types by VTK's numbers, which all readers use.
TRIANGLE, POLYGON, QUAD, TETRAHEDRON, HEXAHEDRON, PRISM, PYRAMID, POLYHEDRON = 5, 7, 9, 10, 12, 13, 14, 42
CORNERS = {TRIANGLE: 3, QUAD: 4, TETRAHEDRON: 4, HEXAHEDRON: 8, PRISM: 6, PYRAMID: 5}
FLAT = (TRIANGLE, QUAD, POLYGON)
SOLID = (TETRAHEDRON, HEXAHEDRON, PRISM, PYRAMID, POLYHEDRON)


def entries_of(begin: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return the indices of runs of entries, one run after the other, from the first entry and the length of each."""
    return np.arange(int(width.sum())) + np.repeat(begin - (np.cumsum(width) - width), width)


def starts_of(width) -> np.ndarray:
    """Return where each of consecutive runs begins, and where the last one ends, shape (run_count + 1,)."""
    return np.concatenate([[0], np.cumsum(width, dtype=np.int64)])


@dataclass(frozen=True, eq=False)
class Faces:
    """The faces of polyhedra: `points[start[f]:start[f + 1]]` go round face f, seen from outside its owner."""

    start: np.ndarray  # shape (face_count + 1,)
    points: np.ndarray  # point indices, concatenated
    owner: np.ndarray  # the cell from which each face points outward, shape (face_count,)
    neighbour: np.ndarray  # the cell on the other side of each inner face, shape (inner_count,): inner faces come first


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of an unstructured block: `points[start[c]:start[c + 1]]` are the corners of cell c."""

    types: np.ndarray  # VTK's number of each cell's type, shape (cell_count,)
    start: np.ndarray  # shape (cell_count + 1,)
    points: np.ndarray  # point indices, concatenated; a polyhedron lists each of its corners once
    faces: Faces | None = None  # faces of all cells if some are polyhedra

    def __len__(self) -> int:
        """Number of cells."""
        return len(self.types)

    @classmethod
    def of_one_type(cls, kind: int, corners) -> "Cells":
        """Return cells of one type from their corners, shape (cell_count, corner_count)."""
        corners = np.asarray(corners, dtype=np.int64)
        count, width = corners.shape
        return cls(np.full(count, kind, np.uint8), width * np.arange(count + 1, dtype=np.int64), corners.ravel())

    @classmethod
    def polygons(cls, width: np.ndarray, points: np.ndarray) -> "Cells":
        """Return polygons from the number of corners of each, and their corners, concatenated."""
        return cls(np.full(len(width), POLYGON, np.uint8), starts_of(width), points)


@dataclass(frozen=True, eq=False)
class Block:
    """One zone of a file: points with cells, a structured grid of points, or points alone.

    `points` may be `GridPoints`, which the stages after the reader make an array unless they keep the grid.
    """

    points: np.ndarray  # coordinates in the file's unit and axes, float64, shape (point_count, 3)
    cells: Cells | None = None  # None for a structured block and for points alone
    shape: tuple[int, int, int] | None = None  # points along (i, j, k) of a structured block, i fastest
    point_data: dict[str, np.ndarray] = field(default_factory=dict)  # shape (point_count,) or (point_count, n)
    cell_data: Mapping[str, np.ndarray] = field(default_factory=dict)  # shape (cell_count,) or (cell_count, n)
    blank: np.ndarray | None = None  # cells (or points, by its length) without flow, in overset and blanked grids
    name: str = ""

    def arrays(self, where: str) -> Mapping[str, np.ndarray]:
        """Return the arrays of its "cell"s or "point"s."""
        return self.cell_data if where == "cell" else self.point_data

    @property
    def cell_count(self) -> int:
        """Number of cells; 0 for points alone."""
        if self.shape is not None:
            return int(np.prod([max(n - 1, 1) for n in self.shape]))
        return 0 if self.cells is None else len(self.cells)


@dataclass(frozen=True, eq=False)
class Polygons:
    """Faces in space: `points[start[f]:start[f + 1]]` go round face f."""

    points: np.ndarray  # corners, one face after the other, shape (n, 3); the last corner may be repeated
    start: np.ndarray  # shape (face_count + 1,)


@dataclass(frozen=True, eq=False)
class Patch:
    """A named part of the boundary, in the file's unit and axes: edges of a plane flow, or faces of a volume.

    `values` returns the values of an array, by its name, at each edge and in the cell behind it; None if unknown.
    """

    name: str
    kind: str  # "wall" where the file marks it as a wall, else the file's own type
    edges: np.ndarray = field(default_factory=lambda: np.empty((0, 2, 3)))  # both ends of each, (edge_count, 2, 3)
    polygons: Polygons | None = None
    values: Callable[[str], tuple[np.ndarray, np.ndarray] | None] | None = None

    @classmethod
    def of(cls, name: str, kind: str, corners: np.ndarray) -> "Patch":
        """Return a patch of edges or of faces with equally many corners, shape (count, corner_count, 3)."""
        each = corners.shape[1]
        if each == 2:
            return cls(name, kind, corners)
        return cls(name, kind, polygons=Polygons(corners.reshape(-1, 3), each * np.arange(len(corners) + 1)))


def wall_patches(path, patches: Sequence[Patch], names=None) -> list[Patch]:
    """Return the patches of the given names; None: those that the file marks as walls."""
    if names is None:
        return [patch for patch in patches if patch.kind == "wall"]
    chosen = {names} if isinstance(names, str) else set(names)
    known = {patch.name for patch in patches}
    if unknown := chosen - known:
        listed = ", ".join(sorted(known)) or "none"
        raise ReadError(path, f"there is no patch {min(unknown)!r}", f"the patches are {listed}")
    return [patch for patch in patches if patch.name in chosen]


@dataclass(frozen=True, eq=False)
class Dataset:
    """The contents of a file at one time; None where the file does not state something."""

    blocks: Sequence[Block]
    format: str
    geometry: str | None = None  # "planar", "axisymmetric" or "volume"; None where the points decide
    patches: Sequence[Patch] = ()
    times: Sequence[float] = ()  # for which the file or case has fields, ascending
    time: float | None = None  # that was read
    axis: tuple[float, float, float] | None = None  # direction of the axis of symmetry in the file's axes
    gas_constant: float | None = None  # [J/(kg K)]
    units: Mapping[str, str] = field(default_factory=dict)  # of each array by name
    length: float | None = None  # unit of the coordinates [m]
    notes: Sequence[str] = ()  # further remarks for the user, in whole sentences
    scaled: str = ""  # the one of the notes by which the file's numbers are hardly in SI
    unsure: str = ""  # the one of the notes of which a caller is warned
    grouped: bool = False  # whether slashes in the names of arrays separate groups, as in HDF5

    def array_names(self) -> list[str]:
        """Return the names of the arrays that all blocks have, in the order of the first block."""
        names = [{**dict.fromkeys(block.point_data), **dict.fromkeys(block.cell_data)} for block in self.blocks]
        return [name for name in (names[0] if names else {}) if all(name in other for other in names)]


def with_all_points(dataset: Dataset) -> Dataset:
    """Return the dataset with the points of each block as an array."""
    if not any(grid_of(block.points) for block in dataset.blocks):
        return dataset
    return replace(dataset, blocks=[replace(block, points=np.asarray(block.points)) for block in dataset.blocks])
