"""Show objects of arrays in a few lines: the fields with their sizes, ranges and units.

`@shown` gives a class a short `__repr__` if it has none of its own, and the same text to notebooks as `_repr_html_`.
Each field is one line: an array's shape and range, another object's class, or a plain value.
"""

import dataclasses
import html
from typing import Any, TypeVar

import numpy as np

from ..inputs.arguments import units_in
from .plain_text import cut

C = TypeVar("C", bound=type)
MOST_NUMBERS = 4  # greatest number of an array's values that are written out
MOST_TEXT = 70  # greatest number of characters of any other value


def shown(target: C) -> C:
    """Return the class with a `__repr__` of a few lines; see this module's docstring."""
    own = vars(target).get("__repr__")
    if own is None or hasattr(own, "__wrapped__"):  # the __repr__ that dataclasses generate is wrapped
        target.__repr__ = _brief  # type: ignore[assignment]
    target._repr_html_ = _as_html  # type: ignore[attr-defined]
    return target


def _brief(thing: Any) -> str:
    units = units_in("\n".join(kind.__doc__ or "" for kind in reversed(type(thing).__mro__)))
    lines = []
    for field in dataclasses.fields(thing):
        value = getattr(thing, field.name)
        if field.repr and value is not None and not callable(value):
            unit = units.get(field.name, "")
            lines.append(f"  {field.name}: {described(value)}{f' {unit}' if unit else ''}")
    return "\n".join([type(thing).__name__, *lines])


def described(value: Any) -> str:
    """Return one value as a line: an array by its shape and range, a dataclass by its name."""
    if isinstance(value, np.ndarray):
        if value.size <= MOST_NUMBERS or value.dtype.kind not in "fiub":
            text = np.array2string(value, precision=6, separator=", ", threshold=20)
            return cut(" ".join(text.split()), MOST_TEXT)
        finite = value[np.isfinite(value)]
        span = f", {finite.min():.6g} to {finite.max():.6g}" if finite.size else ", none finite"
        return f"{' x '.join(map(str, value.shape))}{span}"
    if dataclasses.is_dataclass(value):
        return type(value).__name__
    return f"{value:.9g}" if isinstance(value, float) else cut(" ".join(repr(value).split()), MOST_TEXT)


def drawn_on(axes: Any) -> Any:
    """Return the given Matplotlib axes, or those of a new figure if there are none."""
    if axes is not None:
        return axes
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def extent_of(x: Any, y: Any) -> tuple[float, float, float, float]:
    """Return the outer edges of a picture whose pixel centres are evenly spaced at x and y: matplotlib's `extent`."""
    ends: list[float] = []
    for middles in (x, y):
        half = 0.5 * float(middles[-1] - middles[0]) / max(len(middles) - 1, 1)
        ends += [float(middles[0]) - half, float(middles[-1]) + half]
    return ends[0], ends[1], ends[2], ends[3]


def _as_html(thing: Any) -> str:
    return f"<pre>{html.escape(repr(thing))}</pre>"
