"""Comparison of a synthetic picture above the axis with a measured one below, as in the paper's Figure 6."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..inputs.arguments import checked
from .picture import Picture, picture_dataset
from .view import PictureView

if TYPE_CHECKING:
    import xarray

LEAST_COMMON = 100  # pixels
QUANTILES = (0.05, 0.95)


@dataclass(frozen=True, eq=False)
class HalfComparison(PictureView):
    """Upper half simulated, lower half measured.

    Attributes:
        intensity: the two halves on the simulation's pixels, rows from the lowest up, shape (ny, nx); mid-grey where
            the measured picture does not reach.
        horizontal: pixel centres along the horizontal [m], shape (nx,).
        vertical: pixel centres along the vertical [m], shape (ny,).
        simulated: the simulated picture's lower half on the common pixels, shape (m,).
        measured: the measured brightness there, scaled to the simulation's, shape (m,).
        correlation: Pearson's r of the two, over the common pixels of the lower half.
        gain: factor applied to the measured brightness.
        offset: offset added after that.
        covered: share of the lower half that the measured picture covers.
    """

    intensity: np.ndarray
    horizontal: np.ndarray
    vertical: np.ndarray
    simulated: np.ndarray
    measured: np.ndarray
    correlation: float
    gain: float
    offset: float
    covered: float

    def to_xarray(self) -> "xarray.Dataset":
        """Return the picture as a dataset with units."""
        return picture_dataset(
            self,
            {},
            {
                "kind": "upper half simulated, lower half measured",
                "correlation": self.correlation,
                "gain": self.gain,
                "offset": self.offset,
                "covered": self.covered,
            },
        )


@checked
def compare_halves(simulated: PictureView, measured: Picture) -> HalfComparison:
    """Combine the upper half of a simulated picture with the lower half of a measured one.

    The measured picture is interpolated to the simulation's pixels, and its brightness scaled such that its 5 % and 95
    % quantiles in the lower half are those of the simulation: exposure and film are not compared. Both pictures should
    have the same knife edge.

    Args:
        simulated: a synthetic picture along x, the axis at height 0.
        measured: a photograph with its scale, see `read_picture`.

    Raises:
        ValueError: the lower halves have fewer than 100 pixels in common, or one of them has a single brightness there.
    """
    from scipy.ndimage import map_coordinates

    below = simulated.vertical < 0.0
    columns = _places(simulated.horizontal, measured.horizontal)
    rows = _places(simulated.vertical[below], measured.vertical)
    inside = np.logical_and.outer(
        (rows >= 0.0) & (rows <= len(measured.vertical) - 1),
        (columns >= 0.0) & (columns <= len(measured.horizontal) - 1),
    )
    if inside.sum() < LEAST_COMMON:
        raise ValueError(
            f"the measured picture has {int(inside.sum())} pixels in common with the simulation's lower half: "
            "check pixel_size and nose"
        )
    drawn = map_coordinates(
        measured.intensity, np.stack(np.meshgrid(rows, columns, indexing="ij")), order=1, mode="nearest"
    )
    ours, theirs = simulated.intensity[below][inside], drawn[inside]
    # A photograph finer than the simulation's pixels is sampled, not averaged: smooth it first if its grain matters.
    low, high = np.quantile(ours, QUANTILES)
    dark, bright = np.quantile(theirs, QUANTILES)
    if np.ptp(ours) == 0.0 or bright <= dark:
        raise ValueError("one of the pictures has a single brightness where they overlap: there is nothing to compare")
    gain = float((high - low) / (bright - dark))
    offset = float(low - gain * dark)
    intensity = np.array(simulated.intensity, dtype=np.float64)
    intensity[below] = np.where(inside, np.clip(gain * drawn + offset, 0.0, 1.0), 0.5)
    return HalfComparison(
        intensity=intensity,
        horizontal=simulated.horizontal,
        vertical=simulated.vertical,
        simulated=ours,
        measured=gain * theirs + offset,
        correlation=float(np.corrcoef(ours, theirs)[0, 1]),
        gain=gain,
        offset=offset,
        covered=float(inside.mean()),
    )


def _places(coordinates: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """Convert coordinates [m] to positions relative to pixel centres [pixels]."""
    return (coordinates - centres[0]) / ((centres[-1] - centres[0]) / (len(centres) - 1))
