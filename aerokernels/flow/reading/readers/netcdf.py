"""Read labelled arrays, from a NetCDF file or an xarray data set, as named arrays with their axes in a known order."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.files.netcdf_reading import is_classic
from aerokernels.flow.reading.arrays import coordinates_of, stated_unit
from aerokernels.flow.reading.dataset import Dataset
from aerokernels.flow.reading.readers.named_arrays import arrays_as_dataset
from aerokernels.inputs.arguments import seconds
from aerokernels.process.foreign_files import check_file


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a NetCDF file, with h5netcdf or, in its classic format, with SciPy."""
    import xarray

    engine = "scipy" if is_classic(path) else "h5netcdf"
    if engine == "h5netcdf":
        check_file(path, f"{path}: what it holds")
    with xarray.open_dataset(path, engine=engine, decode_times=False) as data:
        return labelled_dataset(path, data.load(), options.get("variables"), time, "NetCDF")


def labelled_dataset(path, data, variables=None, time=None, kind: str = "xarray") -> Dataset:
    """Return the contents of an xarray data set; arguments as in `flow.read`."""
    variables = {axis: name for axis, name in dict(variables or {}).items() if name}
    names, _ = coordinates_of(map(str, data.variables), True, variables)
    # Transpose arrays to the order of axes that `arrays_as_dataset` expects: lengths do not tell equal axes apart.
    in_order = [*dict.fromkeys(dim for name in names.values() if name in data.variables for dim in data[name].dims)]
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
    options = {"variables": variables}
    return arrays_as_dataset(path, arrays, kind, time, options, units=units, labelled=arrays, grouped=False)
