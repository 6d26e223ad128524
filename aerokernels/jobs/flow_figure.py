"""Draw a flow's density in the optical frame, with its body and axes."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from aerokernels.files.writing import replacing
from aerokernels.flow import DensityField
from aerokernels.jobs.dataset import density_cells
from aerokernels.jobs.figure_layout import house_style, styled_figure
from aerokernels.jobs.plots import BODY_COLOUR, density_limits
from aerokernels.medium import SolidBody

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def flow_figure(flow: DensityField, title: str = "") -> "Figure":
    """Draw the density in the plane x = 0, z to the right and y (or r) upward, and the optical axis as an arrow."""
    density, y, z = density_cells(flow)
    ratio = float(np.clip(np.ptp(y) / np.ptp(z), 0.15, 1.5))
    with styled_figure(7.2, 1.6 + 5.2 * ratio) as figure:
        axes = figure.subplots()
        low, high = density_limits(density)
        shown = axes.pcolormesh(
            1e3 * z, 1e3 * y, density, cmap="viridis", vmin=low, vmax=high, shading="flat", rasterized=True
        )
        figure.colorbar(shown, ax=axes, label="density [kg/m3]").outline.set_visible(False)
        if flow.body is not None:
            lines = flow.body.outlines() if isinstance(flow.body, SolidBody) else [flow.body.profile]
            for y_and_z in lines:
                axes.fill(1e3 * y_and_z[:, 1], 1e3 * y_and_z[:, 0], color=BODY_COLOUR)
        axes.set_aspect("equal")
        axes.set_xlim(1e3 * float(np.min(z)), 1e3 * float(np.max(z)))
        axes.set_ylim(1e3 * float(np.min(y)), 1e3 * float(np.max(y)))
        axes.set_xlabel("z [mm], the optical axis")
        axes.set_ylabel(f"{'r' if flow.geometry == 'axisymmetric' else 'y'} [mm]")
        axes.annotate(
            "direction of view", (0.62, 1.04), (0.38, 1.04), xycoords="axes fraction", textcoords="axes fraction",
            arrowprops={"arrowstyle": "->", "color": "#4a5460"}, color="#4a5460", va="center", fontsize=8.0,
        )  # fmt: skip
        if title:
            figure.suptitle(title, fontsize=10.0)
    return figure


def save_flow_figure(flow: DensityField, place: Path, title: str = "") -> None:
    """Write the figure to a file, whose name's extension determines the format.

    Raises:
        ValueError: No format has this extension.
        OutputError: The disk is full; an earlier file is as it was.
    """
    figure = flow_figure(flow, title)
    known = figure.canvas.get_supported_filetypes()
    if place.suffix[1:].lower() not in known:
        raise ValueError(f"{place}: {place.suffix!r} is not a picture format: use .png, .pdf or .svg")
    place.parent.mkdir(parents=True, exist_ok=True)
    with replacing(place) as (draft,), house_style():
        figure.savefig(draft)
