"""Reject arrays whose numbers would be misread: masked or half-precision ones, labels in different orders."""

from collections.abc import Iterator
from typing import Any

import numpy as np

PLAIN = (float, int, str)


def refuse_masked(value: Any, name: str) -> None:
    """Reject an array with masked numbers, because NumPy would compute with the values under the mask.

    Raises:
        ValueError: Some numbers are masked; the message names the array `name`.
    """
    for part in _parts(value):
        if isinstance(part, np.ma.MaskedArray) and np.ma.is_masked(part):
            count, within = int(np.ma.count_masked(part)), "" if part is value else "an entry of "
            raise ValueError(
                f"{count} of the {part.size} numbers of {within}{name} are masked, so they are not known: fill them "
                f"in, or leave them out ({name}.filled(value), {name}.compressed())"
            )


def refuse_half_precision(value: Any, name: str) -> None:
    """Reject an array of half precision: an OPD of nanometres has one digit or none, a position three.

    Raises:
        ValueError: Its type is float16 or bfloat16; the message names the array `name`.
    """
    for part in _parts(value):
        kind = str(getattr(part, "dtype", ""))
        if kind.endswith("float16"):
            within = "" if part is value else "an entry of "
            raise ValueError(f"{within}{name} is {kind}, which has three digits at most: give float32 or float64")


def _parts(value: Any) -> Iterator[Any]:
    """Yield a value, or the entries of a list or tuple and of those within it, without plain numbers."""
    if isinstance(value, (list, tuple)):
        for entry in value:
            if type(entry) not in PLAIN:
                yield from _parts(entry)
    else:
        yield value


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
