"""SU2: a mesh (.su2) with a restart beside it, binary (.dat) or text (.csv, .dat); values are at the mesh's points.

The binary restart: five int32 (535532, variable count, point count, 0, 0), names of 33 characters, float64 values point
by point, then numbers of the run. Byte order by the first number.
"""

from pathlib import Path
from typing import Any

import numpy as np

from .dataset import POLYGON, Block, Cells, Dataset, Patch, Polygons, ReadError
from .text_tables import read_table

MAGIC = 535532
NAME_LENGTH = 33
DAMAGED = "the file is damaged or was not written to its end: write it again"
CORNERS = {3: 2, 5: 3, 9: 4, 10: 4, 12: 8, 13: 6, 14: 5}
GREATEST_VARIABLE_COUNT = 10_000
COORDINATES = ("x", "y", "z", "pointid", "point_id")


def read(path: Path, time: Any = None, options: dict | None = None) -> Dataset:
    """Read a mesh and its restart; either may be named, the other lies beside it or is given as `mesh`.

    Raises:
        ReadError: A damaged file, a missing mesh or restart, or two that do not belong together.
    """
    options = options or {}
    if path.suffix.lower() == ".su2":
        mesh_path, restart = path, Path(options["solution"]) if options.get("solution") else _restart_beside(path)
    else:
        mesh_path, restart = Path(options["mesh"]) if options.get("mesh") else _mesh_beside(path), path
    points, cells, markers = read_mesh(mesh_path)
    if restart is None:
        return Dataset(
            [Block(points, cells, name=mesh_path.name)], "SU2 mesh without a restart", patches=_walls(points, markers)
        )
    arrays = read_restart(restart)
    count = {len(values) for values in arrays.values()}
    if count != {len(points)}:
        raise ReadError(
            restart,
            f"it holds {sorted(count)} points, the mesh {mesh_path.name} {len(points)}",
            "give the mesh it was made on",
        )
    dimension = 2 if not points[:, 2].any() else 3
    _check_places(restart, arrays, points, dimension)
    arrays = {name: values for name, values in arrays.items() if name.lower() not in COORDINATES}
    return Dataset([Block(points, cells, point_data=arrays)], "SU2", patches=_walls(points, markers))


def _check_places(restart: Path, arrays, points: np.ndarray, dimension: int) -> None:
    """Refuse a restart whose own coordinates are not the mesh's."""
    plain = {name.lower(): values for name, values in arrays.items()}
    size = float(np.ptp(points, axis=0).max())
    for axis, name in enumerate("xyz"[:dimension]):
        if name in plain and np.abs(plain[name] - points[:, axis]).max(initial=0.0) > 1e-4 * size:
            raise ReadError(
                restart, f"its points are not where the mesh has them (column {name})", "give the mesh it was made on"
            )


def _restart_beside(path: Path) -> Path | None:
    found = [
        p
        for p in sorted(path.parent.iterdir())
        if p.suffix.lower() in (".dat", ".csv") and p.is_file() and _is_restart(p)
    ]
    if len(found) > 1:
        names = ", ".join(p.name for p in found)
        raise ReadError(path, f"several restarts lie beside it ({names})", "name one: flow.read(RESTART, mesh=MESH)")
    return found[0] if found else None


def _is_restart(path: Path) -> bool:
    with path.open("rb") as stream:
        head = stream.read(200)
    binary = len(head) > 3 and MAGIC in (int.from_bytes(head[:4], "little"), int.from_bytes(head[:4], "big"))
    return binary or b"pointid" in head.split(b"\n")[0].lower().replace(b"_", b"")


def _mesh_beside(path: Path) -> Path:
    found = sorted(path.parent.glob("*.su2"))
    if len(found) != 1:
        names = ", ".join(p.name for p in found) or "none"
        raise ReadError(path, f"its mesh is not clear (beside it: {names})", "name it: mesh = 'MESH.su2'")
    return found[0]


def read_mesh(path: Path) -> tuple[np.ndarray, Cells, dict[str, np.ndarray]]:
    """Points, cells and the edges of each marker of a mesh, or its faces (four corners) in three dimensions.

    Raises:
        ReadError: A damaged mesh.
    """
    try:
        lines = path.read_text("ascii").splitlines()
    except UnicodeDecodeError:
        raise ReadError(path, "it is no text", DAMAGED) from None
    at, dimension, marker = 0, 0, ""
    points = np.empty((0, 3))
    kinds: list[int] = []
    corners: list[np.ndarray] = []
    markers: dict[str, np.ndarray] = {}
    while at < len(lines):
        key, found, value = lines[at].split("%")[0].partition("=")
        key = key.strip().upper()
        at += 1
        if not found:
            continue
        if key == "MARKER_TAG":
            marker = value.strip()
        elif key in ("NDIME", "NELEM", "NPOIN", "MARKER_ELEMS"):
            count = _whole(path, at, value.split()[0] if value.split() else "")
            if key == "NDIME":
                dimension = count
                if count not in (2, 3):
                    raise ReadError(path, f"line {at}: {count} dimensions", DAMAGED)
                continue
            if count > len(lines) - at:
                raise ReadError(path, f"line {at}: {key}= {count}, but only {len(lines) - at} lines follow", DAMAGED)
            rows = [line.split() for line in lines[at : at + count]]
            if key == "NPOIN":
                points = _points(path, at, rows, dimension)
            elif key == "NELEM":
                kinds, corners = _elements(path, at, rows)
            else:
                pieces = [own for own in _elements(path, at, rows)[1] if dimension <= len(own) <= 4]
                # A triangle names its last corner twice.
                wide = 2 if dimension == 2 else 4
                whole = [np.append(own, own[-1:].repeat(wide - len(own))) for own in pieces if len(own) <= wide]
                markers[marker] = np.array(whole, dtype=np.int64).reshape(-1, wide)
            at += count
    if not len(points) or not kinds:
        raise ReadError(path, "it has no points or no elements", DAMAGED)
    start = np.concatenate([[0], np.cumsum([len(own) for own in corners])])
    flat = np.concatenate(corners)
    if flat.min() < 0 or flat.max() >= len(points):
        raise ReadError(path, f"elements refer to points beyond the {len(points)} that there are", DAMAGED)
    types = np.array([{5: POLYGON, 9: POLYGON}.get(kind, kind) for kind in kinds], np.uint8)
    for name, own in markers.items():
        if len(own) and own.max() >= len(points):
            raise ReadError(path, f"marker {name} refers to points beyond the {len(points)} that there are", DAMAGED)
    return points, Cells(types, start, flat), markers


def _points(path: Path, at: int, rows: list[list[str]], dimension: int) -> np.ndarray:
    points = np.zeros((len(rows), 3))
    for k, row in enumerate(rows):
        try:
            points[k, :dimension] = [float(word) for word in row[:dimension]]
        except ValueError:
            raise ReadError(
                path, f"line {at + k + 1}: a point needs {dimension} coordinates, got {' '.join(row)[:60]!r}", DAMAGED
            ) from None
    return points


def _elements(path: Path, at: int, rows: list[list[str]]) -> tuple[list[int], list[np.ndarray]]:
    kinds: list[int] = []
    corners: list[np.ndarray] = []
    for k, row in enumerate(rows):
        try:
            kind = int(row[0])
            own = np.array([int(word) for word in row[1 : 1 + CORNERS[kind]]])
            if len(own) != CORNERS[kind]:
                raise ValueError
        except (ValueError, KeyError, IndexError):
            raise ReadError(path, f"line {at + k + 1}: no element of SU2: {' '.join(row)[:60]!r}", DAMAGED) from None
        kinds.append(kind)
        corners.append(own)
    return kinds, corners


def _whole(path: Path, line: int, word: str) -> int:
    if not word.isdigit():
        raise ReadError(path, f"line {line}: a count must be a whole number, got {word[:20]!r}", DAMAGED)
    return int(word)


def _patch(name: str, kind: str, corners: np.ndarray) -> Patch:
    if corners.shape[1] == 2:
        return Patch(name, kind, corners)
    return Patch(name, kind, polygons=Polygons(corners.reshape(-1, 3), 4 * np.arange(len(corners) + 1)))


def _walls(points: np.ndarray, markers: dict[str, np.ndarray]) -> list[Patch]:
    """Markers as patches; SU2 keeps what they are in its configuration, so that only names can tell a wall."""
    words = ("wall", "airfoil", "body", "cylinder", "wedge", "cone", "sphere")
    return [
        _patch(name, "wall" if any(word in name.lower() for word in words) else "marker", points[edges])
        for name, edges in markers.items()
        if len(edges)
    ]


def read_restart(path: Path) -> dict[str, np.ndarray]:
    """Values at the points by name, of a binary or a text restart.

    Raises:
        ReadError: A damaged restart.
    """
    data = path.read_bytes()
    if len(data) < 20 or MAGIC not in (int.from_bytes(data[:4], "little"), int.from_bytes(data[:4], "big")):
        return read_table(path, data)
    order = "<" if int.from_bytes(data[:4], "little") == MAGIC else ">"
    _, variables, count = (int(v) for v in np.frombuffer(data, f"{order}i4", 3))
    begin = 20 + NAME_LENGTH * variables
    if not 0 < variables <= GREATEST_VARIABLE_COUNT or count < 1 or begin + 8 * variables * count > len(data):
        raise ReadError(
            path, f"it announces {count} points with {variables} values, {len(data)} bytes cannot hold them", DAMAGED
        )
    names = [
        data[20 + NAME_LENGTH * k : 20 + NAME_LENGTH * (k + 1)].split(b"\0")[0].decode("ascii", "replace").strip()
        for k in range(variables)
    ]
    if len(set(names)) < len(names) or not all(name and name.isprintable() for name in names):
        raise ReadError(path, "its variables have no proper names", DAMAGED)
    values = np.frombuffer(data, f"{order}f8", variables * count, begin).reshape(count, variables)
    return {name: np.array(values[:, k], dtype=np.float64) for k, name in enumerate(names)}
