"""A pupil as a grid of pixels, and the numbers computed from a map of optical path differences over it."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.inputs.checks import check_count
from aerokernels.inputs.kinds import wrong_kind
from aerokernels.pupils import Projected, Pupil, seen_along
from aerokernels.wavefronts import remove_terms, weighted_mean
from aerokernels.wavefronts.pixels import PARTS, STEPS, repeated, three_in_a_row, values_of_parts


@dataclass(frozen=True, eq=False)
class PupilGrid:
    """Square pixels over a pupil."""

    x: np.ndarray  # pixel centres along the pupil's first axis [m], shape (nx,)
    y: np.ndarray  # and along its second axis [m], shape (ny,)
    weight: np.ndarray  # share of each pixel in means over the pupil, sums to 1, shape (ny, nx)
    points: np.ndarray  # centres of the pixels with a weight, in space [m], shape (n, 3)
    pixel: float  # side of a pixel [m]
    pupil: Pupil
    aperture: Pupil | Projected  # the pupil as it is seen along the look direction

    @property
    def lit(self) -> np.ndarray:
        """Whether a pixel has a weight, shape (ny, nx)."""
        return self.weight > 0.0

    @property
    def coordinates(self) -> np.ndarray:
        """Coordinates x and y of the pixels with a weight [m], shape (n, 2)."""
        x, y = np.meshgrid(self.x, self.y)
        return np.stack([x[self.lit], y[self.lit]], axis=1)

    def reader(self, good: np.ndarray, remove: tuple[str, ...], wavelength: float) -> "MapReader":
        """Return a reader of maps of some of the pixels with a weight, `good` of shape (n,)."""
        there = self.spread(good, False)
        result = MapReader(self.coordinates[good], self.weight[there], remove, wavelength)
        if three_in_a_row(there):
            weight = np.where(there, self.weight, 0.0)
            parts = FinerPixels(self.x, self.y, self.pixel, weight, self.aperture.coverage)
            result.finer = parts, MapReader(parts.points, parts.weight, remove, wavelength)
        return result

    def spread(self, values: np.ndarray, fill: Any = np.nan) -> np.ndarray:
        """Return a map of the values of the pixels with a weight, shape (ny, nx)."""
        result = np.full(self.weight.shape, fill, dtype=np.asarray(values).dtype)
        result[self.lit] = values
        return result


def pupil_grid(pupil: Any, pixel_count: int, look: np.ndarray | None = None) -> PupilGrid:
    """Cover a pupil with `pixel_count` square pixels along its greater side, across a look direction if given one."""
    if not isinstance(pupil, Pupil):
        raise wrong_kind(pupil, "pupil", "a Disc or another pupil")
    check_count(pixel_count, "pixel_count", 2)
    aperture = seen_along(pupil, look)
    half = aperture.half_extent
    pixel = 2.0 * max(half) / int(pixel_count)
    # Enough pixels to cover the whole pupil: a missing rim would be missing in every mean.
    counts = [max(1, math.ceil(2.0 * extent / pixel - 1e-9)) for extent in half]
    edges = [pixel * (np.arange(count + 1) - 0.5 * count) for count in counts]
    weight = aperture.coverage(edges[0], edges[1])
    x, y = (0.5 * (edge[1:] + edge[:-1]) for edge in edges)
    lit = weight > 0.0
    columns, rows = np.meshgrid(x, y)
    first, second = aperture.axes
    points = pupil.center + columns[lit][:, None] * first + rows[lit][:, None] * second
    return PupilGrid(x, y, weight / weight.sum(), points, pixel, pupil, aperture)


@dataclass(frozen=True, eq=False)
class Reading:
    """The numbers of a map."""

    opd: np.ndarray  # the map without the removed terms [m], shape (n,)
    piston: float  # mean optical path difference [m]
    tilt: np.ndarray  # slopes along x and y [rad], shape (2,)
    rms: float  # of the map without its mean [m]
    rms_without_tilt: float  # also without its tilt [m]
    strehl: float  # |<exp(i k OPD)>|^2 of `opd`

    @property
    def numbers(self) -> np.ndarray:
        """The numbers in the order of `map_numbers.NAMES`, shape (6,)."""
        return np.array([self.strehl, *self.tilt, self.piston, self.rms_without_tilt, self.rms])


class MapReader:
    """Computes the numbers of maps with the same pixels; the part that depends on the pixels alone is computed once."""

    def __init__(self, coordinates: np.ndarray, weight: np.ndarray, remove: tuple[str, ...], wavelength: float):
        """Prepare from `coordinates` [m], shape (n, 2), and `weight`, shape (n,)."""
        self.weight, self.remove, self.wavelength = weight / weight.sum(), remove, wavelength
        self.coordinates = coordinates
        self._centred = coordinates - weighted_mean(self.weight, coordinates)
        # pinv with a relative cutoff, so that neither small units nor a pupil that is a line make it singular.
        self._inverse = np.linalg.pinv((self._centred * self.weight[:, None]).T @ self._centred, rcond=1e-12)
        # The parts of the pixels, and the reader of their maps; None where errors are not needed or not known.
        self.finer: tuple[FinerPixels, MapReader] | None = None

    def __call__(self, opd: np.ndarray) -> Reading:
        """Return the numbers of a map [m], shape (n,)."""
        piston = float(weighted_mean(self.weight, opd))
        flat = opd - piston
        tilt = self._inverse @ (self._centred.T @ (self.weight * flat))
        level = flat - self._centred @ tilt
        if set(self.remove) <= {"piston", "tilt"}:
            left = level if "tilt" in self.remove else flat
            left = left if "piston" in self.remove else left + piston
        else:
            left = remove_terms(opd, self.remove, self.coordinates, self.weight)
        phase = (2.0 * np.pi / self.wavelength) * left
        phasor = complex(weighted_mean(self.weight, np.cos(phase)), weighted_mean(self.weight, np.sin(phase)))
        rms, rms_without_tilt = (float(np.sqrt(weighted_mean(self.weight, one**2))) for one in (flat, level))
        return Reading(left, piston, tilt, rms, rms_without_tilt, abs(phasor) ** 2)

    def sampling(self, opd: np.ndarray, reading: Reading) -> np.ndarray:
        """Return the errors of a map's numbers by its pixels, shape (6,); NaN where they are too few to tell."""
        if self.finer is None:
            return np.full(len(reading.numbers), np.nan)
        parts, reader = self.finer
        return np.asarray(2.0 * np.abs(reader(parts(opd)).numbers - reading.numbers))


class FinerPixels:
    """The parts of a map's pixels in the pupil: their `points` [m], shape (m, 2), and shares of it, `weight`."""

    def __init__(
        self, x: np.ndarray, y: np.ndarray, pixel: float, weight: np.ndarray, coverage: Callable[..., np.ndarray]
    ):
        """Divide pixels with centres at x and y [m], and shares `weight` of the pupil, 0 where there is no ray.

        `coverage` returns the shares of cells, between edges along both axes, that are in the pupil.
        """
        self._lit = weight > 0.0
        middles = [(axis[:, None] + pixel * np.array(STEPS)).ravel() for axis in (x, y)]
        edges = [np.append(axis, axis[-1] + pixel / PARTS) - 0.5 * pixel / PARTS for axis in middles]
        share = coverage(*edges)
        mean = repeated(share.reshape(len(y), PARTS, len(x), PARTS).mean(axis=(1, 3)))
        fine = repeated(weight) * share / np.where(mean > 0.0, mean, 1.0)
        self._there = fine > 0.0
        self.weight = fine[self._there] / fine.sum()
        columns, rows = np.meshgrid(*middles)
        self.points = np.stack([columns[self._there], rows[self._there]], axis=1)

    def __call__(self, opd: np.ndarray) -> np.ndarray:
        """Return the optical path differences of the parts, shape (m,), from those of the lit pixels, shape (n,)."""
        whole = np.zeros(self._lit.shape)
        whole[self._lit] = opd
        return np.asarray(values_of_parts(whole, self._lit)[self._there])
