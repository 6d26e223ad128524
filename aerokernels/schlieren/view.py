"""What all pictures of a bench have in common: how they are drawn, and what they say of themselves."""

from typing import Any

import numpy as np

from ..shown import drawn_on


class PictureView:
    """A picture with `intensity` and pixel centres `horizontal` and `vertical` [m]."""

    intensity: np.ndarray
    horizontal: np.ndarray
    vertical: np.ndarray

    def plot(self, axes: Any = None) -> Any:
        """Draw the picture in grey over millimetres on matplotlib axes; returns the axes."""
        axes = drawn_on(axes)
        ends = []
        for centres in (self.horizontal, self.vertical):
            half = 0.5 * (centres[-1] - centres[0]) / max(len(centres) - 1, 1)
            ends += [1e3 * (centres[0] - half), 1e3 * (centres[-1] + half)]
        axes.imshow(self.intensity, origin="lower", extent=ends, cmap="gray", vmin=0.0, vmax=1.0)
        axes.set(xlabel="horizontal [mm]", ylabel="vertical [mm]")
        return axes
