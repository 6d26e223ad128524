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
from .quantities import Quantity

C = TypeVar("C", bound=type)
MOST_NUMBERS = 4  # greatest number of an array's values that are written out
MOST_TEXT = 70  # greatest number of characters of any other value
# Greatest number of a unit that counts as rounding; and the greatest share of an error.
ROUNDING = {"m": 1e-12, "rad": 1e-10, "1": 1e-6, "pixel": 1e-5}
SHARE_OF_ERROR = 1e-3
# Greatest spread of other values that counts as rounding, over the greatest of them.
RELATIVE = 1e-9
# The units in which numbers are printed, and the SI units that they have.
SI = {"nm": "m", "mm": "m", "µrad": "rad"}
NOTHING = "0, error below rounding"


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
    picture = thing._picture() if hasattr(thing, "_picture") else None
    return as_html(repr(thing), picture)


def as_html(text: str, picture: Any = None) -> str:
    """Return a text, and a picture of figures.py below it, for a notebook."""
    drawn = "" if picture is None else f'<img src="{picture.static()}" style="max-width: 36em">'
    return f"<pre>{html.escape(text)}</pre>{drawn}"


def map_picture(values: np.ndarray, ends: tuple[Any, ...], axes: tuple[str, str], label: str, colors: str) -> Any:
    """Return the picture of a map [row, column] between `ends` along both axes (left, right, low, high) [m]."""
    from .figures import Axis, Raster

    left, right, low, high = (1e3 * float(end) for end in ends)
    most = float(np.nanmax(np.abs(values), initial=0.0)) or 1.0
    limits = (-most, most) if colors == "delay" else Axis(label).around(values)
    x, y = Axis(f"{axes[0]} [mm]", (left, right)), Axis(f"{axes[1]} [mm]", (low, high))
    even = 0.3 < (high - low) / (right - left) < 1.5
    return Raster(x, y, values[None], Axis(label, limits), colors, even=even)


def plane_picture(values: Any, box: tuple[Any, Any], geometry: str, label: str) -> Any:
    """Return the picture of a field in the plane of the axes y and z, through the middle of its box along x.

    `values` returns the numbers at points (n, 3) [m]; `box` has the lowest and highest corner along the field's axes.
    """
    low, high = np.array(box[0][-2:]), np.array(box[1][-2:])
    low[0] = -high[0] if geometry == "axisymmetric" else low[0]
    count = np.maximum(np.rint(200.0 * (high - low) / (high - low).max()), 2).astype(int)
    y, z = (a + (b - a) * (np.arange(n) + 0.5) / n for a, b, n in zip(low, high, count, strict=True))
    points = np.full((*count, 3), 0.5 * (box[0][0] + box[1][0]) if geometry == "volume" else 0.0)
    points[..., 1], points[..., 2] = y[:, None], z
    result = np.reshape(values(points.reshape(-1, 3)), count)
    return map_picture(result, (low[1], high[1], low[0], high[0]), ("z", "y"), label, "density")


def is_flat(values: Any, unit: str | None = None, error: float = float("nan")) -> bool:
    """Return whether the differences between values are below rounding; so are those of no finite values.

    `unit` is "m" for optical paths, "rad" for angles, "1" for ratios, "pixel" for displacements; any other value, also
    None, for values whose rounding is a share of themselves. `error` is the greatest of the values, NaN if not known.
    """
    finite = np.asarray(values, float)
    finite = finite[np.isfinite(finite)]
    if not finite.size:
        return True
    least = ROUNDING.get(unit or "", RELATIVE * float(np.abs(finite).max()))
    return float(np.ptp(finite)) <= max(least, SHARE_OF_ERROR * (error if np.isfinite(error) else 0.0))


def quantity_text(number: Quantity, factor: float, unit: str, signed: bool = False) -> str:
    """Return a quantity in another unit as text, NOTHING where it is 0 but for rounding and its error is small too."""
    least = ROUNDING.get(SI.get(unit, unit) if unit else "", -1.0)
    if abs(number.value) <= least and not (number.error or 0.0) > least / SHARE_OF_ERROR:
        return NOTHING
    return number.scaled(factor, unit).text(signed)


def say_flat(axes: Any, words: str = "flat: its differences are below rounding", bar: Any = None) -> None:
    """Write words in Matplotlib axes in place of what they would draw, and hide ticks, labels and the colour bar."""
    if bar is not None:
        bar.set_visible(False)
    axes.set_axis_off()
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", wrap=True)
