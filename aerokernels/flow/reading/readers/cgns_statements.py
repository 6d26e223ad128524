"""What a CGNS file in HDF5 states of its whole flow: its axis of symmetry, coordinates, solutions, kinds of data."""

from pathlib import Path

import numpy as np

from aerokernels.flow.reading.dataset import ReadError
from aerokernels.flow.reading.readers.cgns_nodes import (
    Node,
    array_paths,
    child,
    children,
    class_of,
    data_of,
    opened,
    text_of,
)

ON_AXIS = 1e-6  # of the distance of the reference point from the origin: rounding of single precision
DIMENSIONAL = ("", "Null", "DataClassNull", "UserDefined", "Dimensional")


def statements(path: Path) -> tuple[tuple[float, float, float] | None, list[str], str]:
    """Return the direction of the axis of symmetry, None for a flow without one, and notes for the user.

    The last value is the note on data without dimensions, or empty.

    Raises:
        ReadError: An axis that does not go through the origin, from which radii are measured; other coordinates than x,
            y and z; several solutions of one zone of which nothing says which counts.
    """
    with opened(path) as root:
        if root is None:
            return None, ["units of CGNS files in ADF are not read: metres and kg/m3 are taken"], ""
        for base in children(root, "CGNSBase_t"):
            for zone in children(base, "Zone_t"):
                _check_coordinates(path, zone)
                _check_solutions(path, zone)
        found = [own for base in children(root, "CGNSBase_t") for own in children(base, "Axisymmetry_t")]
        scaled = _data_classes(root)
        return (_axis(path, found[0]) if found else None), ([scaled] if scaled else []), scaled


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
    if np.linalg.norm(beside) > ON_AXIS * np.linalg.norm(point):
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
    if other := sorted(classes.difference(DIMENSIONAL)):
        return f"the file calls data {', '.join(other)}: without a reference their numbers are taken as SI units"
    return ""
