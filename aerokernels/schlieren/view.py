"""Base classes of pictures of a bench: plotting, and the error of the brightness."""

from collections.abc import Callable
from functools import cached_property
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


class TracedPicture(PictureView):
    """A picture made of traced light.

    Attributes:
        measure_error: Function that returns the error of each pixel's brightness, shape (ny, nx); None if the light is
            not known.
    """

    measure_error: Callable[[], np.ndarray] | None

    @cached_property
    def error(self) -> np.ndarray:
        """Error of each pixel's brightness before the sensor, shape (ny, nx); NaN if it is not known.

        The light is traced again when it is first read: see picture_error.py.
        """
        return np.full(self.intensity.shape, np.nan) if self.measure_error is None else self.measure_error()
