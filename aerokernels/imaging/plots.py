"""Displacement maps and pictures on matplotlib axes."""

from typing import Any

import numpy as np

from ..display.shown import drawn_on, is_flat, say_flat


def plot_displacement(found: Any, axes: Any = None) -> Any:
    """Draw the size of a displacement [pixels] over the picture."""
    axes = drawn_on(axes)
    size = np.hypot(found.displacement[..., 0], found.displacement[..., 1])
    if is_flat([0.0, *size.ravel()], "pixel"):
        say_flat(axes, "no displacement, but for rounding")
        return axes
    drawn = axes.imshow(size, origin="lower", cmap="viridis")
    axes.figure.colorbar(drawn, ax=axes, label="displacement [pixels]")
    axes.set(xlabel="column [pixels]", ylabel="row [pixels]")
    return axes


def plot_picture(brightness: np.ndarray, axes: Any = None) -> Any:
    """Draw a picture in grey, rows from the lowest up."""
    axes = drawn_on(axes)
    axes.imshow(brightness, origin="lower", cmap="gray")
    axes.set(xlabel="column [pixels]", ylabel="row [pixels]")
    return axes
