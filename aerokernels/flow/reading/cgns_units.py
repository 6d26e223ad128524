"""Units of a CGNS file in HDF5: what its DimensionalUnits_t nodes say of coordinates and of the arrays of solutions.

A node's units hold for all below it that have none of their own, if the class of the data is dimensional or not told.
An array's exponents say which unit is whose; those of density, pressure and temperature are known by their names.
"""

from pathlib import Path

import numpy as np

from .array_units import length_of
from .cgns_nodes import HDF5, Node, children, data_of, node_of, text_of

# Symbols by the standard's words, in the order of the exponents: mass, length, time, temperature, angle.
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
WIDTH = 32  # characters of each word


def units(path: Path) -> tuple[float | None, dict[str, str]]:
    """The unit of length [m], or None, and the unit of each array that has one, of the first zone that tells any.

    Raises:
        ReadError: A unit of length that is not known.
    """
    with path.open("rb") as stream:
        if stream.read(8) != HDF5:
            return None, {}
    import h5py

    with h5py.File(path, "r") as file:
        return units_of(path, node_of(file))


def units_of(path: Path, root: Node) -> tuple[float | None, dict[str, str]]:
    """The same of the nodes of a file."""
    lengths: dict[str, str] = {}
    arrays: dict[str, str] = {}
    for base in children(root, "CGNSBase_t"):
        for zone in children(base, "Zone_t"):
            for label in ("GridCoordinates_t", "FlowSolution_t"):
                for part in children(zone, label):
                    for array in children(part, "DataArray_t"):
                        known = LENGTH if label == "GridCoordinates_t" else EXPONENTS.get(array.name)
                        unit = _unit([root, base, zone, part, array], known)
                        if unit:
                            (lengths if label == "GridCoordinates_t" else arrays).setdefault(array.name, unit)
    return length_of(path, lengths)[0], arrays


def _unit(above: list[Node], known: tuple[float, ...] | None) -> str:
    """The unit of the last node of a row of nodes, each below the one before it; empty where nothing tells it."""
    words, kind = None, ""
    for node in above:
        for own in children(node, "DataClass_t"):
            kind = text_of(own)
        for own in children(node, "DimensionalUnits_t"):
            words = np.asarray(data_of(own)).tobytes().decode("latin-1")
    if words is None or kind not in ("", "Dimensional", "DataClassNull"):
        return ""
    told = next(iter(children(above[-1], "DimensionalExponents_t")), None)
    exponents = known if told is None else tuple(float(power) for power in data_of(told))
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
