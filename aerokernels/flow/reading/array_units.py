"""Units of a file's arrays: from their attributes, or in brackets in their names, as in "p [kPa]"."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from aerokernels.inputs.units import WrittenUnit, is_no_unit, unit_in_name, unit_of

from ...inputs.units import quantity
from .dataset import ReadError


def stated_unit(attributes: Mapping[str, Any]) -> str:
    """Return the unit of an array's attribute `units` or `unit`, in whatever case; empty if it has none."""
    for name in ("units", "unit"):
        for key in sorted(attributes, key=lambda key: key != name):
            if str(key).lower() == name and (text := _text(attributes[key])):
                return text
    return ""


def _text(value: Any) -> str:
    """Return an attribute's text: some programs write it as an array of one entry, or as bytes."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return str(value) if isinstance(value, (str, int, float, np.number)) else ""


def in_si_units(path, values: np.ndarray, name: str, stated: str, dimension: str) -> np.ndarray:
    """Return values in SI, converted from the unit that the file states or that the array's name contains.

    Raises:
        ReadError: A unit of another dimension, or an unknown unit.
    """
    unit = unit_of_array(path, name, stated, dimension)
    if (unit.factor, unit.offset) == (1.0, 0.0):
        return values
    return np.asarray(values * unit.factor + unit.offset)


def unit_of_array(path, name: str, stated: str, dimension: str) -> WrittenUnit:
    """Return the unit of an array; arguments and errors as in `in_si_units`."""
    if is_no_unit(stated):
        stated = unit_in_name(name)  # brackets may contain any text: "x (axial)"
    try:
        return unit_of(stated, dimension)
    except ValueError as fault:
        remedy = "write it in SI, or say what 1 of it is: "
        remedy += "length_unit" if dimension == "length" else f"reference = {{{dimension} = ...}}"
        raise ReadError(path, f"the unit of {name!r}: {fault}", remedy) from None


def length_of(path, axes: Mapping[str, str]) -> tuple[float | None, list[float]]:
    """Return the unit of length [m] of coordinates, None if no unit is stated, and a factor for each coordinate.

    The factors are 1 unless the units of the coordinates differ; then the factors convert all coordinates to metres. A
    coordinate without a unit takes that of the others.

    Args:
        path: The file, for messages.
        axes: Names of the coordinates, and the unit that the file states for each, or "".

    Raises:
        ReadError: A unit that is not a length, or an unknown unit.
    """
    factors = {}
    for name, stated in axes.items():
        if not is_no_unit(stated) or unit_in_name(name):
            factors[name] = unit_of_array(path, name, stated, "length").factor
    units = set(factors.values())
    if len(units) <= 1:
        return (units.pop() if units else None), [1.0] * len(axes)
    return 1.0, [factors.get(name, 1.0) for name in axes]


def ambient_attribute(path, stated, factor: float, values: np.ndarray) -> float | None:
    """Return the ambient density [kg/m3] of an array's attribute `ambient_density`, None if there is none.

    Args:
        path: The file, for messages.
        stated: The attribute: a number of kg/m3, or a text with a unit.
        factor: The unit of the array [kg/m3].
        values: Densities of the array, in its own unit.

    Raises:
        ReadError: Not a density, or a number that fits the array's densities in the array's unit but not in kg/m3.
    """
    if stated is None:
        return None
    if not isinstance(stated, str):
        number = np.asarray(stated)
        if number.size != 1 or number.dtype.kind not in "iuf":
            what = f"its attribute ambient_density is {str(stated)[:40]!r}, which is not a number"
            raise ReadError(path, what, "write kg/m3, as in '1.2 kg/m3'")
        stated = float(number.reshape(()))
    try:
        ambient = quantity(stated, "density")
    except (TypeError, ValueError) as fault:
        raise ReadError(path, f"its attribute ambient_density: {fault}", "write kg/m3, as in '1.2 kg/m3'") from None
    if isinstance(stated, str) or factor == 1.0 or not ambient > 0.0:
        return ambient
    good = values[np.isfinite(values) & (values > 0.0)]
    typical = float(np.median(good)) if good.size else 0.0
    if typical > 0.0 and abs(np.log(ambient / typical)) < abs(np.log(ambient / (factor * typical))):
        raise ReadError(
            path,
            f"its attribute ambient_density = {ambient:g} is in kg/m3, and the array's densities are near "
            f"{factor * typical:.3g} kg/m3",
            f"write {factor * ambient:.6g} if it is in the array's own unit, or its unit beside it",
        )
    return ambient
