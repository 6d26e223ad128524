"""Units of a CGNS file in HDF5, from the DimensionalUnits_t nodes of coordinates and solution arrays.

The units of a node apply to all nodes below it that have no units of their own, if the data class is dimensional or not
stated. An array's exponents combine the base units; the exponents of density, pressure and temperature are known from
their names.
"""

from pathlib import Path

import numpy as np

from aerokernels.flow.reading.array_units import length_of
from aerokernels.flow.reading.readers.cgns_nodes import Node, array_paths, children, class_of, data_of, opened

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


def units(path: Path) -> tuple[float | None, dict[str, str]]:
    """Return the unit of length [m] or None, and the unit of each array, from the first zone that states it.

    Raises:
        ReadError: An unknown unit of length.
    """
    with opened(path) as root:
        return (None, {}) if root is None else units_of(path, root)


def units_of(path: Path, root: Node) -> tuple[float | None, dict[str, str]]:
    """Return what `units` does, from the root node of a file."""
    lengths: dict[str, str] = {}
    arrays: dict[str, str] = {}
    for label, found in (("GridCoordinates_t", lengths), ("FlowSolution_t", arrays)):
        for above in array_paths(root, label):
            name = above[-1].name
            if unit := _unit(above, LENGTH if found is lengths else EXPONENTS.get(name)):
                found.setdefault(name, unit)
    return length_of(path, lengths)[0], arrays


def conversions(path: Path) -> dict[tuple[str, str], tuple[float, float]]:
    """Return scale and offset of normalised arrays by zone and name; the value is scale * number + offset."""
    found: dict[tuple[str, str], tuple[float, float]] = {}
    with opened(path) as root:
        for above in [] if root is None else array_paths(root, "GridCoordinates_t", "FlowSolution_t"):
            if (own := _conversion(above)) is not None:
                found[above[2].name, above[-1].name] = own
    return found


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
