r"""Change of a Strehl ratio by diffraction: a wave through a few slabs of a field, compared with its bent rays.

Wave and rays pass the same thin screens: the phase of each slab at its middle, with free space in between. The wave
propagates by Fresnel's angular spectrum in single precision, whose error is far below the required one. The Strehl
ratio is the squared sum of the amplitude, which free space conserves, so that propagation behind the last screen is not
needed. The number of slabs is doubled until the error is small enough to decide on which side of its limit the change
is: the splitting error is of second order in the thickness, and most of it cancels since both pass the same screens.
Near foci no finite order gives the paths of rays: there the wave is compared with the Strehl ratio of traced rays, or
with straight rays if none were traced.

In a planar field seen across its axis, Fourier components along x do not mix, and the sum contains only the constant
one: one column of pixels is enough.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from ..pupils import Pupil
from ..wavefront.grid import LEAST_COVER
from .slabs import FINEST, Slabs

# First number of slabs. The change is accepted if doubling the slabs moves it by less than a share SAME of the limit,
# or by less than a share DECIDED of its distance from the limit.
FEWEST, SAME, DECIDED = 1, 0.05, 0.5
# Fewer slabs than FEW are accepted only if the change is below a share CLEAR of the limit: results of one and two slabs
# may agree by chance. MANY slabs are enough if nothing changes any more.
FEW, CLEAR, MANY = 4, 0.25, 4
# Margin of pixels around the rays for second derivatives; array elements of screens processed together.
BESIDE, TOGETHER = 2, 1 << 14


@dataclass(frozen=True, eq=False)
class Window:
    """A pupil's light on a grid of square pixels; one column if nothing varies along x.

    Attributes:
        amplitude: Amplitude of the light, float32, shape (rows, columns).
        x: Coordinates of the columns [m].
        y: Coordinates of the rows [m].
        pixel: Side of a pixel [m]; the height of a pixel if there is one column.
        width: Width of a column [m].
    """

    amplitude: np.ndarray
    x: np.ndarray
    y: np.ndarray
    pixel: float
    width: float

    @property
    def lit(self) -> np.ndarray:
        """Mask of the pixels with light."""
        return self.amplitude > 0.0


def window_of(pupil: Pupil, half: float, pixel_count: int, one_column: bool = False) -> Window:
    """Return the window of half width `half` [m] about a pupil."""
    pixel = 2.0 * half / pixel_count
    edges = pixel * (np.arange(pixel_count + 1) - pixel_count // 2 - 0.5)
    columns = edges[[0, -1]] if one_column else edges
    amplitude = np.zeros((pixel_count, len(columns) - 1), dtype=np.float32)
    # Only pixels within the pupil's extent have light.
    across, up = (_within(extent, float(edges[0]), pixel, pixel_count) for extent in pupil.half_extent)
    if one_column:
        across = 0, 1
    lit = pupil.coverage(columns[across[0] : across[1] + 1], edges[up[0] : up[1] + 1])
    lit[lit < LEAST_COVER * lit.max()] = 0.0
    amplitude[slice(*up), slice(*across)] = lit
    middle = 0.5 * (edges[1:] + edges[:-1])
    return Window(amplitude, np.zeros(1) if one_column else middle, middle, pixel, float(columns[-1] - columns[-2]))


def _within(extent: float, start: float, pixel: float, count: int) -> tuple[int, int]:
    """Return the range of the pixels from `start` [m] on that are within an extent on either side of zero [m]."""
    first, last = (math.floor((end - start) / pixel) for end in (-extent, extent))
    return max(first, 0), min(last + 1, count)


@dataclass(frozen=True)
class SlabResult:
    """Result of a wave and rays through some number of slabs.

    Attributes:
        wave: Sum of the wave's amplitude over the sum of the initial amplitude.
        change: Strehl ratio of the wave minus the one of the rays.
        apart: Difference between the Strehl ratios of the slabs' rays and of traced rays.
    """

    wave: complex
    change: float
    apart: float

    def doubt(self, fewer: "SlabResult", alone: bool) -> float:
        """Return the difference from the result of half as many slabs; for a wave alone, of the complex sums.

        The phase of the sum counts so that two Strehl ratios that agree by chance are not taken as converged.
        """
        if alone:
            return abs(self.wave - fewer.wave) * (abs(self.wave) + abs(fewer.wave))
        return abs(self.change - fewer.change)


@dataclass(frozen=True, eq=False)
class WaveAndRays:
    """A wave and rays through a field: everything that does not depend on the number of slabs.

    Attributes:
        window: The pupil's light.
        slabs: The disturbed air.
        passes: Mask of the window's lit pixels whose rays pass the body.
        near: The part of the window that has rays, see `beside`.
        before: Free distance from the pupil to the slabs [m].
        after: Free distance from the slabs to the end of the rays' paths [m].
        wavelength: Vacuum wavelength [m].
        ambient_index: Refractive index of the undisturbed air.
        straight: Whether the slabs' rays are straight.
        traced: Strehl ratio of traced rays; None if there are none.
        by_traced: Whether the wave is compared with the traced rays.
        most_samples: Most pixels of all slabs together, beyond which slabs are not doubled.
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
    most_samples: float = math.inf

    def change(self, limit: float) -> tuple[float, float]:
        """Return the Strehl ratio of the wave minus the one of the rays, and its error, well enough for a limit.

        The error is the difference from half as many slabs; it is infinite if straight rays replace bent ones. With an
        opaque wall the result does not converge smoothly with the thickness: then all slabs are used, and the error is
        NaN.
        """
        opaque = self.slabs.opaque(self.window.x, self.window.y, 1)
        if opaque is not None and opaque.any():
            return self._result(FINEST).change, float("nan")
        count, found, doubt = FEWEST, self._result(FEWEST), math.inf
        while count < FINEST and 2 * count * self.window.amplitude.size <= self.most_samples:
            count, last, found = 2 * count, found, self._result(2 * count)
            by_slabs = found.doubt(last, self.by_traced)
            doubt = max(by_slabs, found.apart)
            if count < FEW and abs(found.change) > CLEAR * limit:
                continue
            if doubt <= max(SAME * limit, DECIDED * abs(abs(found.change) - limit)):
                break
            # If the slabs' rays have converged to a result other than the traced rays', more slabs do not help.
            if count >= MANY and max(by_slabs, abs(found.apart - last.apart)) <= SAME * limit:
                break
        return found.change, math.inf if self.straight and not self.by_traced else doubt

    def _result(self, count: int) -> "SlabResult":
        """Return the result of so many slabs."""
        window = self.window
        paths = self.slabs.paths(window.x, window.y, count)
        wave = self._wave(paths, self.slabs.opaque(window.x, window.y, count)) / self._light
        if self.by_traced and self.traced is not None:
            return SlabResult(wave, abs(wave) ** 2 - self.traced, 0.0)
        by_rays = (abs(self._rays(paths)) / self._light) ** 2
        return SlabResult(wave, abs(wave) ** 2 - by_rays, 0.0 if self.traced is None else abs(by_rays - self.traced))

    @cached_property
    def _light(self) -> float:
        """Sum of the initial amplitudes of the rays."""
        return float(self.window.amplitude[self.passes].sum())

    def _wave(self, paths: np.ndarray, opaque: np.ndarray | None) -> complex:
        """Return the sum of the wave behind all screens, some of which may be partly opaque."""
        forward, inverse = self._transforms
        step = (self.slabs.last - self.slabs.first) / len(paths)
        first, between = self._free([self.before + 0.5 * step, step])
        wave = self._spectrum * first
        for number, factor in enumerate(_one_by_one(paths, self.wavelength)):
            if number > 0:
                wave = forward(wave, overwrite_x=True)
                wave *= between
            wave = inverse(wave, overwrite_x=True)
            wave *= factor
            if opaque is not None:
                wave[opaque[number]] = 0.0
        return complex(wave.sum())

    @cached_property
    def _transforms(self) -> tuple[Callable[..., np.ndarray], Callable[..., np.ndarray]]:
        """Forward and inverse transform; along y alone for one column."""
        from scipy import fft

        if self.window.amplitude.shape[1] == 1:
            return partial(fft.fft, axis=0), partial(fft.ifft, axis=0)
        return fft.fft2, fft.ifft2

    @cached_property
    def _spectrum(self) -> np.ndarray:
        """Fourier transform of the pupil's light."""
        return self._transforms[0](self.window.amplitude)  # of real numbers: half the time of complex ones

    def _free(self, distances: list[float]) -> np.ndarray:
        """Return the factors of the Fourier components over distances [m] of free space, shape (distances, ...)."""
        turn = -0.5 * self.wavelength / (2.0 * np.pi * self.ambient_index) * np.array(distances)
        square, rows = self._frequencies, self.window.amplitude.shape[0]
        phase = turn[:, None] * square  # thousands of radians: in double precision
        factors = np.empty(phase.shape, dtype=np.complex64)
        factors.real, factors.imag = np.cos(phase), np.sin(phase)
        along_y, along_x = factors[:, :rows, None], factors[:, None, rows:]
        return along_y * along_x if along_x.size else along_y

    @cached_property
    def _frequencies(self) -> np.ndarray:
        """Squared wave numbers of the components along y, then of those along x for more than one column [1/m2]."""
        counts = [count for count in self.window.amplitude.shape if count > 1]
        return np.concatenate([(2.0 * np.pi * np.fft.fftfreq(count, self.window.pixel)) ** 2 for count in counts])

    def _rays(self, paths: np.ndarray) -> complex:
        """Return the sum of the rays' amplitudes, with their phases at their starts."""
        paths = paths[:, *self.near]
        path = paths.sum(axis=0)
        if not self.straight:
            step = (self.slabs.last - self.slabs.first) / len(paths)
            path += bending(paths, self.window.pixel, step, self.after)
        return complex((self._rays_light * phase_factor(path, self.wavelength)).sum())

    @cached_property
    def _rays_light(self) -> np.ndarray:
        """Amplitudes of the rays, in the part of the window that has rays."""
        return np.where(self.passes, self.window.amplitude, np.float32(0.0))[self.near]


def beside(passes: np.ndarray) -> tuple[slice, slice]:
    """Return the part of a window that has rays, with a margin of pixels for second derivatives."""
    rows, columns = (np.logical_or.reduce(passes, axis=1 - axis) for axis in (0, 1))
    return _around(rows), _around(columns)


def _around(there: np.ndarray) -> slice:
    """Return the range from the first to the last true entry with a margin of BESIDE."""
    return slice(max(int(there.argmax()) - BESIDE, 0), len(there) - int(there[::-1].argmax()) + BESIDE)


def _one_by_one(paths: np.ndarray, wavelength: float) -> Iterator[np.ndarray]:
    """Yield exp(i k path) of each slab; several small slabs are computed at once to save NumPy calls."""
    some = max(1, TOGETHER // paths[0].size)
    for first in range(0, len(paths), some):
        yield from phase_factor(paths[first : first + some], wavelength)


def bending(paths: np.ndarray, pixel: float, step: float, after: float) -> np.ndarray:
    r"""Return the excess optical path of bent rays over straight ones through screens [m], at the start of each ray.

    To second order in d, rays with deflection t and displacement d get from a screen of path p

        p + d grad p + d H d / 2,       t += grad p + H d,       d += t z,

    and t^2 z / 2 from their slanted path through free space of a length z. Neglected terms are of third order in d over
    the size of a feature.

    Args:
        paths: Optical path of each slab [m], shape (count, rows, columns).
        pixel: Side of a pixel [m].
        step: Thickness of a slab [m].
        after: Free distance behind the last slab [m].

    Returns:
        Excess path [m], shape (rows, columns); zero in a margin of BESIDE pixels, which derivatives do not reach.
    """
    kind, shape = paths.dtype.type, paths.shape[1:]
    axes = [axis for axis in (0, 1) if shape[axis] > 1]
    reach = kind(max(shape) * pixel)
    excess = np.zeros(shape, dtype=kind)
    gained = _inner(excess, axes, BESIDE)
    turn, aside = np.zeros((2, len(axes), *gained.shape), dtype=kind)
    some = max(1, TOGETHER // paths[0].size)
    for first in range(0, len(paths), some):
        part = paths[first : first + some]
        wide = [_slope(part, pixel, axis, axes) for axis in axes]
        slopes = [_inner(each, axes, 1) for each in wide]
        # The first slab meets rays that are not yet displaced.
        bent = slice(1 if first == 0 else 0, None)
        curvatures = _curvatures([each[bent] for each in wide], pixel, axes) if len(paths) > 1 else []
        for number in range(len(part)):
            if first + number > 0:
                more = _times_curvature([each[number - bent.start] for each in curvatures], aside)
                for own, moved, change in zip(slopes, aside, more, strict=True):
                    gained += moved * (own[number] + kind(0.5) * change)
                    own[number] += change
            is_last = first + number == len(paths) - 1
            distance = kind(0.5 * step + after if is_last else step)
            for turned, moved, own in zip(turn, aside, slopes, strict=True):
                turned += own[number]
                gained += kind(0.5) * distance * turned**2
                if not is_last:
                    moved += distance * turned
                    # Slopes of the jump at the box's side, where there is no light, must not overflow.
                    np.minimum(np.maximum(moved, -reach, out=moved), reach, out=moved)
    return excess


def _inner(values: np.ndarray, axes: list[int], margin: int) -> np.ndarray:
    """Return maps (..., rows, columns) without a margin of pixels along the axes."""
    rows, columns = (slice(margin, -margin) if axis in axes else slice(None) for axis in (0, 1))
    return values[..., rows, columns]


def _slope(paths: np.ndarray, pixel: float, axis: int, axes: list[int]) -> np.ndarray:
    """Return central differences over the pixel along one axis of maps (count, rows, columns), without a margin of one.

    The margin is left out along all `axes`.
    """
    ahead, behind = ([slice(1, -1) if own in axes else slice(None) for own in (0, 1)] for _ in range(2))
    ahead[axis], behind[axis] = slice(2, None), slice(None, -2)
    made = paths[:, *ahead] - paths[:, *behind]
    made *= made.dtype.type(0.5 / pixel)
    return made


def _curvatures(slopes: list[np.ndarray], pixel: float, axes: list[int]) -> list[np.ndarray]:
    """Return second derivatives of the screens' paths: along each axis, then mixed."""
    own = [_slope(each, pixel, axis, axes) for each, axis in zip(slopes, axes, strict=True)]
    return [*own, _slope(slopes[0], pixel, 1, axes)] if len(axes) > 1 else own


def _times_curvature(curvatures: list[np.ndarray], aside: np.ndarray) -> list[np.ndarray]:
    """Return the second derivatives of a screen's path times displacements."""
    if len(aside) == 1:
        return [curvatures[0] * aside[0]]
    along_y, along_x, mixed = curvatures
    return [along_y * aside[0] + mixed * aside[1], along_x * aside[1] + mixed * aside[0]]


def phase_factor(path: np.ndarray, wavelength: float) -> np.ndarray:
    """Return exp(i k path) of paths [m], single precision; sine and cosine are much faster than a complex exp."""
    phase = path * np.float32(2.0 * np.pi / wavelength)
    made = np.empty(path.shape, dtype=np.complex64)
    np.cos(phase, out=made.real)
    np.sin(phase, out=made.imag)
    return made
