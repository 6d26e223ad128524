"""What the names of a file's arrays mean: without units, brackets, punctuation and the words of a mean."""

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import ReadError
from aerokernels.inputs.units import WrittenUnit, in_brackets, is_no_unit, quantity, unit_in_name, unit_of, written_unit

# Words in brackets that leave a quantity what it is; others, such as "total" and "gauge", make another one of it.
SAME_QUANTITY = ("static", "absolute", "abs", "thermodynamic", "mean", "average", "averaged", "avg", "si", "gas", "air",
                 "mixture", "fluid")  # fmt: skip


def plain_name(name: str, grouped: bool = False) -> str:
    """Return a name in lower case, without blanks, punctuation and units; without groups if it is `grouped`.

    Elsewhere than in grouped names a slash is a quotient: "p/rho" is not a density.
    """
    plain = re.sub(r"[\[(<{].*", "", _without_comma(name).lower().replace("ρ", "rho"))
    return re.sub(r"[^a-z0-9]", "", plain.rsplit("/", 1)[-1] if grouped else plain)


def quantity_name(name: str, grouped: bool = False) -> str:
    """Return the plain name of the quantity that an array has; words in brackets count unless they are units.

    "Pressure (total)" is "pressuretotal" and no pressure, "T [K]" is "t", "<rho>" is "rho".
    """
    if (whole := re.fullmatch(r"\s*<([^<>]*)>\s*", name)) is not None:
        name = whole[1]
    text = _without_comma(name)
    while inside := in_brackets(text):
        if not (is_no_unit(inside) or written_unit(inside) is not None or inside.lower() in SAME_QUANTITY):
            return re.sub(r"[^a-z0-9]", "", name.lower())
        text = text[: text.rfind(inside)].rstrip(" \t[(<{")
    return plain_name(text, grouped)


def known_names(names: Iterable[str], known: Sequence[str], grouped: bool = False) -> list[str]:
    """Return those of `names` that are the first of the `known` quantities; means over time count after all others."""
    quantities = [(name, quantity_name(name, grouped)) for name in names]
    mean = r"(?:time)?(?:mean|averaged?|avg|ave)"
    for pattern in ("{one}", f"{mean}(?:of)?{{one}}|{{one}}{mean}"):
        for one in known:
            if result := [name for name, own in quantities if re.fullmatch(pattern.format(one=one), own)]:
                return result
    return []


def _without_comma(name: str) -> str:
    """Return a name without a unit that follows a comma, as in "Density, kg/m3"."""
    before, comma, unit = name.rpartition(",")
    return before if comma and written_unit(unit) is not None else name


def stated_unit(attributes: Mapping[str, Any]) -> str:
    """Return the unit of an array's attribute `units` or `unit`, in whatever case; empty if it has none.

    Some programs write it as an array of one entry, or as bytes.
    """
    for name in ("units", "unit"):
        for key in sorted(attributes, key=lambda key: key != name):
            value = attributes[key]
            if isinstance(value, np.ndarray) and value.size == 1:
                value = value.reshape(-1)[0]
            text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
            if str(key).lower() == name and isinstance(text, (str, int, float, np.number)) and str(text):
                return str(text)
    return ""


def unit_of_array(path, name: str, stated: str, dimension: str) -> WrittenUnit:
    """Return the unit of an array, which the file states or the array's name contains."""
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

    `axes` has the unit that the file states, or "", by the name of each coordinate.
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

    `stated` is the attribute, a number of kg/m3 or a text with a unit; `values` are the array's, in units of `factor`.
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


# In lower case, without blanks, punctuation and units.
COLUMNS = {
    "x": ("x", "points0", "coordinatex", "centersx", "ccx", "xcoordinate", "posx", "positionx"),
    "y": ("y", "points1", "coordinatey", "centersy", "ccy", "ycoordinate", "posy", "positiony"),
    "z": ("z", "points2", "coordinatez", "centersz", "ccz", "zcoordinate", "posz", "positionz"),
    "r": ("r", "radius"),
}
PLACE = {"x": 0, "y": 1, "z": 2, "r": 1}
Direction = tuple[float, float, float]


def coordinates_of(
    names: Iterable[str], grouped: bool = False, named: Mapping[str, str] | None = None
) -> tuple[dict[str, str], Direction | None]:
    """Return the names of a flow's coordinates by axis, in the order of the axes, and its axis of symmetry.

    `named` are those that a caller names. A flow over r and z, or r and x, is axisymmetric; None for others.
    """
    plain: dict[str, str] = {}
    for name in sorted(names, key=lambda name: name.count("/")):  # an array at the root counts before those in groups
        plain.setdefault(plain_name(name, grouped), name)
        plain.setdefault(re.sub(r"[^a-z0-9]", "", name.lower()), name)
    usual = {axis: next((plain[one] for one in own if one in plain), None) for axis, own in COLUMNS.items()}
    known = {axis: name for axis, name in (usual | dict(named or {})).items() if name is not None}
    along = next((axis for axis in "zx" if axis in known), None)
    if "r" not in known or "y" in known or along is None:
        return {axis: known[axis] for axis in "xyz" if axis in known}, None
    # In the optical frame z points upstream.
    return {axis: known[axis] for axis in ("r", along)}, {"z": (0.0, 0.0, -1.0), "x": (1.0, 0.0, 0.0)}[along]
