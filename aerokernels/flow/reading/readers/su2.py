"""Read SU2: a mesh (.su2 or .cgns) and a restart, binary (.dat) or text (.csv, .dat), with values at the mesh's points.

The binary restart: five int32 (535532, variable count, point count, 0, 0), names of 33 characters, float64 values point
by point, then metadata of the run. SU2 takes the coordinates of a mesh in CGNS as metres, whatever unit it states. What
neither file states may be in a configuration beside them (SU2's template, config_template.cfg): multiples of the free
stream's density, which follows from its pressure and temperature unless the Reynolds number gives it.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import (
    CORNERS,
    FLAT,
    POLYGON,
    UNFINISHED,
    Block,
    Cells,
    Dataset,
    Patch,
    ReadError,
    entries_of,
    starts_of,
    whole_number,
)
from aerokernels.flow.reading.formats import in_child
from aerokernels.flow.reading.readers.point_table import fortran_numbers, is_number, read_table
from aerokernels.process.foreign_files import OwnFilesError, own_file

MAGIC = [(535532).to_bytes(4, order) for order in ("little", "big")]
ELEMENTS = {3: 2, **CORNERS}  # corners of each type, by VTK's numbers, which SU2 uses: 3 is a line, 1 a point
Mesh = tuple[np.ndarray, Cells, list[Patch]]


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a mesh and its restart; either may be named, the other is in the same folder or given as an option."""
    mesh_path, restart = mesh_and_restart(path, options)
    meshes = [_cgns_mesh(mesh_path)] if mesh_path.suffix.lower() == ".cgns" else read_mesh(mesh_path)
    if restart is None:
        several = [f"zone {k + 1}" if len(meshes) > 1 else mesh_path.name for k in range(len(meshes))]
        blocks = [Block(points, cells, name=name) for (points, cells, _), name in zip(meshes, several, strict=True)]
        return Dataset(blocks, "SU2 mesh without a restart", patches=[one for *_, own in meshes for one in own])
    arrays = read_restart(restart)
    counts = sorted({len(values) for values in arrays.values()})
    fitting = [k for k, (points, _, _) in enumerate(meshes) if counts == [len(points)]]
    if len(fitting) != 1:
        held = ", ".join(str(len(points)) for points, _, _ in meshes)
        fault = f"it holds {counts} points, the mesh {mesh_path.name} {held}"
        if fitting:
            fault += f": {len(fitting)} of its zones have as many"
        raise ReadError(restart, fault, "give the mesh it was made on, of one such zone")
    points, cells, patches = meshes[fitting[0]]
    notes = [f"zone {fitting[0] + 1} of {len(meshes)} in {mesh_path.name}"] if len(meshes) > 1 else []
    more, scaled, unit = configured(restart.parent)
    plain = {name.lower(): values for name, values in arrays.items()}
    size = float(np.ptp(points, axis=0).max())
    for axis, name in enumerate("xyz" if points[:, 2].any() else "xy"):
        if name in plain and np.abs(plain[name] - points[:, axis]).max(initial=0.0) > 1e-4 * size:
            fault = f"its points are not where the mesh has them (column {name})"
            raise ReadError(restart, fault, "give the mesh it was made on")
    arrays = {n: own for n, own in arrays.items() if n.lower() not in ("x", "y", "z", "pointid", "point_id")}
    units = dict.fromkeys(("Density", "Conservative_1"), unit) if unit else {}
    block = Block(points, cells, point_data=arrays)
    return Dataset([block], "SU2", patches=patches, units=units, notes=[*notes, *more], scaled=scaled)


def files(path: Path, options: Mapping[str, Any], time: float | None) -> list[Path]:
    """Return the mesh and the restart that `read` opens."""
    return [one for one in mesh_and_restart(path, options) if one is not None]


def mesh_and_restart(path: Path, options: Mapping[str, Any]) -> tuple[Path, Path | None]:
    """Return the mesh and the restart, or None where a mesh has none beside it; arguments and errors as of `read`."""
    if path.suffix.lower() != ".su2":
        if options.get("mesh"):
            return Path(options["mesh"]), path
        result = sorted(path.parent.glob("*.su2"))
        if len(result) != 1:
            names = ", ".join(p.name for p in result) or "none"
            raise ReadError(path, f"its mesh is not clear (beside it: {names})", "name it: mesh = 'MESH.su2'")
        return own_file(path, result[0].name), path
    if options.get("solution"):
        return path, Path(options["solution"])
    beside = [one for one in sorted(path.parent.iterdir()) if one.suffix.lower() in (".dat", ".csv") and one.is_file()]
    result = [one for one in beside if _is_restart(one)]
    if len(result) > 1:
        names = ", ".join(p.name for p in result)
        raise ReadError(path, f"several restarts are beside it ({names})", "name one: flow.read(RESTART, mesh=MESH)")
    return path, own_file(path, result[0].name) if result else None


def _is_restart(path: Path) -> bool:
    with path.open("rb") as stream:
        head = stream.read(200)
    return head[:4] in MAGIC or b"pointid" in head.split(b"\n")[0].lower().replace(b"_", b"")


def read_mesh(path: Path) -> list[Mesh]:
    """Return points, cells and patches of each zone of a mesh."""
    try:
        text = path.read_text("ascii").splitlines()
    except UnicodeDecodeError:
        raise ReadError(path, "it is not a text", UNFINISHED) from None
    # Comments and empty lines may occur anywhere, also within lists.
    rows = [(number, own) for number, line in enumerate(text, start=1) if (own := line.partition("%")[0].strip())]
    at, marker = 0, ""
    zones: list[dict[str, Any]] = [{"markers": {}}]
    while at < len(rows):
        number, line = rows[at]
        key, equals, value = (word.strip() for word in line.partition("="))
        key, zone = key.upper(), zones[-1]
        at += 1
        if not equals:
            continue
        if key == "IZONE" and "NELEM" in zone:
            zones.append({"markers": {}})
        elif key == "MARKER_TAG":
            marker = value
        elif key in ("NDIME", "NELEM", "NPOIN", "MARKER_ELEMS"):
            word = value.split()[0] if value else ""
            if (count := whole_number(word)) is None:
                fault = f"line {number}: a count must be a whole number, got {word[:20]!r}"
                raise ReadError(path, fault, UNFINISHED)
            if key == "NDIME":
                if count not in (2, 3):
                    raise ReadError(path, f"line {number}: {count} dimensions", UNFINISHED)
                zone[key] = count
                continue
            if at < len(rows) and key == "MARKER_ELEMS" and "=" in rows[at][1]:
                at += 1  # the SEND_TO line of points shared between processes
            if count > len(rows) - at:
                fault = f"line {number}: {key}= {count}, but only {len(rows) - at} lines follow"
                raise ReadError(path, fault, UNFINISHED)
            holder, name = (zone["markers"], marker) if key == "MARKER_ELEMS" else (zone, key)
            holder[name] = rows[at : at + count]
            at += count
    return [_zone(path, zone) for zone in zones]


def _zone(path: Path, zone: dict[str, Any]) -> Mesh:
    """Return points, cells and patches of a zone from its rows, each a line's number and its text."""
    if not zone.get("NPOIN") or not zone.get("NELEM"):
        raise ReadError(path, "it has no points or no elements", UNFINISHED)
    dimension = zone.get("NDIME", 0)
    number, start, flat = _numbers(path, zone["NPOIN"], dimension, f"a point needs {dimension} coordinates")
    points = np.zeros((len(number), 3))
    points[:, :dimension] = flat[start[:, None] + np.arange(dimension)]
    kinds, corners = _elements(path, zone["NELEM"], ELEMENTS)
    cells = Cells(np.where(np.isin(kinds, FLAT), POLYGON, kinds).astype(np.uint8), corners.start, corners.points)
    _check_corners(path, "elements refer", cells.points, len(points))
    wide, patches = (2 if dimension == 2 else 4), []
    # SU2 states the types of boundaries in its configuration.
    walls = ("wall", "airfoil", "body", "cylinder", "wedge", "cone", "sphere")
    for name, rows in zone["markers"].items():
        _, faces = _elements(path, rows, {1: 1, **ELEMENTS})
        _check_corners(path, f"marker {name} refers", faces.points, len(points))
        width = np.diff(faces.start)
        kept = (width >= dimension) & (width <= wide)
        last = np.minimum(np.arange(wide), width[kept, None] - 1)  # a triangle repeats its last corner
        if kept.any():
            corner = points[faces.points[faces.start[:-1][kept, None] + last]]
            kind = "wall" if any(word in name.lower() for word in walls) else "marker"
            patches.append(Patch.of(name, kind, corner))
    return points, cells, patches


def _numbers(path: Path, rows: list[tuple[int, str]], least: int, needed: str):
    """Return the numbers of some lines: each line's own number, its first entry in the numbers, and the numbers."""
    width = np.fromiter((len(line.split()) for _, line in rows), np.int64, len(rows))
    try:
        flat = fortran_numbers(" ".join(line for _, line in rows)) if len(rows) else np.empty(0)
        if width.min(initial=least) < least or len(flat) != width.sum():
            raise ValueError
    except ValueError:
        number, line = next(
            (row for row in rows if len(row[1].split()) < least or not all(map(is_number, row[1].split()))), rows[0]
        )
        raise ReadError(path, f"line {number}: {needed}, got {line[:60]!r}", UNFINISHED) from None
    return np.array([number for number, _ in rows]), np.cumsum(width) - width, flat


def _elements(path: Path, rows: list[tuple[int, str]], known: Mapping[int, int]) -> tuple[np.ndarray, Cells]:
    """Return the types of elements, and their corners as cells; further numbers of a line are left out."""
    number, start, flat = _numbers(path, rows, 2, "not an element of SU2")
    kinds, room = flat[start], np.diff(start, append=len(flat)) - 1
    count = sum(((kinds == kind) * corners for kind, corners in known.items()), np.zeros(len(kinds), np.int64))
    bad = (count == 0) | (count > room)
    if bad.any():
        first = int(np.argmax(bad))
        # Type numbers of elements with interior points are greater.
        if count[first] == 0 and kinds[first] > 100:
            fault = f"line {number[first]}: element {kinds[first]:.0f} is of high order, with points inside it"
            raise ReadError(path, fault, "write the flow on cells with corners only, by SU2's own output for ParaView")
        fault = f"line {number[first]}: not an element of SU2: {rows[first][1][:60]!r}"
        raise ReadError(path, fault, UNFINISHED)
    corners = flat[entries_of(start + 1, count)]
    if (corners != np.floor(corners)).any():
        raise ReadError(path, "corners of its elements are not whole numbers", UNFINISHED)
    kinds = kinds.astype(np.uint8)
    return kinds, Cells(kinds, starts_of(count), corners.astype(np.int64))


def _check_corners(path: Path, what: str, corners: np.ndarray, count: int) -> None:
    if len(corners) and not (corners.min() >= 0 and corners.max() < count):
        raise ReadError(path, f"{what} to points beyond the {count} that there are", UNFINISHED)


def read_restart(path: Path) -> dict[str, np.ndarray]:
    """Return the values at the points by name, from a binary or a text restart."""
    data = path.read_bytes()
    if len(data) < 20 or data[:4] not in MAGIC:
        table = read_table(path, data)
        number = next((own for name, own in table.items() if name.lower().replace("_", "") == "pointid"), None)
        if number is None:
            return table
        rows = np.argsort(number, kind="stable")  # which may be in any order
        if (number[rows] != np.arange(len(rows))).any():
            raise ReadError(path, f"its column PointID does not number the {len(rows)} points from 0 on", UNFINISHED)
        return {name: own[rows] for name, own in table.items()}
    order = "<>"[MAGIC.index(data[:4])]
    _, variables, count = (int(v) for v in np.frombuffer(data, f"{order}i4", 3))
    begin = 20 + 33 * variables
    if not 0 < variables <= 10_000 or count < 1 or begin + 8 * variables * count > len(data):
        fault = f"it announces {count} points with {variables} values, {len(data)} bytes cannot hold them"
        raise ReadError(path, fault, UNFINISHED)
    held = [data[20 + 33 * k : 20 + 33 * (k + 1)].split(b"\0")[0] for k in range(variables)]
    names = [name.decode("ascii", "replace").strip() for name in held]
    if len(set(names)) < len(names) or not all(name and name.isprintable() for name in names):
        raise ReadError(path, "its variables have no proper names", UNFINISHED)
    values = np.frombuffer(data, f"{order}f8", variables * count, begin).reshape(count, variables)
    return {name: np.array(values[:, k], dtype=np.float64) for k, name in enumerate(names)}


def configured(folder: Path) -> tuple[list[str], str, str]:
    """Return notes on what the configurations in a folder state, of numbers whose unit nothing states, and the unit.

    The second is a note too, or empty; the third is the unit of density, or empty.
    """
    notes, scales = [], []
    for path in sorted(folder.glob("*.cfg"))[:20]:
        try:
            with own_file(folder, path.name).open("r", encoding="latin-1") as stream:
                text = stream.read(1_000_000)
        except (OSError, OwnFilesError):
            continue
        words = re.findall(r"^[ \t]*(\w{1,60})[ \t]*=[ \t]*([^\s%,]{1,60})", text, re.MULTILINE)
        stated = {key.upper(): value.upper() for key, value in words}
        if stated.get("AXISYMMETRIC") == "YES":
            notes.append(f"{path.name} states AXISYMMETRIC= YES: geometry='axisymmetric' reads y as the radius")
        if (scale := stated.get("REF_DIMENSIONALIZATION")) is not None:
            scales.append((path.name, scale, _free_stream(stated) if scale.startswith("FREESTREAM") else 1.0))
    name, scale, reference = next((one for one in scales if one[1].startswith("FREESTREAM")), ("", "", 1.0))
    if not scale:
        return notes, "", ""
    if len({reference for _, _, reference in scales}) == 1 and reference is not None:
        notes.append(f"{name} states {scale}: densities are multiples of its free stream's, {reference:.6g} kg/m3")
        return notes, "", f"{reference!r} kg/m3"
    scaled = f"{name} states {scale}: the density is one of numbers without a unit, give its reference"
    return [*notes, scaled], scaled, ""


def _free_stream(stated: Mapping[str, str]) -> float | None:
    """Return the density of the free stream [kg/m3]; None where a configuration does not give it directly."""
    viscous = stated.get("SOLVER", stated.get("PHYSICAL_PROBLEM", "EULER")).endswith(("NAVIER_STOKES", "RANS"))
    start = stated.get("INIT_OPTION", "REYNOLDS" if viscous else "TD_CONDITIONS")
    model = stated.get("FLUID_MODEL", "STANDARD_AIR")
    ideal = model in ("STANDARD_AIR", "IDEAL_GAS") and stated.get("SYSTEM_MEASUREMENTS", "SI") == "SI"
    if start != "TD_CONDITIONS" or not ideal:
        return None
    try:
        if stated.get("FREESTREAM_OPTION", "TEMPERATURE_FS") == "DENSITY_FS":
            result = float(stated["FREESTREAM_DENSITY"])
        else:
            constant = float(stated.get("GAS_CONSTANT", 287.058)) if model == "IDEAL_GAS" else 287.058  # SU2's of air
            result = float(stated["FREESTREAM_PRESSURE"]) / (constant * float(stated["FREESTREAM_TEMPERATURE"]))
    except (KeyError, ValueError, ZeroDivisionError):
        return None
    return result if math.isfinite(result) and result > 0.0 else None


def _cgns_mesh(path: Path) -> Mesh:
    """Return points, cells and patches of the one zone of a mesh in CGNS."""
    result = in_child("cgns", path, None, {})
    if len(result.blocks) != 1:
        fault = f"it has {len(result.blocks)} zones, and SU2 reads a mesh in CGNS of one"
        raise ReadError(path, fault, "give the mesh that SU2 read")
    (block,) = result.blocks
    if block.cells is None:
        fault = f"zone {block.name!r} is structured"
        raise ReadError(path, fault, "give the mesh that SU2 read, which is unstructured")
    return block.points, block.cells, list(result.patches)
