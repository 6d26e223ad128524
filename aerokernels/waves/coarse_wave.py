"""Verdict by a wave through as few slabs of a field, on as coarse a window, as the required error allows.

The finest relevant phase sets the pixels, and diffraction.py doubles the slabs until the change is known. A finest
phase that a traced map shows, but does not resolve, sizes a window on which it is measured again.
"""

import math
from collections.abc import Callable

import numpy as np

from ..medium import IndexField
from ..pupils import Pupil
from .diffraction import WaveAndRays, Window, window_of
from .layers import span_of
from .screens import Crossings, MapPaths, crossings_of, disturbance, places_across, spread_along
from .shadows import SlabsPastBody, fringes, is_clear, shadow_of
from .slabs import FINEST, LookingAlong, Slabs, slabs_of
from .verdict import Validity

# Phase [rad rms] that is too weak to count as the finest; lines in each direction on which the finest is searched.
UNSEEN, FEATURE_LINES = 0.03, 16
# Window over the pupil: least, most, and margin in widths sqrt(wavelength distance). Light that re-enters through its
# sides then changes the Strehl ratio by less than 1e-3: at 1.5 pupils it was up to 0.007.
LEAST_WINDOW, MOST_WINDOW, BESIDE = 1.15, 4.0, 2.0
# Pixels per finest half period; fewest in all, and per half width of the pupil; fewest and most of one column, where
# nothing varies along x; lines across that show where along the path light is disturbed.
PER_FEATURE, LEAST_PIXELS, PER_REACH, COLUMN_PIXELS, SLAB_LINES = 3.0, 48, 32.0, (256, 512), 16
# Most slabs, and most pixels of all slabs together, of a wave that nobody requested: 8 slabs of the largest window take
# 10 ms. Strong turbulence near the limit would take 32 or 64 slabs.
MOST_SLABS, MOST_SAMPLES = 16, 3e5
# Share of the pupil near a focus (screens.py) above which traced rays replace the slabs' rays, and above which straight
# rays do. Traced rays need a map of RESOLVED pixels per finest half period.
SOME, MANY, RESOLVED = 0.01, 0.1, 4.0


def by_waves(
    field: IndexField,
    pupil: Pupil,
    wavelength: float,
    feature: float | None,
    limit: float,
    traced: MapPaths | None = None,
    resolved: bool = True,
    limited: bool = False,
) -> Validity:
    """Return the verdict of a wave through slabs of the field (diffraction.py); a `feature` of None is searched for.

    `traced` is the map of traced rays, if there is one: near foci it replaces the slabs' rays. A `feature` that the map
    did not resolve is measured again on the window. `limited` keeps the number of slabs cheap beside a wavefront.
    """
    reach = max(pupil.half_extent)
    flat = is_one_column(field, pupil.normal)
    clear = is_clear(field, pupil, pupil.normal, wavelength)
    margin = 0.0 if clear else fringes(field, wavelength)
    if not clear:
        traced = None
    begin, end = span_of(field, pupil.center, pupil.normal, pupil.axes, (-reach, reach), (-reach, reach))
    look = LookingAlong(pupil.center, pupil.normal, pupil.axes, _half_window(reach, wavelength, end, margin))
    make: Callable[..., Slabs] = slabs_of if clear else SlabsPastBody
    slabs = make(field, look, begin, end, wavelength)
    half = _half_window(reach, wavelength, slabs.last, margin)
    least, most = COLUMN_PIXELS if flat else (max(LEAST_PIXELS, PER_REACH * half / reach), slabs.most_pixels)
    if feature is None:
        feature = _finest_of(slabs, pupil, flat, wavelength)
    # A rim makes fringes as fine as the pixels allow: then the most pixels are used.
    pixels = _fast(max(min(2.0 * half * PER_FEATURE / feature, most), least)) if clear else most
    window = window_of(pupil, half, pixels, flat)
    path = slabs.paths(window.x, window.y, 1)[0]
    if not resolved:
        seen = np.where(window.amplitude > 0.0, path, np.float32(np.nan))
        feature = finest_and_squares(seen, window.pixel, wavelength)[0]
        if feature <= window.pixel and pixels < most:
            window = window_of(pupil, half, _fast(most), flat)
            path = slabs.paths(window.x, window.y, 1)[0]
    distance = disturbance(field, pupil, pupil.normal).length if clear else _slabs_length(slabs, pupil, flat)
    shadow, light = shadow_of(slabs, window, wavelength, end)
    crossings = crossings_of(path[window.near], window.pixel, light[window.near], distance)
    comparison = WaveAndRays(
        window=window,
        slabs=slabs,
        light=light,
        before=slabs.first,
        after=end - slabs.last,
        wavelength=wavelength,
        ambient_index=field.ambient_index,
        straight=crossings.near > MANY,
        traced=None if traced is None else traced.strehl,
        by_traced=traced is not None and _by_traced(crossings, feature, traced.pixel),
        most_slabs=_most_slabs(window) if limited else FINEST,
    )
    change, error = comparison.change(limit)
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


def _most_slabs(window: Window) -> int:
    """Return the number of slabs that a wave which nobody requested has at most."""
    count = MOST_SLABS
    while count * window.amplitude.size > MOST_SAMPLES:
        count //= 2
    return count


def _fast(pixels: float) -> int:
    """Return the next number of pixels for which Fourier transforms are fast."""
    from scipy.fft import next_fast_len

    return int(next_fast_len(math.ceil(pixels)))


def _half_window(reach: float, wavelength: float, last: float, beside: float) -> float:
    """Return half the width [m] of a window that holds the light of a pupil of half width `reach` up to `last` [m]."""
    return max(min(LEAST_WINDOW * reach + BESIDE * math.sqrt(wavelength * last), MOST_WINDOW * reach), reach + beside)


def _finest_of(slabs: Slabs, pupil: Pupil, flat: bool, wavelength: float) -> float:
    """Return the half period of the finest phase [m] of straight lines through slabs, on lines across the pupil."""
    count = COLUMN_PIXELS[1] if flat else 2 * slabs.most_pixels // 3
    pixel = 2.0 * max(pupil.half_extent) / count
    place = pixel * (np.arange(count) - count // 2)
    few = np.zeros(1) if flat else place[_some_of(count)]
    lines = []
    for x, y in ((few, place),) if flat else ((few, place), (place, few)):
        path = slabs.paths(x, y, 1)[0]
        lit = np.abs(y[:, None]) <= pupil.half_extent[1] if flat else pupil.transmission(*np.meshgrid(x, y)) > 0.0
        opaque = slabs.opaque(x, y, FINEST)
        if opaque is not None:
            lit = lit & ~opaque.any(axis=0)
        path = np.where(lit, path, np.nan)
        lines.append(path.T if x is few else path)
    return _finest_on(np.stack(lines), pixel, wavelength)[0]


def _by_traced(crossings: Crossings, feature: float, pixel: float) -> bool:
    """Return whether to compare with a traced map: near foci, if the map resolves the finest phase.

    Where rays have crossed only traced rays are meaningful, and the errors of a map of strong phases vary from pixel to
    pixel. Before they cross, the phase of a grating may hide between pixels.
    """
    return crossings.crossed > 0.0 or (crossings.near > SOME and feature >= RESOLVED * pixel)


def is_one_column(field: IndexField, normal: np.ndarray) -> bool:
    """Return whether nothing varies along a window's first axis, as in a planar field seen across its axis."""
    return field.geometry == "planar" and abs(float(normal[0])) < 1e-15


def _slabs_length(slabs: Slabs, pupil: Pupil, flat: bool) -> float:
    """Return the disturbed length [m] from lines through the slabs; if `flat`, constant along x, from one row."""
    place = places_across(pupil, SLAB_LINES)
    lit = pupil.transmission(*np.meshgrid(place, place)) > 0.0
    across = np.zeros(1) if flat else place
    if flat:
        lit = np.asarray(lit.any(axis=1, keepdims=True))
    opaque = slabs.opaque(across, place, FINEST)
    if opaque is not None and (lit & ~opaque.any(axis=0)).any():
        lit &= ~opaque.any(axis=0)
    return spread_along(slabs.paths(across, place, FINEST)[:, lit], slabs.first, slabs.last).length


def finest_and_squares(path: np.ndarray, pixel: float, wavelength: float) -> tuple[float, float]:
    """Return the half period [m] of the finest phase above UNSEEN rad, and a mean square [m2] that identifies the map.

    `path` [m] is NaN outside the pupil. The half period is infinite if there is no such phase. Uses second differences
    at increasing distance, which are independent of tilt and of the pupil's edge: a component of period p has its full
    amplitude at a distance of p / 2. The mean square is the one of these differences.
    """
    # A sample of lines is enough: columns and, for a map of more than one column, rows.
    part = _some_of(len(path))
    lines = [path.T[part], path[part]] if path.shape[0] == path.shape[1] else [path.T[part]]
    return _finest_on(np.array(lines), pixel, wavelength)


def _some_of(count: int) -> slice:
    return slice(None, None, max(1, count // FEATURE_LINES))


def _finest_on(lines: np.ndarray, pixel: float, wavelength: float) -> tuple[float, float]:
    """Return `finest_and_squares` of lines of paths (directions, lines, n)."""
    count, wave_number, squares = lines.shape[-1], 2.0 * np.pi / wavelength, 0.0
    for stride in (2**power for power in range(int(np.log2(max(count // 2, 1))) + 1)):
        # For a coarse difference a sparse sample of points is enough.
        step = max(1, stride // 2)
        squares = _mean_squares(lines[..., ::step], stride // step)
        # A component sampled at its extremes has a second difference of four times its amplitude.
        if wave_number * math.sqrt(squares / 8.0) > 2.0 * UNSEEN:
            return stride * pixel, squares
    return float("inf"), squares


def _mean_squares(lines: np.ndarray, stride: int) -> float:
    """Return the sum over directions of mean squared second differences of lines (directions, lines, n) at `stride`."""
    second = lines[..., 2 * stride :] + lines[..., : -2 * stride]
    second -= 2.0 * lines[..., stride:-stride]
    counts = np.add.reduce(second == second, axis=(1, 2))
    second *= second
    totals = np.add.reduce(np.fmax(second, np.float32(0.0), out=second), axis=(1, 2))  # fmax drops NaN
    return sum(total / max(count, 1) for total, count in zip(totals.tolist(), counts.tolist(), strict=True))


def fresnel_number(feature: float, wavelength: float, distance: float) -> float:
    """Return the Fresnel number of a feature [m] over a distance [m]; infinite for no distance."""
    return feature**2 / (wavelength * distance) if distance > 0.0 else float("inf")
