"""Reject arrays whose numbers would be misread: masked or half-precision ones, labels in different orders."""

from typing import Any

import numpy as np


def refuse_masked(value: Any, name: str) -> None:
    """Reject an array with masked numbers, because NumPy would compute with the values under the mask.

    Raises:
        ValueError: Some numbers are masked; the message names the array `name`.
    """
    if isinstance(value, np.ma.MaskedArray) and np.ma.is_masked(value):
        count = int(np.ma.count_masked(value))
        raise ValueError(
            f"{count} of the {value.size} numbers of {name} are masked, so they are not known: fill them in, or leave "
            f"them out ({name}.filled(value), {name}.compressed())"
        )


def refuse_half_precision(value: Any, name: str) -> None:
    """Reject an array of half precision: an OPD of nanometres has one digit or none, a position three.

    Raises:
        ValueError: Its type is float16 or bfloat16; the message names the array `name`.
    """
    kind = str(getattr(value, "dtype", ""))
    if kind.endswith("float16"):
        raise ValueError(f"{name} is {kind}, which has three digits at most: give float32 or float64")


def refuse_shuffled(arguments: dict[str, Any]) -> None:
    """Reject pandas columns with the same labels in different orders: their numbers would be paired by position."""
    labelled = [(name, value.index) for name, value in arguments.items() if hasattr(value, "iloc")]
    for name, index in labelled[1:]:
        first, order = labelled[0]
        if len(index) == len(order) and not index.equals(order) and index.sort_values().equals(order.sort_values()):
            raise ValueError(
                f"{first} and {name} have the same labels in different orders, but are paired by position: bring them "
                f"into one order ({name}.loc[{first}.index]), or drop the labels ({name}.to_numpy())"
            )
