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
from aerokernels.flow.reading.dataset import Block, Dataset, ReadError
from aerokernels.flow.reading.readers.cgns_nodes import (
    REMEDY,
    Node,
    array_paths,
    check_counts,
    child,
    children,
    class_of,
    data_of,
    opened,
    text_of,
)
from aerokernels.flow.reading.readers.cgns_walls import patches_of
from aerokernels.flow.reading.readers.vtk_files import DAMAGED, blocks_of, run

ADF = "of a CGNS file in ADF only zones are read: units are taken as metres and kg/m3, boundary patches are left out"
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
}
LENGTH = (0.0, 1.0, 0.0, 0.0, 0.0)
NORMALISED = "NormalizedByDimensional"  # the class of data that a DataConversion_t makes dimensional
WIDTH = 32  # characters of each unit name


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a CGNS file."""
    with opened(path) as root:
        if root is None:
            counts, scales = {}, {}
            stated: dict[str, Any] = {"notes": [ADF]}
        else:
            counts, scales, stated = check_counts(path, root), conversions(root), _stated(path, root)
    blocks, notes, times, chosen = _zones(path, time)
    for block in blocks:
        if counts.get(block.name, block.cell_count) != block.cell_count:
            fault = f"zone {block.name!r} states {counts[block.name]} cells, and its elements are {block.cell_count}"
            raise ReadError(path, fault, REMEDY)
    blocks = [_dimensional(block, scales) for block in blocks]
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


def _stated(path: Path, root: Node) -> dict[str, Any]:
    """Return what a file states of its whole flow, as attributes of a `Dataset`."""
    for base in children(root, "CGNSBase_t"):
        for zone in children(base, "Zone_t"):
            _check_coordinates(path, zone)
            _check_solutions(path, zone)
    patches, notes = patches_of(root)
    length, units = units_of(path, root)
    symmetry = [own for base in children(root, "CGNSBase_t") for own in children(base, "Axisymmetry_t")]
    scaled = _data_classes(root)
    return {
        "geometry": "axisymmetric" if symmetry else None,
        "axis": _axis(path, symmetry[0]) if symmetry else None,
        "patches": patches,
        "length": length,
        "units": units,
        "scaled": scaled,
        "notes": [*notes, *([scaled] if scaled else [])],
    }


def _dimensional(block: Block, conversions: Mapping[tuple[str, str], tuple[float, float]]) -> Block:
    """Return a zone with its normalised arrays and coordinates converted as the file says."""

    def made(name: str, values: np.ndarray) -> np.ndarray:
        scale, offset = conversions.get((block.name, name), (1.0, 0.0))
        return values if (scale, offset) == (1.0, 0.0) else scale * values + offset

    if not any(zone == block.name for zone, _ in conversions):
        return block
    points = np.stack([made(f"Coordinate{axis}", block.points[:, k]) for k, axis in enumerate("XYZ")], axis=1)
    point_data, cell_data = (
        {n: made(n, own) for n, own in arrays.items()} for arrays in (block.point_data, block.cell_data)
    )
    return replace(block, points=points, point_data=point_data, cell_data=cell_data)


def units_of(path: Path, root: Node) -> tuple[float | None, dict[str, str]]:
    """Return the unit of length [m] or None, and the unit of each array, from the first zone that states it."""
    lengths: dict[str, str] = {}
    arrays: dict[str, str] = {}
    for label, found in (("GridCoordinates_t", lengths), ("FlowSolution_t", arrays)):
        for above in array_paths(root, label):
            name = above[-1].name
            if unit := _unit(above, LENGTH if found is lengths else EXPONENTS.get(name)):
                found.setdefault(name, unit)
    return length_of(path, lengths)[0], arrays


def conversions(root: Node) -> dict[tuple[str, str], tuple[float, float]]:
    """Return scale and offset of normalised arrays by zone and name; the value is scale * number + offset."""
    arrays = ((above, _conversion(above)) for above in array_paths(root, "GridCoordinates_t", "FlowSolution_t"))
    return {(above[2].name, above[-1].name): own for above, own in arrays if own is not None}


def _conversion(above: list[Node]) -> tuple[float, float] | None:
    """Return scale and offset of a normalised array, the last of a path of nodes; None if it states none."""
    stated = [data_of(own).astype(np.float64).ravel() for own in children(above[-1], "DataConversion_t")]
    if not stated or class_of(above) != NORMALISED or len(stated[0]) != 2:
        return None
    return float(stated[0][0]), float(stated[0][1])


def _unit(above: list[Node], known: tuple[float, ...] | None) -> str:
    """Return the unit of the last of a path of nodes, each the child of the one before; empty if not stated."""
    words, kind = None, class_of(above)
    for node in above:
        for own in children(node, "DimensionalUnits_t"):
            words = np.asarray(data_of(own)).tobytes().decode("latin-1")
    if words is None or (kind not in ("", "Dimensional", "DataClassNull") and _conversion(above) is None):
        return ""
    stated = next(iter(children(above[-1], "DimensionalExponents_t")), None)
    exponents = known if stated is None else tuple(float(power) for power in data_of(stated))
    if exponents is None:
        return ""
    said = []
    for k, (symbols, power) in enumerate(zip(SYMBOLS, exponents, strict=False)):
        symbol = symbols.get(words[k * WIDTH : (k + 1) * WIDTH].strip(" \0"))
        if not power:
            continue
        if symbol is None:
            return ""
        said.append(symbol if power == 1.0 else f"{symbol}^{power:g}")
    return " ".join(said)


def _check_coordinates(path: Path, zone: Node) -> None:
    for grid in children(zone, "GridCoordinates_t"):
        names = [array.name for array in children(grid, "DataArray_t")]
        if names and sum(f"Coordinate{axis}" in names for axis in "XYZ") < 2:
            fault = f"zone {zone.name!r} has the coordinates {', '.join(names)}"
            raise ReadError(path, fault, "write CoordinateX, CoordinateY and CoordinateZ")


def _check_solutions(path: Path, zone: Node) -> None:
    """Reject an array in several solutions at the same places, of which VTK would read the first at every time."""
    if any(child(own, "FlowSolutionPointers") for own in children(zone, "ZoneIterativeData_t")):
        return
    holder: dict[tuple[str, str], str] = {}
    for solution in children(zone, "FlowSolution_t"):
        where = next((text_of(own) for own in children(solution, "GridLocation_t")), "Vertex")
        for array in children(solution, "DataArray_t"):
            other = holder.setdefault((where, array.name), solution.name)
            if other != solution.name:
                raise ReadError(
                    path,
                    f"zone {zone.name!r} has {array.name} in {other} and in {solution.name}, and no "
                    "FlowSolutionPointers tell at which time each counts",
                    "keep one of these solutions, or write the pointers",
                )


def _axis(path: Path, symmetry: Node) -> tuple[float, float, float]:
    vectors = {}
    for name, default in (("AxisymmetryReferencePoint", (0.0, 0.0)), ("AxisymmetryAxisVector", (1.0, 0.0))):
        own = child(symmetry, name)
        given = np.asarray(default if own is None else data_of(own), np.float64).ravel()
        vectors[name] = np.pad(given, (0, max(3 - len(given), 0)))[:3]
    point, vector = vectors.values()
    vector = vector / max(float(np.linalg.norm(vector)), 1e-300)
    beside = point - (point @ vector) * vector
    if np.linalg.norm(beside) > 1e-6 * np.linalg.norm(point):
        raise ReadError(
            path,
            f"its axis of symmetry goes through {point.tolist()} along {vector.tolist()}, and not through the origin",
            "move the mesh there, or give origin in frame and geometry='axisymmetric' with a file that states no axis",
        )
    return float(vector[0]), float(vector[1]), float(vector[2])


def _data_classes(root: Node) -> str:
    """Return a note on data classes that are not dimensional, of arrays without a conversion; else an empty text."""
    classes = {
        class_of(above) for above in array_paths(root, "FlowSolution_t") if not children(above[-1], "DataConversion_t")
    }
    if other := sorted(classes.difference(("", "Null", "DataClassNull", "UserDefined", "Dimensional"))):
        return f"the file calls data {', '.join(other)}: without a reference their numbers are taken as SI units"
    return ""
