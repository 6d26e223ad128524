"""Reading NetCDF-4 that somebody gives: by HDF5 in a child process (fragile.py), as a data set of xarray's in this one.

HDF5 computes for ever on some damaged files and ends the process on others. The child needs no xarray, which takes
longer to start than everything else; it sends what the file holds, and large arrays as they are asked for.
"""

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .fragile import DAMAGED, LibraryEndedError, in_child
from .room import NoRoomError, check_file

if TYPE_CHECKING:
    import xarray

SMALL = 2.0**16  # [bytes]: arrays up to this size come with the description of the file
TEXT = "text"  # in place of the type of texts of any length, whose own does not travel


class FarVariable(NamedTuple):
    """A variable of a file: the names of its dimensions, shape, type, attributes, chunks, and its values if small."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: Any
    attributes: dict[str, Any]
    chunks: tuple[int, ...] | None
    values: np.ndarray | None


def open_netcdf(
    path: Path, what: str, *, most_axes: float = float("inf"), decode_times: bool = True, whole: bool = False
) -> "xarray.Dataset":
    """A NetCDF-4 file as a data set whose large arrays are read, in the child, when they are asked for.

    Args:
        path: The file.
        what: It in words, for the message that it announces more than there is memory.
        most_axes: Arrays of more axes do not count there: 1 for those that are read when the file is opened.
        decode_times: Whether times become dates.
        whole: All of it is read at once, into memory.

    Raises:
        NoRoomError: As `room.check_file`.
        LibraryEndedError: HDF5 ended its process on it, or was ended.
        ValueError: A damaged file, or of another format: names it, and says what HDF5 does; so do its arrays when they
            are read.
    """
    with told_of(path):
        state = state_of(path)
        found = in_child(path, f"{__name__}:describe", path, what, most_axes, float("inf") if whole else SMALL)

        def read(name: str, key: tuple) -> np.ndarray:
            with held_still(path, state):
                return np.asarray(in_child(path, f"{__name__}:values", path, name, key))

        data = dataset_of(path, found[0], found[1], decode_times, read)
        return data.load() if whole else data


def state_of(path: Path) -> tuple[int, int]:
    """What tells that a file is still the one that was opened: its size, and when it was written."""
    found = path.stat()
    return found.st_size, found.st_mtime_ns


@contextmanager
def held_still(path: Path, state: tuple[int, int]) -> Iterator[None]:
    """Hold what is read of a file against what it was when it was opened: values of two files would be mixed.

    Raises:
        ValueError: It is gone, or another one; instead of what reading it raised.
    """
    _check_state(path, state)
    try:
        yield
    finally:
        _check_state(path, state)


def _check_state(path: Path, state: tuple[int, int]) -> None:
    try:
        now = state_of(path)
    except OSError as fault:
        raise ValueError(f"{path}: it was there when it was opened, and is not now ({fault.strerror})") from None
    if now != state:
        raise ValueError(f"{path}: it has changed since it was opened: open it again, once it is written")


@contextmanager
def told_of(path: Path) -> Iterator[None]:
    """What the libraries say of a damaged file becomes a ValueError that names it; they meet one with any error."""
    try:
        yield
    except (LibraryEndedError, NoRoomError):
        raise
    except Exception as fault:
        if isinstance(fault, ValueError) and str(path) in str(fault):
            raise
        raise ValueError(f"{path}: cannot be read as NetCDF ({_in_words(fault)}): {DAMAGED}") from fault


def _in_words(fault: Exception) -> str:
    return " ".join(f"{type(fault).__name__}: {str(fault)[:200]}".split())


def dataset_of(
    path: Path,
    variables: dict[str, FarVariable],
    attributes: dict[str, Any],
    decode_times: bool,
    read: Callable[[str, tuple], np.ndarray] | None = None,
) -> "xarray.Dataset":
    """The data set of what `describe` found; `read` gives values of a variable that did not come with it, by a key."""
    import xarray
    from xarray.backends import AbstractDataStore, BackendArray
    from xarray.core.indexing import IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

    class FarArray(BackendArray):
        def __init__(self, name: str, own: FarVariable):
            self.name, self.shape = name, own.shape
            self.dtype = np.dtype(object) if isinstance(own.dtype, str) else own.dtype

        def __getitem__(self, key: Any) -> Any:
            return explicit_indexing_adapter(key, self.shape, IndexingSupport.OUTER_1VECTOR, self.read)

        def read(self, key: tuple) -> np.ndarray:
            assert read is not None
            try:
                return read(self.name, key)
            except Exception as fault:
                if isinstance(fault, ValueError) and str(fault).startswith(str(path)):
                    raise
                raise ValueError(f"{path}: {self.name} cannot be read ({_in_words(fault)}): {DAMAGED}") from fault

    class FarFile(AbstractDataStore):
        def get_variables(self) -> dict[str, Any]:
            return {name: self.variable(name, own) for name, own in variables.items()}

        def variable(self, name: str, own: FarVariable) -> Any:
            data: Any = LazilyIndexedArray(FarArray(name, own)) if own.values is None else own.values
            encoding = {"dtype": str if isinstance(own.dtype, str) else own.dtype, "chunksizes": own.chunks}
            return xarray.Variable(own.dims, data, own.attributes, encoding)

        def get_attrs(self) -> dict[str, Any]:
            return dict(attributes)

        def get_encoding(self) -> dict[str, Any]:
            return {}

    return xarray.decode_cf(FarFile(), decode_times=decode_times)


def describe(path: Path, what: str, most_axes: float, greatest: float) -> tuple[dict[str, FarVariable], dict[str, Any]]:
    """What a file holds, and its attributes, in the child; values of arrays of up to `greatest` bytes."""
    check_file(path, what, most_axes)
    with _opened(path) as file:
        return {name: _described(own, greatest) for name, own in file.variables.items()}, _attributes(file)


def values(path: Path, name: str, key: tuple) -> np.ndarray:
    """Some values of a variable, in the child."""
    with _opened(path) as file:
        return _checked(name, file.variables[name][key])


def _opened(path: Path) -> Any:
    import h5netcdf

    return h5netcdf.File(path, "r", phony_dims="access", decode_vlen_strings=True)


def _described(variable: Any, greatest: float) -> FarVariable:
    kind = np.dtype(variable.dtype)
    dtype = TEXT if kind.kind in "OU" else kind
    size = float(np.prod(variable.shape, dtype=float)) * kind.itemsize
    held = _checked(variable.name, variable[...]) if size <= greatest else None
    return FarVariable(variable.dimensions, variable.shape, dtype, _attributes(variable), variable.chunks, held)


def _checked(name: str, found: Any) -> np.ndarray:
    found = np.asarray(found)
    if found.dtype.kind == "O":
        pickle.dumps(found)  # texts travel, and references of HDF5 raise a TypeError here
    return found


def _attributes(holder: Any) -> dict[str, Any]:
    """Attributes as xarray has them: bytes as texts, where they are none of the numbers that stand for no value."""
    found = {}
    for key, value in holder.attrs.items():
        if isinstance(value, bytes) and key not in ("_FillValue", "missing_value"):
            value = value.decode("utf-8", "backslashreplace")
        if isinstance(value, (str, bytes, bool, int, float, list, tuple, np.generic, np.ndarray)):
            found[key] = value
    return found
