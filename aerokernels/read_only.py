"""Data classes whose arrays nobody may change: how they are pickled and copied."""

from dataclasses import fields

import numpy as np


class ReadOnly:
    """A data class whose arrays are read-only, and are so again after it was pickled or copied.

    A pickle holds its fields. What was computed from them and kept is computed again when it is asked for.
    """

    def __getstate__(self) -> dict:
        """The fields by name."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}  # type: ignore[arg-type]

    def __setstate__(self, state: dict) -> None:
        """Take over the fields; NumPy does not keep whether an array may be written to."""
        for name, value in state.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)
