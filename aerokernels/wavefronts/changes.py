"""Errors of a wavefront's numbers: each computed again on a map that changes by cause, and on finer pixels.

A traced map changes as some of its rays do, each pixel as the nearest of them; a map from elsewhere by smooth patterns
as large as its error. A pixel's error is found by the places nearest to it. The error due to the pixels is three times
the change on pixels of a third of the side: eight ninths of what a number of second order is off by, more of a steep or
rough wavefront.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..tracing.some_pixels import NEAR, STUDENT, total
from ..tracing.variants.causes import FACTOR, Variants, errors, of_a_ray, of_each
from ..tracing.variants.paths import Cause, Rays
from .pixels import PARTS, repeated, three_in_a_row, values_of_parts
from .terms import PupilNumbers, remove_named, weighted_mean

# Pixels whose changes are drawn where no rays are known; number of draws, cosines in each, and their wavelengths over
# 2 pi [radii], in turn.
PIXELS, DRAWS, WAVES, SIZES = 512, 16, 24, (1.0, 0.5, 0.25, 0.1)
# Greatest size of changes by a cause, over the greatest of any, that does not count.
LEAST = 0.01
# A wavefront -> a number of it, or an array.
Number = Callable[[Any], Any]


@dataclass(frozen=True, eq=False)
class Changes:
    """Some places of a wavefront's pupil, and how the OPD there changes by cause."""

    points: np.ndarray  # the places [m], shape (k, 2)
    variants: Variants  # their changes and their shares, which sum to 1
    nearest: np.ndarray  # the place nearest to each pixel inside the pupil, shape (lit count,)
    counting: Variants  # the changes without those by causes that do not count in a sum of squares

    def applied(self, wave: Any, rays: Rays) -> Any:
        """Return the wavefront with the OPD changed as that of the places, without the terms removed from it."""
        opd = np.array(wave.opd)
        opd[wave.lit] += (rays.opd - self.variants.base.opd)[self.nearest]
        return without_named(replace(wave, opd=opd), wave.removed)


def changes_of(wave: Any) -> Changes | None:
    """Return how a wavefront changes by the causes of its error; None if that is not known."""
    from scipy.spatial import cKDTree

    if wave.varied is not None:
        result = wave.varied()
        if result is None:
            return None
        points = (result.start - wave.pupil.center) @ np.linalg.pinv(np.stack(wave.aperture.axes, axis=1)).T
    else:
        sizes = known_errors(wave)
        if sizes is None:
            return None
        some = np.random.default_rng(0).permutation(len(wave.points))[:PIXELS]
        points, sizes = wave.points[some], sizes[some]
        draws = smooth_draws(points, wave.radius, 1.0 / FACTOR) if sizes.any() else ()
        draws = tuple(one * sizes for one in draws)
        result = Variants(points, points, points, Rays.still(len(points)), {"interpolation": Cause(draws=draws)})
    own = cKDTree(wave.points).query(points)[1]
    opd, weight = (values[own] for values in wave.samples)
    result = replace(result, weight=weight / weight.sum(), base=replace(result.base, opd=opd))
    size = {
        name: float(np.max([one.opd.std() for one in (*cause.known, *cause.like, *cause.draws)], initial=0.0))
        for name, cause in result.causes.items()
    }
    least = LEAST * max(size.values(), default=0.0)
    causes = {name: cause for name, cause in result.causes.items() if not size[name] <= least}
    nearest = cKDTree(points).query(wave.points)[1]
    return Changes(points, result, nearest, replace(result, causes=causes))


def known_errors(wave: Any) -> np.ndarray | None:
    """Return the errors [m] that a map from elsewhere has at its pixels, shape (lit count,); None if not known."""
    if wave.error_map is not None:
        return np.asarray(wave.error_map[wave.lit])
    error = float({"total": np.nan, **({} if wave.budget is None else wave.budget())}["total"])
    return None if np.isnan(error) else np.full(len(wave.points), error)


def smooth_draws(points: np.ndarray, radius: float, rms: float) -> tuple[Rays, ...]:
    """Return random patterns of an rms [m] about their mean at points (k, 2) of a pupil."""
    rng, draws = np.random.default_rng(0), []
    for number in range(DRAWS):
        way = rng.normal(0.0, 1.0 / (SIZES[number % len(SIZES)] * radius), (2, WAVES))
        pattern = np.cos(points @ way + rng.uniform(0.0, 2.0 * np.pi, WAVES)).sum(axis=1)
        pattern -= pattern.mean()
        size = float(np.sqrt(np.mean(pattern**2)))
        draws.append(replace(Rays.still(len(points)), opd=pattern * (rms / size if size > 0.0 else 0.0)))
    return tuple(draws)


def of_pixels(wave: Any, number: Number) -> np.ndarray:
    """Return the error of a number, or of each in an array, due to the pixels; NaN if they are too few to tell."""
    plain = np.asarray(number(wave))
    if not three_in_a_row(wave.lit):
        return np.full(plain.shape, np.nan)
    return np.asarray(3.0 * np.abs(number(finer(wave)) - plain))


def of_changes(wave: Any, number: Number) -> np.ndarray:
    """Return the error of a number of a map, or of each in an array, but for the pixels; NaN if it is not known."""
    changes = wave.changes
    if changes is None:
        return np.full(np.shape(number(wave)), np.nan)
    return _total(lambda rays: number(changes.applied(wave, rays)), changes)


def of_map(wave: Any, number: Number) -> np.ndarray:
    """Return the error of a number of a map, or of each in an array; NaN if it is not known."""
    return np.asarray(np.hypot(of_changes(wave, number), of_pixels(wave, number)))


def _total(number: Callable[[Rays], np.ndarray], changes: Changes) -> np.ndarray:
    """Return the error of a number of rays, or of each in an array, by all causes."""
    causes = errors(number, changes.counting).values()
    return np.asarray(np.linalg.norm([np.zeros(np.shape(number(changes.variants.base))), *causes], axis=0))


def of_samples(wave: Any) -> np.ndarray:
    """Return the errors of Strehl ratio, OPD rms [m] and slopes along x and y [rad], shape (4,)."""
    changes = wave.changes
    if changes is None:
        return np.full(4, np.nan)
    numbers = PupilNumbers(changes.points, changes.variants.weight, wave.wavelength)

    def number(rays: Rays) -> np.ndarray:
        flat = remove_named(rays.opd, changes.variants.weight, changes.points, wave.removed, wave.radius)
        return numbers(replace(rays, opd=flat))[[0, 2, 3, 4]]

    pixels = of_pixels(wave, lambda one: np.array([one.strehl(), one.rms, *one.tilt]))
    result = np.hypot(_total(number, changes), pixels)
    result[2:][np.ptp(wave.points, axis=0) == 0.0] = np.nan  # a line has no slope across it
    return np.asarray(result)


def of_opd(wave: Any):
    """Return the error budget of the OPD of a pixel [m], about the mean and without the removed terms."""
    return of_a_ray(partial(_of_opd, wave), wave.changes.variants, "m")


def of_each_pixel(wave: Any) -> np.ndarray:
    """Return the error of the OPD of each pixel [m], as of_opd has it of all, shape (n, n); NaN if it is not known."""
    from scipy.spatial import cKDTree

    found = np.full(wave.opd.shape, np.nan)
    if wave.varied is None:
        sizes = known_errors(wave)
        found[wave.lit] = np.nan if sizes is None else sizes
    elif wave.changes is not None:
        points = wave.changes.points
        near = cKDTree(points).query(wave.points, min(NEAR, len(points)))[1].reshape(len(wave.points), -1)
        found[wave.lit] = STUDENT * total(of_each(partial(_of_opd, wave), wave.changes.variants, near))
    return found


def _of_opd(wave: Any, change: Rays) -> np.ndarray:
    """Return what a change of the places makes of the OPD there, about the mean and without the removed terms."""
    points, weight = wave.changes.points, wave.changes.variants.weight
    left = remove_named(change.opd, weight, points, wave.removed, wave.radius)
    return np.asarray(left - weighted_mean(weight, left))


def of_extremes(wave: Any) -> float:
    """Return the error of the greatest OPD minus the least [m].

    Each is off by the error of its pixel, and lies between pixels: at most a step to a neighbor from its pixel.
    """
    if not three_in_a_row(wave.lit):
        return float("nan")
    steps = off = 0.0
    for place in (np.nanargmax(wave.opd), np.nanargmin(wave.opd)):
        row, column = np.unravel_index(place, wave.opd.shape)
        about = wave.opd[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        steps += float(np.nanmax(np.abs(about - wave.opd[row, column])))
        off += float(wave.pixel_errors[row, column])
    return float(np.hypot(off, steps))


def finer(wave: Any) -> Any:
    """Return a wavefront on pixels of a third of the side, with the removed terms fitted and removed again."""
    result = values_of_parts(np.where(wave.lit, wave.opd, 0.0), wave.lit)
    weight, intensity = _divided(wave, wave.weight, 1), _divided(wave, wave.intensity, 2)
    intensity = np.maximum(intensity, weight**2)
    fine = replace(wave, opd=result, weight=weight, intensity=intensity, pixel=wave.pixel / PARTS, error_map=None)
    return without_named(fine, wave.removed)


def without_named(wave: Any, names: tuple[str, ...]) -> Any:
    """Return a wavefront without terms of `remove_terms` and Zernike polynomials "Z4", ..., fitted to its samples."""
    if not names:
        return wave
    opd = np.full(wave.opd.shape, np.nan)
    path, weight = wave.samples
    opd[wave.lit] = remove_named(path, weight, wave.points, names, wave.radius)
    return replace(wave, opd=opd, removed=tuple(dict.fromkeys((*wave.removed, *names))))


def _divided(wave: Any, values: np.ndarray, power: int) -> np.ndarray:
    """Return mean amplitudes or intensities (power 2) of the parts of pixels; their mean is the pixel's own."""
    whole, count = repeated(values), len(values)
    if wave.aperture is None:
        return whole
    edges = wave.pixel / PARTS * (np.arange(PARTS * count + 1) - 0.5 * PARTS * count)
    share = wave.aperture.coverage(edges, edges, power)
    mean = repeated(share.reshape(count, PARTS, count, PARTS).mean(axis=(1, 3)))
    return np.where(mean > 0.0, whole * share / np.where(mean > 0.0, mean, 1.0), whole)
