r"""The rays' own answer: what diffraction changes of the Strehl ratio of a traced wavefront, by two screens.

Half of its phase stands on either side of free space of the length over which the light is disturbed. It must cost
little even beside a wavefront that is a fan of a few rays: its pixels are as coarse as its finest phase allows, and the
length, which is one of the field and the pupil, is kept with the field.
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

# The window beside the pupil on each side: in widths sqrt(wavelength length), pixels at least, and over the pupil's
# width, both together, at most. Pixels across the pupil: at most, and at least where the finest phase leaves a choice
# of so many pixels to its half period or more.
BESIDE, FEWEST_BESIDE, MOST_BESIDE, MOST_PIXELS, FEWEST_PIXELS, PER_FEATURE = 3.0, 4, 0.5, 64, 32, 6.0
# Rays are straight where curvature times distance is more than this: near their foci second order in their turn says
# nothing of where they go.
NEAR_FOCUS = 0.5
# The greatest curvature times distance that two screens are asked about.
FLAT = 0.3
# Lines of sight across the pupil and layers along them by which the disturbed length is found, and lengths kept.
LINES, LINE_LAYERS, NODE_LAYERS, KEPT = 4, 32, 64, 8
GOLDEN = 0.5 * (5.0**0.5 - 1.0)


@dataclass(frozen=True)
class Crossings:
    """What rays do over a distance.

    Attributes:
        crossed: Share of the pupil where they cross.
        curvature: The greatest focusing curvature times the distance.
        near: Share of the pupil where that is greater than NEAR_FOCUS.
    """

    crossed: float
    curvature: float
    near: float


@dataclass(frozen=True)
class ScreensAnswer:
    """What the two screens say.

    Attributes:
        change: Strehl ratio of the two screens less that of the whole phase at once.
        length: The disturbed length [m].
        crossings: What the wavefront's rays do over it.
    """

    change: float
    length: float
    crossings: Crossings


@dataclass(frozen=True, eq=False)
class MapPaths:
    """A traced map as the verdict looks at it: in single precision, less what delays all alike.

    Attributes:
        path: Optical path [m], float32, NaN where there is no light, shape (rows, columns).
        light: Weight of each pixel, float32, shape (rows, columns).
        pixel: Side of a pixel [m].
        wavelength: In vacuum [m].
    """

    path: np.ndarray
    light: np.ndarray
    pixel: float
    wavelength: float

    @cached_property
    def strehl(self) -> float:
        """The Strehl ratio, in a small part of the time of `Wavefront.strehl`."""
        path = np.where(self.light > 0.0, self.path, np.float32(0.0))
        return float(abs((self.light * phase_factor(path, self.wavelength)).sum()) ** 2 / self.light.sum() ** 2)

    def every(self, stride: int) -> "MapPaths":
        """Every so many pixels either way."""
        part = slice(stride // 2, None, stride)
        return MapPaths(self.path[part, part], self.light[part, part], stride * self.pixel, self.wavelength)


def paths_of(wavefront: Wavefront) -> MapPaths:
    """The paths of a wavefront's map."""
    path = wavefront.opd - wavefront.opd.flat[wavefront.weight.argmax()]
    return MapPaths(path.astype(np.float32), wavefront.weight.astype(np.float32), wavefront.pixel, wavefront.wavelength)


def screens_answer(
    field: IndexField, pupil: Pupil, look: np.ndarray, paths: MapPaths, feature: float
) -> ScreensAnswer | None:
    """What a map says whose finest phase has a half period of `feature` [m]; None where rays come near foci."""
    length = disturbance(field, pupil, look).length
    paths = paths.every(stride_of(len(paths.path), paths.pixel, feature))
    crossings = crossings_of(paths.path, paths.pixel, paths.light, length)
    if crossings.crossed > 0.0 or crossings.curvature > FLAT:
        return None
    return ScreensAnswer(_two_screens(paths, field.ambient_index, length), length, crossings)


@dataclass(frozen=True)
class Disturbance:
    """Where a pupil's light is disturbed, as if evenly.

    Attributes:
        length: Over how long a way [m].
        until: How far from the pupil that ends [m].
    """

    length: float
    until: float


def disturbance(field: IndexField, pupil: Pupil, look: np.ndarray) -> Disturbance:
    """Where a pupil's light is disturbed, kept with the field."""
    key = ("disturbance", weakref.ref(pupil), look.tobytes())
    found: Disturbance = field.derive(key, lambda: _on_lines(field, pupil, look), KEPT)
    return found


def stride_of(count: int, pixel: float, feature: float) -> int:
    """Every so many pixels of a map are looked at."""
    stride = -(-count // MOST_PIXELS)
    while count // (2 * stride) >= FEWEST_PIXELS and feature >= PER_FEATURE * 2.0 * stride * pixel:
        stride *= 2
    return stride


def places_across(pupil: Pupil, count: int) -> np.ndarray:
    """Places across a pupil [m] that no grating has in common with them."""
    return max(pupil.half_extent) * (2.0 * ((np.arange(count) + 0.5) * GOLDEN % 1.0) - 1.0)


def _on_lines(field: IndexField, pupil: Pupil, look: np.ndarray) -> Disturbance:
    """Where light is disturbed, by a few lines through the pupil."""
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
    """The same of lines along z of a grid, at the nodes beside them: no interpolant is needed for a width."""
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
    # Beside the box there is nothing.
    lines = grid.samples[(*(node * inside[:, None]).T, slice(begin, end, step))] * inside[:, None]
    way = sign * (float(grid.spacing[-1]) * np.array([begin, begin + step * lines.shape[1]]) - ends * grid.spacing[-1])
    return spread_along(lines.T, *way.tolist())


def spread_along(layers: np.ndarray, begin: float, end: float) -> Disturbance:
    """The even spread with the mean and the standard deviation of the disturbance of lines (layers, lines) [m].

    Layers lie between two distances from the pupil [m], of which the first layer's may be the greater.
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
    """Strehl ratio of half the phase, free space and the other half, less that of the whole phase at once.

    Two sheets are as far apart as an even spread over the length is wide, twice its standard deviation. Light that
    leaves the pupil sideways meets no phase there. So the mean is taken out: what delays all alike is of no account,
    and would stand as a step about the pupil.
    """
    from scipy.fft import fft2, ifft2

    path, light, pixel, wavelength, count = paths.path, paths.light, paths.pixel, paths.wavelength, len(paths.path)
    # As much room beside the pupil as light diffracts into.
    beside = max(FEWEST_BESIDE, math.ceil(BESIDE * math.sqrt(wavelength * length) / pixel))
    size = fast_size(count + min(2 * beside, math.ceil(MOST_BESIDE * count)))
    whole_light = float(light.sum())
    path = np.where(light > 0.0, path, np.float32(0.0))
    mean = float(np.einsum("ij,ij->", path, light)) / whole_light
    half = phase_factor(np.where(light > 0.0, np.float32(0.5) * (path - np.float32(mean)), np.float32(0.0)), wavelength)
    wave = light * half
    whole = np.einsum("ij,ij->", half, wave)
    across = 2.0 * np.pi * np.fft.fftfreq(size, pixel)
    way = 0.5 * length / math.sqrt(3.0) * wavelength / (2.0 * np.pi * ambient_index)
    free = np.exp(-1j * way * across**2).astype(np.complex64)
    # No products of matrices, though they are few numbers: BLAS would wake its threads, which takes longer than that.
    spectrum = fft2(wave, s=(size, size))
    spectrum *= free[:, None]
    spectrum *= free
    between = ifft2(spectrum, overwrite_x=True)[:count, :count]
    # Beside the pupil there is no phase, and free space leaves the sum of all alone.
    half -= np.float32(1.0)
    total = wave.sum() + np.einsum("ij,ij->", half, between)
    return (abs(complex(total)) ** 2 - abs(complex(whole)) ** 2) / whole_light**2


def fast_size(count: int) -> int:
    """The next size that a transform is quick for."""
    from scipy.fft import next_fast_len

    return int(next_fast_len(count))


def crossings_of(path: np.ndarray, pixel: float, light: np.ndarray, distance: float) -> Crossings:
    """What rays do over a distance [m], by paths [m] and light of each pixel; not of two at a map's rim."""
    row, mixed, column = _curvatures(path, distance / (4.0 * pixel**2))
    light = light[2:-2, 2:-2] if path.shape[1] > 1 else light[2:-2]
    middle, spread = 0.5 * (row + column), np.sqrt((0.5 * (row - column)) ** 2 + mixed**2)
    light = np.where(np.isfinite(middle + spread), light, 0.0)
    whole = float(light.sum())
    if not whole > 0.0:
        return Crossings(0.0, 0.0, 0.0)
    focusing = spread - middle  # light turns toward where it is delayed: a negative curvature focuses
    crossed, near = (
        float((light * there).sum()) / whole
        for there in ((1.0 - focusing) * (1.0 + middle + spread) < 0.0, focusing > NEAR_FOCUS)
    )
    return Crossings(crossed, float(focusing.max(initial=0.0, where=light > 0.0)), near)


def _curvatures(path: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second derivatives of a map along y, mixed, and along x, by differences over four pixels, times a factor.

    Of the map less two pixels on each side; of one column, along y alone.
    """
    if path.shape[1] == 1:
        row = scale * (path[4:] + path[:-4] - 2.0 * path[2:-2])
        return row, np.zeros_like(row), np.zeros_like(row)
    twice = 2.0 * path[2:-2, 2:-2]
    row, column = path[4:, 2:-2] + path[:-4, 2:-2] - twice, path[2:-2, 4:] + path[2:-2, :-4] - twice
    mixed = path[3:-1, 3:-1] + path[1:-3, 1:-3] - path[3:-1, 1:-3] - path[1:-3, 3:-1]
    return scale * row, scale * mixed, scale * column
