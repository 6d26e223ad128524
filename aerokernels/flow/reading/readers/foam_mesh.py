"""Read the mesh of an OpenFOAM case: points, faces, owner and neighbour of each face, and the boundary's patches.

A patch has values at its faces where the solver writes them: one value, or one for each face, in the boundaryField of a
field. Values given in another way (coded, by macros, from other files) are unknown.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerokernels.flow.reading.dataset import Block, Cells, Faces, Patch, Polygons, ReadError, check_points, entries_of
from aerokernels.flow.reading.readers.foam_file import FoamFile, find
from aerokernels.flow.reading.readers.point_table import is_number

LEVEL = ("zeroGradient", "symmetry", "symmetryPlane", "slip")  # conditions by which a wall has what its cells have
BAD_MESH = "run checkMesh on the case and make the mesh again"
Axis = tuple[float, float, float]


@dataclass(frozen=True)
class FoamPatch:
    """A patch: its name, its type, its first face and its number of faces."""

    name: str
    kind: str
    first: int
    count: int

    @property
    def faces(self) -> np.ndarray:
        """The numbers of its faces."""
        return np.arange(self.first, self.first + self.count)


@dataclass(frozen=True, eq=False)
class FoamMesh:
    """A polyMesh folder."""

    folder: Path
    points: np.ndarray  # coordinates [m], shape (point_count, 3)
    faces: Faces
    cell_count: int
    patches: list[FoamPatch]  # of the boundary

    def ring(self, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the point numbers of some faces, concatenated, and how many each face has."""
        width = np.diff(self.faces.start)[faces]
        return self.faces.points[entries_of(self.faces.start[faces], width)], width

    def face_means(self, faces: np.ndarray) -> np.ndarray:
        """Return the means of the corners of some faces."""
        ring, width = self.ring(faces)
        return np.add.reduceat(self.points[ring], np.cumsum(width) - width, axis=0) / width[:, None]

    def upward(self, faces: np.ndarray) -> np.ndarray:
        """Return the normal of the plane of some faces, oriented so that its greatest component is positive."""
        corners = self.points[self.ring(faces)[0]]
        normal = np.linalg.svd(corners - corners.mean(axis=0), full_matrices=False)[2][2]
        return np.asarray(np.copysign(1.0, normal[np.argmax(np.abs(normal))]) * normal)


def read_mesh(folder: Path) -> FoamMesh:
    """Read a polyMesh folder."""
    file = FoamFile(folder / "points")
    points = file.numbers(file.scalar, 3).astype(np.float64)
    check_points(file.path, points)
    file = FoamFile(folder / "faces")
    start, corners = file.faces()
    if len(corners) and not (0 <= corners.min() and corners.max() < len(points)):
        raise ReadError(file.path, f"faces refer to points beyond the {len(points)} that there are", BAD_MESH)
    face_count = len(start) - 1
    file = FoamFile(folder / "owner")
    owner = file.numbers(file.label).astype(np.int64)
    if len(owner) != face_count:
        raise ReadError(file.path, f"it names owners of {len(owner)} faces, there are {face_count}", BAD_MESH)
    file = FoamFile(folder / "neighbour")
    neighbour = file.numbers(file.label).astype(np.int64)
    neighbour = neighbour[neighbour >= 0]  # old versions list -1 for the boundary
    # The last cell owns no face if all of its neighbours have lower numbers.
    cell_count = int(max(owner.max(initial=-1), neighbour.max(initial=-1))) + 1
    # A cell has four faces or more: a greater cell number is damaged, and would set the size of arrays.
    fits = len(neighbour) <= face_count and owner.min(initial=0) >= 0
    if not fits or cell_count > (face_count + len(neighbour)) // 4:
        raise ReadError(file.path, "owners and neighbours of faces do not agree", BAD_MESH)
    if not cell_count:
        raise ReadError(folder, "the mesh has no cells", BAD_MESH)
    if (owner[: len(neighbour)] == neighbour).any():
        raise ReadError(file.path, "a face has the same cell on both sides", BAD_MESH)
    patches = _patches(folder / "boundary", len(neighbour), face_count)
    return FoamMesh(folder, points, Faces(start, corners, owner, neighbour), cell_count, patches)


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


def plane_of(mesh: FoamMesh) -> tuple[str, np.ndarray, Axis | None] | None:
    """Return ("axisymmetric" or "planar", the faces of one side, axis if known) of a mesh one cell thick, or None.

    The sides of a wedge are two patches of type "wedge"; the sides of a plane are one or two patches of type "empty".
    Every cell has one face on either side.
    """
    wedges, empty = ([p.faces for p in mesh.patches if p.kind == kind and p.count] for kind in ("wedge", "empty"))
    if wedges:
        return "axisymmetric", wedges[0], _axis_of(mesh, wedges)
    if not empty:
        return None
    faces = np.concatenate(empty)
    height = mesh.face_means(faces) @ mesh.upward(faces[:1])
    # Take the lower of the two faces of each cell.
    order = np.lexsort((height, mesh.faces.owner[faces]))
    owner = mesh.faces.owner[faces][order]
    return "planar", faces[order[np.append(True, owner[1:] != owner[:-1])]], None


def _axis_of(mesh: FoamMesh, wedges: list[np.ndarray]) -> Axis | None:
    """Return the coordinate axis in which the sides of a wedge meet; None if they do not tell."""
    if len(wedges) != 2:
        return None
    normals = np.array([mesh.upward(faces) for faces in wedges])
    heights = [mesh.face_means(faces).mean(axis=0) @ normal for faces, normal in zip(wedges, normals, strict=True)]
    along = np.cross(*normals)
    if np.linalg.norm(along) < 1e-4:  # the angle between the sides, of which rounding hides where they meet
        return None
    along /= np.linalg.norm(along)
    point = np.linalg.solve(np.array([*normals, along]), [*heights, 0.0])
    beside = mesh.points - point
    radius = np.linalg.norm(beside - np.outer(beside @ along, along), axis=1).max()
    # Rounding of the points moves the axis by up to a hundredth of the radius.
    if np.abs(along).max() < 1.0 - 0.01**2 or np.linalg.norm(point) > 0.01 * radius:
        raise ReadError(
            mesh.folder,
            f"the sides of the wedge meet in a line through {np.round(point, 9).tolist()} along "
            f"{np.round(along, 6).tolist()}: that is the axis of symmetry, and it is not x, y or z",
            "move the mesh there, with transformPoints",
        )
    axis = np.eye(3)[int(np.argmax(np.abs(along)))]
    return axis[0], axis[1], axis[2]


def surface_patches(mesh: FoamMesh) -> list[Patch]:
    """Return the patches of a volume, without those between processors."""
    start, points, result = mesh.faces.start, mesh.faces.points, []
    for patch in mesh.patches:
        if not patch.count or patch.kind.startswith("processor"):
            continue
        first, last = patch.first, patch.first + patch.count
        corners = mesh.points[points[start[first] : start[last]]]
        result.append(Patch(patch.name, patch.kind, polygons=Polygons(corners, start[first : last + 1] - start[first])))
    return result


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
    corners, width = mesh.ring(faces)
    used, renumbered = np.unique(corners, return_inverse=True)
    block = Block(mesh.points[used], Cells.polygons(width, renumbered.ravel()), cell_data=cell_data)
    on_side = np.zeros(len(mesh.points), dtype=bool)
    on_side[used] = True
    patches = []
    for patch in mesh.patches:
        if patch.kind in ("wedge", "empty", "processor") or not patch.count:
            continue
        point, width = mesh.ring(patch.faces)
        pairs = np.stack([np.repeat(patch.faces, width), point], axis=1)[on_side[point]]
        pairs = np.unique(pairs, axis=0)  # of a face and a point of it on this side
        _, first, count = np.unique(pairs[:, 0], return_index=True, return_counts=True)
        first = first[count == 2]
        edges = np.stack([mesh.points[pairs[first, 1]], mesh.points[pairs[first + 1, 1]]], axis=1)
        own = pairs[first, 0]
        values = FoamPatchValues(time, cell_data, patch, own - patch.first, mesh.faces.owner[own])
        patches.append(Patch(patch.name, patch.kind, edges, values=values))
    return block, patches


@dataclass(frozen=True, eq=False)
class FoamPatchValues:
    """Values at the faces of a patch, by name of a field."""

    folder: Path  # of the time
    cell_data: object  # the fields' averages over the cells
    patch: FoamPatch
    faces: np.ndarray  # numbers of the selected faces within the patch
    owner: np.ndarray  # the cell behind each of them

    def __call__(self, name: str) -> tuple[np.ndarray, np.ndarray] | None:
        """Return a scalar field at the faces and in their cells, shape (len(faces),) each; None if not known."""
        try:
            kind, values = self._condition(name)
            # Gas that slips along a wall has no thermal layer, whatever the wall's temperature.
            if find(self.folder / "U") and self._condition("U")[0] in LEVEL:
                kind, values = LEVEL[0], None
        except ReadError:  # wall values are optional: the cell averages of the file remain
            return None
        cells = np.asarray(self.cell_data[name])[self.owner]  # type: ignore[index]
        if values is None:
            return (cells, cells) if kind in LEVEL else None
        if len(values) not in (1, self.patch.count):
            return None
        return (values[self.faces] if len(values) > 1 else np.full(len(self.faces), values[0])), cells

    def _condition(self, name: str) -> tuple[str, np.ndarray | None]:
        """Return type and `value` of the condition on the patch, by its name, else by the last matching pattern."""
        file = FoamFile(self.folder / name)
        starts = list(re.compile(rb"\bboundaryField\s*\{").finditer(file.data, file.at))
        if not starts:
            raise file.fault("there is no boundaryField")
        file.at = starts[-1].end()
        own: dict[str, list] | None = None
        alike: dict[str, list] = {}
        while file.peek() != b"}":
            quoted = file.peek() == b'"'
            word = file.word()
            fits = word == self.patch.name or (quoted and _fits(word, self.patch.name))
            entries = dict(file.entries(self.patch.count if fits else 0))
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
    plain = re.fullmatch(r"(?:[\w|()-]|\.\*?){1,200}", pattern) and pattern.count("(") < 3 and pattern.count("*") < 3
    try:
        return bool(plain) and re.fullmatch(pattern, name[:200]) is not None
    except re.error:
        return False
