"""Read Exodus II, which is NetCDF: element blocks in two or three dimensions, values at nodes and in elements, times.

All blocks share the nodes: they become one block, with the element variables that all of them have. VTK's reader
returns single precision. Runs in the child process of fragile.py.

Reference: Schoof and Yarberry, "EXODUS II: a finite element data model", SAND92-2137, Sandia (1994).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.files.netcdf_reading import is_classic
from aerokernels.flow.reading.dataset import CORNERS, Block, Cells, Dataset, ReadError, chosen_time, starts_of

# VTK's numbers of the elements' types by the beginnings of their names; corners are listed first, in VTK's order.
ELEMENTS = {"TRI": 5, "QUA": 9, "SHE": 9, "TET": 10, "HEX": 12, "WED": 13, "PYR": 14}
LINES = ("BAR", "BEA", "TRU", "SPH", "CIR", "EDG")


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a file of Exodus II."""
    import xarray

    with xarray.open_dataset(path, engine="scipy" if is_classic(path) else "h5netcdf", decode_cf=False) as file:
        return _dataset(path, {str(name): file[name] for name in file.variables}, time)


def _dataset(path: Path, held: Mapping[str, Any], time: Any) -> Dataset:
    places = [held[f"coord{axis}"].values for axis in "xyz" if f"coord{axis}" in held]
    places = places or list(held["coord"].values)
    points = np.zeros((len(places[0]), 3))
    points[:, : len(places)] = np.stack(places, axis=1)
    times = sorted({float(value) for value in held["time_whole"].values}) if "time_whole" in held else []
    chosen = chosen_time(path, times, time)
    step = 0 if chosen is None else held["time_whole"].values.tolist().index(chosen)
    numbers, blocks, left_out = [], [], []
    for number in range(1, 1 + sum(name.startswith("connect") and name[7:].isdigit() for name in held)):
        corners = held[f"connect{number}"]
        called = str(_text(corners.attrs.get("elem_type", ""))).upper()
        if called.startswith(LINES):
            left_out.append(called)
            continue
        if (kind := ELEMENTS.get(called[:3])) is None or corners.shape[1] < CORNERS[kind]:
            known = "triangles, quadrilaterals, tetrahedra, hexahedra, wedges and pyramids"
            raise ReadError(path, f"element block {number} is of type {called[:40]!r}", f"write {known}")
        numbers.append(number)
        blocks.append((kind, corners.values[:, : CORNERS[kind]].astype(np.int64) - 1, corners.shape[1]))
    if not blocks:
        raise ReadError(path, "it has no elements of a flow", "give a file with a mesh and its arrays")
    width = np.concatenate([np.full(len(own), own.shape[1]) for _, own, _ in blocks])
    kinds = np.concatenate([np.full(len(own), kind, np.uint8) for kind, own, _ in blocks])
    cells = Cells(kinds, starts_of(width), np.concatenate([own.ravel() for _, own, _ in blocks]))
    point_data = {name: held[f"vals_nod_var{k}"].values[step] for k, name in _names(held, "name_nod_var")}
    cell_data = {
        name: np.concatenate([held[f"vals_elem_var{k}eb{number}"].values[step] for number in numbers])
        for k, name in _names(held, "name_elem_var")
        if all(f"vals_elem_var{k}eb{number}" in held for number in numbers)
    }
    second = any(count > own.shape[1] for _, own, count in blocks)
    notes = ["elements of second order are read by their corners alone"] if second else []
    notes += [f"elements of type {', '.join(left_out)} are left out"] if left_out else []
    block = Block(points, cells, None, point_data, cell_data)
    return Dataset([block], "Exodus", times=times, time=chosen, notes=notes)


def _names(held: Mapping[str, Any], variable: str) -> list[tuple[int, str]]:
    """Return number, from 1 on, and name of each variable of a kind."""
    rows = held[variable].values if variable in held else []
    return [(k, _text(np.asarray(row).tobytes())) for k, row in enumerate(rows, start=1)]


def _text(value: Any) -> str:
    return (value.decode("latin-1") if isinstance(value, bytes) else str(value)).split("\0")[0].strip()
