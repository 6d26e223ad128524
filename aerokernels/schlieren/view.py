"""Base class of all pictures of a bench: plotting."""

from typing import Any

import numpy as np

from ..display.shown import drawn_on, extent_of


class PictureView:
    """A picture with its scale.

    Attributes:
        intensity: Brightness, 0 black to 1 white, rows from the lowest up, shape (ny, nx).
        horizontal: Pixel centres along the horizontal [m], shape (nx,).
        vertical: Pixel centres along the vertical [m], shape (ny,).
    """

    intensity: np.ndarray
    horizontal: np.ndarray
    vertical: np.ndarray

    def plot(self, axes: Any = None) -> Any:
        """Draw the picture in grey over millimetres on matplotlib axes; return the axes."""
        axes = drawn_on(axes)
        ends = extent_of(1e3 * self.horizontal, 1e3 * self.vertical)
        axes.imshow(self.intensity, origin="lower", extent=ends, cmap="gray", vmin=0.0, vmax=1.0)
        axes.set(xlabel="horizontal [mm]", ylabel="vertical [mm]")
        return axes
