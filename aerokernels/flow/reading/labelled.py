"""Labelled arrays: xarray's data sets, of a NetCDF file or handed over, as named arrays with their axes in order."""

import re
from pathlib import Path

import numpy as np

from ...room import NoRoomError, check_file
from .coordinates import COLUMNS
from .dataset import Dataset, ReadError
from .named_arrays import DAMAGED, dataset_of

CLASSIC = b"CDF"


def read(path: Path, time=None, options: dict | None = None) -> Dataset:
    """Read a NetCDF file, by h5netcdf or, in its classic form, by SciPy.

    Raises:
        ReadError: A damaged file, or one without coordinates.
    """
    import xarray

    with path.open("rb") as stream:
        engine = "scipy" if stream.read(3) == CLASSIC else "h5netcdf"
    try:
        if engine == "h5netcdf":
            check_file(path, "what it holds")
        with xarray.open_dataset(path, engine=engine, decode_times=False) as data:
            return labelled_dataset(path, data.load(), (options or {}).get("variables"), time, "NetCDF")
    except ReadError:
        raise
    except NoRoomError as fault:
        raise ReadError(path, *str(fault).split(": ", 1)) from None
    except Exception as fault:  # the libraries meet a damaged file with any error
        raise ReadError(
            path, f"it is no whole NetCDF file ({type(fault).__name__}: {str(fault)[:120]})", DAMAGED
        ) from None


def labelled_dataset(path, data, variables=None, time=None, kind: str = "xarray") -> Dataset:
    """What an xarray data set holds; arguments as in `flow.read`."""
    variables = dict(variables or {})
    names = {axis: variables.get(axis) for axis in COLUMNS}
    for axis, known in COLUMNS.items():
        plain = {re.sub(r"[^a-z0-9]", "", str(name).lower()): str(name) for name in reversed([*data.variables])}
        names[axis] = names[axis] or next((plain[one] for one in known if one in plain), None)
    in_order = [own for axis in "xyrz" if (own := names[axis]) is not None and own in data.dims]
    arrays, units = {}, {}
    for name in data.variables:
        entry = data[name]
        if not np.issubdtype(entry.dtype, np.number):
            continue
        spatial = [dim for dim in in_order if dim in entry.dims]
        others = [dim for dim in entry.dims if dim not in spatial]
        if len(spatial) > 1:
            entry = entry.transpose(*others, *spatial)
        values = np.asarray(entry.values)
        if values.ndim:
            arrays[str(name)] = values
            units[str(name)] = str(entry.attrs.get("units", ""))
    return dataset_of(path, arrays, units, {a: n for a, n in variables.items() if n}, kind, time)
