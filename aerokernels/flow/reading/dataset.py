"""What every reader of a flow file hands over: points, cells, arrays and boundary patches, in the file's own frame.

A reader knows its format and nothing of optics; what comes after it (density, frame, plane or volume, body) knows
nothing of formats. This page is all that the two have in common.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

LONGEST = 5000  # letters of what is wrong with a file, in a message


def whole_number(word: str) -> int | None:
    """The number that a word of at most 18 digits says; None of any other: digits of other scripts, or thousands."""
    return int(word) if word.isascii() and word.isdigit() and len(word) <= 18 else None


class ReadError(ValueError):
    """A flow file that cannot be used. The message names the file, the place in it and the remedy, on one line."""

    def __init__(self, path, fault: str, remedy: str):
        """Put file, fault and remedy together."""
        words = f"{path}: {fault}"
        if len(words) > LONGEST:  # names in a file may have any length
            words = f"{words[: LONGEST // 2]} ... {words[-LONGEST // 2 :]}"
        super().__init__(" ".join(f"{words}: {remedy[:LONGEST]}".split()))

    def __reduce__(self):
        """Pickled as its message: it travels between processes."""
        return ReadError.said, (str(self),)

    @staticmethod
    def said(message: str) -> "ReadError":
        """The error of a whole message."""
        error = ReadError.__new__(ReadError)
        ValueError.__init__(error, message)
        return error


def chosen_time(path, times: Sequence[float], asked) -> float | None:
    """The time asked for out of those that a file holds, ascending; None where it tells none and none was asked for.

    Raises:
        ReadError: No such time: which there are.
    """
    if asked in (None, "latest", "first"):
        return (times[0] if asked == "first" else times[-1]) if times else None
    if not times:
        raise ReadError(path, f"it holds one time only, not t = {asked!r}", "leave time out")
    wanted = float(asked)  # or a text of one: `formats.checked_time` has refused others
    nearest = min(times, key=lambda value: abs(value - wanted))
    if not abs(nearest - wanted) <= 1e-9 * abs(wanted):
        some = ", ".join(f"{value:g}" for value in times[:8]) + (", ..." if len(times) > 8 else "")
        raise ReadError(path, f"there is no time {asked!r}", f"take one of {some}, 'first' or 'latest'")
    return nearest


GREATEST_COORDINATE = 1e12  # of any unit: what is greater was never a length


def check_points(path, points: np.ndarray, name: str = "") -> None:
    """Refuse coordinates that are not finite, or none.

    Raises:
        ReadError: Such points: how many, and which is the first.
    """
    with np.errstate(invalid="ignore"):
        bad = ~(np.abs(points) < GREATEST_COORDINATE).all(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        where = f" of {name!r}" if name else ""
        raise ReadError(
            path,
            f"{int(bad.sum())} of {len(points)} points{where} have no proper place, the first is point {first} at "
            f"{points[first].tolist()}",
            "the file is damaged: write it again",
        )


# VTK's numbers of cell types, the common tongue of readers: corners of each, and its faces where it is solid.
VERTEX, LINE, TRIANGLE, POLYGON, QUAD, TETRAHEDRON, HEXAHEDRON, PRISM, PYRAMID, POLYHEDRON = (
    1, 3, 5, 7, 9, 10, 12, 13, 14, 42,
)  # fmt: skip
CORNERS = {TRIANGLE: 3, QUAD: 4, TETRAHEDRON: 4, HEXAHEDRON: 8, PRISM: 6, PYRAMID: 5}
FLAT = (TRIANGLE, QUAD, POLYGON)
SOLID = (TETRAHEDRON, HEXAHEDRON, PRISM, PYRAMID, POLYHEDRON)


@dataclass(frozen=True, eq=False)
class Faces:
    """The faces of polyhedra: `points[start[f]:start[f + 1]]` go round face f, looking from outside its owner.

    Attributes:
        start: Where each face begins, shape (face_count + 1,).
        points: Point indices, concatenated.
        owner: The cell that each face looks out of, shape (face_count,).
        neighbour: The cell behind each of the first faces, shape (inner_count,): inner faces come first.
    """

    start: np.ndarray
    points: np.ndarray
    owner: np.ndarray
    neighbour: np.ndarray


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of an unstructured block: `points[start[c]:start[c + 1]]` are the corners of cell c.

    Attributes:
        types: VTK's number of each cell's type, shape (cell_count,).
        start: Where each cell begins, shape (cell_count + 1,).
        points: Point indices, concatenated; of a polyhedron its corners, each once.
        faces: Faces of all cells, where some are polyhedra; otherwise None.
    """

    types: np.ndarray
    start: np.ndarray
    points: np.ndarray
    faces: Faces | None = None

    def __len__(self) -> int:
        """Number of cells."""
        return len(self.types)

    @classmethod
    def of_one_type(cls, kind: int, corners) -> "Cells":
        """Cells of one type from their corners, shape (cell_count, corner_count)."""
        corners = np.asarray(corners, dtype=np.int64)
        count, width = corners.shape
        return cls(np.full(count, kind, np.uint8), width * np.arange(count + 1, dtype=np.int64), corners.ravel())


@dataclass(frozen=True, eq=False)
class Block:
    """One zone of a file: points with cells, a structured grid of points, or points alone.

    Attributes:
        points: Coordinates in the file's unit and axes, float64, shape (point_count, 3).
        cells: The cells, or None for a structured block and for points alone.
        shape: Points along (i, j, k) of a structured block, the first index fastest; None for others.
        point_data: Arrays by name, shape (point_count,) or (point_count, n).
        cell_data: Arrays by name, shape (cell_count,) or (cell_count, n); structured cells with i fastest.
        blank: Cells (or, by size, points) without flow: holes of overset and blanked grids; None for no holes.
        name: The zone's name.
    """

    points: np.ndarray
    cells: Cells | None = None
    shape: tuple[int, int, int] | None = None
    point_data: dict[str, np.ndarray] = field(default_factory=dict)
    cell_data: Mapping[str, np.ndarray] = field(default_factory=dict)
    blank: np.ndarray | None = None
    name: str = ""

    @property
    def cell_count(self) -> int:
        """Number of cells; 0 for points alone."""
        if self.shape is not None:
            return int(np.prod([max(n - 1, 1) for n in self.shape]))
        return 0 if self.cells is None else len(self.cells)


@dataclass(frozen=True, eq=False)
class Polygons:
    """Faces in space: `points[start[f]:start[f + 1]]` go round face f.

    Attributes:
        points: Their corners, one face after the other, shape (n, 3); the last may be there twice.
        start: Where each face begins, shape (face_count + 1,).
    """

    points: np.ndarray
    start: np.ndarray


NO_EDGES = np.empty((0, 2, 3))


@dataclass(frozen=True, eq=False)
class Patch:
    """A named part of the boundary: edges in the plane of a two-dimensional flow, faces of a volume.

    Attributes:
        name: The patch's name in the file.
        kind: "wall" where the file says so, else the file's own word for it.
        edges: Both ends of each edge in the file's unit and axes, shape (edge_count, 2, 3); none of a volume.
        polygons: The faces in the file's unit and axes, of a volume.
        values: What an array has at each edge, by its name; None where the file does not say.
        behind: The cell behind each edge, where there are values.
    """

    name: str
    kind: str
    edges: np.ndarray = field(default_factory=lambda: NO_EDGES)
    polygons: Polygons | None = None
    values: Callable[[str], np.ndarray | None] | None = None
    behind: np.ndarray | None = None

    @classmethod
    def of(cls, name: str, kind: str, corners: np.ndarray) -> "Patch":
        """Edges or faces of equally many corners, shape (count, corner_count, 3): edges have two."""
        each = corners.shape[1]
        if each == 2:
            return cls(name, kind, corners)
        return cls(name, kind, polygons=Polygons(corners.reshape(-1, 3), each * np.arange(len(corners) + 1)))


@dataclass(frozen=True, eq=False)
class Dataset:
    """What a file holds at one time.

    Attributes:
        blocks: The zones.
        format: The format in words.
        geometry: "planar", "axisymmetric" or "volume" where the file tells; None where its points must.
        patches: Boundary patches.
        times: Times for which the file or case holds fields, ascending; empty for none.
        time: The one that was read, or None.
        axis: Direction of the axis of symmetry in the file's axes, for an axisymmetric flow.
        gas_constant: Of the gas, where the file tells it [J/(kg K)].
        ambient: Density of the free stream in the file's unit, where the file tells it.
        units: Unit of each array by name, where the file tells it.
        length: Unit of the coordinates [m], where the file tells it.
        notes: What else a user should know, in whole sentences.
    """

    blocks: Sequence[Block]
    format: str
    geometry: str | None = None
    patches: Sequence[Patch] = ()
    times: Sequence[float] = ()
    time: float | None = None
    axis: tuple[float, float, float] | None = None
    gas_constant: float | None = None
    ambient: float | None = None
    units: Mapping[str, str] = field(default_factory=dict)
    length: float | None = None
    notes: Sequence[str] = ()

    def array_names(self) -> list[str]:
        """Names of all arrays that every block with cells or points has, in the order of the first."""
        names = [[*block.point_data, *block.cell_data] for block in self.blocks]
        return [name for name in (names[0] if names else []) if all(name in other for other in names)]
