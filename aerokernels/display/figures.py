"""Pictures: each is described once, and shown by a report's script, or on paper and in notebooks as a figure."""

import base64
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .canvas import BELOW, COLORS, DASHES, INK, ORANGE, color_bar, color_map, data_url, figure_of, make_room

if TYPE_CHECKING:
    from matplotlib.axes import Axes

RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
LEAST_DECADE = 1e-5  # of logarithmic images of light


def packed(values: Any) -> dict[str, Any]:
    """Return numbers as 16-bit integers in base64 with offset and step; 0 stands for a number that is not finite."""
    numbers = np.asarray(values, float)
    known = numbers[np.isfinite(numbers)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 1.0)
    step = (high - low) / 65533.0 or 1.0
    with np.errstate(invalid="ignore"):
        whole = np.where(np.isfinite(numbers), 1 + np.round((numbers - low) / step), 0).astype("<u2")
    text = base64.b64encode(whole.tobytes()).decode("ascii")
    return {"b64": text, "low": low, "step": step, "shape": list(numbers.shape)}


def plain(values: Any, digits: int = 6) -> list[Any]:
    """Return numbers for the page's script with so many significant digits, None where they are not finite."""
    numbers = np.asarray(values, float)
    rounded = [float(f"{one:.{digits}g}") if math.isfinite(one) else None for one in numbers.ravel().tolist()]
    return np.array(rounded, dtype=object).reshape(numbers.shape).tolist()


@dataclass(frozen=True)
class Axis:
    """One axis, or the values of a raster.

    Attributes:
        label: What it is, with its unit.
        limits: Its ends; None for those of the values.
        unit: The unit alone, for values under the pointer.
        log: Whether it is logarithmic.
        names: Words at 0, 1, 2, ... in place of numbers.
    """

    label: str
    limits: tuple[float, float] | None = None
    unit: str = ""
    log: bool = False
    names: Sequence[str] = ()

    def around(self, values: Any) -> tuple[float, float]:
        """Return the axis's ends: the given ones, or those of `values` with a margin."""
        if self.names:
            return -0.5, len(self.names) - 0.5
        if self.limits is not None:
            return self.limits
        known = np.asarray(values, float).ravel()
        known = known[np.isfinite(known) & ((known > 0.0) | (not self.log))]
        if not known.size:
            return (0.1, 1.0) if self.log else (0.0, 1.0)
        low, high = float(known.min()), float(known.max())
        if self.log:
            return low / 1.2, high * 1.2
        margin = 0.06 * (high - low) or 0.1 * abs(high) or 1.0
        return low - margin, high + margin

    def spec(self, values: Any) -> dict[str, Any]:
        """Return the axis for the page's script."""
        names = {"names": list(self.names)} if self.names else {}
        return {"label": self.label, "unit": self.unit, "log": self.log, "limits": list(self.around(values)), **names}


@dataclass(frozen=True, eq=False)
class Line:
    """A line or a row of dots.

    Attributes:
        x, y: Its points.
        name: What it is; empty for no entry in the key.
        style: A style of the page: "one", "two" (dashed), "twosolid", "plain", "free" (dotted), "c0" to "c6".
        error: Half the height of the band or bar about each point.
        dots: Whether its points are drawn.
        joined: Whether dots are joined by a line.
        says: What is said of it under the pointer; the name if empty.
    """

    x: Any
    y: Any
    name: str = ""
    style: str = "one"
    error: Any = None
    dots: bool = False
    joined: bool = False
    says: str = ""

    def spec(self) -> dict[str, Any]:
        """Return the line for the page's script."""
        error = {} if self.error is None else {"error": plain(np.nan_to_num(np.asarray(self.error, float)), 3)}
        kinds = {"name": self.name, "style": self.style, "dots": self.dots, "joined": self.joined, "says": self.says}
        return {**kinds, "x": plain(self.x), "y": plain(self.y), **error}


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines over one axis.

    Attributes:
        x, y: The axes.
        lines: The lines.
        band: Half the height of a grey band about 0, below which nothing is known.
        limits: Lines across the plot: pairs of ("x" or "y", value, words).
        marks: Points to which the eye is drawn.
        gap: A distance along x that is named: (from, to, lines of words).
        pick: Whether the pointer reads the line that is nearest to it, else all of them.
    """

    x: Axis
    y: Axis
    lines: Sequence[Line]
    band: float = 0.0
    limits: Sequence[tuple[str, float, str]] = ()
    marks: Sequence[tuple[float, float]] = ()
    gap: tuple[float, float, Sequence[str]] | None = None
    pick: bool = False
    tall: float = 0.0

    @property
    def _extremes(self) -> tuple[np.ndarray, np.ndarray]:
        x = np.concatenate([np.ravel(one.x) for one in self.lines]).astype(float)
        y = [np.asarray(one.y, float) for one in self.lines]
        e = [0.0 if one.error is None else np.nan_to_num(np.asarray(one.error, float)) for one in self.lines]
        ends = [end for one, error in zip(y, e, strict=True) for end in (one - error, one + error)]
        return x, np.concatenate([*map(np.ravel, ends), [-self.band, self.band] if self.band else []])

    def spec(self, name: str) -> dict[str, Any]:
        """Return the picture for the page's script."""
        x, y = self._extremes
        spec: dict[str, Any] = {"kind": "lines", "id": name, "x": self.x.spec(x), "y": self.y.spec(y)}
        spec |= {"lines": [one.spec() for one in self.lines], "pick": self.pick, "tall": self.tall, "band": self.band}
        spec["limits"] = [{axis: value, "text": words} for axis, value, words in self.limits]
        spec["marks"] = [{"x": x, "y": y} for x, y in self.marks]
        if self.gap is not None:
            spec["gap"] = {"x": list(self.gap[:2]), "text": list(self.gap[2])}
        return spec

    def static(self) -> str:
        """Return the picture for paper, as a data URL."""
        with figure_of(2.05) as (figure, axes):
            self.draw(axes)
            make_room(figure, axes)
            return data_url(figure, "svg")

    def draw(self, axes: "Axes") -> None:
        """Draw the picture on Matplotlib axes."""
        if self.band:
            axes.axhspan(-self.band, self.band, color="#e6e9ed", lw=0.0)
        for one in self.lines:
            _draw_line(axes, one, many=len(self.lines) > 8)
        for axis, value, words in self.limits:
            draw = axes.axhline if axis == "y" else axes.axvline
            draw(value, color=INK, lw=0.8, ls=":")
            place = (0.02, value) if axis == "y" else (value, 0.94)
            transform = axes.get_yaxis_transform() if axis == "y" else axes.get_xaxis_transform()
            axes.text(*place, f" {words}", transform=transform, va="bottom", fontsize=7.5, color=INK)
        for place in self.marks:
            axes.plot(*place, "o", ms=4, color=ORANGE)
        if self.gap is not None:
            axes.text(0.97, 0.06, "\n".join(self.gap[2]), transform=axes.transAxes, ha="right", color=ORANGE)
        _dress(axes, self.x, self.y, *self._extremes)
        if len({one.name for one in self.lines if one.name}) > 1:
            handles, names = axes.get_legend_handles_labels()
            unique = dict(zip(names, handles, strict=True))
            axes.legend(unique.values(), unique.keys())


def _draw_line(axes: "Axes", one: Line, many: bool) -> None:
    color, dash = COLORS[one.style], DASHES.get(one.style, "-")
    label = one.name or "_"
    if one.dots:
        error = None if one.error is None else np.nan_to_num(np.asarray(one.error, float))
        joined = dash if one.joined else ""
        axes.errorbar(one.x, one.y, error, fmt="o", ls=joined, ms=3.5, capsize=2, color=color, label=label)
        return
    if one.error is not None:
        y, e = np.asarray(one.y, float), np.nan_to_num(np.asarray(one.error, float))
        axes.fill_between(one.x, y - e, y + e, color=color, alpha=0.22, lw=0.0)
    axes.plot(one.x, one.y, color=color, ls=dash, lw=0.9 if many else 1.4, label=label)


def _dress(axes: "Axes", x: Axis, y: Axis, x_values: Any, y_values: Any) -> None:
    """Scale, limit and label both axes."""
    from matplotlib.ticker import MaxNLocator, NullLocator

    for axis, one, values in (("x", x, x_values), ("y", y, y_values)):
        low, high = one.around(values)
        axes.set(**{f"{axis}scale": "log" if one.log else "linear", f"{axis}lim": (low, high)})
        scale = getattr(axes, f"{axis}axis")
        scale.set_label_text(one.label)
        if one.log:  # Matplotlib's own labels are formulas, which take as long as the figure
            scale.set_major_formatter(lambda value, _: _power_of_ten(value))
            scale.set_minor_locator(NullLocator())
        elif not one.names:
            scale.set_major_locator(MaxNLocator(6))
        if one.names:
            turned = sum(map(len, one.names)) > 40
            getattr(axes, f"set_{axis}ticks")(range(len(one.names)), one.names, rotation=30 if turned else 0)
    axes.grid(True, axis="y", color="#eceff2", lw=0.6)
    axes.set_axisbelow(True)


def _power_of_ten(value: float) -> str:
    exponent = round(np.log10(value))
    return {0: "1", 1: "10"}.get(exponent, "10" + f"{exponent}".translate(RAISED))


@dataclass(frozen=True, eq=False)
class Raster:
    """A raster of numbers, or a film of rasters.

    Attributes:
        x, y: The axes, with the ends of the outer pixels.
        frames: Numbers of each frame, shape (frame_count, row_count, column_count), rows upward; NaN: none.
        z: The colors' axis; a logarithmic one has powers of ten as limits.
        colors: Name of the map, see `color_map`.
        error: Numbers smaller than this are grey.
        times: What is said of each frame of a film.
        even: Whether both axes have the same scale.
    """

    x: Axis
    y: Axis
    frames: np.ndarray
    z: Axis
    colors: str = "value"
    error: float = 0.0
    times: Sequence[str] = ()
    even: bool = True

    @property
    def shape(self) -> float:
        """Height over width."""
        if not self.even:
            return 0.7
        (left, right), (low, high) = self.x.around(()), self.y.around(())
        return (high - low) / (right - left)

    def spec(self, name: str) -> dict[str, Any]:
        """Return the picture for the page's script."""
        spec: dict[str, Any] = {"kind": "raster", "id": name, "x": self.x.spec(()), "y": self.y.spec(())}
        spec |= {"z": self.z.spec(self.frames), "map": self.colors, "error": self.error, "shape": self.shape}
        spec |= {"missing": not self.even, "frames": [packed(one) for one in self.frames], "times": list(self.times)}
        return spec

    def static(self, frame: int = 0) -> str:
        """Return one frame for paper, as a data URL."""
        low, high = self.z.around(self.frames)
        left, right = self.x.around(())
        bottom, top = self.y.around(())
        with figure_of(min(2.45, 0.65 + 1.95 * self.shape), bar=True) as (figure, axes):
            values = self.frames[frame]
            shown = np.log10(np.maximum(values, 10.0**low)) if self.z.log else values
            options: dict[str, Any] = {"origin": "lower", "interpolation": "nearest"}
            options |= {"extent": (left, right, bottom, top), "aspect": "equal" if self.even else "auto"}
            image = axes.imshow(shown, cmap=color_map(self.colors), vmin=low, vmax=high, **options)
            if self.error:
                from matplotlib.colors import ListedColormap

                below = np.where(np.abs(values) < self.error, 1.0, np.nan)
                axes.imshow(below, cmap=ListedColormap([BELOW]), **options)
            _dress(axes, self.x, self.y, (), ())
            axes.grid(False)
            bar = color_bar(figure, image, self.z.label)
            if self.z.log:
                marks = np.arange(np.ceil(low), high + 0.5)
                bar.set_ticks(list(marks), labels=[_power_of_ten(10.0**mark) for mark in marks])
            return data_url(figure, "png")
