r"""A verdict on ray optics: does light through this field do what its rays say?

Three numbers of the wavefront W over the distance D that its light takes to leave the disturbed air tell why not:

    Fresnel number     l^2 / (lambda D), l the half period of the finest phase that matters; below about 1 that phase
                       turns into brightness before it is out
    ray crossing       share of the pupil where det(1 + D grad grad W) < 0: behind a focus neighbours change places
    curvature          the greatest D |W''|: near 1 there is a focus

and one says how much: the Strehl ratio of a wave through the same air, less that of its rays through the same slabs,
on a window coarse enough to cost little and fine enough for that finest phase (diffraction.py). What the slabs lack is
lacking in both, so the difference stands for diffraction alone. The rays bend, to second order in how far they go
aside: a wave holds what that does to their paths, as traced rays do, and it is no diffraction. Near foci no order tells
where they go; straight ones stand for them there.

Beside a traced wavefront there is a cheaper answer: half of its phase on either side of free space of the length over
which the light is disturbed, which the field is looked up on a few lines for. Where that changes the Strehl ratio by
far less than is allowed, no rays cross (the determinant is positive everywhere) and nothing is near a focus, the rays
have answered for themselves; otherwise the wave answers.
"""

import math
from dataclasses import dataclass

import numpy as np

from ..arguments import checked
from ..medium import IndexField
from ..pupils import Pupil
from ..tracing.lines import box_span
from ..wavefront import Wavefront
from .angular_spectrum import transfer_exponent
from .diffraction import Ways, slope, window_of
from .layers import span_of
from .slabs import FINEST, LookingAlong, Slabs, slabs_of

# The greatest change of the Strehl ratio that rays may cost and still be good.
GOOD = 1e-2
# Phase [rad rms] that may be left out of what counts as the finest.
UNSEEN = 0.03
# The window over the pupil, and that of one column, where nothing varies along x; pixels to the finest half period, and
# in all at least; of one column, at least and at most; lines across that tell where along the way light is disturbed.
WINDOW, COLUMN_WINDOW, PER_FEATURE, LEAST_PIXELS, COLUMN_PIXELS, SLAB_LINES = 1.5, 2.0, 4.0, 48, (256, 512), 16
# Rays are straight where curvature times distance is more than the first over a share of the pupil of the second: near
# their foci second order in their turn says nothing of where they go.
NEAR_FOCUS, GREATEST_SHARE = 0.5, 0.1
# The rays' own answer: the share of the limit that it must stay below, the greatest curvature, its map's pixels, and
# the lines of sight and layers by which the disturbed length is found.
CLEAR, FLAT, SCREEN_PIXELS, LINES, LINE_LAYERS = 0.1, 0.3, 64, 4, 32


@dataclass(frozen=True)
class Validity:
    """What diffraction does that rays do not know of.

    Attributes:
        strehl_change: Strehl ratio by waves less that by rays, both through the same samples.
        feature: Half period of the finest phase that matters [m]; infinite where none does.
        distance: Length over which the light is disturbed, and has left the disturbance at its end [m].
        fresnel_number: feature^2 / (wavelength distance).
        crossed_share: Share of the pupil where rays have crossed.
        curvature: The greatest product of that distance and a curvature of the wavefront, of the sign that focuses.
        limit: The change of the Strehl ratio up to which rays are good.
        answered_by: "rays" where the traced wavefront left no doubt, "waves" where a wave was sent through the field.
    """

    strehl_change: float
    feature: float
    distance: float
    fresnel_number: float
    crossed_share: float
    curvature: float
    limit: float = GOOD
    answered_by: str = "waves"

    @property
    def good(self) -> bool:
        """Whether rays give the Strehl ratio to within `limit`."""
        return abs(self.strehl_change) <= self.limit

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        who = "the traced wavefront" if self.answered_by == "rays" else "a wave through the field"
        change = f"waves change the Strehl ratio by {self.strehl_change:+.2g}, {self.limit:g} being allowed, says {who}"
        if self.good:
            return f"rays are good: {change}"
        why = f"the Fresnel number of the finest phase is {self.fresnel_number:.2g}"
        if self.crossed_share > 0.0:
            why = f"rays cross over {100.0 * self.crossed_share:.2g} % of the pupil"
        return f"rays are not good: {change}; {why}; see split_step"

    def __bool__(self) -> bool:
        """Whether rays are good."""
        return self.good


@checked
def validity(
    field: IndexField,
    pupil: Pupil,
    *,
    wavelength: float | None = None,
    wavefront: Wavefront | None = None,
    limit: float = GOOD,
) -> Validity:
    """Whether rays through a field give the Strehl ratio of a pupil, and what they leave out.

    Args:
        field: The refractive index.
        pupil: The pupil; light leaves it along its normal.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm where it has none.
        wavefront: Its traced wavefront, whose finest phase is then looked at, and which may answer by itself at a small
            part of its own cost; None looks at straight rays and asks a wave.
        limit: The change of the Strehl ratio up to which rays are good.

    Raises:
        TypeError: `field` or `pupil` of the wrong kind.
        ValueError: A pupil that does not see the field; a number that makes no sense.
    """
    if not isinstance(field, IndexField):
        raise TypeError(f"field must be an IndexField, got {type(field).__name__}")
    if not isinstance(pupil, Pupil):
        raise TypeError(f"pupil must be a Disc, Annulus, Rectangle, Polygon or Mask, got {type(pupil).__name__}")
    if not (np.isfinite(limit) and limit > 0.0):
        raise ValueError(f"limit must be positive, got {limit!r}")
    wavelength = field.wavelength_for(wavelength)
    feature = float("inf")
    if wavefront is not None:
        feature = finest_feature(_phase_map(wavefront), wavefront.pixel)
        answer = by_rays(field, pupil, wavefront, wavelength, feature, limit)
        if answer is not None:
            return answer
    return by_waves(field, pupil, wavefront, wavelength, feature, limit)


def by_waves(
    field: IndexField, pupil: Pupil, wavefront: Wavefront | None, wavelength: float, feature: float, limit: float
) -> Validity:
    """The verdict of a wave through slabs of the field: see diffraction.py."""
    reach = max(pupil.half_extent)
    # In a planar field seen across its axis nothing varies along the first axis.
    flat = field.geometry == "planar" and abs(float(pupil.normal[0])) < 1e-15
    look = LookingAlong(pupil.center, pupil.normal, pupil.axes, (COLUMN_WINDOW if flat else WINDOW) * reach)
    begin, end = span_of(field, look.center, look.normal, look.axes, *(2 * [(-look.half, look.half)]))
    slabs = slabs_of(field, look, begin, end, wavelength)
    if wavefront is None or feature < 2.0 * wavefront.pixel:
        window = window_of(pupil, reach, COLUMN_PIXELS[1] if flat else 2 * slabs.most_pixels // 3, flat)
        path = slabs.taken(window.x, window.y, 1)[0]
        phase = np.where(window.lit, 2.0 * np.pi / wavelength * path, np.nan)
        feature = min(feature, finest_feature(phase, window.pixel))
    least, most = COLUMN_PIXELS if flat else (LEAST_PIXELS, slabs.most_pixels)
    pixels = _fast_size(math.ceil(np.clip(2.0 * look.half * PER_FEATURE / feature, least, most)))
    window = window_of(pupil, look.half, pixels, flat)
    distance = _slabs_length(slabs, pupil)
    path = slabs.taken(window.x, window.y, 1)[0]
    crossed, curvature, near = _crossings(path, window.pixel, window.amplitude, distance)
    ways = Ways(
        window=window,
        slabs=slabs,
        before=slabs.first,
        after=end - slabs.last,
        wavelength=wavelength,
        ambient_index=field.ambient_index,
        straight=near > GREATEST_SHARE,
    )
    return Validity(
        strehl_change=ways.change(limit),
        feature=feature,
        distance=distance,
        fresnel_number=_fresnel_number(feature, wavelength, distance),
        crossed_share=crossed,
        curvature=curvature,
        limit=limit,
    )


def _slabs_length(slabs: Slabs, pupil: Pupil) -> float:
    """The disturbed length [m], by lines through the slabs."""
    place = max(pupil.half_extent) * (2.0 * (np.arange(SLAB_LINES) + 0.5) / SLAB_LINES - 1.0)
    x, y = np.meshgrid(place, place)
    lit = pupil.transmission(x, y) > 0.0
    return _spread_along(slabs.taken(place, place, FINEST)[:, lit], slabs.last - slabs.first)


def finest_feature(phase: np.ndarray, pixel: float) -> float:
    """Half period of the finest phase [m] that holds UNSEEN rad of a map, NaN outside the pupil; infinite if none does.

    By second differences at growing distance, which no tilt touches and no edge of the pupil: a component of period p
    holds its whole at a distance of p / 2.
    """
    for stride in (2**power for power in range(int(np.log2(max(len(phase) // 2, 1))) + 1)):
        squares = []
        for axis in (0, 1):
            moved = np.moveaxis(phase, axis, 0)
            if len(moved) <= 2 * stride:
                continue
            second = moved[2 * stride :] - 2.0 * moved[stride:-stride] + moved[: -2 * stride]
            there = second[np.isfinite(second)]
            if there.size:
                squares.append(float(np.mean(there**2)))
        # Of a component that is sampled at its extremes the second difference is four times the amplitude.
        if squares and np.sqrt(sum(squares) / 8.0) > 2.0 * UNSEEN:
            return stride * pixel
    return float("inf")


def _fresnel_number(feature: float, wavelength: float, distance: float) -> float:
    """Of a feature [m] over a distance [m]; infinite where nothing is disturbed."""
    return feature**2 / (wavelength * distance) if distance > 0.0 else float("inf")


def _spread_along(layers: np.ndarray, length: float) -> float:
    """Length of an even spread with the standard deviation of the disturbance of lines (layers, lines) [m]."""
    weight = np.mean((layers - layers.mean(axis=1, keepdims=True)) ** 2, axis=1)
    if not weight.any():
        return 0.0
    place = (np.arange(len(layers)) + 0.5) * length / len(layers)
    middle = np.average(place, weights=weight)
    return float(np.sqrt(12.0 * np.average((place - middle) ** 2, weights=weight) + (length / len(layers)) ** 2))


def by_rays(
    field: IndexField, pupil: Pupil, wavefront: Wavefront, wavelength: float, feature: float, limit: float
) -> Validity | None:
    """The verdict of a traced wavefront alone; None where it leaves a doubt, or does not hold its finest phase."""
    if feature < 2.0 * wavefront.pixel or wavefront.wavelength != wavelength or wavefront.blocked > 1e-3:
        return None
    length = _length_on_lines(field, pupil, wavefront)
    stride = max(1, len(wavefront.opd) // SCREEN_PIXELS)
    if feature < 2.0 * stride * wavefront.pixel:
        stride = 1
    pixel = stride * wavefront.pixel
    opd, weight = (array[stride // 2 :: stride, stride // 2 :: stride] for array in (wavefront.opd, wavefront.weight))
    lit = weight > 0.0
    path = np.where(lit, opd, 0.0)
    crossed, curvature, _ = _crossings(opd, pixel, weight, length)
    size = _fast_size(int(np.ceil(WINDOW * len(opd))))
    wide = np.zeros((size, size)), np.zeros((size, size))
    for array, values in zip(wide, (weight, path), strict=True):
        array[: len(opd), : len(opd)] = values
    change = _two_screens(wide[0], wide[1], pixel, wavelength, field.ambient_index, length)
    if not (abs(change) <= CLEAR * limit and crossed == 0.0 and curvature <= FLAT):
        return None
    return Validity(
        strehl_change=change,
        feature=feature,
        distance=length,
        fresnel_number=_fresnel_number(feature, wavelength, length),
        crossed_share=crossed,
        curvature=curvature,
        limit=limit,
        answered_by="rays",
    )


def _fast_size(count: int) -> int:
    from scipy.fft import next_fast_len

    return int(next_fast_len(count))


def _length_on_lines(field: IndexField, pupil: Pupil, wavefront: Wavefront) -> float:
    """The disturbed length [m], by a few lines through the pupil."""
    look = pupil.normal if wavefront.direction is None else np.asarray(wavefront.direction)
    reach = max(pupil.half_extent)
    place = reach * (2.0 * (np.arange(LINES) + 0.5) / LINES - 1.0)
    x, y = (axis.ravel() for axis in np.meshgrid(place, place))
    lit = pupil.transmission(x, y) > 0.0
    if lit.any():
        x, y = x[lit], y[lit]
    first, second = pupil.axes
    start = pupil.center + x[:, None] * first + y[:, None] * second
    span = box_span(field, start, np.broadcast_to(look, start.shape).copy())
    meets = span.meets & (span.leave > 0.0) & (span.leave < 1e30)
    if not meets.any():
        return 0.0
    begin, end = max(float(span.enter[meets].min()), 0.0), float(span.leave[meets].max())
    depth = begin + (end - begin) * (np.arange(LINE_LAYERS) + 0.5) / LINE_LAYERS
    points = start + depth[:, None, None] * look
    layers = field.contrast_at(points.reshape(-1, 3)).reshape(LINE_LAYERS, len(start))
    return _spread_along(layers, end - begin)


def _two_screens(
    weight: np.ndarray, path: np.ndarray, pixel: float, wavelength: float, ambient_index: float, length: float
) -> float:
    """Strehl ratio of half the phase, free space and the other half, less that of the whole phase at once.

    Two sheets are as far apart as an even spread over the length is wide, twice its standard deviation.
    """
    from scipy.fft import fft2, ifft2

    half = np.exp(1j * np.pi / wavelength * path)
    exponent = transfer_exponent(weight.shape, pixel, wavelength, ambient_index, False)
    apart = ifft2(fft2(weight * half) * np.exp(length / np.sqrt(3.0) * exponent)) * half
    return float((abs(apart.sum()) ** 2 - abs((weight * half**2).sum()) ** 2) / weight.sum() ** 2)


def _phase_map(wavefront: Wavefront) -> np.ndarray:
    return 2.0 * np.pi / wavefront.wavelength * wavefront.opd


def _crossings(path: np.ndarray, pixel: float, light: np.ndarray, distance: float) -> tuple[float, float, float]:
    """What rays do over a distance, by their paths and the light of each pixel.

    Returns:
        The share of the pupil where they cross, the greatest focusing curvature times the distance, and the share of
        the pupil where that is greater than NEAR_FOCUS.
    """
    row, mixed, column = _curvatures(path, pixel)
    known = (light > 0.0) & np.isfinite(row) & np.isfinite(column) & np.isfinite(mixed)
    if not known.any():
        return 0.0, 0.0, 0.0
    middle, spread = 0.5 * (row + column)[known], np.hypot(0.5 * (row - column), mixed)[known]
    focusing = -distance * (middle - spread)  # light turns toward where it is delayed: a negative one focuses
    least = 1.0 - focusing
    greatest = 1.0 + distance * (middle + spread)
    crossed, near = (
        float(np.average(there, weights=light[known])) for there in (least * greatest < 0.0, focusing > NEAR_FOCUS)
    )
    return crossed, float(focusing.max(initial=0.0)), near


def _curvatures(path: np.ndarray, pixel: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Second derivatives of a map along y, mixed, and along x; of one column, along y alone."""
    along_y = slope(path, pixel, 0)
    row = slope(along_y, pixel, 0)
    if path.shape[1] == 1:
        return row, np.zeros_like(row), np.zeros_like(row)
    return row, slope(along_y, pixel, 1), slope(slope(path, pixel, 1), pixel, 1)
