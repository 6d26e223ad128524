r"""Change of the Strehl ratio of a traced wavefront by diffraction, from the wavefront alone, by two phase screens.

Half of the wavefront's phase is put on either side of free space, whose length is the one over which the light is
disturbed. This must be cheap even compared with a wavefront of a few rays: the pixels are as coarse as the finest phase
allows, and the length, which depends on the field and the pupil only, is cached on the field.
"""

import math
import weakref
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..medium.tensor_points import contrast_without_gradient
from ..pupils import Pupil
from ..tracing.lines import box_span
from ..wavefront import Wavefront
from .diffraction import phase_factor

# Margin of the window on each side of the pupil: in widths sqrt(wavelength length); fewest pixels; most for both sides
# together, over the pupil's width. Pixels across the pupil: most, and fewest while the half period of the finest phase
# has PER_FEATURE pixels or more.
BESIDE, FEWEST_BESIDE, MOST_BESIDE, MOST_PIXELS, FEWEST_PIXELS, PER_FEATURE = 3.0, 4, 0.5, 64, 32, 6.0
# Rays are near a focus where curvature times distance exceeds this: there the second order in their deflection does not
# give their paths.
NEAR_FOCUS = 0.5
# Two screens are used up to this curvature times distance.
FLAT = 0.3
# Lines of sight across the pupil and layers along them that give the disturbed length; lengths cached on a field.
LINES, LINE_LAYERS, NODE_LAYERS, KEPT = 4, 32, 64, 8
GOLDEN = 0.5 * (5.0**0.5 - 1.0)


@dataclass(frozen=True)
class Crossings:
    """Crossing and focusing of rays over a distance.

    Attributes:
        crossed: Share of the pupil where rays cross.
        curvature: Greatest focusing curvature times the distance.
        near: Share of the pupil where this product exceeds NEAR_FOCUS.
    """

    crossed: float
    curvature: float
    near: float


@dataclass(frozen=True)
class ScreensAnswer:
    """Result of the two screens.

    Attributes:
        change: Strehl ratio of the two screens minus the one of the whole phase at once.
        length: The disturbed length [m].
        crossings: Crossing and focusing of the wavefront's rays over that length.
    """

    change: float
    length: float
    crossings: Crossings


@dataclass(frozen=True, eq=False)
class MapPaths:
    """A traced map for the verdict: in single precision, without a common delay.

    Attributes:
        path: Optical path [m], float32, NaN outside the pupil, shape (rows, columns).
        light: Weight of each pixel, float32, shape (rows, columns).
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
    """

    path: np.ndarray
    light: np.ndarray
    pixel: float
    wavelength: float

    @cached_property
    def strehl(self) -> float:
        """Strehl ratio, several times faster than `Wavefront.strehl`."""
        path = np.where(self.light > 0.0, self.path, np.float32(0.0))
        return float(abs((self.light * phase_factor(path, self.wavelength)).sum()) ** 2 / self.light.sum() ** 2)

    def every(self, stride: int) -> "MapPaths":
        """Return the map of every `stride`-th row and column."""
        part = slice(stride // 2, None, stride)
        return MapPaths(self.path[part, part], self.light[part, part], stride * self.pixel, self.wavelength)


def paths_of(wavefront: Wavefront) -> MapPaths:
    """Return the paths of a wavefront's map."""
    path = wavefront.opd - wavefront.opd.flat[wavefront.weight.argmax()]
    return MapPaths(path.astype(np.float32), wavefront.weight.astype(np.float32), wavefront.pixel, wavefront.wavelength)


def screens_answer(
    field: IndexField, pupil: Pupil, look: np.ndarray, paths: MapPaths, feature: float
) -> ScreensAnswer | None:
    """Return the result for a map whose finest phase has half period `feature` [m]; None if rays come near foci."""
    length = disturbance(field, pupil, look).length
    paths = paths.every(stride_of(len(paths.path), paths.pixel, feature))
    crossings = crossings_of(paths.path, paths.pixel, paths.light, length)
    if crossings.crossed > 0.0 or crossings.curvature > FLAT:
        return None
    return ScreensAnswer(_two_screens(paths, field.ambient_index, length), length, crossings)


@dataclass(frozen=True)
class Disturbance:
    """The range over which a pupil's light is disturbed, as an even distribution.

    Attributes:
        length: Length of the range [m].
        until: Distance from the pupil to its end [m].
    """

    length: float
    until: float


def disturbance(field: IndexField, pupil: Pupil, look: np.ndarray) -> Disturbance:
    """Return the range over which a pupil's light is disturbed, cached on the field."""
    key = ("disturbance", weakref.ref(pupil), look.tobytes())
    found: Disturbance = field.derive(key, lambda: _on_lines(field, pupil, look), KEPT)
    return found


def stride_of(count: int, pixel: float, feature: float) -> int:
    """Return the stride at which the pixels of a map are used."""
    stride = -(-count // MOST_PIXELS)
    while count // (2 * stride) >= FEWEST_PIXELS and feature >= PER_FEATURE * 2.0 * stride * pixel:
        stride *= 2
    return stride


def places_across(pupil: Pupil, count: int) -> np.ndarray:
    """Return coordinates across a pupil [m] that are not commensurate with any grating."""
    return max(pupil.half_extent) * (2.0 * ((np.arange(count) + 0.5) * GOLDEN % 1.0) - 1.0)


def _on_lines(field: IndexField, pupil: Pupil, look: np.ndarray) -> Disturbance:
    """Return the range over which light is disturbed, from a few lines through the pupil."""
    place = places_across(pupil, LINES)
    x, y = np.tile(place, LINES), np.repeat(place, LINES)
    lit = pupil.transmission(x, y) > 0.0
    if lit.any():
        x, y = x[lit], y[lit]
    if isinstance(field.samples, UniformGrid) and abs(abs(float(look[2])) - 1.0) < 1e-15:
        return _by_nodes(field, field.samples, pupil, float(look[2]), x, y)
    first, second = pupil.axes
    start = pupil.center + x[:, None] * first + y[:, None] * second
    span = box_span(field, start, np.broadcast_to(look, start.shape).copy())
    meets = span.meets & (span.leave > 0.0) & (span.leave < 1e30)
    if not meets.any():
        return Disturbance(0.0, 0.0)
    begin, end = max(float(span.enter[meets].min()), 0.0), float(span.leave[meets].max())
    depth = begin + (end - begin) * (np.arange(LINE_LAYERS) + 0.5) / LINE_LAYERS
    points = start + depth[:, None, None] * look
    layers = contrast_without_gradient(field, points.reshape(-1, 3)).reshape(LINE_LAYERS, len(start))
    return spread_along(layers, begin, end)


def _by_nodes(field: IndexField, grid: UniformGrid, pupil: Pupil, sign: float, x, y) -> Disturbance:
    """Return the range for lines along z of a grid, from the nearest nodes: a width needs no interpolant."""
    center, (first, second) = pupil.center, pupil.axes
    points = center + x[:, None] * first + y[:, None] * second
    place = field.local_coordinates(points)[:, :-1]
    node = np.rint((place - grid.origin[:-1]) / grid.spacing[:-1]).astype(int)
    inside = ((node >= 0) & (node < grid.shape[:-1])).all(axis=1)
    ends = (float(center[2]) - grid.origin[-1]) / grid.spacing[-1]
    count = grid.shape[-1]
    begin, end = (max(0, math.ceil(ends)), count) if sign > 0.0 else (0, min(count, math.floor(ends) + 1))
    step = max(1, (end - begin) // NODE_LAYERS)
    if end - begin < 2 or not inside.any():
        return Disturbance(0.0, 0.0)
    # Outside the box the contrast is zero.
    lines = grid.samples[(*(node * inside[:, None]).T, slice(begin, end, step))] * inside[:, None]
    distance = sign * (
        float(grid.spacing[-1]) * np.array([begin, begin + step * lines.shape[1]]) - ends * grid.spacing[-1]
    )
    return spread_along(lines.T, *distance.tolist())


def spread_along(layers: np.ndarray, begin: float, end: float) -> Disturbance:
    """Return the even distribution with the mean and standard deviation of the disturbance of `layers` (layers, lines).

    `begin` and `end` are distances from the pupil [m] of the first and the last layer's outer faces, in either order.
    """
    layers = layers - (np.einsum("ij->i", layers) / layers.shape[1])[:, None]
    weight = np.einsum("ij,ij->i", layers, layers)
    total = float(np.einsum("i->", weight))
    if not total > 0.0:
        return Disturbance(0.0, 0.0)
    step = (end - begin) / len(layers)
    place = begin + (np.arange(len(layers)) + 0.5) * step
    middle = float(np.einsum("i,i->", place, weight)) / total
    place -= middle
    length = math.sqrt(12.0 * float(np.einsum("i,i,i->", place, place, weight)) / total + step**2)
    return Disturbance(length, middle + 0.5 * length)


def _two_screens(paths: MapPaths, ambient_index: float, length: float) -> float:
    """Return the Strehl ratio of two half screens with free space between minus the one of the whole phase.

    The screens are as far apart as twice the standard deviation of an even distribution over the length. Light that
    leaves the pupil sideways meets no phase there, so the mean phase is removed: a common delay does not matter, and
    would be a step around the pupil.
    """
    from scipy.fft import fft2, ifft2, next_fast_len

    path, light, pixel, wavelength, count = paths.path, paths.light, paths.pixel, paths.wavelength, len(paths.path)
    # A margin for the light that diffracts out of the pupil.
    beside = max(FEWEST_BESIDE, math.ceil(BESIDE * math.sqrt(wavelength * length) / pixel))
    size = next_fast_len(count + min(2 * beside, math.ceil(MOST_BESIDE * count)))
    whole_light = float(light.sum())
    path = np.where(light > 0.0, path, np.float32(0.0))
    mean = float(np.einsum("ij,ij->", path, light)) / whole_light
    half = phase_factor(np.where(light > 0.0, np.float32(0.5) * (path - np.float32(mean)), np.float32(0.0)), wavelength)
    wave = light * half
    whole = np.einsum("ij,ij->", half, wave)
    across = 2.0 * np.pi * np.fft.fftfreq(size, pixel)
    distance = 0.5 * length / math.sqrt(3.0) * wavelength / (2.0 * np.pi * ambient_index)
    free = np.exp(-1j * distance * across**2).astype(np.complex64)
    # No matrix products: BLAS would wake its threads, which takes longer than these few operations.
    spectrum = fft2(wave, s=(size, size))
    spectrum *= free[:, None]
    spectrum *= free
    between = ifft2(spectrum, overwrite_x=True)[:count, :count]
    # Outside the pupil the second screen has no phase, and free space conserves the total sum.
    half -= np.float32(1.0)
    total = wave.sum() + np.einsum("ij,ij->", half, between)
    return (abs(complex(total)) ** 2 - abs(complex(whole)) ** 2) / whole_light**2


def crossings_of(path: np.ndarray, pixel: float, light: np.ndarray, distance: float) -> Crossings:
    """Return crossing and focusing over a distance [m], from paths [m] and light, without two pixels at the rim."""
    row, mixed, column = _curvatures(path, distance / (4.0 * pixel**2))
    light = light[2:-2, 2:-2] if path.shape[1] > 1 else light[2:-2]
    middle, spread = 0.5 * (row + column), np.sqrt((0.5 * (row - column)) ** 2 + mixed**2)
    light = np.where(np.isfinite(middle + spread), light, 0.0)
    whole = float(light.sum())
    if not whole > 0.0:
        return Crossings(0.0, 0.0, 0.0)
    focusing = spread - middle  # light turns toward the delayed side: a negative curvature focuses
    crossed, near = (
        float((light * there).sum()) / whole
        for there in ((1.0 - focusing) * (1.0 + middle + spread) < 0.0, focusing > NEAR_FOCUS)
    )
    return Crossings(crossed, float(focusing.max(initial=0.0, where=light > 0.0)), near)


def _curvatures(path: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return second derivatives of a map along y, mixed, and along x, by differences over four pixels, times a factor.

    The results exclude two pixels on each side; for one column only the derivative along y is not zero.
    """
    if path.shape[1] == 1:
        row = scale * (path[4:] + path[:-4] - 2.0 * path[2:-2])
        return row, np.zeros_like(row), np.zeros_like(row)
    twice = 2.0 * path[2:-2, 2:-2]
    row, column = path[4:, 2:-2] + path[:-4, 2:-2] - twice, path[2:-2, 4:] + path[2:-2, :-4] - twice
    mixed = path[3:-1, 3:-1] + path[1:-3, 1:-3] - path[3:-1, 1:-3] - path[1:-3, 3:-1]
    return scale * row, scale * mixed, scale * column
