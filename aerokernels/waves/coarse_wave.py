"""The verdict of a wave: it goes through as few slabs of a field, on as coarse a window, as the question allows.

The finest phase that matters sets the pixels, and diffraction.py doubles the slabs until the answer is known.
"""

import math

import numpy as np

from ..medium import IndexField
from ..pupils import Pupil
from ..wavefront import Wavefront
from .diffraction import Ways, window_of
from .layers import span_of
from .screens import Crossings, crossings_of, disturbed_length, fast_size, places_across, spread_along
from .shadows import SlabsPastBody, fringes, is_clear, shadow_of
from .slabs import FINEST, LookingAlong, Slabs, disturbed_until, slabs_of
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


def by_waves(
    field: IndexField,
    pupil: Pupil,
    wavelength: float,
    feature: float | None,
    limit: float,
    traced: Wavefront | None = None,
) -> Validity:
    """The verdict of a wave through slabs of the field, see diffraction.py; a finest phase of None is looked for.

    `traced` is the wavefront of traced rays, where there is one: rays near their foci are those.
    """
    reach = max(pupil.half_extent)
    flat = is_one_column(field, pupil.normal)
    clear = is_clear(field, pupil, pupil.normal, wavelength)
    look = LookingAlong(pupil.center, pupil.normal, pupil.axes, reach)
    begin, end = span_of(field, look.center, look.normal, look.axes, *(2 * [(-look.half, look.half)]))
    last = disturbed_until(field, look, begin, end, wavelength)
    half = min(LEAST_WINDOW * reach + BESIDE * math.sqrt(wavelength * last), MOST_WINDOW * reach)
    if not clear:
        half = max(half, reach + fringes(field, wavelength))
    look = LookingAlong(pupil.center, pupil.normal, pupil.axes, half)
    slabs: Slabs = (
        slabs_of(field, look, begin, end, wavelength) if clear else SlabsPastBody(field, look, begin, end, wavelength)
    )
    if feature is None:
        window = window_of(pupil, reach, COLUMN_PIXELS[1] if flat else 2 * slabs.most_pixels // 3, flat)
        path = slabs.taken(window.x, window.y, 1)[0]
        _, passes = shadow_of(slabs, window, wavelength, end)
        feature = finest_feature(np.where(passes, path, np.nan), window.pixel, wavelength)
    least, most = COLUMN_PIXELS if flat else (max(LEAST_PIXELS, PER_REACH * half / reach), slabs.most_pixels)
    # Fringes of a rim are as fine as the pixels allow.
    pixels = fast_size(math.ceil(np.clip(2.0 * look.half * PER_FEATURE / feature, least, most))) if clear else most
    window = window_of(pupil, look.half, pixels, flat)
    if clear:
        distance = disturbed_length(field, pupil, pupil.normal)
    else:
        distance = _slabs_length(slabs, pupil, flat)
    shadow, passes = shadow_of(slabs, window, wavelength, end)
    path = slabs.taken(window.x, window.y, 1)[0]
    crossings = crossings_of(path, window.pixel, window.amplitude * passes, distance)
    ways = Ways(
        window=window,
        slabs=slabs,
        passes=passes,
        before=slabs.first,
        after=end - slabs.last,
        wavelength=wavelength,
        ambient_index=field.ambient_index,
        straight=crossings.near > MANY,
        traced=strehl_of(traced) if traced is not None and clear else None,
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


def _by_traced(crossings: Crossings, feature: float, pixel: float) -> bool:
    """Whether rays are known by a traced map alone: near their foci, of a map that holds the finest phase.

    Where they have crossed no other is left, and what a map of strong phases misses is different from pixel to pixel; a
    grating's phase before that may hide between pixels.
    """
    return crossings.crossed > 0.0 or (crossings.near > SOME and feature >= RESOLVED * pixel)


def strehl_of(wavefront: Wavefront) -> float:
    """A map's Strehl ratio as it stands, in a fraction of the time of `Wavefront.strehl`."""
    lit = wavefront.weight > 0.0
    weight = wavefront.weight[lit]
    phase = wavefront.opd[lit] * (2.0 * math.pi / wavefront.wavelength)
    parts = np.einsum("i,i->", weight, np.cos(phase)), np.einsum("i,i->", weight, np.sin(phase))
    return float((parts[0] ** 2 + parts[1] ** 2) / np.einsum("i->", weight) ** 2)


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
    return spread_along(slabs.spread(across, place)[:, lit], slabs.last - slabs.first)


def finest_feature(path: np.ndarray, pixel: float, wavelength: float) -> float:
    """Half period of the finest phase [m] that holds UNSEEN rad of paths [m], NaN outside the pupil; infinite if none.

    By second differences at growing distance, which no tilt touches and no edge of the pupil: a component of period p
    holds its whole at a distance of p / 2.
    """
    count, wave_number = len(path), 2.0 * np.pi / wavelength
    # Some lines either way say what all of them do: columns and, of a map of more than one, rows.
    part = slice(None, None, max(1, count // FEATURE_LINES))
    ways = [path.T[part], path[part]] if path.shape[0] == path.shape[1] else [path.T[part]]
    lines = np.stack(ways)
    for stride in (2**power for power in range(int(np.log2(max(count // 2, 1))) + 1)):
        # Of a coarse difference every second part of it is looked at: the rest says the same.
        step = max(1, stride // 2)
        squares = _mean_squares(lines[..., ::step], stride // step)
        # Of a component that is sampled at its extremes the second difference is four times the amplitude.
        if wave_number * math.sqrt(squares / 8.0) > 2.0 * UNSEEN:
            return stride * pixel
    return float("inf")


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
