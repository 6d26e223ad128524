r"""Change of the Strehl ratio of a traced wavefront by diffraction, from the wavefront alone, by two phase screens.

Half of the wavefront's phase is put on either side of free space, whose length is the one over which the light is
disturbed. This must be cheap even compared with a wavefront of a few rays: the pixels are as coarse as the finest phase
allows, and the length, which depends on the field and the pupil only, is cached on the field.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..derived import cached_on
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
BESIDE, FEWEST_BESIDE, MOST_BESIDE, MOST_PIXELS, FEWEST_PIXELS, PER_FEATURE = 2.0, 4, 0.5, 64, 32, 4.0
# Rays are near a focus where curvature times distance exceeds this: there the second order in their deflection does not
# give their paths.
NEAR_FOCUS = 0.5
# Two screens are used up to this curvature times distance.
FLAT = 0.3
# Lines of sight across the pupil and layers along them that give the disturbed length; lengths cached on a field.
LINES, LINE_LAYERS, KEPT = 4, 32, 8
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
    def whole_light(self) -> float:
        """Sum of the weights."""
        return float(np.add.reduce(self.light, axis=None))

    @cached_property
    def lit_path(self) -> np.ndarray:
        """Optical path [m], zero outside the pupil."""
        return np.where(self.light > 0.0, self.path, np.float32(0.0))

    @cached_property
    def strehl(self) -> float:
        """Strehl ratio, several times faster than `Wavefront.strehl`."""
        total = complex((self.light * phase_factor(self.lit_path, self.wavelength)).sum())
        return (abs(total) / self.whole_light) ** 2

    def every(self, stride: int) -> "MapPaths":
        """Return the map of every `stride`-th row and column."""
        if stride == 1:
            return self
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


@cached_on("field", KEPT)
def disturbance(field: IndexField, pupil: Pupil, look: np.ndarray) -> Disturbance:
    """Return the range over which a pupil's light is disturbed, from a few lines through it."""
    place = places_across(pupil, LINES).tolist()
    x, y = np.array(LINES * place), np.array([one for one in place for _ in range(LINES)])
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


def stride_of(count: int, pixel: float, feature: float) -> int:
    """Return the stride at which the pixels of a map are used."""
    stride = -(-count // MOST_PIXELS)
    while count // (2 * stride) >= FEWEST_PIXELS and feature >= PER_FEATURE * 2.0 * stride * pixel:
        stride *= 2
    return stride


def places_across(pupil: Pupil, count: int) -> np.ndarray:
    """Return coordinates across a pupil [m] that are not commensurate with any grating."""
    reach = max(pupil.half_extent)
    return np.array([reach * (2.0 * ((number + 0.5) * GOLDEN % 1.0) - 1.0) for number in range(count)])


def _by_nodes(field: IndexField, grid: UniformGrid, pupil: Pupil, sign: float, x, y) -> Disturbance:
    """Return the range for lines along z of a grid, from the nearest nodes: a width needs no interpolant."""
    # A few lines: plain numbers take a fraction of the time of arrays.
    (right, above, far), (across, up) = pupil.center.tolist(), (axis.tolist() for axis in pupil.axes)
    points: list[tuple[float, ...]] = [
        (right + one * across[0] + other * up[0], above + one * across[1] + other * up[1])
        for one, other in zip(x.tolist(), y.tolist(), strict=True)
    ]
    if field.geometry != "volume":
        points = [(math.hypot(*point) if field.geometry == "axisymmetric" else point[1],) for point in points]
    *axes, (origin, spacing, count) = zip(grid.origin.tolist(), grid.spacing.tolist(), grid.shape, strict=True)
    nodes = [
        [round((one - start) / cell) for one, (start, cell, _) in zip(point, axes, strict=True)] for point in points
    ]
    inside = [node for node in nodes if all(0 <= one < most for one, (*_, most) in zip(node, axes, strict=True))]
    ends = (far - origin) / spacing
    begin, end = (max(0, math.ceil(ends)), count) if sign > 0.0 else (0, min(count, math.floor(ends) + 1))
    if end - begin < 2 or not inside:
        return Disturbance(0.0, 0.0)
    # All nodes: a thin shock may be between any two.
    lines = grid.samples[..., begin:end][tuple(np.array(inside).T)]
    if len(inside) < len(nodes):  # outside the box the contrast is zero
        lines = np.concatenate([lines, np.zeros((len(nodes) - len(inside), lines.shape[1]))])
    distance = (sign * spacing * (node - ends) for node in (begin, end))
    return spread_along(lines.T, *distance)


def spread_along(layers: np.ndarray, begin: float, end: float) -> Disturbance:
    """Return the even distribution with the mean and standard deviation of the disturbance of `layers` (layers, lines).

    `begin` and `end` are distances from the pupil [m] of the first and the last layer's outer faces, in either order.
    """
    layers = layers - np.add.reduce(layers, axis=1, keepdims=True) / layers.shape[1]
    weight = np.einsum("ij,ij->i", layers, layers)
    total = float(np.add.reduce(weight))
    if not total > 0.0:
        return Disturbance(0.0, 0.0)
    place, step = np.arange(0.5, len(layers)), (end - begin) / len(layers)
    middle = float(np.einsum("i,i->", place, weight)) / total
    place -= middle
    square = float(np.einsum("i,i,i->", place, place, weight)) / total
    length = abs(step) * math.sqrt(12.0 * square + 1.0)
    return Disturbance(length, begin + middle * step + 0.5 * length)


def _two_screens(paths: MapPaths, ambient_index: float, length: float) -> float:
    """Return the Strehl ratio of two half screens with free space between minus the one of the whole phase.

    The screens are as far apart as twice the standard deviation of an even distribution over the length. Light that
    leaves the pupil sideways meets no phase there, so the mean phase is removed: a common delay does not matter, and
    would be a step around the pupil.
    """
    from scipy.fft import fft, ifft, next_fast_len

    path, light, pixel, wavelength, count = paths.lit_path, paths.light, paths.pixel, paths.wavelength, len(paths.path)
    # A margin for the light that diffracts out of the pupil.
    beside = max(FEWEST_BESIDE, math.ceil(BESIDE * math.sqrt(wavelength * length) / pixel))
    size = next_fast_len(count + min(2 * beside, math.ceil(MOST_BESIDE * count)))
    whole_light = paths.whole_light
    mean = float(np.einsum("ij,ij->", path, light)) / whole_light
    half = phase_factor(np.where(light > 0.0, np.float32(0.5) * (path - np.float32(mean)), np.float32(0.0)), wavelength)
    wave = light * half
    whole = np.einsum("ij,ij->", half, wave)
    across = 2.0 * np.pi * np.fft.fftfreq(size, pixel)
    distance = 0.5 * length / math.sqrt(3.0) * wavelength / (2.0 * np.pi * ambient_index)
    free = np.exp(-1j * distance * across**2).astype(np.complex64)
    # No matrix products: BLAS would wake its threads, which takes longer than these few operations. Only lines with
    # light are transformed first, and only lines within the map last.
    spectrum = fft(fft(wave, size, axis=1), size, axis=0, overwrite_x=True)
    spectrum *= free[:, None]
    spectrum *= free
    between = ifft(ifft(spectrum, axis=0, overwrite_x=True)[:count], axis=1, overwrite_x=True)[:, :count]
    # Outside the pupil the second screen has no phase, and free space conserves the total sum.
    half -= np.float32(1.0)
    total = wave.sum() + np.einsum("ij,ij->", half, between)
    return (abs(complex(total)) ** 2 - abs(complex(whole)) ** 2) / whole_light**2


def crossings_of(path: np.ndarray, pixel: float, light: np.ndarray, distance: float) -> Crossings:
    """Return crossing and focusing over a distance [m], from paths [m] and light, without two pixels at the rim."""
    row, mixed, column = _curvatures(path, distance / (4.0 * pixel**2))
    light = light[2:-2, 2:-2] if path.shape[1] > 1 else light[2:-2]
    if column is None or mixed is None:
        middle, spread = 0.5 * row, np.abs(0.5 * row)
    else:
        middle, spread = 0.5 * (row + column), np.sqrt((0.5 * (row - column)) ** 2 + mixed**2)
    focusing = spread - middle  # light turns toward the delayed side: a negative curvature focuses
    known = (light > 0.0) & np.isfinite(focusing)
    light, focusing = light[known], focusing[known]
    whole = float(light.sum())
    if not whole > 0.0:
        return Crossings(0.0, 0.0, 0.0)
    greatest = max(float(focusing.max()), 0.0)
    if greatest <= NEAR_FOCUS:  # then no rays cross
        return Crossings(0.0, greatest, 0.0)
    crossed = (1.0 - focusing) * (1.0 + focusing + 2.0 * middle[known]) < 0.0
    return Crossings(float(light[crossed].sum()) / whole, greatest, float(light[focusing > NEAR_FOCUS].sum()) / whole)


def _curvatures(path: np.ndarray, scale: float) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Return second derivatives of a map along y, mixed, and along x, by differences over four pixels, times a factor.

    The results exclude two pixels on each side; for one column there is only the derivative along y.
    """
    if path.shape[1] == 1:
        row = scale * (path[4:] + path[:-4] - 2.0 * path[2:-2])
        return row, None, None
    twice = 2.0 * path[2:-2, 2:-2]
    row, column = path[4:, 2:-2] + path[:-4, 2:-2] - twice, path[2:-2, 4:] + path[2:-2, :-4] - twice
    mixed = path[3:-1, 3:-1] + path[1:-3, 1:-3] - path[3:-1, 1:-3] - path[1:-3, 3:-1]
    return scale * row, scale * mixed, scale * column
