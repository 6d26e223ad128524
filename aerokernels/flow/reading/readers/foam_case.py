"""Read OpenFOAM cases: serial and decomposed, ascii and binary, wedge, planar and 3-D, any time.

Finite-volume fields are cell averages and stay so. VTK's reader is not used because it returns single precision.
"""

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import POLYHEDRON, Block, Cells, Dataset, ReadError, chosen_time
from aerokernels.flow.reading.readers.foam_file import FoamFile, find
from aerokernels.flow.reading.readers.foam_mesh import FoamMesh, flat_block, plane_of, read_mesh, surface_patches
from aerokernels.process.foreign_files import own_file

UNIVERSAL_GAS_CONSTANT = 8314.4626  # [J/(kmol K)]
_INTERNAL = re.compile(rb"\binternalField\s+(uniform|nonuniform)\b")
_WIDTH = {"volScalarField": 1, "volVectorField": 3}
_MOLAR_MASS = re.compile(r"\bmolWeight\s+([0-9.eE+-]+)\s*;")
_COMMENT = re.compile(r"//[^\n]*|/\*.*?(?:\*/|\Z)", re.DOTALL)  # an unclosed comment extends to the end
_DIMENSIONS = re.compile(rb"\bdimensions\s*\[([^\]]*)\]")
_INCLUDE = re.compile(r'^[ \t]*#include\w*\s+"([^"\n]+)"', re.MULTILINE)


def may_be_case(path: Path) -> bool:
    """Return whether a path is of a kind that denotes a case: a folder, a .foam file or a controlDict."""
    return path.is_dir() or path.suffix.lower() in (".foam", ".openfoam") or path.name == "controlDict"


def is_case(path: Path) -> bool:
    """Return whether a path is an OpenFOAM case: a folder with a mesh, its controlDict, or a .foam file in it."""
    folder = case_folder(path)
    return (folder / "constant" / "polyMesh").is_dir() or (folder / "processor0").is_dir() or (
        (folder / "system" / "controlDict").is_file()
    )  # fmt: skip


def case_folder(path: Path) -> Path:
    """Return the folder of a case from the folder itself, a .foam file in it or its controlDict."""
    if path.is_dir():
        return path
    return path.parent.parent if path.name == "controlDict" else path.parent


def times_of(folder: Path) -> list[tuple[float, str]]:
    """Return the times for which a folder holds fields, ascending, with the names of their folders."""
    found = []
    for entry in folder.iterdir():
        try:
            value = float(entry.name)
        except ValueError:
            continue
        if entry.is_dir() and np.isfinite(value) and any(True for _ in fields_in(entry)):
            found.append((value, entry.name))
    return sorted(found)


def fields_in(folder: Path) -> Iterator[str]:
    """Yield the names of the files in a time's folder."""
    for entry in sorted(folder.iterdir()):
        if entry.is_file() and not entry.name.startswith(".") and not entry.name.endswith("~"):
            yield entry.name.removesuffix(".gz")


class FoamFields(Mapping):
    """The cell fields of one time by name, each read on first access.

    Attributes:
        units: Unit of each field by name, from its dimensions.
    """

    def __init__(self, folder: Path, cell_count: int):
        """Find the files that are fields of cells."""
        self._folder, self._cell_count = folder, cell_count
        self._read: dict[str, np.ndarray] = {}
        self.units: dict[str, str] = {}
        self._names = [name for name in fields_in(folder) if self._width(name)] if folder.is_dir() else []

    def _width(self, name: str) -> int:
        path = find(self._folder / name)
        try:
            file = FoamFile(path) if path else None
        except ReadError:
            return 1  # a damaged file is reported when the field is read
        width = _WIDTH.get(file.header.get("class", ""), 0) if file else 0
        if file and width and (found := _DIMENSIONS.search(file.data, file.at)):
            self.units[name] = unit_in_words(found[1].decode("latin-1"))
        return width

    def __iter__(self):
        """Names of the fields."""
        return iter(self._names)

    def __len__(self) -> int:
        """Number of fields."""
        return len(self._names)

    def __contains__(self, name) -> bool:
        """Return whether there is such a field, without reading it."""
        return name in self._names

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a field's averages over the cells, shape (cell_count,) or (cell_count, 3)."""
        if name not in self._names:
            raise KeyError(name)
        if name not in self._read:
            self._read[name] = read_field(self._folder / name, self._cell_count)
        return self._read[name]


def unit_in_words(exponents: str) -> str:
    """Return a field's dimensions, such as "1 -3 0 0 0 0 0", as a unit: "kg m^-3".

    The exponents are those of mass, length, time, temperature, amount, current and luminous intensity.
    """
    symbols = ("kg", "m", "s", "K", "mol", "A", "cd")
    try:
        powers = [float(word) for word in exponents.split()]
    except ValueError:  # named dimensions, which only OpenFOAM can resolve
        return ""
    return " ".join(f"{one}^{power:g}" for one, power in zip(symbols, powers, strict=False) if power)


def read_field(path: Path, cell_count: int) -> np.ndarray:
    """Return the cell averages of a volScalarField or volVectorField."""
    file = FoamFile(path)
    width = _WIDTH.get(file.header.get("class", ""))
    if width is None:
        raise file.fault(f"a {file.header.get('class', 'nameless')} is not a field of cells", "name a volScalarField")
    match = _INTERNAL.search(file.data, file.at)
    if match is None and re.search(rb"\binternalField\s+#", file.data[file.at :]):
        what = "its internalField is code, such as #codeStream, which OpenFOAM alone runs"
        raise ReadError(path, what, "run the solver, and read a time that it wrote")
    if match is None:
        raise file.fault("there is no internalField")
    file.at = match.end()
    if match[1] == b"uniform":
        file.skip()
        end = file.data.find(b";", file.at)
        written = file.data[file.at : max(end, file.at)].decode("latin-1").strip()
        written = _value_of(file, written[1:].strip("{}")) if written.startswith("$") else written
        text = written.translate(str.maketrans("()", "  ")).split()
        try:
            values = np.array([float(word) for word in text])
        except ValueError:
            values = np.empty(0)
        if values.size != width:
            raise file.fault("the uniform value is not a number")
        return np.tile(values, (cell_count, 1)) if width > 1 else np.full(cell_count, values[0])
    file.word()  # List<scalar>
    values = file.numbers(file.scalar, width, cell_count).astype(np.float64)
    if len(values) != cell_count:
        raise file.fault(f"the field has {len(values)} entries, the mesh {cell_count} cells")
    return values


def _value_of(file: FoamFile, name: str) -> str:
    """Return the value of a macro such as $pInlet, from the file itself or from files that it includes."""
    text = _COMMENT.sub("", file.data.decode("latin-1"))
    texts = [text]
    for included in _INCLUDE.findall(text):
        other = own_file(file.path.parent.parent, os.path.join(file.path.parent.name, included))  # within the case
        # A greater file, in bytes, is not looked into.
        if other.is_file() and other.stat().st_size <= 1_000_000:
            texts.append(_COMMENT.sub("", other.read_text("latin-1")))
    values = [
        found for one in texts for found in re.findall(rf"^[ \t]*{re.escape(name)}\s+([^;{{}}]*);", one, re.MULTILINE)
    ]
    return str(values[-1]).strip() if values else ""


@dataclass(frozen=True)
class FoamTime:
    """A time of a case.

    Attributes:
        value: The time [s].
        name: Name of its folder.
        parts: The folders that contain it: the case itself, or those of all processors.
    """

    value: float
    name: str
    parts: list[Path]


def case_times(folder: Path) -> list[FoamTime]:
    """Return the times of a case, ascending: those of the whole case, and others that only its processors have.

    The times of a whole case that has not been solved, its initial state, count only if it is not decomposed.
    """
    parts = sorted(folder.glob("processor[0-9]*"), key=lambda part: int(re.sub(r"\D", "", part.name) or 0))
    collated = next(folder.glob("processors*"), None)
    whole = (folder / "constant" / "polyMesh").is_dir()
    serial = [FoamTime(value, name, [folder]) for value, name in times_of(folder)] if whole else []
    if not any(time.value > 0.0 for time in serial):
        if collated is not None and not parts:
            raise ReadError(
                collated, "its fields are in the collated format, which is not read", "run reconstructPar on the case"
            )
        serial = [] if parts else serial
    if not parts and not whole:
        raise ReadError(folder, "there is no constant/polyMesh", "make the mesh first, with blockMesh say")
    known = {time.value for time in serial}
    more = [FoamTime(value, name, parts) for value, name in times_of(parts[0]) if value not in known] if parts else []
    if not serial and not more:
        raise ReadError(folder, "the case has no fields at any time", "run the solver, or restore its time folders")
    return sorted([*serial, *more], key=lambda time: time.value)


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read an OpenFOAM case."""
    folder = case_folder(path)
    times = case_times(folder)
    value = chosen_time(folder, [entry.value for entry in times], time)
    chosen = next(entry for entry in reversed(times) if entry.value == value)
    blocks, patches, geometries, axes = [], [], [], []
    for part in chosen.parts:
        block, own, geometry, axis = _part(part, chosen.name)
        blocks.append(block)
        patches += own
        geometries.append(geometry)
        axes += [axis] if axis is not None else []
    if len(set(geometries)) > 1:
        raise ReadError(folder, "some processors have another geometry than the others", "decompose the case again")
    return Dataset(
        blocks,
        f"OpenFOAM case{f', decomposed in {len(chosen.parts)}' if chosen.parts != [folder] else ''}",
        geometry=geometries[0],
        patches=patches,
        times=[entry.value for entry in times],
        time=value,
        axis=(axes[0] if axes else _axis(blocks)) if geometries[0] == "axisymmetric" else None,
        gas_constant=_gas_constant(folder),
        units=getattr(blocks[0].cell_data, "units", {}),
        length=1.0,
    )


def files(path: Path, options: Mapping[str, Any], time: float | None) -> list[Path]:
    """Return the files and folders that `read` opens, at one time or at all: not results that are kept in the case."""
    folder = case_folder(path)
    times = [entry for entry in case_times(folder) if time is None or entry.value == time]
    parts = dict.fromkeys([folder, *(part for entry in times for part in entry.parts)])
    constant = [part / "constant" for part in parts if (part / "constant").is_dir()]
    fixed = [file for one in constant for file in sorted(one.iterdir()) if file.is_file()]
    meshes = [one / "polyMesh" for one in constant if (one / "polyMesh").is_dir()]
    return [*fixed, *meshes, *(part / entry.name for entry in times for part in entry.parts)]


def _part(folder: Path, time: str) -> tuple[Block, list, str, tuple[float, float, float] | None]:
    """Return the block, the patches, the geometry and the axis of symmetry of a serial case or of one processor."""
    moved = folder / time / "polyMesh"
    mesh = read_mesh(folder / "constant" / "polyMesh")
    if find(moved / "points") is not None:
        raise ReadError(moved, "the mesh moves", "read a case with a fixed mesh")
    fields = FoamFields(folder / time, mesh.cell_count)
    plane = plane_of(mesh)
    if plane is None:
        return _solid_block(mesh, fields), surface_patches(mesh), "volume", None
    geometry, faces, axis = plane
    block, patches = flat_block(mesh, faces, fields, folder / time)
    return block, patches, geometry, axis


def _solid_block(mesh: FoamMesh, fields: FoamFields) -> Block:
    count = mesh.cell_count
    kinds, start = np.full(count, POLYHEDRON, np.uint8), np.zeros(count + 1, np.int64)
    cells = Cells(kinds, start, np.empty(0, int), mesh.faces)
    return Block(mesh.points, cells, cell_data=fields)


def _axis(blocks: list[Block]) -> tuple[float, float, float]:
    """Return the axis of a wedge whose sides do not tell it: the coordinate axis that is in its plane."""
    points = np.concatenate([block.points for block in blocks])
    centred = points - points.mean(axis=0)
    normal = np.linalg.svd(centred.T @ centred)[0][:, 2]
    # The plane contains the axis, so that the axis is perpendicular to the normal: the plane of a wedge side, which is
    # tilted, contains one coordinate axis only.
    across = np.abs(normal)
    axis = [0.0, 0.0, 0.0]
    axis[int(np.argmin(across))] = 1.0
    return axis[0], axis[1], axis[2]


def _gas_constant(folder: Path) -> float | None:
    """Return the gas constant [J/(kg K)] from the molar mass in constant/thermophysicalProperties, None without one."""
    for name in ("thermophysicalProperties", "physicalProperties"):
        path = folder / "constant" / name
        for place in (path, folder.parent / "constant" / name):
            if place.is_file():
                masses = {float(word) for word in _MOLAR_MASS.findall(_COMMENT.sub("", place.read_text("latin-1")))}
                if len(masses) == 1 and (mass := masses.pop()) > 0.0:
                    return UNIVERSAL_GAS_CONSTANT / mass
    return None
