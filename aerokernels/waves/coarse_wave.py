"""Change of a Strehl ratio by diffraction: a coarse split-step wave and bent rays through the same thin screens.

The Strehl ratio is the squared sum of the amplitude, which free space conserves, so that propagation behind the last
screen does not matter. In a planar field seen across its axis Fourier components along x do not mix, and the sum
contains only the constant one: one column of pixels is enough.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..medium import IndexField
from ..pupils import Pupil
from ..tracing.lines import box_size
from .layers import along_z, mean_layers, path_range
from .split_step import fourier_library, plane_wave, through_layers
from .wave import Wave, propagated

# Most slabs of the disturbed air.
FINEST = 64


@dataclass(frozen=True, eq=False)
class Slabs:
    """FINEST slabs of equal thickness of the disturbed air in the view of a window."""

    wave: Wave  # the pupil's light on the window
    # Optical paths [m], float32, shape (FINEST, rows, columns), without a delay common to all lines of a slab.
    paths: np.ndarray
    opaque: np.ndarray | None  # masks of where light ends on a body, of the same shape; None if it does not
    light: np.ndarray  # amplitude of the light whose rays pass the body, shape (rows, columns)
    first: float  # start of the slabs along the line of sight [m]
    last: float  # end of the slabs [m]
    end: float  # end of the field's box [m]
    disturbed: float  # length over which the light is disturbed [m]

    @property
    def path(self) -> np.ndarray:
        """Optical paths of straight lines [m], shape (rows, columns)."""
        return np.asarray(self.paths.sum(axis=0, dtype=np.float64))

    @property
    def blocked(self) -> float:
        """Share of the light that ends on a body."""
        amplitude = self.wave.amplitude.real
        return max(1.0 - float((self.light**2).sum() / (amplitude**2).sum()), 0.0)

    @property
    def column_width(self) -> float:
        """Width of a column of pixels [m]: the window's if there is one."""
        rows, columns = self.wave.amplitude.shape
        return self.wave.pixel * (rows if columns == 1 else 1)


def slabs_of(field: IndexField, pupil: Pupil, wavelength: float) -> Slabs:
    """Return the slabs of a field in the view of a pupil, on pixels that resolve the finest phase."""
    from scipy.fft import next_fast_len

    reach, flat = max(pupil.half_extent), field.geometry == "planar" and abs(float(pupil.normal[0])) < 1e-15
    begin, end = path_range(field, plane_wave(pupil, wavelength, 16, 1.0, field.ambient_index))
    # The light of a pupil diffracts by some widths sqrt(wavelength distance); the fringes of a rim reach farther.
    fringes = 0.0 if field.body is None else 4.0 * math.sqrt(wavelength * box_size(field))
    half = max(min(1.15 * reach + 2.0 * math.sqrt(wavelength * end), 4.0 * reach), reach + fringes)

    def window(pixels: float) -> Wave:
        wave = plane_wave(pupil, wavelength, next_fast_len(math.ceil(pixels)), half / reach, field.ambient_index)
        if not flat:
            return wave
        edges = wave.pixel * (np.arange(len(wave.amplitude) + 1) - len(wave.amplitude) // 2 - 0.5)
        return replace(wave, amplitude=pupil.coverage(edges[[0, -1]], edges), incident=None)

    least, most = (256, 512) if flat else (96, 192 if along_z(field, pupil.normal) else 96)
    first, last, disturbed = _disturbed(field, window(least // 4), begin, end)
    for pixels in (least, most):
        wave = window(max(pixels, 32.0 * half / reach))
        paths, opaque = mean_layers(field, wave, first, last, FINEST, most_parts=None if most > least else 1)
        # The delay of a line common to a slab would cost digits of the differences.
        paths -= paths[:, :1, :1]
        lit = wave.amplitude.real > 0.0
        feature = finest_phase(np.where(lit, paths.sum(axis=0), np.nan), wave.pixel, wavelength)
        # A rim makes fringes as fine as the pixels allow.
        if 3.0 * wave.pixel <= feature and (opaque is None or not opaque.any()):
            break
    light = wave.amplitude.real
    if opaque is not None and opaque.any():
        dark = np.asarray(opaque.any(axis=0))
        light = np.where(dark, 0.0, light)
        if not light.any():
            raise ValueError("the body blocks all of the pupil's light: move the pupil, or turn its normal")
        paths = _continued(paths, dark)
    else:
        opaque = None
    return Slabs(wave, paths, opaque, light, first, last, end, disturbed)


def finest_phase(path: np.ndarray, pixel: float, wavelength: float) -> float:
    """Return the half period [m] of the finest phase of a map above 0.03 rad rms; infinite if there is none.

    `path` [m] is NaN outside the pupil, shape (n, n) or (n, 1). A component of period p has its full amplitude in
    second differences at a distance of p / 2, four times its own; they do not depend on tilt and the pupil's edge.
    """
    wave_number, stride = 2.0 * np.pi / wavelength, 1
    while 2 * stride < len(path):
        squares = 0.0
        for lines in (path, path.T) if path.shape[1] > 1 else (path,):
            second = lines[2 * stride :] + lines[: -2 * stride] - 2.0 * lines[stride:-stride]
            known = np.isfinite(second)
            squares += float(np.square(second[known]).sum()) / max(int(known.sum()), 1)
        if wave_number * math.sqrt(squares / 8.0) > 0.06:
            return stride * pixel
        stride *= 2
    return math.inf


def _continued(paths: np.ndarray, dark: np.ndarray) -> np.ndarray:
    """Return paths that continue into a shadow from beside it, so that a rim makes no slope."""
    from scipy.ndimage import distance_transform_edt

    row, column = distance_transform_edt(dark, return_distances=False, return_indices=True)
    return np.asarray(paths[:, row, column])


def _disturbed(field: IndexField, wave: Wave, begin: float, end: float) -> tuple[float, float, float]:
    """Return between which distances [m] the air differs across a coarse window, and the length of the disturbance.

    At either end a phase of 0.01 rad is left out. The length is that of an even distribution of the same variance.
    """
    paths, opaque = mean_layers(field, wave, begin, end, 4 * FINEST, most_parts=4)
    step, wave_number = (end - begin) / len(paths), 2.0 * np.pi / wave.wavelength
    lit = wave.amplitude.real > 0.0
    first, last = begin, end
    if opaque is None or not opaque.any():
        phase = wave_number * (paths.max(axis=(1, 2)) - paths.min(axis=(1, 2)))
        known = np.flatnonzero((np.cumsum(phase) > 0.01) & (np.cumsum(phase[::-1])[::-1] > 0.01))
        if len(known):
            first, last = begin + step * max(int(known[0]) - 1, 0), begin + step * min(int(known[-1]) + 2, len(paths))
    elif (lit & ~opaque.any(axis=0)).any():
        lit &= ~opaque.any(axis=0)
    variance, place = paths[:, lit].var(axis=1, dtype=np.float64), np.arange(len(paths))
    total = float(variance.sum())
    if not total > 0.0:
        return first, last, 0.0
    middle = float(place @ variance) / total
    square = float((place - middle) ** 2 @ variance) / total
    return first, last, step * math.sqrt(12.0 * square + 1.0)


@dataclass(frozen=True, eq=False)
class WaveAndRays:
    """A wave and rays through slabs."""

    slabs: Slabs
    straight: bool  # whether the slabs' rays are straight, near foci
    traced: float | None = None  # Strehl ratio of traced rays; None if there are none
    by_traced: bool = False  # whether the wave is compared with the traced rays

    def change(self, limit: float) -> tuple[float, float]:
        """Return the Strehl ratio of the wave minus the one of the rays, and its error, well enough for a limit."""
        if self.slabs.opaque is not None:
            wave = self._wave(FINEST)
            return abs(wave) ** 2 - self._rays(FINEST), math.nan
        count, before, wave = 2, self._wave(2), self._wave(4)
        rays_before, rays = (self._rays(2), self._rays(4)) if not self.by_traced else (self.traced, self.traced)
        while True:
            count *= 2
            assert rays is not None and rays_before is not None
            change = abs(wave) ** 2 - rays
            # Of a wave alone the complex sums are compared: two Strehl ratios may agree by chance.
            if self.by_traced:
                doubt = abs(wave - before) * (abs(wave) + abs(before))
            else:
                doubt = abs(change - (abs(before) ** 2 - rays_before))
            if count >= FINEST or doubt <= max(0.05 * limit, 0.5 * abs(abs(change) - limit)):
                break
            before, wave = wave, self._wave(2 * count)
            rays_before, rays = (rays, self._rays(2 * count)) if not self.by_traced else (rays, rays)
        if self.straight and not self.by_traced:
            return change, math.inf
        return change, max(doubt, 0.0 if self.traced is None else abs(rays - self.traced))

    def _screens(self, count: int) -> np.ndarray:
        """Return the paths of `count` slabs [m], shape (count, rows, columns)."""
        paths = self.slabs.paths
        return np.asarray(paths.reshape(count, -1, *paths.shape[1:]).sum(axis=1))

    def _wave(self, count: int) -> complex:
        """Return the sum of the wave behind so many screens over that of the light."""
        slabs = self.slabs
        start = propagated(slabs.wave, slabs.first, paraxial=True)
        found = through_layers(
            start,
            slabs.paths,
            slabs.opaque,
            count,
            length=slabs.last - slabs.first,
            paraxial=True,
            library=fourier_library(),
            precision="float32",
        )
        return complex(found.sum()) / float(slabs.light.sum())

    def _rays(self, count: int) -> float:
        """Return the Strehl ratio of rays through so many screens, with their phases at their starts."""
        slabs, screens = self.slabs, self._screens(count)
        path = slabs.path
        if not self.straight:
            step = (slabs.last - slabs.first) / count
            path = path + bending(screens, slabs.wave.pixel, step, slabs.end - slabs.last)
        total = (slabs.light * np.exp(2j * np.pi / slabs.wave.wavelength * path)).sum()
        return float(abs(total / slabs.light.sum()) ** 2)


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
        Excess path [m], shape (rows, columns).
    """
    axes = [axis for axis in (0, 1) if paths.shape[axis + 1] > 1]
    excess, reach = np.zeros(paths.shape[1:]), max(paths.shape[1:]) * pixel
    turn, aside = np.zeros((2, len(axes), *excess.shape))
    for number, path in enumerate(paths.astype(np.float64)):
        slopes = np.array([np.gradient(path, pixel, axis=axis) for axis in axes])
        if number:
            more = sum(
                np.gradient(slopes, pixel, axis=axis + 1) * moved for axis, moved in zip(axes, aside, strict=True)
            )
            excess += (aside * (slopes + 0.5 * more)).sum(axis=0)
            slopes += more
        turn += slopes
        distance = 0.5 * step + after if number == len(paths) - 1 else step
        excess += 0.5 * distance * (turn**2).sum(axis=0)
        # Slopes of the jump at the box's side, where there is no light, must not overflow.
        aside = np.clip(aside + distance * turn, -reach, reach)
    return excess
