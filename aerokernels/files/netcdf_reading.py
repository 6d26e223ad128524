"""Read foreign NetCDF files: by HDF5 in a child process (fragile.py), as an xarray dataset in this process.

HDF5 computes for ever on some damaged files and ends the process on others. The child does not import xarray, which
takes longer than everything else; it sends a description of the file, and large arrays when they are needed. Files of
the classic format are not HDF5, and are read in this process (netcdf_classic.py).
"""

import pickle
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..process.fragile import in_child
from ..process.room import check_file
from .netcdf_classic import is_classic, open_classic
from .netcdf_lazy import FileVariable, dataset_of, errors_naming, file_state, unchanged

if TYPE_CHECKING:
    import xarray

SMALL = 2.0**16  # [bytes]: arrays up to this size are sent with the description of the file
TEXT = "text"  # replaces the type of variable-length text, which cannot be pickled


def open_netcdf(
    path: Path, what: str, *, most_axes: float = float("inf"), decode_times: bool = True, whole: bool = False
) -> "xarray.Dataset":
    """Open a NetCDF file as a dataset whose large arrays are read, in the child, when they are needed.

    Args:
        path: The file.
        what: The file in words, for the message that it announces more data than fit in memory.
        most_axes: Arrays of more axes do not count as such data: 1 for those that are read when the file is opened.
        decode_times: Whether times become dates.
        whole: Whether to read all of it at once, into memory.

    Raises:
        NoRoomError: As `room.check_file`.
        LibraryEndedError: HDF5 ended the child, or the child exceeded its limits.
        ValueError: A damaged file, or one of another format; the message names it and quotes HDF5. Reading its arrays
            raises the same.
    """
    with errors_naming(path):
        if is_classic(path):
            data = open_classic(path, decode_times)
            return data.load() if whole else data
        state = file_state(path)
        found = in_child(path, f"{__name__}:describe", path, what, most_axes, float("inf") if whole else SMALL)

        def read(name: str, key: tuple) -> np.ndarray:
            with unchanged(path, state):
                return np.asarray(in_child(path, f"{__name__}:values", path, name, key))

        data = dataset_of(path, found[0], found[1], decode_times, read)
        return data.load() if whole else data


def describe(
    path: Path, what: str, most_axes: float, greatest: float
) -> tuple[dict[str, FileVariable], dict[str, Any]]:
    """Return, in the child, a file's variables and attributes, with the values of arrays of up to `greatest` bytes."""
    check_file(path, what, most_axes)
    with _opened(path) as file:
        return {name: _described(own, greatest) for name, own in file.variables.items()}, _attributes(file)


def values(path: Path, name: str, key: tuple) -> np.ndarray:
    """Read, in the child, some values of a variable."""
    with _opened(path) as file:
        return _checked(file.variables[name][key])


def _opened(path: Path) -> Any:
    import h5netcdf

    return h5netcdf.File(path, "r", phony_dims="access", decode_vlen_strings=True)


def _described(variable: Any, greatest: float) -> FileVariable:
    kind = np.dtype(variable.dtype)
    dtype = TEXT if kind.kind in "OU" else kind
    size = float(np.prod(variable.shape, dtype=float)) * kind.itemsize
    values = _checked(variable[...]) if size <= greatest else None
    return FileVariable(variable.dimensions, variable.shape, dtype, _attributes(variable), variable.chunks, values)


def _checked(found: Any) -> np.ndarray:
    found = np.asarray(found)
    if found.dtype.kind == "O":
        pickle.dumps(found)  # texts can be sent; HDF5 references raise a TypeError here
    return found


def _attributes(holder: Any) -> dict[str, Any]:
    """Return attributes as xarray has them: bytes as text, except fill values."""
    found = {}
    for key, value in holder.attrs.items():
        if isinstance(value, bytes) and key not in ("_FillValue", "missing_value"):
            value = value.decode("utf-8", "backslashreplace")
        if isinstance(value, (str, bytes, bool, int, float, list, tuple, np.generic, np.ndarray)):
            found[key] = value
    return found
