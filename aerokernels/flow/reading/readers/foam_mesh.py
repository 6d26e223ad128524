"""Read the mesh of an OpenFOAM case: points, faces, owner and neighbour of each face, and the boundary's patches.

A patch has values at its faces where the solver writes them: one value, or one for each face, in the boundaryField of a
field. Values given in another way (coded, by macros, from other files) are unknown.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerokernels.flow.reading.dataset import POLYGON, Block, Cells, Faces, Patch, Polygons, ReadError, check_points
from aerokernels.flow.reading.readers.foam_file import FoamFile, find
from aerokernels.flow.reading.readers.point_table import is_number

_BOUNDARY = re.compile(rb"\bboundaryField\s*\{")
_PLAIN = re.compile(r"(?:[\w|()-]|\.\*?){1,200}")
LEVEL = ("zeroGradient", "symmetry", "symmetryPlane", "slip")  # conditions by which a wall has what its cells have
BAD_MESH = "run checkMesh on the case and make the mesh again"


@dataclass(frozen=True)
class FoamPatch:
    """A patch: its name, its type, its first face and its number of faces."""

    name: str
    kind: str
    first: int
    count: int


@dataclass(frozen=True, eq=False)
class FoamMesh:
    """A polyMesh folder.

    Attributes:
        folder: Path of the folder.
        points: Coordinates [m], shape (point_count, 3).
        faces: The faces.
        cell_count: Number of cells.
        patches: The patches of the boundary.
    """

    folder: Path
    points: np.ndarray
    faces: Faces
    cell_count: int
    patches: list[FoamPatch]

    def patch_faces(self, kind: str) -> list[np.ndarray]:
        """Return the indices of the faces of each non-empty patch of a type."""
        return [np.arange(p.first, p.first + p.count) for p in self.patches if p.kind == kind and p.count]


def read_mesh(folder: Path) -> FoamMesh:
    """Read a polyMesh folder."""
    file = FoamFile(folder / "points")
    points = file.numbers(file.scalar, 3).astype(np.float64)
    check_points(file.path, points)
    file = FoamFile(folder / "faces")
    start, corners = file.faces()
    if len(corners) and not (0 <= corners.min() and corners.max() < len(points)):
        raise ReadError(file.path, f"faces refer to points beyond the {len(points)} that there are", BAD_MESH)
    owner, neighbour = _cells_of_faces(folder, len(start) - 1)
    # The last cell owns no face if all of its neighbours have lower numbers.
    cell_count = int(max(owner.max(), neighbour.max(initial=-1))) + 1 if len(owner) else 0
    if not cell_count:
        raise ReadError(folder, "the mesh has no cells", BAD_MESH)
    patches = _patches(folder / "boundary", len(neighbour), len(start) - 1)
    return FoamMesh(folder, points, Faces(start, corners, owner, neighbour), cell_count, patches)


def _cells_of_faces(folder: Path, face_count: int) -> tuple[np.ndarray, np.ndarray]:
    file = FoamFile(folder / "owner")
    owner = file.numbers(file.label).astype(np.int64)
    if len(owner) != face_count:
        raise ReadError(file.path, f"it names owners of {len(owner)} faces, there are {face_count}", BAD_MESH)
    file = FoamFile(folder / "neighbour")
    neighbour = file.numbers(file.label).astype(np.int64)
    neighbour = neighbour[neighbour >= 0]  # old versions list -1 for the boundary
    # A cell has four faces or more: a greater cell number is damaged, and would set the size of arrays.
    most = (face_count + len(neighbour)) // 4
    fits = len(neighbour) <= face_count and len(owner) and owner.min() >= 0
    if not fits or max(owner.max(), neighbour.max(initial=-1)) >= most:
        raise ReadError(file.path, "owners and neighbours of faces do not agree", BAD_MESH)
    if (owner[: len(neighbour)] == neighbour).any():
        raise ReadError(file.path, "a face has the same cell on both sides", BAD_MESH)
    return owner, neighbour


def _patches(path: Path, inner: int, face_count: int) -> list[FoamPatch]:
    file = FoamFile(path)
    patches = []
    count = file.count()
    file.expect(b"(")
    for _ in range(count):
        name, entries = file.word(), dict(file.entries())
        try:
            patch = FoamPatch(name, entries["type"][0], int(entries["startFace"][0]), int(entries["nFaces"][0]))
        except (KeyError, IndexError, ValueError):
            raise file.fault(f"patch {name} has no type, startFace or nFaces", BAD_MESH) from None
        if patch.first < inner or patch.count < 0 or patch.first + patch.count > face_count:
            raise file.fault(f"patch {name} has faces that are not there", BAD_MESH)
        patches.append(patch)
    file.expect(b")")
    return patches


LEAST_ANGLE = 1e-4  # between the sides of a wedge: below it, rounding of the points hides where the sides meet
OFF_AXIS = 0.01  # allowed distance of the axis from the origin, relative to the greatest radius: rounding of points


Axis = tuple[float, float, float]


def plane_of(mesh: FoamMesh) -> tuple[str, np.ndarray, Axis | None] | None:
    """Return ("axisymmetric" or "planar", the faces of one side, axis if known) of a mesh one cell thick, or None.

    The sides of a wedge are two patches of type "wedge"; the sides of a plane are one or two patches of type "empty".
    Every
    cell has one face on either side.
    """
    wedges, empty = mesh.patch_faces("wedge"), mesh.patch_faces("empty")
    if wedges:
        return "axisymmetric", wedges[0], _axis_of(mesh, wedges)
    if not empty:
        return None
    faces = np.concatenate(empty)
    height = _face_means(mesh, faces) @ _upward(mesh, faces[:1])
    # Take the lower of the two faces of each cell.
    order = np.lexsort((height, mesh.faces.owner[faces]))
    owner = mesh.faces.owner[faces][order]
    return "planar", faces[order[np.append(True, owner[1:] != owner[:-1])]], None


def _upward(mesh: FoamMesh, faces: np.ndarray) -> np.ndarray:
    """Return the normal of the plane of some faces, oriented so that its greatest component is positive."""
    corners = mesh.points[mesh.faces.points[_rows(mesh, faces)]]
    normal = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2][2]
    return np.asarray(np.copysign(1.0, normal[np.argmax(np.abs(normal))]) * normal)


def _axis_of(mesh: FoamMesh, wedges: list[np.ndarray]) -> Axis | None:
    """Return the coordinate axis in which the sides of a wedge meet; None if they do not tell."""
    if len(wedges) != 2:
        return None
    normals = np.array([_upward(mesh, faces) for faces in wedges])
    heights = [_face_means(mesh, faces).mean(axis=0) @ normal for faces, normal in zip(wedges, normals, strict=True)]
    along = np.cross(*normals)
    if np.linalg.norm(along) < LEAST_ANGLE:
        return None
    along /= np.linalg.norm(along)
    point = np.linalg.solve(np.array([*normals, along]), [*heights, 0.0])
    beside = mesh.points - point
    radius = np.linalg.norm(beside - np.outer(beside @ along, along), axis=1).max()
    if np.abs(along).max() < 1.0 - OFF_AXIS**2 or np.linalg.norm(point) > OFF_AXIS * radius:
        raise ReadError(
            mesh.folder,
            f"the sides of the wedge meet in a line through {np.round(point, 9).tolist()} along "
            f"{np.round(along, 6).tolist()}: that is the axis of symmetry, and it is not x, y or z",
            "move the mesh there, with transformPoints",
        )
    axis = np.eye(3)[int(np.argmax(np.abs(along)))]
    return axis[0], axis[1], axis[2]


def _rows(mesh: FoamMesh, faces: np.ndarray) -> np.ndarray:
    """Return the indices into `mesh.faces.points` of the points of some faces, concatenated."""
    width = np.diff(mesh.faces.start)[faces]
    before = np.cumsum(width) - width
    return np.arange(int(width.sum())) + np.repeat(mesh.faces.start[faces] - before, width)


def _face_means(mesh: FoamMesh, faces: np.ndarray) -> np.ndarray:
    width = np.diff(mesh.faces.start)[faces]
    corners = mesh.points[mesh.faces.points[_rows(mesh, faces)]]
    return np.add.reduceat(corners, np.cumsum(width) - width, axis=0) / width[:, None]


def surface_patches(mesh: FoamMesh) -> list[Patch]:
    """Return the patches of a volume, without those between processors."""
    start, points, found = mesh.faces.start, mesh.faces.points, []
    for patch in mesh.patches:
        if not patch.count or patch.kind.startswith("processor"):
            continue
        first, last = patch.first, patch.first + patch.count
        corners = mesh.points[points[start[first] : start[last]]]
        found.append(Patch(patch.name, patch.kind, polygons=Polygons(corners, start[first : last + 1] - start[first])))
    return found


def flat_block(mesh: FoamMesh, faces: np.ndarray, cell_data, time: Path) -> tuple[Block, list[Patch]]:
    """Return one side of a mesh one cell thick as polygons, in the order of the cells, and the patches' edges.

    `time` is the folder of the fields, which have values on patches.
    """
    owner = mesh.faces.owner[faces]
    order = np.argsort(owner, kind="stable")
    faces, owner = faces[order], owner[order]
    if len(owner) != mesh.cell_count or (owner != np.arange(mesh.cell_count)).any():
        raise ReadError(
            mesh.folder,
            f"{mesh.cell_count} cells have {len(owner)} faces on a side of type wedge or empty: not one cell thick",
            "give a case that is one cell thick, or one without such patches",
        )
    width = np.diff(mesh.faces.start)[faces]
    corners = mesh.faces.points[_rows(mesh, faces)]
    used, renumbered = np.unique(corners, return_inverse=True)
    start = np.concatenate([[0], np.cumsum(width)])
    cells = Cells(np.full(len(faces), POLYGON, np.uint8), start, renumbered.ravel())
    block = Block(mesh.points[used], cells, cell_data=cell_data)
    on_side = np.zeros(len(mesh.points), dtype=bool)
    on_side[used] = True
    patches = []
    for patch in mesh.patches:
        if patch.kind in ("wedge", "empty", "processor") or not patch.count:
            continue
        own = np.arange(patch.first, patch.first + patch.count)
        face = np.repeat(own, np.diff(mesh.faces.start)[own])
        point = mesh.faces.points[_rows(mesh, own)]
        kept = on_side[point]
        face, point = face[kept], point[kept]
        pairs = np.unique(np.stack([face, point], axis=1), axis=0)
        _, first, count = np.unique(pairs[:, 0], return_index=True, return_counts=True)
        first = first[count == 2]
        edges = np.stack([mesh.points[pairs[first, 1]], mesh.points[pairs[first + 1, 1]]], axis=1)
        meant = pairs[first, 0]
        behind = mesh.faces.owner[meant]
        values = FoamPatchValues(time, cell_data, patch.name, meant - patch.first, patch.count, behind)
        patches.append(Patch(patch.name, patch.kind, edges, values=values))
    return block, patches


@dataclass(frozen=True, eq=False)
class FoamPatchValues:
    """Values at the faces of a patch, by name of a field.

    Attributes:
        folder: The time's folder.
        cell_data: The fields' averages over the cells.
        patch: The patch's name.
        faces: Numbers of the selected faces within the patch.
        face_count: Number of all faces of the patch.
        owner: The cell behind each selected face.
    """

    folder: Path
    cell_data: object
    patch: str
    faces: np.ndarray
    face_count: int
    owner: np.ndarray

    def __call__(self, name: str) -> tuple[np.ndarray, np.ndarray] | None:
        """Return a scalar field at the faces and in their cells, shape (len(faces),) each; None if not known."""
        try:
            file = FoamFile(self.folder / name)
            kind, values = self._condition(file)
            if values is not None and len(values) not in (1, self.face_count):
                raise file.fault(f"patch {self.patch!r} has {self.face_count} faces and {len(values)} values")
            # Gas that slips along a wall has no thermal layer, whatever the wall's temperature.
            if find(self.folder / "U") and self._condition(FoamFile(self.folder / "U"))[0] in LEVEL:
                kind, values = LEVEL[0], None
        except ReadError:  # wall values are optional: the cell averages of the file remain
            return None
        cells = np.asarray(self.cell_data[name])[self.owner]  # type: ignore[index]
        if values is None:
            return (cells, cells) if kind in LEVEL else None
        return (values[self.faces] if len(values) > 1 else np.full(len(self.faces), values[0])), cells

    def _condition(self, file: FoamFile) -> tuple[str, np.ndarray | None]:
        """Return type and `value` of the condition on the patch, by its name, else by the last matching pattern."""
        starts = list(_BOUNDARY.finditer(file.data, file.at))
        if not starts:
            raise file.fault("there is no boundaryField")
        file.at = starts[-1].end()
        own: dict[str, list] | None = None
        alike: dict[str, list] = {}
        while file.peek() != b"}":
            quoted = file.peek() == b'"'
            name = file.word()
            fits = name == self.patch or (quoted and _fits(name, self.patch))
            entries = dict(file.entries(self.face_count if fits else 0))
            if fits:
                own, alike = (own, entries) if quoted else (entries, alike)
        entries = alike if own is None else own
        value = entries.get("value") or [""]
        numbers = value[1] if value[0] == "nonuniform" else None
        if value[0] == "uniform" and is_number(str(value[-1])):
            numbers = np.array([float(value[-1])])
        return str((entries.get("type") or [""])[0]), numbers if numbers is not None and numbers.ndim == 1 else None


def _fits(pattern: str, name: str) -> bool:
    """Return whether a pattern such as "(wall|body).*" matches a patch; patterns that are slow to match never do."""
    plain = _PLAIN.fullmatch(pattern) and pattern.count("(") < 3 and pattern.count("*") < 3
    try:
        return bool(plain) and re.fullmatch(pattern, name[:200]) is not None
    except re.error:
        return False
