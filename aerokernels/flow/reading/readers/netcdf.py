"""Read labelled arrays, from a NetCDF file or an xarray data set, as named arrays with their axes in a known order."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.files.netcdf_reading import is_classic
from aerokernels.flow.reading.arrays import COLUMNS, axes_of, plain_name, stated_unit
from aerokernels.flow.reading.dataset import DAMAGED, Dataset, ReadError
from aerokernels.flow.reading.readers.named_arrays import dataset_of
from aerokernels.inputs.arguments import seconds
from aerokernels.process.foreign_files import NoRoomError, check_file


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a NetCDF file, with h5netcdf or, in its classic format, with SciPy."""
    import xarray

    engine = "scipy" if is_classic(path) else "h5netcdf"
    try:
        if engine == "h5netcdf":
            check_file(path, "what it holds")
        with xarray.open_dataset(path, engine=engine, decode_times=False) as data:
            return labelled_dataset(path, data.load(), options.get("variables"), time, "NetCDF")
    except ReadError:
        raise
    except NoRoomError as fault:
        raise ReadError(path, *str(fault).split(": ", 1)) from None
    except Exception as fault:  # the libraries raise any error for a damaged file
        raise ReadError(
            path, f"it is not a complete NetCDF file ({type(fault).__name__}: {str(fault)[:120]})", DAMAGED
        ) from None


def labelled_dataset(path, data, variables=None, time=None, kind: str = "xarray") -> Dataset:
    """Return the contents of an xarray data set; arguments as in `flow.read`."""
    variables = dict(variables or {})
    plain = {plain_name(str(name)): str(name) for name in reversed([*data.variables])}
    names = {axis: variables.get(axis) or next((plain[one] for one in known if one in plain), None)
             for axis, known in COLUMNS.items()}  # fmt: skip
    # Transpose arrays to the order of axes that `dataset_of` expects: lengths alone do not tell equal axes apart.
    order, _ = axes_of({axis: own for axis, own in names.items() if own is not None})
    in_order = list(
        dict.fromkeys(dim for axis in order if names[axis] in data.variables for dim in data[names[axis]].dims)
    )
    arrays, units = {}, {}
    for name in data.variables:
        entry = data[name]
        if entry.dtype.kind in "mM":  # only one-dimensional dates are an axis of time
            entry = entry.copy(data=seconds(entry.values)) if entry.ndim == 1 else entry
        if entry.dtype.kind not in "iuf" or len(set(entry.dims)) < entry.ndim:  # a dimension that occurs twice
            continue
        entry = entry.squeeze(
            [dim for dim in entry.dims if data.sizes[dim] == 1 and dim not in {*in_order, *data.coords}]
        )
        spatial = [dim for dim in in_order if dim in entry.dims]
        others = [dim for dim in entry.dims if dim not in spatial]
        if len(spatial) > 1:
            entry = entry.transpose(*others, *spatial)
        values = np.asarray(entry.values)
        if values.ndim:
            arrays[str(name)] = values
            units[str(name)] = stated_unit(entry.attrs)
    return dataset_of(path, arrays, units, {a: n for a, n in variables.items() if n}, kind, time, arrays)
