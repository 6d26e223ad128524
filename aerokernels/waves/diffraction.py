r"""What diffraction changes of a Strehl ratio: a wave through a few slabs of a field beside its bent rays.

Both go through the same thin screens, the slabs' phases at their middles with free space between them; the wave by
Fresnel's angular spectrum in single precision, whose error is far below what is asked. The Strehl ratio is the square
of the amplitude's sum, which free space leaves alone, so the way after the last screen is not gone. The number of slabs
is doubled until the change is known well enough to say on which side of its limit it lies: the splitting's error is of
second order in the thickness, and the same screens of both take most of it away. Near their foci no order tells where
rays go: there it is the traced rays' Strehl ratio that is compared, and straight ones' where there is none.

In a planar field seen across its axis the waves along x do not mix, and the sum keeps only the one that does not vary:
one line of pixels is the whole problem.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..pupils import Pupil
from ..wavefront.grid import LEAST_COVER
from .slabs import FINEST, Slabs

# Slabs to begin with. The change is known where doubling them moves it by less than a share of its limit, or by less
# than a share of what it lies off the limit.
FEWEST, SAME, DECIDED = 1, 0.05, 0.5
# Fewer slabs than these are believed only where the change is below a share of its limit: one and two may be alike by
# chance.
FEW, CLEAR = 4, 0.5


@dataclass(frozen=True, eq=False)
class Window:
    """A pupil's light on a grid of square pixels, of one column where nothing varies along x.

    Attributes:
        amplitude: Its amplitude, float, shape (rows, columns).
        x: Places of the columns [m].
        y: Places of the rows [m].
        pixel: Side of a pixel [m]; of one column, its height.
        width: Width of a column [m].
    """

    amplitude: np.ndarray
    x: np.ndarray
    y: np.ndarray
    pixel: float
    width: float

    @property
    def lit(self) -> np.ndarray:
        """Which pixels have light."""
        return self.amplitude > 0.0


def window_of(pupil: Pupil, half: float, pixel_count: int, one_column: bool = False) -> Window:
    """The window of half a width [m] about a pupil."""
    pixel = 2.0 * half / pixel_count
    edges = pixel * (np.arange(pixel_count + 1) - pixel_count // 2 - 0.5)
    columns = np.array([edges[0], edges[-1]]) if one_column else edges
    amplitude = pupil.coverage(columns, edges)
    amplitude[amplitude < LEAST_COVER * amplitude.max()] = 0.0
    middle = 0.5 * (edges[1:] + edges[:-1])
    return Window(amplitude, np.zeros(1) if one_column else middle, middle, pixel, float(np.diff(columns)[0]))


@dataclass(frozen=True)
class Through:
    """What a number of slabs say.

    Attributes:
        wave: The wave's sum over that of the light that it began as.
        change: Strehl ratio of the wave less that of the rays.
        apart: How far the rays' Strehl ratio is from that of traced ones.
    """

    wave: complex
    change: float
    apart: float

    def doubt(self, fewer: "Through", alone: bool) -> float:
        """How far half as many slabs are from it; of a wave that stands alone, by its phase, too.

        So two Strehl ratios that happen to be alike are not taken for one.
        """
        if alone:
            return abs(self.wave - fewer.wave) * (abs(self.wave) + abs(fewer.wave))
        return max(abs(self.change - fewer.change), self.apart)


@dataclass(frozen=True, eq=False)
class Ways:
    """What does not change with the number of slabs.

    Attributes:
        window: The pupil's light.
        slabs: The disturbed air.
        passes: Which of the window's lit pixels have rays that get past a body.
        before: Free way from the pupil to the slabs [m].
        after: Free way from the slabs to where the rays' paths end [m].
        wavelength: In vacuum [m].
        ambient_index: Index of the air at rest.
        straight: Whether the rays are straight ones.
        traced: Strehl ratio of traced rays; None: there are none.
        by_traced: Whether it is those that the wave is compared with.
    """

    window: Window
    slabs: Slabs
    passes: np.ndarray
    before: float
    after: float
    wavelength: float
    ambient_index: float
    straight: bool
    traced: float | None = None
    by_traced: bool = False

    def change(self, limit: float) -> tuple[float, float]:
        """Strehl ratio of the wave less that of the rays, known well enough for a limit, and what it may be off by.

        That is by half as many slabs, infinite where straight rays stand for bent ones. An opaque wall is no smooth
        function of its depth: where there is one, as many slabs as there are are taken.
        """
        opaque = self.slabs.opaque(self.window.x, self.window.y, 1)
        if opaque is not None and opaque.any():
            return self._through(FINEST).change, float("nan")
        count, found, doubt = FEWEST, self._through(FEWEST), math.inf
        while count < FINEST:
            count, last, found = 2 * count, found, self._through(2 * count)
            doubt = found.doubt(last, self.by_traced)
            if count < FEW and abs(found.change) > CLEAR * limit:
                continue
            if doubt <= max(SAME * limit, DECIDED * abs(abs(found.change) - limit)):
                break
        return found.change, math.inf if self.straight and not self.by_traced else doubt

    def _through(self, count: int) -> "Through":
        """What so many slabs say."""
        window = self.window
        paths = self.slabs.taken(window.x, window.y, count)
        opaque = self.slabs.opaque(window.x, window.y, count)
        passes = self.passes
        paths -= paths[:, passes].mean(axis=1)[:, None, None]  # what delays all alike is of no account
        paths = paths.astype(np.float32)
        whole = float(window.amplitude[passes].sum())
        wave = self._wave(paths, opaque) / whole
        if self.by_traced and self.traced is not None:
            return Through(wave, abs(wave) ** 2 - self.traced, 0.0)
        by_rays = (abs(self._rays(paths)) / whole) ** 2
        return Through(wave, abs(wave) ** 2 - by_rays, 0.0 if self.traced is None else abs(by_rays - self.traced))

    def _wave(self, paths: np.ndarray, opaque: np.ndarray | None) -> complex:
        """The wave's sum behind all screens, some of them opaque in places."""
        from scipy.fft import fft2, ifft2

        step = (self.slabs.last - self.slabs.first) / len(paths)
        wave = self._spectrum.copy()
        way = self._free(self.before + 0.5 * step)
        for number, path in enumerate(paths):
            for factor in way:
                wave *= factor
            wave = ifft2(wave, overwrite_x=True)
            wave *= phase_factor(path, self.wavelength)
            if opaque is not None:
                wave[opaque[number]] = 0.0
            if number == 0 and len(paths) > 1:
                way = self._free(step)
            if number < len(paths) - 1:
                wave = fft2(wave, overwrite_x=True)
        return complex(wave.sum())

    @cached_property
    def _spectrum(self) -> np.ndarray:
        """Of the pupil's light."""
        from scipy.fft import fft2

        return np.asarray(fft2(self.window.amplitude.astype(np.complex64), overwrite_x=True))

    def _free(self, way: float) -> list[np.ndarray]:
        """What a way [m] of free space does to the components along y and along x."""
        wave_number = 2.0 * np.pi * self.ambient_index / self.wavelength
        factors = []
        for square in self._frequencies:
            factors.append(np.exp(-0.5j * way / wave_number * square).astype(np.complex64))
        return factors

    @cached_property
    def _frequencies(self) -> list[np.ndarray]:
        """Squares of the components' wave numbers along y and, of more than one column, along x [1/m2]."""
        rows, columns = (
            (2.0 * np.pi * np.fft.fftfreq(count, self.window.pixel)) ** 2 for count in self.window.amplitude.shape
        )
        return [rows[:, None], columns] if len(columns) > 1 else [rows[:, None]]

    def _rays(self, paths: np.ndarray) -> complex:
        """The sum of what the rays bring, by where they began."""
        path = paths.sum(axis=0)
        if not self.straight:
            step = (self.slabs.last - self.slabs.first) / len(paths)
            path += bending(paths, self.window.pixel, step, self.after)
        lit = self.passes
        return complex((self.window.amplitude[lit] * phase_factor(path[lit], self.wavelength)).sum(dtype=np.complex128))


def bending(paths: np.ndarray, pixel: float, step: float, after: float) -> np.ndarray:
    r"""Optical path that bent rays have more than straight ones through screens [m], where a ray began.

    Rays that are turned by t and have gone aside by d meet a screen's path p and slopes there, to second order in d,

        p + d grad p + d H d / 2,       t += grad p + H d,       d += t z,

    and t^2 z / 2 is the way that they go aslant through free space of a length z. What is left out is of third order in
    d over the size of a feature.

    Args:
        paths: Optical path of each slab [m], shape (count, rows, columns).
        pixel: Side of a pixel [m].
        step: Thickness of a slab [m].
        after: Free way behind the last one [m].

    Returns:
        Path, shape (rows, columns).
    """
    kind, shape = paths.dtype.type, paths.shape[1:]
    axes = [axis for axis in (0, 1) if shape[axis] > 1]
    reach = kind(max(shape) * pixel)
    gained = np.zeros(shape, dtype=kind)
    turn, aside = np.zeros((2, len(axes), *shape), dtype=kind)
    for number, path in enumerate(paths):
        slopes = [slope(path, pixel, axis) for axis in axes]
        if number > 0:
            more = _times_curvature(slopes, aside, pixel, axes)
            for own, moved, change in zip(slopes, aside, more, strict=True):
                gained += moved * (own + kind(0.5) * change)
                own += change
        way = kind(step if number < len(paths) - 1 else 0.5 * step + after)
        for turned, moved, own in zip(turn, aside, slopes, strict=True):
            turned += own
            moved += way * turned
            np.clip(moved, -reach, reach, out=moved)  # beside a jump at the box's side, where no light is
            gained += kind(0.5) * way * turned**2
    return gained


def _times_curvature(slopes: list[np.ndarray], aside: np.ndarray, pixel: float, axes: list[int]) -> list[np.ndarray]:
    """Second derivatives of a screen's path times displacements."""
    more = [slope(own, pixel, axis) * moved for own, axis, moved in zip(slopes, axes, aside, strict=True)]
    if len(axes) > 1:
        mixed = slope(slopes[0], pixel, 1)
        more[0] += mixed * aside[1]
        more[1] += mixed * aside[0]
    return more


def slope(values: np.ndarray, pixel: float, axis: int) -> np.ndarray:
    """Central differences along an axis, one-sided at its ends, over the pixel: `numpy.gradient` of this alone."""
    values = np.swapaxes(values, 0, axis)
    made = np.empty_like(values)
    made[1:-1] = values[2:] - values[:-2]
    made[0], made[-1] = 2.0 * (values[1] - values[0]), 2.0 * (values[-1] - values[-2])
    made *= values.dtype.type(0.5 / pixel)
    return np.swapaxes(made, 0, axis)


def phase_factor(path: np.ndarray, wavelength: float) -> np.ndarray:
    """exp(i k path) of paths [m], single precision, by sines and cosines: several times quicker than a complex exp."""
    phase = path * np.float32(2.0 * np.pi / wavelength)
    made = np.empty(path.shape, dtype=np.complex64)
    np.cos(phase, out=made.real)
    np.sin(phase, out=made.imag)
    return made
