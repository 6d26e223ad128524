"""What a CGNS file in HDF5 states of its whole flow: an axis of symmetry, and whether its data are non-dimensional."""

from pathlib import Path

import numpy as np

from .cgns_nodes import Node, child, children, data_of, opened, text_of
from .dataset import ReadError

ON_AXIS = 1e-6  # of the distance of the reference point from the origin: rounding of single precision
DIMENSIONAL = ("", "Null", "DataClassNull", "UserDefined", "Dimensional")


def statements(path: Path) -> tuple[tuple[float, float, float] | None, list[str]]:
    """Return the direction of the axis of symmetry, None for a flow without one, and notes for the user.

    Raises:
        ReadError: An axis that does not go through the origin, from which radii are measured.
    """
    with opened(path) as root:
        if root is None:
            return None, ["units of CGNS files in ADF are not read: metres and kg/m3 are taken"]
        found = [own for base in children(root, "CGNSBase_t") for own in children(base, "Axisymmetry_t")]
        return (_axis(path, found[0]) if found else None), _data_classes(root)


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


def _data_classes(root: Node) -> list[str]:
    """Return a note on data classes that are not dimensional."""
    bases = children(root, "CGNSBase_t")
    zones = [zone for base in bases for zone in children(base, "Zone_t")]
    solutions = [part for zone in zones for part in children(zone, "FlowSolution_t")]
    arrays = [array for part in solutions for array in children(part, "DataArray_t")]
    classes = {text_of(own) for node in (*bases, *zones, *solutions, *arrays) for own in children(node, "DataClass_t")}
    if other := sorted(classes.difference(DIMENSIONAL)):
        return [f"the file calls data {', '.join(other)}: without a reference their numbers are taken as SI units"]
    return []
