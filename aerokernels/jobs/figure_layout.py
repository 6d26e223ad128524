"""Where the panels of a picture lie: beside each other, in inches, with room for what is written around them.

The sizes are known before anything is drawn, so a picture is drawn once. A layout that measures its labels first has to
draw every picture twice, and more often to settle.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 120
LEFT, RIGHT, BOTTOM, TOP = 0.85, 0.2, 0.6, 0.4  # room around a panel for its labels and title [in]
SCALE_ROOM = 0.75  # for the labels of a scale on the right [in]
BAR_GAP, BAR_WIDTH = 0.12, 0.17  # of a colour bar [in]
LEAST_WIDTH = 5.2  # of a picture, so that its title fits [in]


@dataclass(frozen=True)
class Panel:
    """One panel of a picture.

    Attributes:
        width: Of the axes' box [in].
        height: Of the axes' box [in].
        bar: Whether a colour bar stands beside it.
        scale: Whether it has a second scale on the right.
    """

    width: float
    height: float
    bar: bool = False
    scale: bool = False

    @property
    def room(self) -> float:
        """Width with all that is written beside the panel [in]."""
        right = SCALE_ROOM if self.bar or self.scale else RIGHT
        return LEFT + self.width + right + (BAR_GAP + BAR_WIDTH if self.bar else 0.0)


def fitted_panel(ratio: float, width: float, height: float, bar: bool = False) -> Panel:
    """The largest panel of a ratio of height to width that fits in `width` x `height` [in]."""
    return Panel(min(width, height / ratio), min(height, width * ratio), bar)


def panelled_figure(panels: Sequence[Panel]) -> "tuple[Figure, list[tuple[Axes, Axes | None]]]":
    """A figure without window or global state, and for each panel its axes and those of its colour bar, if any."""
    from matplotlib.figure import Figure

    content = sum(panel.room for panel in panels)
    width, height = max(content, LEAST_WIDTH), BOTTOM + max(panel.height for panel in panels) + TOP
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
