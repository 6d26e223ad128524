"""Read CGNS files with VTK's reader: structured and unstructured zones, solutions at vertices or cell centres.

What the file states beside its zones is read from its nodes: units, which apply to all nodes below theirs that have
none of their own, an axis of symmetry, boundary patches, data without dimensions. Runs in the child process of
fragile.py.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.arrays import length_of
from aerokernels.flow.reading.dataset import HDF5_MAGIC, Block, Dataset, ReadError
from aerokernels.flow.reading.readers.cgns_nodes import (
    REMEDY,
    array_paths,
    check_counts,
    child,
    children,
    class_of,
    data_of,
    location_of,
    name_of,
    patches_of,
    zones_of,
)
from aerokernels.flow.reading.readers.vtk_files import DAMAGED, blocks_of, run

# Symbols of the standard's unit names, in the order of the exponents: mass, length, time, temperature, angle.
SYMBOLS = (
    {"Kilogram": "kg", "Gram": "g", "Slug": "slug", "PoundMass": "lb"},
    {"Meter": "m", "Centimeter": "cm", "Millimeter": "mm", "Foot": "ft", "Inch": "in"},
    {"Second": "s"},
    {"Kelvin": "K", "Celsius": "degC", "Rankine": "degR", "Fahrenheit": "degF"},
    {"Degree": "deg", "Radian": "rad"},
)
EXPONENTS = {
    "Density": (1.0, -3.0, 0.0, 0.0, 0.0),
    "Pressure": (1.0, -1.0, -2.0, 0.0, 0.0),
    "Temperature": (0.0, 0.0, 0.0, 1.0, 0.0),
    "Coordinate": (0.0, 1.0, 0.0, 0.0, 0.0),
}


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a CGNS file."""
    note = (
        "of a CGNS file in ADF only zones are read: units are taken as metres and kg/m3, boundary patches are left out"
    )
    counts: dict[str, int] = {}
    stated: dict[str, Any] = {"notes": [note]}
    with path.open("rb") as stream:
        in_hdf5 = stream.read(len(HDF5_MAGIC)) == HDF5_MAGIC
    if in_hdf5:
        import h5py

        with h5py.File(path, "r") as root:
            counts, stated = check_counts(path, root), _stated(path, root)
    blocks, notes, times, chosen = _zones(path, time)
    for block in blocks:
        if counts.get(block.name, block.cell_count) != block.cell_count:
            fault = f"zone {block.name!r} states {counts[block.name]} cells, and its elements are {block.cell_count}"
            raise ReadError(path, fault, REMEDY)
    stated["notes"] = [*notes, *stated["notes"]]
    return Dataset(blocks, "CGNS", times=times, time=chosen, **stated)


def _zones(path: Path, time: Any) -> tuple[list[Block], list[str], list[float], float | None]:
    """Return the zones by VTK's reader, notes, the file's times, and the one that was read."""
    from vtkmodules.vtkIOCGNSReader import vtkCGNSReader

    reader = vtkCGNSReader()
    reader.SetFileName(str(path))
    if not reader.CanReadFile(str(path)):
        raise ReadError(path, "it is not a CGNS file, or it is incomplete", DAMAGED)
    reader.UpdateInformation()
    reader.EnableAllBases()
    reader.EnableAllPointArrays()
    reader.EnableAllCellArrays()
    reader.SetDoublePrecisionMesh(1)
    reader.SetLoadBndPatch(False)
    data, times, chosen = run(path, reader, time)
    if times == [0.0]:  # which VTK reports for a file without times
        times, chosen = [], None
    notes: dict[str, None] = {}
    blocks = [block for block in blocks_of(path, data, notes) if block.cell_count]
    if not blocks:
        raise ReadError(path, "it has no zone with cells", DAMAGED)
    names = [block.name for block in blocks]
    twice = next((name for name in names if name and names.count(name) > 1), None)
    if reader.GetNumberOfBaseArrays() > 1 and twice is not None:
        fault = f"{reader.GetNumberOfBaseArrays()} of its bases contain a zone {twice!r}: moments or cases of one flow"
        raise ReadError(path, fault, "write each base to a file of its own")
    blocks = [replace(block, name=block.name or f"zone {k}") for k, block in enumerate(blocks, start=1)]
    return blocks, list(notes), times, chosen


def _stated(path: Path, root) -> dict[str, Any]:
    """Return what a file states of its whole flow, as attributes of a `Dataset`."""
    for _, zone in zones_of(root):
        _check_zone(path, zone)
    patches, notes = patches_of(root)
    lengths: dict[str, str] = {}
    units: dict[str, str] = {}
    for label, result in (("GridCoordinates_t", lengths), ("FlowSolution_t", units)):
        for above in array_paths(root, label):
            if unit := _unit(above, "Coordinate" if result is lengths else name_of(above[-1])):
                result.setdefault(name_of(above[-1]), unit)
    symmetry = [own for base in children(root, "CGNSBase_t") for own in children(base, "Axisymmetry_t")]
    classes = {class_of(above) for above in array_paths(root, "FlowSolution_t")}
    scaled = ""
    if other := sorted(classes.difference(("", "Null", "DataClassNull", "UserDefined", "Dimensional"))):
        scaled = f"the file calls data {', '.join(other)}: without a reference their numbers are taken as SI units"
    return {
        "geometry": "axisymmetric" if symmetry else None,
        "axis": _axis(path, symmetry[0]) if symmetry else None,
        "patches": patches,
        "length": length_of(path, lengths)[0],
        "units": units,
        "scaled": scaled,
        "notes": [*notes, *([scaled] if scaled else [])],
    }


def _unit(above: list, quantity: str) -> str:
    """Return the unit of the last of a path of nodes, each the child of the one before; empty if not stated."""
    units = [own for node in above for own in children(node, "DimensionalUnits_t")]
    if not units or class_of(above) not in ("", "Dimensional", "DataClassNull"):
        return ""
    words = data_of(units[-1]).tobytes().decode("latin-1")
    stated = next(iter(children(above[-1], "DimensionalExponents_t")), None)
    exponents = EXPONENTS.get(quantity, ()) if stated is None else tuple(float(power) for power in data_of(stated))
    said = []
    for k, (symbols, power) in enumerate(zip(SYMBOLS, exponents, strict=False)):
        symbol = symbols.get(words[k * 32 : (k + 1) * 32].strip(" \0"))  # each name has 32 characters
        if not power:
            continue
        if symbol is None:
            return ""
        said.append(symbol if power == 1.0 else f"{symbol}^{power:g}")
    return " ".join(said)


def _check_zone(path: Path, zone) -> None:
    """Reject other coordinates than x, y, z, and an array in several solutions of one place.

    Of these VTK would read the first at every time, unless pointers tell at which time each counts.
    """
    for grid in children(zone, "GridCoordinates_t"):
        names = [name_of(array) for array in children(grid, "DataArray_t")]
        if names and sum(f"Coordinate{axis}" in names for axis in "XYZ") < 2:
            fault = f"zone {name_of(zone)!r} has the coordinates {', '.join(names)}"
            raise ReadError(path, fault, "write CoordinateX, CoordinateY and CoordinateZ")
    if any(child(own, "FlowSolutionPointers") for own in children(zone, "ZoneIterativeData_t")):
        return
    holder: dict[tuple[str, str], str] = {}
    for solution in children(zone, "FlowSolution_t"):
        for array in children(solution, "DataArray_t"):
            other = holder.setdefault((location_of(solution), name_of(array)), name_of(solution))
            if other != name_of(solution):
                raise ReadError(
                    path,
                    f"zone {name_of(zone)!r} has {name_of(array)} in {other} and in {name_of(solution)}, and no "
                    "FlowSolutionPointers tell at which time each counts",
                    "keep one of these solutions, or write the pointers",
                )


def _axis(path: Path, symmetry) -> tuple[float, float, float]:
    vectors = []
    for name, default in (("AxisymmetryReferencePoint", (0.0, 0.0)), ("AxisymmetryAxisVector", (1.0, 0.0))):
        own = child(symmetry, name)
        stated = np.asarray(default if own is None else data_of(own), np.float64).ravel()
        vectors.append(np.pad(stated, (0, max(3 - len(stated), 0)))[:3])
    point, vector = vectors
    vector = vector / max(float(np.linalg.norm(vector)), 1e-300)
    if np.linalg.norm(point - (point @ vector) * vector) > 1e-6 * np.linalg.norm(point):
        raise ReadError(
            path,
            f"its axis of symmetry goes through {point.tolist()} along {vector.tolist()}, and not through the origin",
            "move the mesh there, or give origin in frame and geometry='axisymmetric' with a file that states no axis",
        )
    return float(vector[0]), float(vector[1]), float(vector[2])
