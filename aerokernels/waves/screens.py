r"""The rays' own answer: what diffraction changes of the Strehl ratio of a traced wavefront, by two screens.

Half of its phase stands on either side of free space of the length over which the light is disturbed. It must cost
little even beside a wavefront that is a fan of a few rays: its pixels are as coarse as its finest phase allows, and the
length, which is one of the field and the pupil, is kept with the field.
"""

import math
import weakref
from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..medium.tensor_points import contrast_without_gradient
from ..pupils import Pupil
from ..tracing.lines import box_span
from ..wavefront import Wavefront
from .diffraction import phase_factor, slope

# The window over the pupil. Pixels across it: at most, and at least where the finest phase leaves a choice of so many
# pixels to its half period or more.
WINDOW, MOST_PIXELS, FEWEST_PIXELS, PER_FEATURE = 1.5, 64, 32, 6.0
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


def strehl_of(wavefront: Wavefront) -> float:
    """A map's Strehl ratio as it stands, in single precision and a small part of the time of `Wavefront.strehl`."""
    weight, opd = wavefront.weight, wavefront.opd
    path = np.where(weight > 0.0, opd - opd.flat[weight.argmax()], 0.0).astype(np.float32)
    light = weight.astype(np.float32)
    return float(abs((light * phase_factor(path, wavefront.wavelength)).sum()) ** 2 / light.sum() ** 2)


def screens_answer(
    field: IndexField, pupil: Pupil, look: np.ndarray, wavefront: Wavefront, wavelength: float, feature: float
) -> ScreensAnswer | None:
    """What a wavefront says whose finest phase has a half period of `feature` [m]; None where rays come near foci."""
    length = disturbed_length(field, pupil, look)
    stride = stride_of(len(wavefront.opd), wavefront.pixel, feature)
    pixel = stride * wavefront.pixel
    opd, weight = (array[stride // 2 :: stride, stride // 2 :: stride] for array in (wavefront.opd, wavefront.weight))
    crossings = crossings_of(opd, pixel, weight, length)
    if crossings.crossed > 0.0 or crossings.curvature > FLAT:
        return None
    change = _two_screens(opd, weight, pixel, wavelength, field.ambient_index, length)
    return ScreensAnswer(change, length, crossings)


def disturbed_length(field: IndexField, pupil: Pupil, look: np.ndarray) -> float:
    """The length over which a pupil's light is disturbed [m], kept with the field."""
    key = ("disturbed length", weakref.ref(pupil), look.tobytes())
    length: float = field.derive(key, lambda: _length_on_lines(field, pupil, look), KEPT)
    return length


def stride_of(count: int, pixel: float, feature: float) -> int:
    """Every so many pixels of a map are looked at."""
    stride = -(-count // MOST_PIXELS)
    while count // (2 * stride) >= FEWEST_PIXELS and feature >= PER_FEATURE * 2.0 * stride * pixel:
        stride *= 2
    return stride


def places_across(pupil: Pupil, count: int) -> np.ndarray:
    """Places across a pupil [m] that no grating has in common with them."""
    return max(pupil.half_extent) * (2.0 * ((np.arange(count) + 0.5) * GOLDEN % 1.0) - 1.0)


def _length_on_lines(field: IndexField, pupil: Pupil, look: np.ndarray) -> float:
    """The disturbed length [m], by a few lines through the pupil."""
    x, y = (axis.ravel() for axis in np.meshgrid(*(2 * [places_across(pupil, LINES)])))
    lit = pupil.transmission(x, y) > 0.0
    if lit.any():
        x, y = x[lit], y[lit]
    if isinstance(field.samples, UniformGrid) and abs(abs(float(look[2])) - 1.0) < 1e-15:
        return _length_by_nodes(field, field.samples, pupil, float(look[2]), x, y)
    first, second = pupil.axes
    start = pupil.center + x[:, None] * first + y[:, None] * second
    span = box_span(field, start, np.broadcast_to(look, start.shape).copy())
    meets = span.meets & (span.leave > 0.0) & (span.leave < 1e30)
    if not meets.any():
        return 0.0
    begin, end = max(float(span.enter[meets].min()), 0.0), float(span.leave[meets].max())
    depth = begin + (end - begin) * (np.arange(LINE_LAYERS) + 0.5) / LINE_LAYERS
    points = start + depth[:, None, None] * look
    layers = contrast_without_gradient(field, points.reshape(-1, 3)).reshape(LINE_LAYERS, len(start))
    return spread_along(layers, end - begin)


def _length_by_nodes(field: IndexField, grid: UniformGrid, pupil: Pupil, sign: float, x, y) -> float:
    """The same of lines along z of a grid, at the nodes beside them: no interpolant is needed for a width."""
    center, axes = pupil.center, pupil.axes
    points = center + np.asarray(x)[:, None] * axes[0] + np.asarray(y)[:, None] * axes[1]
    local = field.local_coordinates(points)[:, :-1]
    node = np.rint((local - grid.origin[:-1]) / grid.spacing[:-1]).astype(int)
    inside = ((node >= 0) & (node < grid.shape[:-1])).all(axis=1)
    ends = (float(center[2]) - grid.origin[-1]) / grid.spacing[-1]
    count = grid.shape[-1]
    first, last = (max(0, math.ceil(ends)), count) if sign > 0.0 else (0, min(count, math.floor(ends) + 1))
    step = max(1, (last - first) // NODE_LAYERS)
    if last - first < 2 or not inside.any():
        return 0.0
    lines = np.zeros((len(x), len(range(first, last, step))))
    lines[inside] = grid.samples[(*node[inside].T, slice(first, last, step))]
    return spread_along(lines.T, step * lines.shape[1] * float(grid.spacing[-1]))


def spread_along(layers: np.ndarray, length: float) -> float:
    """Length of an even spread with the standard deviation of the disturbance of lines (layers, lines) [m]."""
    layers = layers - (np.einsum("ij->i", layers) / layers.shape[1])[:, None]
    weight = np.einsum("ij,ij->i", layers, layers)
    total = float(np.einsum("i->", weight))
    if not total > 0.0:
        return 0.0
    step = length / len(layers)
    place = (np.arange(len(layers)) + 0.5) * step
    place -= float(np.einsum("i,i->", place, weight)) / total
    return math.sqrt(12.0 * float(np.einsum("i,i,i->", place, place, weight)) / total + step**2)


def _two_screens(
    opd: np.ndarray, weight: np.ndarray, pixel: float, wavelength: float, ambient_index: float, length: float
) -> float:
    """Strehl ratio of half the phase, free space and the other half, less that of the whole phase at once.

    Two sheets are as far apart as an even spread over the length is wide, twice its standard deviation. Light that
    leaves the pupil sideways meets no phase there. So the mean is taken out: what delays all alike is of no account,
    and would stand as a step about the pupil.
    """
    from scipy.fft import fft2, ifft2

    lit, count, size = weight > 0.0, len(opd), fast_size(int(np.ceil(WINDOW * len(opd))))
    light = float(np.einsum("ij->", weight))
    path = np.where(lit, opd, 0.0)
    path -= np.einsum("ij,ij->", path, weight) / light
    half = phase_factor(np.where(lit, 0.5 * path, 0.0).astype(np.float32), wavelength)
    wave = weight.astype(np.float32) * half
    whole = np.einsum("ij,ij->", half, wave)
    across = 2.0 * np.pi * np.fft.fftfreq(size, pixel)
    way = 0.5 * length / np.sqrt(3.0) * wavelength / (2.0 * np.pi * ambient_index)
    free = np.exp(-1j * way * across**2).astype(np.complex64)
    # No products of matrices, though they are few numbers: BLAS would wake its threads, which takes longer than that.
    spectrum = fft2(wave, s=(size, size))
    spectrum *= free[:, None]
    spectrum *= free
    between = ifft2(spectrum, overwrite_x=True)[:count, :count]
    # Beside the pupil there is no phase, and free space leaves the sum of all alone.
    total = np.einsum("ij->", wave) + np.einsum("ij,ij->", half - np.float32(1.0), between)
    return float((abs(complex(total)) ** 2 - abs(complex(whole)) ** 2) / light**2)


def fast_size(count: int) -> int:
    """The next size that a transform is quick for."""
    from scipy.fft import next_fast_len

    return int(next_fast_len(count))


def crossings_of(path: np.ndarray, pixel: float, light: np.ndarray, distance: float) -> Crossings:
    """What rays do over a distance [m], by their paths [m] and the light of each pixel."""
    row, mixed, column = _curvatures(path, pixel)
    known = (light > 0.0) & np.isfinite(row + column + mixed)
    if not known.any():
        return Crossings(0.0, 0.0, 0.0)
    row, mixed, column, light = row[known], mixed[known], column[known], light[known]
    middle, spread = 0.5 * (row + column), np.hypot(0.5 * (row - column), mixed)
    focusing = -distance * (middle - spread)  # light turns toward where it is delayed: a negative one focuses
    least, greatest = 1.0 - focusing, 1.0 + distance * (middle + spread)
    crossed, near = (
        float(light[there].sum() / light.sum()) for there in (least * greatest < 0.0, focusing > NEAR_FOCUS)
    )
    return Crossings(crossed, float(focusing.max(initial=0.0)), near)


def _curvatures(path: np.ndarray, pixel: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second derivatives of a map along y, mixed, and along x; of one column, along y alone."""
    along_y = slope(path, pixel, 0)
    row = slope(along_y, pixel, 0)
    if path.shape[1] == 1:
        return row, np.zeros_like(row), np.zeros_like(row)
    return row, slope(along_y, pixel, 1), slope(slope(path, pixel, 1), pixel, 1)
