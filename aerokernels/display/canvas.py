"""Matplotlib figures without windows or global state: colors, the page's style, and figures as data."""

import base64
import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, SOFT, BLUE, ORANGE, GREY, BELOW = "#1b2430", "#5a6573", "#1f5fa8", "#b4500f", "#8a94a0", "#c9ced4"
COLORS = {"one": BLUE, "two": ORANGE, "twosolid": ORANGE, "plain": GREY, "free": GREY}
# Colors of ordered lines, dark to light.
SHADES = ("#440154", "#46327e", "#375b8d", "#277e8e", "#1fa188", "#48c16e", "#9bd93c")
COLORS |= {f"c{k}": color for k, color in enumerate(SHADES)}
DASHES = {"two": "--", "free": ":"}
DELAY = ["#08305f", "#2d6fae", "#93c1e0", "#f6f5f1", "#f0b587", "#c05a22", "#6b2204"]
STYLE = {
    "font.size": 8.5,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.labelsize": 8.5,
    "legend.frameon": False,
    "legend.fontsize": 7.5,
    "svg.fonttype": "none",
    "svg.hashsalt": "aerokernels",
}
WIDE = {**STYLE, "font.size": 10.0, "axes.titlesize": 11.0, "axes.titleweight": "bold", "axes.labelsize": 10.0}
# Matplotlib's parameters that are no matter of drawing.
NOT_DRAWN = "backend", "interactive", "toolbar", "timezone", "webagg"
WIDTH = 3.8  # of a static figure [in], half a page of paper
DPI = 150


def color_map(name: str) -> Any:
    """Return Matplotlib's map: "density", "delay" (zero is white), "light" or "value"."""
    from matplotlib import colormaps
    from matplotlib.colors import LinearSegmentedColormap

    if name == "delay":
        return LinearSegmentedColormap.from_list("delay", DELAY)
    return colormaps[{"density": "viridis", "light": "inferno", "value": "cividis"}[name]]


def color_tables(names: set[str]) -> dict[str, list[str]]:
    """Return 64 colors of each map, for the page's script."""
    shades = {name: color_map(name)(np.linspace(0.0, 1.0, 64), bytes=True)[:, :3] for name in sorted(names)}
    return {name: [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in rows] for name, rows in shades.items()}


@contextmanager
def house_style(style: Mapping[Any, Any] | None = None) -> Iterator[None]:
    """Draw the block in Matplotlib's own defaults and `style`, whatever a user's matplotlibrc says.

    One with `text.usetex` needs LaTeX, which reads "%", "#" and "_" in a name as commands. Nor is a text read as a
    formula: labels and names of files may hold "$".
    """
    from matplotlib import rc_context, rcParamsDefault

    own = {name: value for name, value in rcParamsDefault.items() if not name.startswith(NOT_DRAWN)}
    with rc_context({**own, "text.parse_math": False, **(style or {})}):
        yield


@contextmanager
def figure_of(height: float, bar: bool = False) -> "Iterator[tuple[Figure, Axes]]":
    """Make a static figure in the page's style, and its axes.

    Args:
        height: Its height [in]; the width is that of all.
        bar: Whether there is room on the right for a color bar.
    """
    from matplotlib.figure import Figure

    left, bottom, top, right = 0.62, 0.48, 0.1, 0.8 if bar else 0.12  # room for labels [in]
    with house_style(STYLE):
        figure = Figure(figsize=(WIDTH, height), dpi=DPI)
        size = 1.0 - (left + right) / WIDTH, 1.0 - (bottom + top) / height
        yield figure, figure.add_axes((left / WIDTH, bottom / height, *size))


def make_room(figure: "Figure", axes: "Axes") -> None:
    """Move the left side of axes so far that their longest labels are inside the figure."""
    whole = axes.get_tightbbox()
    assert whole is not None  # the axes are visible
    lacking = max(0.04 - float(whole.x0) / figure.dpi, 0.0) / WIDTH
    box = axes.get_position()
    axes.set_position((box.x0 + lacking, box.y0, box.width - lacking, box.height))


def color_bar(figure: "Figure", image: Any, label: str) -> Any:
    """Draw a color bar right of a figure's only axes."""
    axes = image.axes
    axes.apply_aspect()
    box = axes.get_position()
    bar = figure.colorbar(image, cax=figure.add_axes((box.x1 + 0.03, box.y0, 0.035, box.height)), label=label)
    bar.outline.set_linewidth(0.5)
    return bar


def data_url(figure: "Figure", kind: str) -> str:
    """Return a figure as a data URL: "svg" for lines, "png" for rasters."""
    sink = io.BytesIO()
    metadata = {"Date": None} if kind == "svg" else {"Software": None}
    figure.savefig(sink, format=kind, metadata=metadata)
    mime = "image/svg+xml" if kind == "svg" else "image/png"
    return f"data:{mime};base64,{base64.b64encode(sink.getvalue()).decode('ascii')}"


@contextmanager
def styled_figure(width: float, height: float, dpi: int = 120, style: Any = None) -> "Iterator[Figure]":
    """Yield a figure of `width` x `height` [in] without window or global state; the block draws in `style` or WIDE."""
    from matplotlib.figure import Figure

    with house_style(style or WIDE):
        yield Figure(figsize=(width, height), layout="constrained", dpi=dpi)


def png(figure: "Figure") -> bytes:
    """Return `figure` as the bytes of a PNG file."""
    buffer = io.BytesIO()
    with house_style():
        figure.savefig(buffer, format="png", pil_kwargs={"compress_level": 4})
    return buffer.getvalue()
