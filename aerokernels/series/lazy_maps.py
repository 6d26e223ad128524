"""Maps of a Zarr store, read by xarray on demand; damaged chunks raise an error that names the store."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import xarray
import zarr
from xarray.backends import BackendArray
from xarray.core.indexing import (
    CopyOnWriteArray,
    IndexingSupport,
    LazilyIndexedArray,
    MemoryCachedArray,
    explicit_indexing_adapter,
)

from aerokernels.process.foreign_files import fault_text


class _Map(BackendArray):
    """An array of a Zarr store, for xarray."""

    def __init__(self, path: Path, name: str):
        self.path, self.name = path, name
        self.array: Any = zarr.open_group(str(path), mode="r")[name]
        self.shape, self.dtype = self.array.shape, self.array.dtype

    def __getitem__(self, key: Any) -> Any:
        return explicit_indexing_adapter(key, self.shape, IndexingSupport.OUTER, self._read)

    def _read(self, key: tuple) -> np.ndarray:
        try:
            return np.asarray(self.array.oindex[key])
        except Exception as fault:  # Zarr raises any error for damaged data
            remedy = "take another copy, or make the series again"
            raise ValueError(f"{self.path}: {self.name} is damaged ({fault_text(fault)}): {remedy}") from fault


def name_damaged_arrays(path: Path, found: xarray.Dataset, names: Iterable[str]) -> xarray.Dataset:
    """Return the dataset of a Zarr store whose arrays `names` raise ValueError with the store's name if damaged."""

    def variable(name: str) -> xarray.Variable:
        own = found[name].variable
        lazy: Any = LazilyIndexedArray(_Map(path, name))
        data = MemoryCachedArray(CopyOnWriteArray(lazy))  # as xarray opens them itself
        return xarray.Variable(own.dims, data, own.attrs, own.encoding)

    return found.assign({name: variable(name) for name in names})
