"""Pupils made of pixels: a mask of any shape and apodisation, and the rectangle, which is a single pixel."""

from abc import abstractmethod
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..display.shown import shown
from ..inputs.arguments import GREAT, SMALL, checked
from ..inputs.checks import check_positive
from ..inputs.kinds import are_numbers
from .base import Pupil
from .square_map import PIXELS, SquareMap, cumulative


class _Pixels(Pupil):
    """Base class of pupils whose transmission is constant in each pixel of a grid about the centre."""

    @property
    @abstractmethod
    def _weights(self) -> np.ndarray:
        """Transmission of each pixel, shape (rows, columns)."""

    @property
    @abstractmethod
    def _size(self) -> tuple[float, float]:
        """Width and height of a pixel [m]."""

    @property
    def half_extent(self) -> tuple[float, float]:
        """Half the width and half the height of the whole grid of pixels [m]."""
        rows, columns = self._weights.shape
        width, height = self._size
        return 0.5 * columns * width, 0.5 * rows * height

    @property
    def reach(self) -> float:
        """Distance of the corners from the centre [m]."""
        return float(np.hypot(*self.half_extent))

    @property
    def area(self) -> float:
        """Integral of the transmission [m2]."""
        width, height = self._size
        return float(self._weights.sum() * width * height)

    @property
    def _lit_area(self) -> float:
        width, height = self._size
        return float(np.count_nonzero(self._weights) * width * height)

    @cached_property
    def square_map(self) -> SquareMap:
        """Map of the unit square onto the pupil, in units of `reach`."""
        rows, columns = self._weights.shape
        half, size = np.array(self.half_extent) / self.reach, np.array(self._size) / self.reach
        shares = cumulative(self._weights.sum(axis=1)), cumulative(self._weights)
        return SquareMap(PIXELS, rows, columns, np.concatenate([-half, size, *(part.ravel() for part in shares)]))

    def coverage(self, x_edges: np.ndarray, y_edges: np.ndarray, power: int = 1) -> np.ndarray:
        """Return the exact mean of a power of the transmission in each grid cell: see `Pupil.coverage`."""
        along_x, along_y = (
            _overlap(np.asarray(edges), extent, size, count)
            for edges, extent, size, count in zip(
                (x_edges, y_edges), self.half_extent, self._size, self._weights.shape[::-1], strict=True
            )
        )
        return np.asarray(along_y @ self._weights**power @ along_x.T)

    def transmission(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the transmission of the pixel that contains each point: see `Pupil.transmission`."""
        places, there = [], np.array(True)
        for value, extent, size, count in zip(
            (x, y), self.half_extent, self._size, self._weights.shape[::-1], strict=True
        ):
            value = np.asarray(value, dtype=np.float64)
            there = there & (np.abs(value) <= extent * (1.0 + 1e-12))
            places.append(np.clip(np.floor((value + extent) / size).astype(int), 0, count - 1))
        return np.where(there, self._weights[places[1], places[0]], 0.0)

    def _gauss(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        """Return a product rule in each pixel or, if there are too many pixels, one mapped from the unit square."""
        row, column = np.nonzero(self._weights)
        order = max(1, round(np.sqrt(count / len(row))))
        if len(row) > 2 * count:
            order = max(1, round(np.sqrt(count)))
        node, weight = np.polynomial.legendre.leggauss(order)
        u, v = (axis.ravel() for axis in np.meshgrid(0.5 * (node + 1.0), 0.5 * (node + 1.0)))
        share = 0.25 * np.outer(weight, weight).ravel()
        if len(row) > 2 * count:
            return self.square_map.points(np.stack([u, v], axis=1)), share
        half, size = np.array(self.half_extent), np.array(self._size)
        corner = np.stack([column, row], axis=1)[:, None]
        points = (corner + np.stack([u, v], axis=1)) * size - half
        of_pixel = self._weights[row, column] / self._weights.sum()
        return points.reshape(-1, 2) / self.reach, np.outer(of_pixel, share).ravel()


def _overlap(edges: np.ndarray, extent: float, size: float, count: int) -> np.ndarray:
    """Return the fraction of each cell between `edges` that each of `count` pixels covers, shape (cells, count)."""
    pixel = -extent + size * np.arange(count + 1)
    high = np.minimum(edges[1:, None], pixel[None, 1:])
    low = np.maximum(edges[:-1, None], pixel[None, :-1])
    both = high - low
    # Edges that coincide overlap by rounding errors, which are not counted.
    return np.where(both > 1e-14 * extent, both, 0.0) / (edges[1:] - edges[:-1])[:, None]


@checked
@shown
@dataclass(frozen=True, eq=False)
class Rectangle(_Pixels):
    """A flat rectangular pupil.

    Attributes:
        width: Extent along its first axis [m]: along x if the normal is +z.
        height: Extent along its second axis [m].
        center: Centre [m], shape (3,).
        normal: Direction in which the pupil looks (made a unit vector), shape (3,).

    Raises:
        ValueError: A side that is not positive, or a centre or normal that is not three finite numbers.
    """

    width: float
    height: float
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    normal: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    if TYPE_CHECKING:  # arrays are made of what is given

        def __init__(  # noqa: D107
            self, width: float, height: float, center: ArrayLike = (0, 0, 0), normal: ArrayLike = (0, 0, 1)
        ) -> None: ...

    def __post_init__(self):
        """Check and normalise."""
        check_positive(self.width, "width of a Rectangle")
        check_positive(self.height, "height of a Rectangle")
        self._check_place()

    @property
    def half_extent(self) -> tuple[float, float]:
        """Half the width and half the height [m]."""
        return 0.5 * float(self.width), 0.5 * float(self.height)

    @property
    def _weights(self) -> np.ndarray:
        return np.array([[1.0]])

    @property
    def _size(self) -> tuple[float, float]:
        return float(self.width), float(self.height)


@checked
@shown
@dataclass(frozen=True, eq=False)
class Mask(_Pixels):
    """A flat pupil of any shape and transmission, constant in each of its pixels.

    Attributes:
        weights: Transmission of the amplitude, not negative, of any scale, shape (row count, column count): rows along
            the pupil's second axis (y if the normal is +z), columns along its first, both ascending.
        pixel: Side of a pixel [m]; two numbers for width and height.
        center: The middle of the array [m], shape (3,).
        normal: Direction in which the pupil looks (made a unit vector), shape (3,).

    Raises:
        ValueError: Weights that are not a two-axis array of finite numbers, negative, all zero or with a greatest one
            outside 1e-60 to 1e60; a pixel that is not positive; a centre or normal that is not three finite numbers.
    """

    weights: np.ndarray
    pixel: float | tuple[float, float]
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    normal: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    if TYPE_CHECKING:  # arrays are made of what is given

        def __init__(  # noqa: D107
            self,
            weights: ArrayLike,
            pixel: float | tuple[float, float],
            center: ArrayLike = (0, 0, 0),
            normal: ArrayLike = (0, 0, 1),
        ) -> None: ...

    def __post_init__(self):
        """Check and make a read-only copy."""
        weights = np.array(self.weights, dtype=np.float64)
        if weights.ndim != 2 or weights.size == 0:
            raise ValueError(f"the weights of a Mask must be an array of two axes [y, x], got shape {weights.shape}")
        bad = ~(np.isfinite(weights) & (weights >= 0.0))
        if bad.any():
            first = tuple(int(index) for index in np.argwhere(bad)[0])
            raise ValueError(f"{bad.sum()} weights of a Mask are negative or not finite, the first is {first}")
        greatest = float(weights.max())
        if greatest == 0.0:
            raise ValueError("the weights of a Mask are all zero: no light gets through")
        if not SMALL <= greatest <= GREAT:
            raise ValueError(f"the greatest weight of a Mask is {greatest:g}: scale the weights to about 1")
        weights.setflags(write=False)
        object.__setattr__(self, "weights", weights)
        if not are_numbers(self.pixel):
            raise TypeError(f"the pixel of a Mask must be one length or two [m], got {self.pixel!r}")
        for size in np.atleast_1d(np.asarray(self.pixel, dtype=np.float64)):
            check_positive(size, "pixel of a Mask")
        if np.shape(self.pixel) not in ((), (2,)):
            raise ValueError(f"the pixel of a Mask must be one length or two, got {self.pixel!r}")
        self._check_place()

    @property
    def _weights(self) -> np.ndarray:
        return self.weights

    @property
    def _size(self) -> tuple[float, float]:
        width, height = np.broadcast_to(np.asarray(self.pixel, dtype=np.float64), (2,))
        return float(width), float(height)
