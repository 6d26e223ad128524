"""Draw schlieren pictures, shadowgraphs and interferograms as figures with their scale."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.quantities import Quantity
from aerokernels.display.shown import extent_of
from aerokernels.jobs.figure_layout import styled_figure
from aerokernels.jobs.plots import ACCENT
from aerokernels.schlieren import HalfComparison, ShockAngle
from aerokernels.schlieren.picture import PictureView

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def _axes(picture: PictureView, count: int) -> "tuple[Figure, list[Axes]]":
    width, height = (float(np.ptp(side)) for side in (picture.horizontal, picture.vertical))
    ratio = min(max(height / width, 0.3), 3.0)
    across = 4.2 if count > 1 else 6.4
    with styled_figure(across * count, across * ratio + 0.9) as figure:
        axes = figure.subplots(1, count, squeeze=False, sharey=True)[0]
    return figure, list(axes)


def _draw(axes: "Axes", picture: PictureView) -> None:
    extent = extent_of(1e3 * picture.horizontal, 1e3 * picture.vertical)
    axes.imshow(picture.intensity, origin="lower", extent=extent, cmap="gray", vmin=0.0, vmax=1.0, interpolation="none")
    axes.set_xlabel(_axis_label(getattr(picture, "right", None), "z"))


def _axis_label(direction: np.ndarray | None, default: str) -> str:
    """Return the label of a picture's axis: x, y or z where it points along one of them, else words."""
    if direction is None:
        return f"{default} [mm]"
    axis = int(np.argmax(np.abs(direction)))
    if abs(direction[axis]) < 1.0 - 1e-9:
        return "across the view [mm]"
    return f"{'-' if direction[axis] < 0.0 else ''}{'xyz'[axis]} [mm]"


def pictures_figure(pictures: Mapping[str, Any], shock: ShockAngle | None = None) -> "Figure":
    """Draw pictures side by side by kind, and into the schlieren picture the shock that was measured on it."""
    figure, panels = _axes(next(iter(pictures.values())), len(pictures))
    for axes, (kind, picture) in zip(panels, pictures.items(), strict=True):
        _draw(axes, picture)
        axes.set_title(_title(kind, picture))
        if kind == "schlieren" and shock is not None:
            _draw_shock(axes, shock)
    panels[0].set_ylabel(_axis_label(next(iter(pictures.values())).up, "y"))
    return figure


def _draw_shock(axes: "Axes", shock: ShockAngle) -> None:
    along = np.unique(shock.points[:, 0])
    height = np.polynomial.polynomial.polyval(along - shock.place, shock.curve)
    angle, error = np.degrees(shock.angle), 2.0 * np.degrees(shock.standard_error)
    label = f"shock {Quantity(float(angle), float(error))}° at {1e3 * shock.place:.1f} mm"
    for sign, words in ((1.0, label), (-1.0, None)):
        if (sign * shock.points[:, 1] > 0.0).any():
            axes.plot(1e3 * along, sign * 1e3 * height, color=ACCENT, linewidth=1.2, linestyle="--", label=words)
    axes.legend(loc="lower right", fontsize=8, labelcolor="white", frameon=True, facecolor="#1d2630", framealpha=0.8)


def comparison_figure(comparison: HalfComparison) -> "Figure":
    """Draw the simulated picture above and the measured picture below."""
    figure, (axes,) = _axes(comparison, 1)
    _draw(axes, comparison)
    axes.axhline(0.0, color=ACCENT, linewidth=0.8)
    axes.set(ylabel="y [mm]", title=f"Above simulated, below measured: r = {comparison.correlation:.3f}")
    return figure


def _title(kind: str, picture: Any) -> str:
    if kind == "schlieren":
        edge = picture.knife_edge
        words = f"{edge} edge" if isinstance(edge, str) else f"edge that brightens toward {np.degrees(edge):.0f}°"
        return f"Schlieren, {words}"
    if kind == "shadowgraph":
        return f"Shadowgraph, screen at {picture.distance:g} m"
    spacing = picture.fringe_spacing
    return "Interferogram, infinite fringe" if spacing is None else f"Interferogram, fringes of {1e3 * spacing:g} mm"
