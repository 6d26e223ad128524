"""Read NetCDF files of others: by HDF5 in a child process (fragile.py), as an xarray dataset in this process.

HDF5 computes for ever on some damaged files and ends the process on others. The child does not import xarray, which
takes longer than everything else; it sends a description of the file, and large arrays when they are needed. Files of
the classic format are not HDF5, and are read by SciPy in this process.
"""

import pickle
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from aerokernels.process.foreign_files import FileFault, check_file, fault_text
from aerokernels.process.fragile import DAMAGED, in_child

if TYPE_CHECKING:
    import xarray

SMALL = 2.0**16  # [bytes]: arrays up to this size are sent with the description of the file


class FileVariable(NamedTuple):
    """A variable of a file: the names of its dimensions, shape, type, attributes, chunks, and its values if small."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: Any
    attributes: dict[str, Any]
    chunks: tuple[int, ...] | None
    values: np.ndarray | None


def is_classic(path: Path) -> bool:
    """Return whether a file is NetCDF of the classic format."""
    with path.open("rb") as stream:
        return stream.read(3) == b"CDF"


def open_netcdf(
    path: Path, what: str, *, most_axes: float = float("inf"), decode_times: bool = True, whole: bool = False
) -> "xarray.Dataset":
    """Open a NetCDF file as a dataset whose large arrays are read when they are needed, those of HDF5 in the child.

    `what` and `most_axes` are those of `check_file`; `whole` reads all of it into memory at once. Raises a FileFault
    for a damaged file, or one of another format, which names it and quotes HDF5; so does reading its arrays.
    """
    with errors_naming(path):
        state = _state(path)
        classic = is_classic(path)
        if classic:
            variables, attributes = _describe_classic(path)
        else:
            most = float("inf") if whole else SMALL
            variables, attributes = in_child(path, f"{__name__}:describe", path, what, most_axes, most)

        def read(name: str, key: tuple) -> np.ndarray:
            """Read values, of the file that was opened: no values of two files are mixed."""
            _check_state(path, state)
            try:
                if classic:
                    return _classic_values(path, name, key)
                return np.asarray(in_child(path, f"{__name__}:values", path, name, key))
            finally:
                _check_state(path, state)

        data = dataset_of(path, variables, attributes, decode_times, read)
        return data.load() if whole else data


def _state(path: Path) -> tuple[int, int]:
    """Return size and modification time of a file, to detect that it has changed."""
    state = path.stat()
    return state.st_size, state.st_mtime_ns


def _check_state(path: Path, state: tuple[int, int]) -> None:
    try:
        now = _state(path)
    except OSError as fault:
        raise FileFault(f"{path}: it was opened, but no longer exists ({fault.strerror})") from None
    if now != state:
        raise FileFault(f"{path}: it has changed since it was opened: open it again, once it is written")


@contextmanager
def errors_naming(path: Path, what: str = "cannot be read as NetCDF") -> Iterator[None]:
    """Convert the various errors that libraries raise for a damaged file to a ValueError that names the file."""
    try:
        yield
    except FileFault:
        raise
    except Exception as fault:
        raise FileFault(f"{path}: {what} ({fault_text(fault)}): {DAMAGED}") from fault


def dataset_of(
    path: Path,
    variables: dict[str, FileVariable],
    attributes: dict[str, Any],
    decode_times: bool,
    read: Callable[[str, tuple], np.ndarray] | None = None,
) -> "xarray.Dataset":
    """Return the dataset of the variables; `read` reads values of those that have none here, by name and index."""
    import xarray
    from xarray.backends import BackendArray
    from xarray.backends.memory import InMemoryDataStore
    from xarray.core.indexing import IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

    class FileArray(BackendArray):
        def __init__(self, name: str, own: FileVariable):
            self.name, self.shape = name, own.shape
            self.dtype = np.dtype(object) if isinstance(own.dtype, str) else own.dtype

        def __getitem__(self, key: Any) -> Any:
            return explicit_indexing_adapter(key, self.shape, IndexingSupport.OUTER_1VECTOR, self.read)

        def read(self, key: tuple) -> np.ndarray:
            assert read is not None
            with errors_naming(path, f"{self.name} cannot be read"):
                return read(self.name, key)

    def variable(name: str, own: FileVariable) -> Any:
        data: Any = LazilyIndexedArray(FileArray(name, own)) if own.values is None else own.values
        encoding = {"dtype": str if isinstance(own.dtype, str) else own.dtype, "chunksizes": own.chunks}
        return xarray.Variable(own.dims, data, own.attributes, encoding)

    store = InMemoryDataStore({name: variable(name, own) for name, own in variables.items()}, dict(attributes))
    return xarray.decode_cf(store, decode_times=decode_times)


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
        return _sendable(file.variables[name][key])


def _opened(path: Path) -> Any:
    import h5netcdf

    return h5netcdf.File(path, "r", phony_dims="access", decode_vlen_strings=True)


def _described(variable: Any, greatest: float) -> FileVariable:
    kind = np.dtype(variable.dtype)
    dtype = "text" if kind.kind in "OU" else kind  # the type of variable-length text cannot be pickled
    size = float(np.prod(variable.shape, dtype=float)) * kind.itemsize
    small = _sendable(variable[...]) if size <= greatest else None
    return FileVariable(variable.dimensions, variable.shape, dtype, _attributes(variable), variable.chunks, small)


def _sendable(array: Any) -> np.ndarray:
    array = np.asarray(array)
    if array.dtype.kind == "O":
        pickle.dumps(array)  # texts can be sent; HDF5 references raise a TypeError here
    return array


def _attributes(holder: Any) -> dict[str, Any]:
    """Return attributes as xarray has them: bytes as text, except fill values."""
    attributes = {}
    for key, value in holder.attrs.items():
        if isinstance(value, bytes) and key not in ("_FillValue", "missing_value"):
            value = value.decode("utf-8", "backslashreplace")
        if isinstance(value, (str, bytes, bool, int, float, list, tuple, np.generic, np.ndarray)):
            attributes[key] = value
    return attributes


@contextmanager
def _opened_classic(path: Path) -> Iterator[Any]:
    from scipy.io import netcdf_file

    # Mapped for a moment only: if a mapped file is cut short, reading the missing part ends the process.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # SciPy's, of arrays that refer to the map
        with netcdf_file(path, "r", mmap=True) as file:
            yield file


def _describe_classic(path: Path) -> tuple[dict[str, FileVariable], dict[str, Any]]:
    def attributes(holder: Any) -> dict[str, Any]:
        return {key: value.decode("utf-8", "replace") if isinstance(value, bytes) and key != "_FillValue" else value
                for key, value in holder._attributes.items()}  # fmt: skip

    with _opened_classic(path) as file:
        variables = {
            name: FileVariable(
                own.dimensions, own.data.shape, own.data.dtype.newbyteorder("="), attributes(own), None, None
            )
            for name, own in file.variables.items()
        }
        return variables, attributes(file)


def _classic_values(path: Path, name: str, key: tuple) -> np.ndarray:
    with _opened_classic(path) as file:
        data = file.variables[name].data
        return np.array(data[key], dtype=data.dtype.newbyteorder("="))
