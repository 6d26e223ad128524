"""Read HDF5: arrays by name, with their units, as their attributes and dimension scales say what they hold.

Packed values are unpacked as NetCDF does: value * scale_factor + add_offset, without the fill value. Arrays whose axes
are named, by dimension scales or labels, are returned in the order time, r, x, y, z. Coordinates are as in
named_arrays.py. Runs in the child process of fragile.py.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.arrays import COLUMNS, plain_name, stated_unit
from aerokernels.flow.reading.dataset import Dataset
from aerokernels.flow.reading.readers.named_arrays import arrays_as_dataset


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a file of named arrays."""
    import h5py

    with h5py.File(path, "r") as file:
        arrays, described = arrays_of(file)
    return arrays_as_dataset(path, arrays, "HDF5", time, options, **described)


def arrays_of(file: Any) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Return the arrays of an open file, and `arrays_as_dataset`'s `units`, `ends` and `labelled` of them."""
    import h5py

    arrays: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    bounds: dict[str, set[float]] = {}
    labelled: set[str] = set()

    def take(name: str, entry) -> None:
        for key, value in entry.attrs.items():
            number = np.asarray(value)
            if (
                (end := re.fullmatch(r"([xyzr])_?(min|max)", key.lower()))
                and number.size == 1
                and number.dtype.kind in "iuf"
            ):
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
    return arrays, {"units": units, "ends": ends, "labelled": labelled}


def _unpacked(attributes: Any, values: np.ndarray) -> np.ndarray:
    """Return values as numbers of their unit; an attribute that is no single number does not count."""

    def number(key: str) -> float | None:
        own = np.asarray(attributes.get(key))
        return float(own.reshape(-1)[0]) if own.size == 1 and own.dtype.kind in "iuf" else None

    scale, offset, fill, missing = map(number, ("scale_factor", "add_offset", "_FillValue", "missing_value"))
    if scale is None and offset is None:
        return values
    empty = np.isin(values, [own for own in (fill, missing) if own is not None])
    result = values * (1.0 if scale is None else scale) + (0.0 if offset is None else offset)
    return np.where(empty, np.nan, result)


def _places(entry: Any) -> list[int] | None:
    """Return where the axes of an array are in the order of the module; None unless all of them are named."""
    names = [next((scale.name for scale in axis.values()), "") or axis.label for axis in entry.dims]
    axes = {plain: axis for axis, plains in COLUMNS.items() for plain in plains}
    return ["rxyz".find(axes.get(plain_name(name, True), "?")) for name in names] if all(names) else None
