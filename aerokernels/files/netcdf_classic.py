"""Read NetCDF files of the classic format: the header by SciPy, values from the file when they are needed.

SciPy maps the file into memory; if the file is later cut short, reading the missing part ends the process. Here the map
is used only to find the positions of the values, which are then read from the file.
"""

import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from .netcdf_lazy import FileVariable, dataset_of, errors_naming, file_state, unchanged

if TYPE_CHECKING:
    import xarray


def is_classic(path: Path) -> bool:
    """Return whether a file is NetCDF of the classic format."""
    with path.open("rb") as stream:
        return stream.read(3) == b"CDF"


class Place(NamedTuple):
    """Position of a variable's values in a file: first byte, bytes from row to row, shape and type."""

    begin: int
    step: int
    shape: tuple[int, ...]
    dtype: np.dtype

    def rows(self, path: Path, first: int, count: int) -> np.ndarray:
        """Read some rows along the first axis; a scalar is one row.

        Raises:
            EOFError: The file ends before them.
        """
        inner = self.shape[1:]
        length = math.prod(inner) * self.dtype.itemsize
        together = count if self.step == length else 1  # in records, other variables are between the rows
        found = np.empty((count, *inner), self.dtype)
        with path.open("rb") as file:
            for row in range(0, count, together):
                file.seek(self.begin + (first + row) * self.step)
                read = file.read(together * length)
                if len(read) != together * length:
                    raise EOFError("the file ends before it")
                found[row : row + together] = np.frombuffer(read, self.dtype).reshape(together, *inner)
        return found.astype(self.dtype.newbyteorder("="))

    def values(self, path: Path, key: tuple) -> np.ndarray:
        """Read the values at an outer index: whole numbers, slices, and at most one array of numbers."""
        if not self.shape:
            return self.rows(path, 0, 1)[0][key]
        wanted = np.arange(self.shape[0])[key[0]]
        if not wanted.size:
            return np.empty(self.shape, self.dtype.newbyteorder("="))[key]
        first, last = int(wanted.min()), int(wanted.max())
        taken = self.rows(path, first, last - first + 1)[wanted - first]
        return taken[(*[slice(None)] * wanted.ndim, *key[1:])]


def open_classic(path: Path, decode_times: bool = True) -> "xarray.Dataset":
    """Open a file of the classic format as a dataset whose values are read when they are needed.

    Raises:
        ValueError: A damaged file, or one that changes while it is read; the message names the file. Reading its arrays
            raises the same.
    """
    with errors_naming(path):
        state = file_state(path)
        variables, places, attributes = _described(path)

        def read(name: str, key: tuple) -> np.ndarray:
            with unchanged(path, state):
                return places[name].values(path, key)

        return dataset_of(path, variables, attributes, decode_times, read)


def _described(path: Path) -> tuple[dict[str, FileVariable], dict[str, Place], dict[str, Any]]:
    from scipy.io import netcdf_file

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # arrays still refer to the map, but are not used
        with netcdf_file(path, "r", mmap=True) as file:
            start = _address(file._mm_buf) if file.variables else 0
            variables, places = {}, {}
            for name, own in file.variables.items():
                data = own.data
                step = data.strides[0] if data.ndim else data.itemsize
                places[name] = Place(_address(data) - start, step, data.shape, data.dtype)
                kind = data.dtype.newbyteorder("=")
                variables[name] = FileVariable(own.dimensions, data.shape, kind, _decoded(own._attributes), None, None)
            return variables, places, _decoded(file._attributes)


def _address(array: np.ndarray) -> int:
    return int(array.__array_interface__["data"][0])


def _decoded(attributes: dict[str, Any]) -> dict[str, Any]:
    """Return attributes as xarray has them: bytes as text, except fill values."""
    return {key: value.decode("utf-8", "replace") if isinstance(value, bytes) and key != "_FillValue" else value
            for key, value in attributes.items()}  # fmt: skip
