"""Reports as self-contained HTML pages, by the template templates/report.html, and the style of their figures.

Panels are sized in inches, with fixed room for titles and labels, before anything is drawn, so that a figure is drawn
once. A layout that measures its labels has to draw every figure twice or more.
"""

import base64
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from aerokernels.display.plain_text import plain
from aerokernels.display.shown import NOTHING
from aerokernels.process.foreign_files import fault_text
from aerokernels.process.opened import OPENED

if TYPE_CHECKING:
    import jinja2
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Picture = tuple[str, str, Callable]  # name, caption, a function that draws it
Drawn = tuple[str, str, bytes | str]  # name, caption, a PNG file or the reason why there is none


def page(
    title: str,
    lead: str,
    sections: Iterable[Mapping[str, Any]],
    *,
    cards: Iterable[tuple[str, str]] = (),
    remarks: Iterable[tuple[str, str]] = (),
    alarm: bool = False,
) -> str:
    """Return a complete HTML document; all texts are escaped.

    Args:
        title: Its heading.
        lead: The line below it.
        sections: Each a mapping with "title" and any of: "paragraphs", texts; "figures", see `drawn`; "rows", pairs of
            name and value; "table", columns and rows; "bullets", lines; "text", preformatted; "film", see the template.
        cards: The most important numbers, as pairs of words and value.
        remarks: What a reader must know besides the numbers, as pairs of heading and text.
        alarm: Whether the numbers are not meaningful.
    """
    return OPENED.once("template of reports", _template).render(
        title=title, lead=lead, sections=list(sections), cards=list(cards), remarks=list(remarks), alarm=alarm
    )


def drawn(pictures: Iterable[Picture]) -> list[Drawn]:
    """Draw figures; one that cannot be drawn is replaced by the reason, since a report needs no figure."""
    figures: list[Drawn] = []
    for name, caption, draw in pictures:
        try:
            with house_style():
                figures.append((name, caption, png(draw())))
        except Exception as fault:
            figures.append((name, caption, fault_text(fault, None)))
    return figures


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> dict[str, Any]:
    """Return a section with a table."""
    return {"title": title, "table": (columns, list(rows))}


def embedded(data: bytes) -> str:
    """Return a PNG file as a data URL."""
    return f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"


def _template() -> "jinja2.Template":
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("aerokernels.jobs"),
        autoescape=True,
        finalize=lambda value: plain(value) if type(value) is str else value,
    )
    environment.globals["nothing"] = NOTHING
    # The width is in the head of a PNG file; a wide picture has two panels and can be scrolled on a phone.
    environment.filters |= {"embedded": embedded, "is_wide": lambda data: int.from_bytes(data[16:20], "big") > 850}
    return environment.get_template("report.html")


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
