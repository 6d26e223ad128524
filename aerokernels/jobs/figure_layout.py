"""Style and layout of figures: panels side by side, sized in inches, with fixed room for titles and labels.

The sizes are fixed before anything is drawn, so that a figure is drawn once. A layout that measures its labels has to
draw every figure twice or more.
"""

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

STYLE: dict[Any, Any] = {
    "font.size": 10.0,
    "axes.titlesize": 11.0,
    "axes.titleweight": "bold",
    "axes.edgecolor": "#8a94a0",
    "axes.linewidth": 0.8,
    "axes.grid": False,
    "grid.color": "#e3e7eb",
    "xtick.color": "#4a5460",
    "ytick.color": "#4a5460",
    "legend.frameon": False,
    "figure.facecolor": "white",
}
# Matplotlib's parameters that are no matter of drawing.
NOT_DRAWN = "backend", "interactive", "toolbar", "timezone", "webagg"
DPI = 120
LEFT, RIGHT, BOTTOM, TOP = 0.85, 0.2, 0.6, 0.4  # room around a panel for its labels and title [in]
SCALE_ROOM = 0.75  # room for the labels of a scale on the right [in]
BAR_GAP, BAR_WIDTH = 0.12, 0.17  # gap before and width of a colour bar [in]
LEAST_WIDTH = 5.2  # least width of a figure, so that its title fits [in]


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


def plain_decades(axes: "Axes") -> None:
    """Label logarithmic axes by plain numbers: by default Matplotlib writes them as formulas."""
    from matplotlib.ticker import LogFormatter

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter(LogFormatter())
            axis.set_minor_formatter(LogFormatter())


@dataclass(frozen=True)
class Panel:
    """One panel of a figure."""

    width: float  # width of the axes' box [in]
    height: float  # height of the axes' box [in]
    bar: bool = False  # whether the panel has a colour bar on the right
    scale: bool = False  # whether the panel has a second scale on the right

    @property
    def room(self) -> float:
        """Width of the panel with its labels, colour bar and second scale [in]."""
        right = SCALE_ROOM if self.bar or self.scale else RIGHT
        return LEFT + self.width + right + (BAR_GAP + BAR_WIDTH if self.bar else 0.0)


def fitted_panel(ratio: float, width: float, height: float, bar: bool = False) -> Panel:
    """Return the largest panel of `ratio`, height over width, that fits in `width` x `height` [in]."""
    return Panel(min(width, height / ratio), min(height, width * ratio), bar)


def panelled_figure(*panels: Panel) -> "tuple[Figure, list[tuple[Axes, Axes | None]]]":
    """Make a figure without window or global state; return it and each panel's axes and colour bar axes (or None)."""
    from matplotlib.figure import Figure

    content = sum(panel.room for panel in panels)
    width, height = max(content, LEAST_WIDTH), BOTTOM + max(panel.height for panel in panels) + TOP
    with house_style(STYLE):
        figure = Figure(figsize=(width, height), dpi=DPI)
        made: list[tuple[Axes, Axes | None]] = []
        start = 0.5 * (width - content)
        for panel in panels:
            left = start + LEFT
            share = BOTTOM / height, panel.height / height
            axes = figure.add_axes((left / width, share[0], panel.width / width, share[1]))
            bar = None
            if panel.bar:
                left += panel.width + BAR_GAP
                bar = figure.add_axes((left / width, share[0], BAR_WIDTH / width, share[1]))
            made.append((axes, bar))
            start += panel.room
    return figure, made


@contextmanager
def styled_figure(width: float, height: float, dpi: int = DPI, style: Any = None) -> "Iterator[Figure]":
    """Yield a figure of `width` x `height` [in] without window or global state; the block draws in `style` or STYLE."""
    from matplotlib.figure import Figure

    with house_style(style or STYLE):
        yield Figure(figsize=(width, height), layout="constrained", dpi=dpi)


def png(figure: "Figure") -> bytes:
    """Return `figure` as the bytes of a PNG file."""
    buffer = io.BytesIO()
    with house_style():
        figure.savefig(buffer, format="png", pil_kwargs={"compress_level": 4})
    return buffer.getvalue()
