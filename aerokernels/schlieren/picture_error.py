"""Error of the brightness of a picture's pixels.

The picture is made again from the same light and compared. The error is the sum of

    the tracing   its change with rays of a tenth of the tolerance in double precision
    the rays      twice its greatest change with two and three rays for each along both sides of a pixel: a pixel is the
                  mean over its area, and one number of rays may agree with another by chance at a body's edge; beside
                  the outline of a body also half of the distance of the rays, which may miss a strip of that width
    the grid      its change through every second and every fourth node of the field, extrapolated by the observed order
                  around each pixel (medium/level_maps.py); for a resampled field, these of the field before, and the
                  change by resampling it

each the greatest of some pixels around. The sensor's noise, the air beyond the field's box (`known` marks it) and the
field's own errors are not in it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ..medium import IndexField
from ..medium.level_maps import changes_between, pixels_around, remaining_error
from .line_of_sight import LineOfSight, ParallelLight

# Tolerance of the rays that measure the error of others, as a factor.
TIGHTER = 0.1
# Rays along a side of a pixel that measure the error of others, as multiples.
FINER = (2, 3)
# Factor on the change with other rays: four times the rays leave a quarter of the error of a smooth picture, and half
# of it where there is an edge.
SAFETY = 2.0

# Makes the brightness, shape (ny, nx), from traced light: one for each point of the source.
Make = Callable[[Iterable[LineOfSight]], np.ndarray]


def error_of(shown: np.ndarray, lights: Sequence[ParallelLight | None], make: Make) -> Callable[[], np.ndarray] | None:
    """Return a function that returns `picture_error`; None if one of the lights is not known."""
    known = [one for one in lights if one is not None]
    return partial(picture_error, shown, known, make) if len(known) == len(lights) else None


def shown_as(lights: Iterable[LineOfSight], make: Make, exposure: float) -> np.ndarray:
    """Return the brightness of made light at an exposure, 0 black to 1 white, shape (ny, nx)."""
    return np.clip(exposure * make(lights), 0.0, 1.0)


def picture_error(shown: np.ndarray, lights: Sequence[ParallelLight], make: Make) -> np.ndarray:
    """Return the error of a picture's brightness, shape (ny, nx); NaN on a mesh without coarser versions.

    Args:
        shown: The brightness, shape (ny, nx).
        lights: The light that the picture was made from: one for each point of its source.
        make: Makes the brightness from this light, traced.
    """
    field = lights[0].field
    base = field if field.source is None else field.source
    levels = base.refinement
    if levels is None:
        return np.full(shown.shape, np.nan)

    outline = np.zeros(shown.shape, dtype=bool)

    def lit(one: ParallelLight) -> LineOfSight:
        traced = one.trace()
        share = traced.pixel_mean(traced.blocked.astype(np.float64))
        outline[...] |= _range_around(share) > 0.0
        return traced

    def again(through: IndexField, finer: int = 1) -> np.ndarray:
        options = lights[0].options
        tight = {**options, "tolerance": TIGHTER * options["tolerance"], "precision": "float64"}
        return make(
            lit(replace(one, field=through, options=tight, rays_per_pixel=finer * one.rays_per_pixel)) for one in lights
        )

    traced = again(field)
    versions = [one for one in (levels.fine, levels.coarse, levels.coarser) if one is not None]
    through = [traced if one is field else again(one) for one in versions]
    pitch = min(lights[0].window.pitch)
    around = pixels_around(base, pitch, (shown.shape[0], shown.shape[1]))
    left = remaining_error(levels, changes_between(through), around)
    if base is not field:
        flow = through[0] if levels.fine is base else again(base)
        left = left + _greatest_around(flow - traced, pixels_around(field, pitch, (shown.shape[0], shown.shape[1])))
    finer = [again(field, factor) for factor in FINER]
    rays = SAFETY * np.max([_greatest_around(one - traced, 3) for one in finer], axis=0)
    strip = _range_around(finer[-1]) / (2.0 * FINER[-1] * lights[0].rays_per_pixel)
    return np.asarray(_greatest_around(traced - shown, 3) + rays + np.where(outline, strip, 0.0) + left)


def _range_around(values: np.ndarray) -> np.ndarray:
    """Return the greatest value less the least one of a pixel and its neighbours."""
    from scipy.ndimage import maximum_filter, minimum_filter

    return np.asarray(maximum_filter(values, 3, mode="nearest") - minimum_filter(values, 3, mode="nearest"))


def _greatest_around(change: np.ndarray, width: int) -> np.ndarray:
    from scipy.ndimage import maximum_filter

    return np.asarray(maximum_filter(np.abs(change), size=width, mode="nearest"))
