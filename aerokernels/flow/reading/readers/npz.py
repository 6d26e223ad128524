"""Read NPZ: named arrays with their coordinates, as in named_arrays.py. Objects are never unpickled."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import Dataset, ReadError
from aerokernels.flow.reading.readers.named_arrays import arrays_as_dataset
from aerokernels.process.foreign_files import check_room


def read(path: Path, time: Any, options: Mapping[str, Any]) -> Dataset:
    """Read a file of named arrays."""
    arrays: dict[str, np.ndarray] = {}
    objects = False
    with np.load(path, allow_pickle=False) as file:
        check_room(float(sum(part.file_size for part in file.zip.infolist())), f"{path}: it")
        for name in file.files:
            try:
                values = file[name]
            except ValueError as fault:
                if "allow_pickle" not in str(fault):
                    raise
                objects = True
                continue
            if isinstance(values, np.ndarray) and values.dtype.kind in "iufb":  # other parts are bytes
                arrays[name] = values
    if not arrays and objects:
        raise ReadError(
            path,
            "it contains only Python objects, which are never unpickled, because that would run code in them",
            "save plain arrays: numpy.savez(path, x=..., y=..., density=...)",
        )
    return arrays_as_dataset(path, arrays, "NumPy arrays", time, options)
