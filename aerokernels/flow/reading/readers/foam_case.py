"""Read OpenFOAM cases: serial and decomposed, ascii and binary, wedge, planar and 3-D, any time.

Finite-volume fields are cell averages and stay so. VTK's reader is not used because it returns single precision.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import POLYHEDRON, Block, Cells, Dataset, ReadError, chosen_time
from aerokernels.flow.reading.readers.foam_file import FoamFile, find
from aerokernels.flow.reading.readers.foam_mesh import flat_block, plane_of, read_mesh, surface_patches

WIDTH = {"volScalarField": 1, "volVectorField": 3}


def may_be_case(path: Path) -> bool:
    """Return whether a path is of a kind that denotes a case: a folder, a .foam file or a controlDict."""
    return path.is_dir() or path.suffix.lower() in (".foam", ".openfoam") or path.name == "controlDict"


def is_case(path: Path) -> bool:
    """Return whether a path is an OpenFOAM case: a folder with a mesh, its controlDict, or a .foam file in it."""
    folder = case_folder(path)
    parts = (folder / "constant" / "polyMesh", folder / "processor0")
    return any(part.is_dir() for part in parts) or (folder / "system" / "controlDict").is_file()


def case_folder(path: Path) -> Path:
    """Return the folder of a case from the folder itself, a .foam file in it or its controlDict."""
    if path.is_dir():
        return path
    return path.parent.parent if path.name == "controlDict" else path.parent


def times_of(folder: Path) -> list[tuple[float, str]]:
    """Return the times for which a folder holds fields, ascending, with the names of their folders."""
    result = []
    for entry in folder.iterdir():
        try:
            value = float(entry.name)
        except ValueError:
            continue
        if entry.is_dir() and np.isfinite(value) and fields_in(entry):
            result.append((value, entry.name))
    return sorted(result)


def fields_in(folder: Path) -> list[str]:
    """Return the names of the files in a time's folder."""
    names = [entry.name for entry in sorted(folder.iterdir()) if entry.is_file()]
    return [name.removesuffix(".gz") for name in names if not name.startswith(".") and not name.endswith("~")]


class FoamFields(Mapping):
    """The cell fields of one time by name, each read on first access; `units` has the unit of each."""

    def __init__(self, folder: Path, cell_count: int):
        """Find the files that are fields of cells."""
        self._folder, self._cell_count = folder, cell_count
        self._read: dict[str, np.ndarray] = {}
        self.units: dict[str, str] = {}
        self._names = [name for name in fields_in(folder) if self._is_field(name)] if folder.is_dir() else []

    def _is_field(self, name: str) -> bool:
        try:
            file = FoamFile(self._folder / name)
        except ReadError:
            return True  # a damaged file is reported when the field is read
        if file.header.get("class") not in WIDTH:
            return False
        if result := re.compile(rb"\bdimensions\s*\[([^\]]*)\]").search(file.data, file.at):
            symbols = ("kg", "m", "s", "K", "mol", "A", "cd")  # of mass, length, time, temperature, amount, ...
            try:
                powers = [float(word) for word in result[1].split()]
            except ValueError:  # named dimensions, which only OpenFOAM can resolve
                powers = []
            pairs = zip(symbols, powers, strict=False)
            self.units[name] = " ".join(f"{one}^{power:g}" for one, power in pairs if power)
        return True

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


def read_field(path: Path, cell_count: int) -> np.ndarray:
    """Return the cell averages of a volScalarField or volVectorField."""
    file = FoamFile(path)
    width = WIDTH.get(file.header.get("class", ""))
    if width is None:
        raise file.fault(f"a {file.header.get('class', 'nameless')} is not a field of cells", "name a volScalarField")
    match = re.compile(rb"\binternalField\s+(uniform|nonuniform|#)").search(file.data, file.at)
    if match is None:
        raise file.fault("there is no internalField")
    if match[1] == b"#":
        what = "its internalField is code, such as #codeStream, which OpenFOAM alone runs"
        raise ReadError(path, what, "run the solver, and read a time that it wrote")
    file.at = match.end()
    if match[1] == b"nonuniform":
        file.word()  # List<scalar>
        values = file.numbers(file.scalar, width, cell_count).astype(np.float64)
        if len(values) != cell_count:
            raise file.fault(f"the field has {len(values)} entries, the mesh {cell_count} cells")
        return values
    file.peek()
    written = file.data[file.at :].partition(b";")[0].translate(bytes.maketrans(b"()", b"  ")).split()
    try:
        values = np.array([float(word) for word in written])
    except ValueError:  # a macro, such as $pInlet
        values = np.empty(0)
    if values.size != width:
        raise file.fault("the uniform value is not a number", "write numbers, or read a time that the solver wrote")
    return np.tile(values, (cell_count, 1)) if width > 1 else np.full(cell_count, values[0])


@dataclass(frozen=True)
class FoamTime:
    """A time of a case."""

    value: float  # [s]
    name: str  # of its folder
    parts: list[Path]  # the folders that contain it: the case itself, or those of all processors


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
    parts = [_part(part, chosen.name) for part in chosen.parts]
    blocks, geometries = [part[0] for part in parts], [part[2] for part in parts]
    if len(set(geometries)) > 1:
        raise ReadError(folder, "some processors have another geometry than the others", "decompose the case again")
    axis = next((part[3] for part in parts if part[3] is not None), None)
    if geometries[0] == "axisymmetric" and axis is None:
        fault = "its patches of type wedge do not tell the axis of symmetry"
        raise ReadError(folder, fault, "make them two patches, one for each side of a wedge of some degrees")
    return Dataset(
        blocks,
        f"OpenFOAM case{f', decomposed in {len(chosen.parts)}' if chosen.parts != [folder] else ''}",
        geometry=geometries[0],
        patches=[patch for part in parts for patch in part[1]],
        times=[entry.value for entry in times],
        time=value,
        axis=axis,
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
    if (plane := plane_of(mesh)) is not None:
        geometry, faces, axis = plane
        return *flat_block(mesh, faces, fields, folder / time), geometry, axis
    kinds, start = np.full(mesh.cell_count, POLYHEDRON, np.uint8), np.zeros(mesh.cell_count + 1, np.int64)
    block = Block(mesh.points, Cells(kinds, start, np.empty(0, int), mesh.faces), cell_data=fields)
    return block, surface_patches(mesh), "volume", None


def _gas_constant(folder: Path) -> float | None:
    """Return the gas constant [J/(kg K)] from the molar mass in constant/thermophysicalProperties, None without one."""
    for name in ("thermophysicalProperties", "physicalProperties"):
        for place in (folder / "constant" / name, folder.parent / "constant" / name):
            if not place.is_file():
                continue
            # An unclosed comment extends to the end.
            text = re.sub(r"//[^\n]*|/\*.*?(?:\*/|\Z)", "", place.read_text("latin-1"), flags=re.DOTALL)
            masses = {float(word) for word in re.findall(r"\bmolWeight\s+([0-9.eE+-]+)\s*;", text)}
            if len(masses) == 1 and (mass := masses.pop()) > 0.0:
                return 8314.4626 / mass  # by the universal gas constant [J/(kmol K)]
    return None
