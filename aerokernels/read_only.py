"""Provide a base for data classes with read-only arrays that stay read-only after pickling and copying."""

from dataclasses import fields

import numpy as np


class ReadOnly:
    """A data class whose arrays are read-only, also after pickling and copying.

    A pickle contains the fields only; cached results are computed again when needed.
    """

    def __getstate__(self) -> dict:
        """Return the fields by name."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}  # type: ignore[arg-type]

    def __setstate__(self, state: dict) -> None:
        """Set the fields; arrays are made read-only again, because NumPy does not pickle that flag."""
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)
