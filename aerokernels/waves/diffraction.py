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
from ..wavefront.pixels import LEAST_COVER
from .bending import MARGIN, bending
from .slabs import FINEST, Slabs

# One slab and two come first. The change is accepted if doubling the slabs moves it by less than a share SAME of the
# limit, or by less than a share DECIDED of its distance from the limit.
SAME, DECIDED = 0.05, 0.5
# Fewer slabs than FEW are accepted only if the change is below a share CLEAR of the limit: results of one and two slabs
# may agree by chance. MANY slabs are enough if nothing changes any more.
FEW, CLEAR, MANY = 4, 0.25, 4
# Array elements of screens processed together.
TOGETHER = 1 << 14


@dataclass(frozen=True, eq=False)
class Window:
    """A pupil's light on a grid of square pixels; one column if nothing varies along x.

    Attributes:
        amplitude: Amplitude of the light, float32, shape (rows, columns).
        x: Coordinates of the columns [m].
        y: Coordinates of the rows [m].
        pixel: Side of a pixel [m]; the height of a pixel if there is one column.
        width: Width of a column [m].
        near: The part that may have light, with a margin of MARGIN pixels for second derivatives.
    """

    amplitude: np.ndarray
    x: np.ndarray
    y: np.ndarray
    pixel: float
    width: float
    near: tuple[slice, slice]


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
    rows, right = (slice(max(first - MARGIN, 0), last + MARGIN) for first, last in (up, across))
    middle = edges[:-1] + 0.5 * pixel
    width = float(columns[-1] - columns[-2])
    return Window(amplitude, np.zeros(1) if one_column else middle, middle, pixel, width, (rows, right))


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
        light: Amplitude of the light whose rays pass the body, float32, shape (rows, columns).
        before: Free distance from the pupil to the slabs [m].
        after: Free distance from the slabs to the end of the rays' paths [m].
        wavelength: Vacuum wavelength [m].
        ambient_index: Refractive index of the undisturbed air.
        straight: Whether the slabs' rays are straight.
        traced: Strehl ratio of traced rays; None if there are none.
        by_traced: Whether the wave is compared with the traced rays.
        most_slabs: Number of slabs that is not doubled.
    """

    window: Window
    slabs: Slabs
    light: np.ndarray
    before: float
    after: float
    wavelength: float
    ambient_index: float
    straight: bool
    traced: float | None = None
    by_traced: bool = False
    most_slabs: int = FINEST

    def change(self, limit: float) -> tuple[float, float]:
        """Return the Strehl ratio of the wave minus the one of the rays, and its error, well enough for a limit.

        The error is the difference from half as many slabs; it is infinite if straight rays replace bent ones. With an
        opaque wall the result does not converge smoothly with the thickness: then all slabs are used, and the error is
        NaN.
        """
        opaque = self.slabs.opaque(self.window.x, self.window.y, 1)
        if opaque is not None and opaque.any():
            return self._result(FINEST).change, float("nan")
        count, (last, found) = 2, self._first_two()
        while True:
            by_slabs = found.doubt(last, self.by_traced)
            doubt = max(by_slabs, found.apart)
            if count >= FEW or abs(found.change) <= CLEAR * limit:
                if doubt <= max(SAME * limit, DECIDED * abs(abs(found.change) - limit)):
                    break
                # If the slabs' rays have converged to a result other than the traced rays', more slabs do not help.
                if count >= MANY and max(by_slabs, abs(found.apart - last.apart)) <= SAME * limit:
                    break
            if count >= self.most_slabs:
                break
            count, last, found = 2 * count, found, self._result(2 * count)
        return found.change, math.inf if self.straight and not self.by_traced else doubt

    def _result(self, count: int) -> "SlabResult":
        """Return the result of so many slabs."""
        window = self.window
        paths = self.slabs.paths(window.x, window.y, count)
        wave = self._wave(paths, self.slabs.opaque(window.x, window.y, count))
        return self._compared([wave], [paths])[0]

    def _first_two(self) -> list[SlabResult]:
        """Return the results of one slab and of two, at once: their cost is that of the calls."""
        window, (forward, inverse) = self.window, self._transforms
        paths = [self.slabs.paths(window.x, window.y, count) for count in (1, 2)]
        length = self.slabs.last - self.slabs.first
        free = self._free([self.before + 0.5 * length, self.before + 0.25 * length, 0.5 * length])
        factors = phase_factor(np.concatenate(paths), self.wavelength)
        waves = inverse(self._spectrum * free[:2], overwrite_x=True)
        waves *= factors[:2]
        between = forward(waves[1])
        between *= free[2]
        last = inverse(between, overwrite_x=True)
        last *= factors[2]
        return self._compared([complex(waves[0].sum()), complex(last.sum())], paths)

    def _compared(self, waves: list[complex], paths: list[np.ndarray]) -> list[SlabResult]:
        """Return the results for sums of waves behind some screens and for the paths of the screens."""
        waves = [wave / self._light for wave in waves]
        if self.by_traced and self.traced is not None:
            return [SlabResult(wave, abs(wave) ** 2 - self.traced, 0.0) for wave in waves]
        by_rays = [(abs(one) / self._light) ** 2 for one in self._rays(paths)]
        apart = [0.0 if self.traced is None else abs(one - self.traced) for one in by_rays]
        return [
            SlabResult(wave, abs(wave) ** 2 - one, more) for wave, one, more in zip(waves, by_rays, apart, strict=True)
        ]

    @cached_property
    def _light(self) -> float:
        """Sum of the initial amplitudes of the rays."""
        return float(np.add.reduce(self.light, axis=None))

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
            return partial(fft.fft, axis=-2), partial(fft.ifft, axis=-2)
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

    def _rays(self, screens: list[np.ndarray]) -> list[complex]:
        """Return the sums of the rays' amplitudes through some screens, with their phases at their starts."""
        near, sums = self.window.near, []
        for paths in screens:
            paths = paths[:, *near]
            sums.append(paths.sum(axis=0))
            if not self.straight:
                step = (self.slabs.last - self.slabs.first) / len(paths)
                sums[-1] += bending(paths, self.window.pixel, step, self.after)
        factors = phase_factor(np.array(sums), self.wavelength)
        factors *= self.light[near]
        return [complex(one.sum()) for one in factors]  # pairwise, which einsum's sum is not


def _one_by_one(paths: np.ndarray, wavelength: float) -> Iterator[np.ndarray]:
    """Yield exp(i k path) of each slab; several small slabs are computed at once to save NumPy calls."""
    some = max(1, TOGETHER // paths[0].size)
    for first in range(0, len(paths), some):
        yield from phase_factor(paths[first : first + some], wavelength)


def phase_factor(path: np.ndarray, wavelength: float) -> np.ndarray:
    """Return exp(i k path) of paths [m], single precision; sine and cosine are much faster than a complex exp."""
    phase = path * np.float32(2.0 * np.pi / wavelength)
    made = np.empty(path.shape, dtype=np.complex64)
    np.cos(phase, out=made.real)
    np.sin(phase, out=made.imag)
    return made
