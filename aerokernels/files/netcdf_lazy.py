"""Represent an unchanging NetCDF file as an xarray dataset whose large arrays are read when they are needed."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..process.fault_text import FileFault, fault_text
from ..process.fragile import DAMAGED

if TYPE_CHECKING:
    import xarray


class FileVariable(NamedTuple):
    """A variable of a file: the names of its dimensions, shape, type, attributes, chunks, and its values if small."""

    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: Any
    attributes: dict[str, Any]
    chunks: tuple[int, ...] | None
    values: np.ndarray | None


def file_state(path: Path) -> tuple[int, int]:
    """Return size and modification time of a file, to detect that it has changed."""
    found = path.stat()
    return found.st_size, found.st_mtime_ns


@contextmanager
def unchanged(path: Path, state: tuple[int, int]) -> Iterator[None]:
    """Check before and after a block that a file is the one that was opened, so that no values of two files are mixed.

    Raises:
        ValueError: The file is gone, or has changed; replaces the block's own error.
    """
    _check_state(path, state)
    try:
        yield
    finally:
        _check_state(path, state)


def _check_state(path: Path, state: tuple[int, int]) -> None:
    try:
        now = file_state(path)
    except OSError as fault:
        raise FileFault(f"{path}: it was opened, but no longer exists ({fault.strerror})") from None
    if now != state:
        raise FileFault(f"{path}: it has changed since it was opened: open it again, once it is written")


@contextmanager
def errors_naming(path: Path) -> Iterator[None]:
    """Convert the various errors that libraries raise for a damaged file to a ValueError that names the file."""
    try:
        yield
    except FileFault:
        raise
    except Exception as fault:
        raise FileFault(f"{path}: cannot be read as NetCDF ({fault_text(fault)}): {DAMAGED}") from fault


def dataset_of(
    path: Path,
    variables: dict[str, FileVariable],
    attributes: dict[str, Any],
    decode_times: bool,
    read: Callable[[str, tuple], np.ndarray] | None = None,
) -> "xarray.Dataset":
    """Return the dataset of the given variables; `read` reads values of a variable without them, by name and index."""
    import xarray
    from xarray.backends import AbstractDataStore, BackendArray
    from xarray.core.indexing import IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

    class FileArray(BackendArray):
        def __init__(self, name: str, own: FileVariable):
            self.name, self.shape = name, own.shape
            self.dtype = np.dtype(object) if isinstance(own.dtype, str) else own.dtype

        def __getitem__(self, key: Any) -> Any:
            return explicit_indexing_adapter(key, self.shape, IndexingSupport.OUTER_1VECTOR, self.read)

        def read(self, key: tuple) -> np.ndarray:
            assert read is not None
            try:
                return read(self.name, key)
            except FileFault:
                raise
            except Exception as fault:
                raise FileFault(f"{path}: {self.name} cannot be read ({fault_text(fault)}): {DAMAGED}") from fault

    class OpenFile(AbstractDataStore):
        def get_variables(self) -> dict[str, Any]:
            return {name: self.variable(name, own) for name, own in variables.items()}

        def variable(self, name: str, own: FileVariable) -> Any:
            data: Any = LazilyIndexedArray(FileArray(name, own)) if own.values is None else own.values
            encoding = {"dtype": str if isinstance(own.dtype, str) else own.dtype, "chunksizes": own.chunks}
            return xarray.Variable(own.dims, data, own.attributes, encoding)

        def get_attrs(self) -> dict[str, Any]:
            return dict(attributes)

        def get_encoding(self) -> dict[str, Any]:
            return {}

    return xarray.decode_cf(OpenFile(), decode_times=decode_times)
