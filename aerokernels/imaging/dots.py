"""The background of a BOS bench: dots at random, drawn finer than a camera's pixels."""

from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import checked
from .camera import Camera

# Samples of the pattern to a pixel, along each side.
OVERSAMPLING = 2
# Pixels of a picture to one of the camera, along each side, from which on they are squares that are summed up.
FINE = 1.5


@dataclass(frozen=True, eq=False)
class Background:
    """A picture that stands in the plane of the scene.

    Attributes:
        brightness: 0 to 1, shape (rows, columns), axes [y, x]; continued outside by its border.
        sample: Distance of its samples in pixels of the camera's picture.
        squares: Whether samples are squares of even brightness, of which a pixel of the camera takes the exact mean;
            otherwise they lie on a cubic spline.
    """

    brightness: np.ndarray
    sample: float
    squares: bool = False

    @classmethod
    def of_scene(cls, brightness, pixel: float, camera: Camera) -> "Background":
        """A picture whose pixels have the side `pixel` [m] in the plane of the scene, centred on the camera's axis."""
        brightness = np.asarray(brightness, dtype=np.float64)
        if brightness.ndim != 2 or min(brightness.shape) < 2 or not np.isfinite(brightness).all():
            raise ValueError(f"a background must be a finite array [y, x], got shape {brightness.shape}")
        if not (np.isfinite(pixel) and pixel > 0.0):
            raise ValueError(f"the background's pixel must be a positive length [m], got {pixel!r}")
        sample = float(pixel) / camera.scene_pixel
        return cls(brightness, sample, squares=sample * FINE <= 1.0)

    def prepared(self) -> np.ndarray:
        """Coefficients of the cubic spline, of the brightness averaged over a pixel of the camera; sums of squares."""
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
        """Brightness at places from the middle [pixels], arrays of one shape."""
        from scipy.ndimage import map_coordinates

        darkest, brightest = self.brightness.min(), self.brightness.max()
        if self.squares:
            return np.clip(self._mean(prepared, row, column), darkest, brightest)
        place = [
            values / self.sample + 0.5 * (count - 1)
            for values, count in zip((row, column), prepared.shape, strict=True)
        ]
        found = map_coordinates(prepared, place, order=3, mode="nearest", prefilter=False)
        # A spline overshoots beside hard edges.
        return np.asarray(np.clip(found, darkest, brightest, out=found))

    @property
    def _edge(self) -> int:
        """Samples by which squares go on beyond the border: a pixel of the camera that lies outside sees these."""
        return int(np.ceil(1.0 / self.sample)) + 1

    def _mean(self, sums: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Mean of the squares over the camera's pixels about places from the middle [pixels], by sums up to corners."""
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
    """Bright Gaussian dots at random on black.

    Attributes:
        diameter: Diameter of a dot, to 1 / e^2 of its brightness [pixels of the picture].
        density: Dots to a pixel of the picture.
        seed: Which pattern.

    Raises:
        ValueError: A number that makes no sense.
    """

    diameter: float = 2.5
    density: float = 0.12
    seed: int = 0

    def __post_init__(self):
        """Check."""
        for name in ("diameter", "density"):
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0):
                raise ValueError(f"{name} = {getattr(self, name)!r}: give a positive number")
        if self.diameter < 1.0:
            raise ValueError(f"diameter = {self.diameter:g} pixels: dots below one pixel are not resolved")

    def background(self, shape: tuple[int, int], margin: float) -> Background:
        """The pattern over a picture of (rows, columns) and a margin around it [pixels]."""
        sample = 1.0 / OVERSAMPLING
        rows, columns = (int(np.ceil((count + 2.0 * margin) / sample)) for count in shape)
        draw = np.random.default_rng(self.seed)
        count = max(1, int(round(self.density * rows * columns * sample**2)))
        y, x = draw.random(count) * rows, draw.random(count) * columns
        radius = 0.5 * self.diameter / sample
        reach = int(np.ceil(2.0 * radius))
        covered = np.zeros(rows * columns)  # -log of what is dark: dots that overlap do not add up beyond white
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
    """Weights of the mean over a width [samples], odd in number: the ends count by their share."""
    half = int(np.ceil(0.5 * width - 0.5))
    place = np.arange(-half, half + 1)
    share = np.clip(0.5 * width - np.abs(place) + 0.5, 0.0, 1.0)
    return np.asarray(share / share.sum())
