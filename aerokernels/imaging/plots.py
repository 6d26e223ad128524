"""Displacement maps and pictures on matplotlib axes."""

from typing import Any

import numpy as np


def new_axes(axes: Any = None) -> Any:
    """The axes given, or those of a new figure."""
    if axes is not None:
        return axes
    from matplotlib import pyplot

    return pyplot.subplots(layout="constrained")[1]


def plot_displacement(found: Any, axes: Any = None) -> Any:
    """The size of a displacement [pixels] over the picture."""
    axes = new_axes(axes)
    size = np.hypot(found.displacement[..., 0], found.displacement[..., 1])
    drawn = axes.imshow(size, origin="lower", cmap="viridis")
    axes.figure.colorbar(drawn, ax=axes, label="displacement [pixels]")
    axes.set(xlabel="column [pixels]", ylabel="row [pixels]")
    return axes


def plot_picture(brightness: np.ndarray, axes: Any = None) -> Any:
    """A picture in grey, rows from the lowest up."""
    axes = new_axes(axes)
    axes.imshow(brightness, origin="lower", cmap="gray")
    axes.set(xlabel="column [pixels]", ylabel="row [pixels]")
    return axes
