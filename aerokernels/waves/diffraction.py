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
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ..pupils import Pupil
from ..wavefront.grid import LEAST_COVER
from .slabs import FINEST, Slabs

# Slabs to begin with. The change is known where doubling them moves it by less than a share of its limit, or by less
# than a share of what it lies off the limit.
FEWEST, SAME, DECIDED = 1, 0.05, 0.5
# Fewer slabs than these are believed only where the change is below a share of its limit: one and two may be alike by
# chance. So many are enough where nothing moves any more.
FEW, CLEAR, MANY = 4, 0.5, 4
# Pixels beside the rays that their curvature takes; numbers of screens that are looked at together.
BESIDE, TOGETHER = 2, 1 << 14


@dataclass(frozen=True, eq=False)
class Window:
    """A pupil's light on a grid of square pixels, of one column where nothing varies along x.

    Attributes:
        amplitude: Its amplitude, float32, shape (rows, columns).
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
    amplitude = np.zeros((pixel_count, len(columns) - 1), dtype=np.float32)
    # Nothing is lit beside the pupil's own extent.
    across, up = (
        slice(max(int(np.searchsorted(each, -extent, "right")) - 1, 0), int(np.searchsorted(each, extent)) + 1)
        for each, extent in zip((columns, edges), pupil.half_extent, strict=True)
    )
    amplitude[up.start : up.stop - 1, across.start : across.stop - 1] = pupil.coverage(columns[across], edges[up])
    amplitude[amplitude < LEAST_COVER * amplitude.max()] = 0.0
    middle = 0.5 * (edges[1:] + edges[:-1])
    return Window(amplitude, np.zeros(1) if one_column else middle, middle, pixel, float(columns[1] - columns[0]))


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
        return abs(self.change - fewer.change)


@dataclass(frozen=True, eq=False)
class Ways:
    """What does not change with the number of slabs.

    Attributes:
        window: The pupil's light.
        slabs: The disturbed air.
        passes: Which of the window's lit pixels have rays that get past a body.
        near: The part of the window that has rays, see `beside`.
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
    near: tuple[slice, slice]
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
            by_slabs = found.doubt(last, self.by_traced)
            doubt = max(by_slabs, found.apart)
            if count < FEW and abs(found.change) > CLEAR * limit:
                continue
            if doubt <= max(SAME * limit, DECIDED * abs(abs(found.change) - limit)):
                break
            # Where the slabs' rays stand still apart from the traced ones, their number has nothing to do with it.
            if count >= MANY and max(by_slabs, abs(found.apart - last.apart)) <= SAME * limit:
                break
        return found.change, math.inf if self.straight and not self.by_traced else doubt

    def _through(self, count: int) -> "Through":
        """What so many slabs say."""
        window = self.window
        paths = self.slabs.taken(window.x, window.y, count)
        wave = self._wave(paths, self.slabs.opaque(window.x, window.y, count)) / self._light
        if self.by_traced and self.traced is not None:
            return Through(wave, abs(wave) ** 2 - self.traced, 0.0)
        by_rays = (abs(self._rays(paths)) / self._light) ** 2
        return Through(wave, abs(wave) ** 2 - by_rays, 0.0 if self.traced is None else abs(by_rays - self.traced))

    @cached_property
    def _light(self) -> float:
        """The sum of the amplitudes that rays bring."""
        return float(self.window.amplitude[self.passes].sum())

    def _wave(self, paths: np.ndarray, opaque: np.ndarray | None) -> complex:
        """The wave's sum behind all screens, some of them opaque in places."""
        forward, inverse = self._transforms
        step = (self.slabs.last - self.slabs.first) / len(paths)
        wave, way = self._spectrum * self._free(self.before + 0.5 * step), None
        for number, factor in enumerate(_one_by_one(paths, self.wavelength)):
            if number > 0:
                way = self._free(step) if way is None else way
                wave = forward(wave, overwrite_x=True)
                wave *= way
            wave = inverse(wave, overwrite_x=True)
            wave *= factor
            if opaque is not None:
                wave[opaque[number]] = 0.0
        return complex(wave.sum())

    @cached_property
    def _transforms(self) -> tuple[Callable[..., np.ndarray], Callable[..., np.ndarray]]:
        """There and back, of one column along it alone."""
        from scipy import fft

        if self.window.amplitude.shape[1] == 1:
            return partial(fft.fft, axis=0), partial(fft.ifft, axis=0)
        return fft.fft2, fft.ifft2

    @cached_property
    def _spectrum(self) -> np.ndarray:
        """Of the pupil's light."""
        return self._transforms[0](self.window.amplitude.astype(np.complex64), overwrite_x=True)

    def _free(self, way: float) -> np.ndarray:
        """What a way [m] of free space does to the components."""
        turn = -0.5 * way * self.wavelength / (2.0 * np.pi * self.ambient_index)
        rows, *columns = (np.exp(1j * turn * square).astype(np.complex64) for square in self._frequencies)
        return rows[:, None] * columns[0] if columns else rows[:, None]

    @cached_property
    def _frequencies(self) -> list[np.ndarray]:
        """Squares of the components' wave numbers along y and, of more than one column, along x [1/m2]."""
        shape = self.window.amplitude.shape
        counts = shape if shape[1] > 1 else shape[:1]
        return [(2.0 * np.pi * np.fft.fftfreq(count, self.window.pixel)) ** 2 for count in counts]

    def _rays(self, paths: np.ndarray) -> complex:
        """The sum of what the rays bring, by where they began."""
        paths = paths[:, *self.near]
        path = paths.sum(axis=0)
        if not self.straight:
            step = (self.slabs.last - self.slabs.first) / len(paths)
            path += bending(paths, self.window.pixel, step, self.after)
        return complex((self._rays_light * phase_factor(path, self.wavelength)).sum())

    @cached_property
    def _rays_light(self) -> np.ndarray:
        """The rays' amplitude, in the part of the window that has any."""
        return np.where(self.passes, self.window.amplitude, np.float32(0.0))[self.near]


def beside(passes: np.ndarray) -> tuple[slice, slice]:
    """The part of a window that has rays, with as many pixels beside them as their curvature takes."""
    there = [np.flatnonzero(passes.any(axis=1 - axis)) for axis in (0, 1)]
    rows, columns = (slice(max(int(one[0]) - BESIDE, 0), int(one[-1]) + 1 + BESIDE) for one in there)
    return rows, columns


def _one_by_one(paths: np.ndarray, wavelength: float) -> Iterator[np.ndarray]:
    """exp(i k path) of each slab; of small ones some together, since a call of NumPy takes as long as they do."""
    some = max(1, TOGETHER // paths[0].size)
    for first in range(0, len(paths), some):
        yield from phase_factor(paths[first : first + some], wavelength)


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
    some = max(1, TOGETHER // paths[0].size)
    for first in range(0, len(paths), some):
        slopes = [slope(paths[first : first + some], pixel, axis + 1) for axis in axes]
        curvatures = _curvatures(slopes, pixel, axes) if len(paths) > 1 else []
        for number in range(len(slopes[0])):
            if first + number > 0:
                more = _times_curvature([each[number] for each in curvatures], aside)
                for own, moved, change in zip(slopes, aside, more, strict=True):
                    gained += moved * (own[number] + kind(0.5) * change)
                    own[number] += change
            way = kind(step if first + number < len(paths) - 1 else 0.5 * step + after)
            for turned, moved, own in zip(turn, aside, slopes, strict=True):
                turned += own[number]
                moved += way * turned
                # Beside a jump at the box's side, where no light is.
                np.minimum(np.maximum(moved, -reach, out=moved), reach, out=moved)
                gained += kind(0.5) * way * turned**2
    return gained


def _curvatures(slopes: list[np.ndarray], pixel: float, axes: list[int]) -> list[np.ndarray]:
    """Second derivatives of screens' paths: along each axis, then mixed."""
    own = [slope(each, pixel, axis + 1) for each, axis in zip(slopes, axes, strict=True)]
    return [*own, slope(slopes[0], pixel, 2)] if len(axes) > 1 else own


def _times_curvature(curvatures: list[np.ndarray], aside: np.ndarray) -> list[np.ndarray]:
    """Second derivatives of a screen's path times displacements."""
    if len(aside) == 1:
        return [curvatures[0] * aside[0]]
    along_y, along_x, mixed = curvatures
    return [along_y * aside[0] + mixed * aside[1], along_x * aside[1] + mixed * aside[0]]


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
