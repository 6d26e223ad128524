"""Background of a BOS bench: random dots, sampled finer than a camera's pixels."""

from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import checked
from .camera import Camera

# Samples of the pattern per pixel, along each side.
OVERSAMPLING = 2
# Pixels of a picture per camera pixel, along each side, from which on they are treated as squares.
FINE = 1.5


@dataclass(frozen=True, eq=False)
class Background:
    """A picture in the plane of the scene.

    Attributes:
        brightness: Brightness 0 to 1, shape (rows, columns), axes [y, x]; its border is continued outside.
        sample: Spacing of its samples in pixels of the camera's picture.
        squares: Whether samples are squares of uniform brightness, over which a pixel of the camera takes the exact
            mean; otherwise they are interpolated by a cubic spline.
    """

    brightness: np.ndarray
    sample: float
    squares: bool = False

    @classmethod
    def of_scene(cls, brightness, pixel: float, camera: Camera) -> "Background":
        """Make the background of a picture with pixels of `pixel` [m] in the scene's plane, centred on the axis."""
        brightness = np.asarray(brightness, dtype=np.float64)
        if brightness.ndim != 2 or min(brightness.shape) < 2 or not np.isfinite(brightness).all():
            raise ValueError(f"a background must be a finite array [y, x], got shape {brightness.shape}")
        if not (np.isfinite(pixel) and pixel > 0.0):
            raise ValueError(f"the background's pixel must be a positive length [m], got {pixel!r}")
        sample = float(pixel) / camera.scene_pixel
        return cls(brightness, sample, squares=sample * FINE <= 1.0)

    def prepared(self) -> np.ndarray:
        """Return spline coefficients of the brightness averaged over a camera pixel; for squares, cumulative sums."""
        if self.squares:
            padded = np.pad(self.brightness, self._edge, mode="edge")
            return np.pad(padded.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))
        from scipy.ndimage import correlate1d, spline_filter

        box = _box(1.0 / self.sample)
        smooth = self.brightness
        for axis in (0, 1):
            smooth = correlate1d(smooth, box, axis=axis, mode="nearest")
        return np.asarray(spline_filter(smooth, order=3, mode="nearest"))

    def seen(self, prepared: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Return the brightness at positions relative to the middle [pixels], arrays of one shape."""
        from scipy.ndimage import map_coordinates

        darkest, brightest = self.brightness.min(), self.brightness.max()
        if self.squares:
            return np.clip(self._mean(prepared, row, column), darkest, brightest)
        place = [
            values / self.sample + 0.5 * (count - 1)
            for values, count in zip((row, column), prepared.shape, strict=True)
        ]
        found = map_coordinates(prepared, place, order=3, mode="nearest", prefilter=False)
        # A spline overshoots near hard edges.
        return np.asarray(np.clip(found, darkest, brightest, out=found))

    @property
    def _edge(self) -> int:
        """Samples by which squares are continued beyond the border, for camera pixels outside."""
        return int(np.ceil(1.0 / self.sample)) + 1

    def _mean(self, sums: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Return the mean of the squares over camera pixels at positions from the middle [pixels]."""
        from scipy.ndimage import map_coordinates

        half = 0.5 / self.sample
        middle = [
            np.clip(values / self.sample + 0.5 * (count - 1), half, count - 1 - half)
            for values, count in zip((row, column), sums.shape, strict=True)
        ]
        total = np.zeros(np.shape(row))
        for up in (-1.0, 1.0):
            for along in (-1.0, 1.0):
                corner = [middle[0] + up * half, middle[1] + along * half]
                total += up * along * map_coordinates(sums, corner, order=1, mode="nearest")
        return np.asarray(total * self.sample**2)


@checked
@dataclass(frozen=True)
class DotPattern:
    """Random bright Gaussian dots on black.

    Attributes:
        diameter: Diameter of a dot, to 1 / e^2 of its brightness [pixels of the picture].
        density: Dots per pixel of the picture.
        seed: Seed of the random pattern.

    Raises:
        ValueError: A number is out of range.
    """

    diameter: float = 2.5
    density: float = 0.12
    seed: int = 0

    def __post_init__(self):
        """Check the values."""
        for name in ("diameter", "density"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(f"{name} = {getattr(self, name)!r}: give a positive number")
        if self.diameter < 1.0:
            raise ValueError(f"diameter = {self.diameter:g} pixels: dots below one pixel are not resolved")

    def background(self, shape: tuple[int, int], margin: float) -> Background:
        """Return the pattern for a picture of (rows, columns) with a margin around it [pixels]."""
        sample = 1.0 / OVERSAMPLING
        rows, columns = (int(np.ceil((count + 2.0 * margin) / sample)) for count in shape)
        draw = np.random.default_rng(self.seed)
        count = max(1, int(round(self.density * rows * columns * sample**2)))
        y, x = draw.random(count) * rows, draw.random(count) * columns
        radius = 0.5 * self.diameter / sample
        reach = int(np.ceil(2.0 * radius))
        covered = np.zeros(rows * columns)  # -log(1 - brightness): overlapping dots do not exceed white
        i, j = np.floor(y).astype(int), np.floor(x).astype(int)
        for di in range(-reach, reach + 1):
            for dj in range(-reach, reach + 1):
                row, column = i + di, j + dj
                inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
                square = (row - y)[inside] ** 2 + (column - x)[inside] ** 2
                light = -np.log1p(-0.98 * np.exp(-2.0 * square / radius**2))
                covered += np.bincount((row * columns + column)[inside], weights=light, minlength=covered.size)
        return Background(1.0 - np.exp(-covered.reshape(rows, columns)), sample)


def _box(width: float) -> np.ndarray:
    """Return the weights of a mean over a width [samples], odd in number: the end samples count by their share."""
    half = int(np.ceil(0.5 * width - 0.5))
    place = np.arange(-half, half + 1)
    share = np.clip(0.5 * width - np.abs(place) + 0.5, 0.0, 1.0)
    return np.asarray(share / share.sum())
