"""Read the boundaryField of an OpenFOAM field: the solver's values at the faces of walls.

A patch with an entry `value` has one value, or one for each face; a patch of zero gradient has the averages of its
cells. Values given in another way (coded, by macros, from other files) are unknown.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.readers.foam_file import FoamFile, find

_BOUNDARY = re.compile(rb"\bboundaryField\s*\{")
_PLAIN = re.compile(r"(?:[\w|()-]|\.\*?){1,200}")
_WIDTH = {"scalar": 1, "vector": 3, "symmTensor": 6, "tensor": 9, "sphericalTensor": 1}
LEVEL = ("zeroGradient", "symmetry", "symmetryPlane", "slip")


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
        here = {self.patch: self.face_count}
        try:
            found = boundary_values(FoamFile(self.folder / name), here)[self.patch]
            # Gas that slips along a wall has no thermal layer, whatever the wall's temperature.
            if find(self.folder / "U") and _conditions(FoamFile(self.folder / "U"), here)[self.patch][0] in LEVEL:
                found = LEVEL[0]
        except ReadError:  # wall values are optional: the cell averages of the file remain
            return None
        cells = np.asarray(self.cell_data[name])[self.owner]  # type: ignore[index]
        if isinstance(found, str):
            return (cells, cells) if found in LEVEL else None
        return found[self.faces], cells


def boundary_values(file: FoamFile, patches: dict[str, int]) -> dict[str, np.ndarray | str]:
    """Return a scalar field at the faces of patches, or the type of a patch's condition without a value.

    Args:
        file: The field.
        patches: Number of faces of each patch by name.

    Raises:
        ReadError: A boundaryField that is missing or not closed, or whose numbers of values differ from those of the
            faces.
    """
    found: dict[str, np.ndarray | str] = {}
    for name, (kind, value) in _conditions(file, patches).items():
        if value is not None and len(value) not in (1, patches[name]):
            raise file.fault(f"patch {name!r} has {patches[name]} faces and {len(value)} values")
        found[name] = kind if value is None else np.full(patches[name], value[0]) if len(value) == 1 else value
    return found


def _conditions(file: FoamFile, patches: dict[str, int]) -> dict[str, tuple[str, np.ndarray | None]]:
    """Return type and `value` of the condition on each patch, by its name, else by the last matching pattern."""
    starts = list(_BOUNDARY.finditer(file.data, file.at))
    if not starts:
        raise file.fault("there is no boundaryField")
    file.at = starts[-1].end()
    exact, alike = {}, []
    while file.peek() != b"}":
        quoted = file.peek() == b'"'
        name = file.word()
        fits = [one for one in patches if one == name or (quoted and _fits(name, one))]
        entry = _condition(file, max((patches[one] for one in fits), default=0))
        for one in fits:
            (alike.append((one, entry)) if quoted else exact.update({one: entry}))
    return {name: exact.get(name, dict(alike).get(name, ("", None))) for name in patches}


def _fits(pattern: str, name: str) -> bool:
    """Return whether a pattern such as "(wall|body).*" matches a patch; patterns that are slow to match never do."""
    plain = _PLAIN.fullmatch(pattern) and pattern.count("(") < 3 and pattern.count("*") < 3
    try:
        return bool(plain) and re.fullmatch(pattern, name[:200]) is not None
    except re.error:
        return False


def _condition(file: FoamFile, repeated: int) -> tuple[str, np.ndarray | None]:
    """Return the type of a patch's condition, and its `value`: one number, or one for each face."""
    kind, value = "", None
    file.expect(b"{")
    while file.peek() != b"}":
        key = file.word()
        entry = _entry(file, repeated)
        if key == "type" and isinstance(entry, str):
            kind = entry
        elif key == "value" and isinstance(entry, np.ndarray) and entry.ndim == 1:
            value = entry
    file.at += 1
    return kind, value


def _entry(file: FoamFile, repeated: int) -> np.ndarray | str:
    """Return an entry up to its semicolon: numbers where it is uniform or nonuniform, else its first word."""
    first, numbers, depth = "", None, 0
    while depth or file.peek() != b";":
        mark = file.peek()
        if not mark or (mark == b"}" and depth == 0):
            raise file.fault("an entry is not closed")
        if mark in b"(){};":
            depth += 1 if mark in b"({" else -1 if mark in b")}" else 0
            file.at += 1
            if mark == b"}" and depth == 0:  # a nested dictionary ends without a semicolon
                return first
            continue
        word = file.word()
        first = first or word
        if word == "nonuniform" and depth == 0:
            following = file.word()
            if following == "0":  # "0()": a patch without faces on this processor of a decomposed case
                numbers = np.empty(0)
                continue
            kind = re.fullmatch(r"List<(\w+)>", following)
            width = _WIDTH.get(kind[1]) if kind else None
            if width is None:
                raise file.fault("a list is of no kind that is known")
            numbers = file.numbers(file.scalar, width, repeated).astype(np.float64)
        elif first == "uniform" and word != "uniform" and depth == 0:
            try:
                numbers = np.array([float(word)])
            except ValueError:
                numbers = None
    file.at += 1
    return first if numbers is None else numbers
