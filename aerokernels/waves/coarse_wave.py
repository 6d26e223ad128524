"""The verdict of a wave: it goes through as few slabs of a field, on as coarse a window, as the question allows.

The finest phase that matters sets the pixels, and diffraction.py doubles the slabs until the answer is known.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..medium import IndexField
from ..pupils import Pupil
from .diffraction import Ways, beside, window_of
from .layers import span_of
from .screens import Crossings, crossings_of, disturbance, fast_size, places_across, spread_along
from .shadows import SlabsPastBody, fringes, is_clear, shadow_of
from .slabs import FINEST, LookingAlong, Slabs, slabs_of
from .verdict import Validity

# Phase [rad rms] that may be left out of what counts as the finest, and lines either way on which that is looked for.
UNSEEN, FEATURE_LINES = 0.03, 16
# The window over the pupil: at least, at most, and how far beside it in widths sqrt(wavelength distance). What comes
# back from beyond its sides is then less than 1e-3 of the Strehl ratio: at 1.5 pupils it was up to 0.007.
LEAST_WINDOW, MOST_WINDOW, BESIDE = 1.15, 4.0, 2.0
# Pixels to the finest half period; in all, and to the pupil's width, at least; of one column, where nothing varies
# along x, at least and at most; lines across that tell where along the way light is disturbed.
PER_FEATURE, LEAST_PIXELS, PER_REACH, COLUMN_PIXELS, SLAB_LINES = 4.0, 48, 32.0, (256, 512), 16
# The share of the pupil from which on rays are near foci (screens.py): of traced ones, which a map has to resolve by so
# many pixels to the finest half period, and of those for which straight ones stand.
SOME, MANY, RESOLVED = 0.01, 0.1, 4.0


@dataclass(frozen=True)
class TracedMap:
    """What a wave asks of a traced wavefront.

    Attributes:
        strehl: Its Strehl ratio.
        pixel: Side of its pixels [m].
    """

    strehl: float
    pixel: float


def by_waves(
    field: IndexField,
    pupil: Pupil,
    wavelength: float,
    feature: float | None,
    limit: float,
    traced: TracedMap | None = None,
) -> Validity:
    """The verdict of a wave through slabs of the field, see diffraction.py; a finest phase of None is looked for.

    `traced` is the map of traced rays, where there is one: rays near their foci are those.
    """
    reach = max(pupil.half_extent)
    flat = is_one_column(field, pupil.normal)
    clear = is_clear(field, pupil, pupil.normal, wavelength)
    look = LookingAlong(pupil.center, pupil.normal, pupil.axes, reach)
    begin, end = span_of(field, look.center, look.normal, look.axes, *(2 * [(-look.half, look.half)]))
    look = replace(look, half=_half_window(reach, wavelength, end, 0.0 if clear else fringes(field, wavelength)))
    slabs: Slabs = (
        slabs_of(field, look, begin, end, wavelength) if clear else SlabsPastBody(field, look, begin, end, wavelength)
    )
    half = _half_window(reach, wavelength, slabs.last, 0.0 if clear else fringes(field, wavelength))
    if feature is None:
        feature = _finest_of(slabs, pupil, flat, wavelength)
    least, most = COLUMN_PIXELS if flat else (max(LEAST_PIXELS, PER_REACH * half / reach), slabs.most_pixels)
    # Fringes of a rim are as fine as the pixels allow.
    pixels = fast_size(math.ceil(np.clip(2.0 * half * PER_FEATURE / feature, least, most))) if clear else most
    window = window_of(pupil, half, pixels, flat)
    if clear:
        distance = disturbance(field, pupil, pupil.normal).length
    else:
        distance = _slabs_length(slabs, pupil, flat)
    shadow, passes = shadow_of(slabs, window, wavelength, end)
    near = beside(passes)
    path = slabs.taken(window.x, window.y, 1)[0]
    crossings = crossings_of(path[near], window.pixel, (window.amplitude * passes)[near], distance)
    ways = Ways(
        window=window,
        slabs=slabs,
        passes=passes,
        near=near,
        before=slabs.first,
        after=end - slabs.last,
        wavelength=wavelength,
        ambient_index=field.ambient_index,
        straight=crossings.near > MANY,
        traced=traced.strehl if traced is not None and clear else None,
        by_traced=traced is not None and clear and _by_traced(crossings, feature, traced.pixel),
    )
    change, error = ways.change(limit)
    return Validity(
        strehl_change=change,
        feature=feature,
        distance=distance,
        fresnel_number=fresnel_number(feature, wavelength, distance),
        crossed_share=crossings.crossed,
        curvature=crossings.curvature,
        limit=limit,
        blocked=shadow.blocked,
        rim_fresnel_number=shadow.fresnel_number,
        error=error,
    )


def _half_window(reach: float, wavelength: float, last: float, beside: float) -> float:
    """Half the width [m] of a window that holds the light of a pupil of half a width `reach` until `last` [m]."""
    return max(min(LEAST_WINDOW * reach + BESIDE * math.sqrt(wavelength * last), MOST_WINDOW * reach), reach + beside)


def _finest_of(slabs: Slabs, pupil: Pupil, flat: bool, wavelength: float) -> float:
    """Half period of the finest phase [m] of straight lines through slabs, on some lines across the pupil."""
    count = COLUMN_PIXELS[1] if flat else 2 * slabs.most_pixels // 3
    pixel = 2.0 * max(pupil.half_extent) / count
    place = pixel * (np.arange(count) - count // 2)
    few = np.zeros(1) if flat else place[_some_of(count)]
    lines = []
    for x, y in ((few, place),) if flat else ((few, place), (place, few)):
        path = slabs.taken(x, y, 1)[0]
        lit = np.abs(y[:, None]) <= pupil.half_extent[1] if flat else pupil.transmission(*np.meshgrid(x, y)) > 0.0
        opaque = slabs.opaque(x, y, FINEST)
        if opaque is not None:
            lit = lit & ~opaque.any(axis=0)
        path = np.where(lit, path, np.nan)
        lines.append(path.T if x is few else path)
    return _finest_on(np.stack(lines), pixel, wavelength)[0]


def _by_traced(crossings: Crossings, feature: float, pixel: float) -> bool:
    """Whether rays are known by a traced map alone: near their foci, of a map that holds the finest phase.

    Where they have crossed no other is left, and what a map of strong phases misses is different from pixel to pixel; a
    grating's phase before that may hide between pixels.
    """
    return crossings.crossed > 0.0 or (crossings.near > SOME and feature >= RESOLVED * pixel)


def is_one_column(field: IndexField, normal: np.ndarray) -> bool:
    """Whether nothing varies along a window's first axis: in a planar field seen across its axis."""
    return field.geometry == "planar" and abs(float(normal[0])) < 1e-15


def _slabs_length(slabs: Slabs, pupil: Pupil, flat: bool) -> float:
    """The disturbed length [m], by lines through the slabs; of a flat one, which are alike along x, by one row."""
    place = places_across(pupil, SLAB_LINES)
    lit = pupil.transmission(*np.meshgrid(place, place)) > 0.0
    across = np.zeros(1) if flat else place
    if flat:
        lit = np.asarray(lit.any(axis=1, keepdims=True))
    opaque = slabs.opaque(across, place, FINEST)
    if opaque is not None and (lit & ~opaque.any(axis=0)).any():
        lit &= ~opaque.any(axis=0)
    return spread_along(slabs.taken(across, place, FINEST)[:, lit], slabs.first, slabs.last).length


def finest_feature(path: np.ndarray, pixel: float, wavelength: float) -> float:
    """Half period of the finest phase [m] that holds UNSEEN rad of paths [m], NaN outside the pupil; infinite if none.

    By second differences at growing distance, which no tilt touches and no edge of the pupil: a component of period p
    holds its whole at a distance of p / 2.
    """
    return finest_and_squares(path, pixel, wavelength)[0]


def finest_and_squares(path: np.ndarray, pixel: float, wavelength: float) -> tuple[float, float]:
    """As `finest_feature`, and the mean square of its second differences [m2], which tells one map from another."""
    # Some lines either way say what all of them do: columns and, of a map of more than one, rows.
    part = _some_of(len(path))
    ways = [path.T[part], path[part]] if path.shape[0] == path.shape[1] else [path.T[part]]
    return _finest_on(np.stack(ways), pixel, wavelength)


def _some_of(count: int) -> slice:
    return slice(None, None, max(1, count // FEATURE_LINES))


def _finest_on(lines: np.ndarray, pixel: float, wavelength: float) -> tuple[float, float]:
    """`finest_and_squares` of lines of paths (ways, lines, n)."""
    count, wave_number, squares = lines.shape[-1], 2.0 * np.pi / wavelength, 0.0
    for stride in (2**power for power in range(int(np.log2(max(count // 2, 1))) + 1)):
        # Of a coarse difference every second part of it is looked at: the rest says the same.
        step = max(1, stride // 2)
        squares = _mean_squares(lines[..., ::step], stride // step)
        # Of a component that is sampled at its extremes the second difference is four times the amplitude.
        if wave_number * math.sqrt(squares / 8.0) > 2.0 * UNSEEN:
            return stride * pixel, squares
    return float("inf"), squares


def _mean_squares(lines: np.ndarray, stride: int) -> float:
    """Mean squares of second differences along lines (ways, lines, n) at a distance of so many pixels, their sum."""
    second = lines[..., 2 * stride :] + lines[..., : -2 * stride]
    second -= 2.0 * lines[..., stride:-stride]
    total = 0.0
    for own in second:
        known = own[np.isfinite(own)]
        if len(known):
            total += float(np.einsum("i,i->", known, known)) / len(known)  # no BLAS: its threads take longer than that
    return total


def fresnel_number(feature: float, wavelength: float, distance: float) -> float:
    """Of a feature [m] over a distance [m]; infinite where nothing is disturbed."""
    return feature**2 / (wavelength * distance) if distance > 0.0 else float("inf")
