"""Arrays of an HDF5 file by name, with their units, as their attributes and dimension scales say what they hold.

Packed values are unpacked as NetCDF does: value * scale_factor + add_offset, without the fill value. Arrays whose axes
are named, by dimension scales or labels, are returned in the order time, r, x, y, z.
"""

import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from aerokernels.flow.reading.array_names import plain_name
from aerokernels.flow.reading.array_units import stated_unit
from aerokernels.flow.reading.dataset import DAMAGED, ReadError
from aerokernels.flow.reading.readers.coordinates import COLUMNS

AXIS_END = re.compile(r"([xyzr])_?(min|max)")


class Held(NamedTuple):
    """Contents of an HDF5 file.

    Attributes:
        arrays: Its arrays by name.
        units: Their units.
        ends: The ends of axes.
        labelled: Names of the arrays whose axes are named.
    """

    arrays: dict[str, np.ndarray]
    units: dict[str, str]
    ends: dict[str, tuple[float, float]]
    labelled: set[str]


def hdf5_arrays(path: Path) -> Held:
    """Return the contents of an HDF5 file."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return arrays_of(file)
    except (OSError, RuntimeError, KeyError, ValueError) as fault:
        raise ReadError(path, f"HDF5 cannot read it ({str(fault)[:120]})", DAMAGED) from None


def arrays_of(file: Any) -> Held:
    """Return what `hdf5_arrays` does, from an open file."""
    import h5py

    arrays: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    bounds: dict[str, set[float]] = {}
    labelled: set[str] = set()

    def take(name: str, entry) -> None:
        for key, value in entry.attrs.items():
            number = np.asarray(value)
            if (end := AXIS_END.fullmatch(key.lower())) and number.size == 1 and number.dtype.kind in "iuf":
                bounds.setdefault("".join(end.groups()), set()).add(float(number.reshape(-1)[0]))
        if isinstance(entry, h5py.Dataset) and entry.shape and np.issubdtype(entry.dtype, np.number):
            if name.rsplit("/", 1)[-1] in ("data", "values") and len(entry.parent) == 1 and "/" in name:
                name = name.rsplit("/", 1)[0]  # a group with a single array gives it its name
            places = _places(entry)
            arrays[name] = _unpacked(entry.attrs, entry[...])
            if places is not None:
                labelled.add(name)
                if places != sorted(places):
                    arrays[name] = arrays[name].transpose(np.argsort(places, kind="stable"))
            units[name] = stated_unit(entry.attrs)

    take("", file)
    file.visititems(take)
    known = {key: values.pop() for key, values in bounds.items() if len(values) == 1}
    ends = {a: (known[f"{a}min"], known[f"{a}max"]) for a in "xyzr" if f"{a}min" in known and f"{a}max" in known}
    return Held(arrays, units, ends, labelled)


def _unpacked(attributes: Any, values: np.ndarray) -> np.ndarray:
    """Return values as numbers of their unit; an attribute that is no single number does not count."""
    scale, offset, fill, missing = (
        _number(attributes.get(key)) for key in ("scale_factor", "add_offset", "_FillValue", "missing_value")
    )
    if scale is None and offset is None:
        return values
    empty = np.isin(values, [own for own in (fill, missing) if own is not None])
    found = values * (1.0 if scale is None else scale) + (0.0 if offset is None else offset)
    return np.where(empty, np.nan, found)


def _number(value: Any) -> float | None:
    number = np.asarray(value)
    return float(number.reshape(-1)[0]) if number.size == 1 and number.dtype.kind in "iuf" else None


def _places(entry: Any) -> list[int] | None:
    """Return where the axes of an array are in the order of the module; None unless all of them are named."""
    names = [next((scale.name for scale in axis.values()), "") or axis.label for axis in entry.dims]
    axes = {plain: axis for axis, plains in COLUMNS.items() for plain in plains}
    return ["rxyz".find(axes.get(plain_name(name, True), "?")) for name in names] if all(names) else None
