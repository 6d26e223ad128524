"""Map of a wavefront from samples scattered over a pupil, such as random rays or a sensor's lenslets.

Zernike polynomials are fitted first; the residual is interpolated over triangles (Clough and Tocher's cubics), and
extrapolated by parabolas. The error is measured: every fourth sample is predicted from the others.
"""

from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.kinds import refuse_masked, wrong_kind
from ..pupils import Pupil
from ..tracing.variants.causes import FACTOR, Variants
from ..tracing.variants.paths import Cause, Rays
from ..zernike import zernike_modes
from .changes import smooth_draws
from .pixels import pupil_grid

W = TypeVar("W", bound=Any)  # Wavefront, of which this is a method
# Most Zernike polynomials; fewest samples for each of them; fewest samples of a wavefront.
MODES, PER_MODE, FEWEST = 36, 3, 9
# One of so many samples is predicted from the others to measure the error.
LEFT_OUT = 4
# Up to so many samples, each is left out once; with more, fewer eighths are left out, about so many samples in all.
EACH_LEFT_OUT = 5000
# A hole is a point of the pupil farther from every sample than so many mean distances of the samples.
HOLE = 4.0
# Most samples in the fit of a parabola.
ABOUT = 14


@checked
def from_samples(
    cls: type[W],
    /,
    points: Numbers,
    opd: Numbers,
    pupil: Pupil,
    wavelength: float,
    *,
    pixel_count: int | None = None,
    error: Numbers | None = None,
) -> W:
    """Interpolate samples scattered over a pupil to a map: see scattered.py. The error is measured on the samples.

    Args:
        cls: The class of the wavefront.
        points: Positions of the samples: x and y in the pupil's plane from its centre [m], shape (n, 2), or points
            in space, shape (n, 3).
        opd: Their optical path differences [m], positive where light is delayed, shape (n,).
        pupil: The pupil, whose transmission weights the map.
        wavelength: Vacuum wavelength [m].
        pixel_count: As for `wavefront`.
        error: Error of all samples, a number, or of each, shape (n,) [m], if known; "sampling" in the budget.

    Raises:
        TypeError: The wavelength is not a number, or `pupil` is not a pupil.
        ValueError: Shapes disagree; samples are not finite, too few, duplicated or do not cover the pupil; or a
            number is out of range.
    """
    if not isinstance(pupil, Pupil):
        raise wrong_kind(pupil, "pupil", "a Disc, Annulus, Rectangle, Polygon or Mask")
    place, values = _checked(points, opd, pupil)
    sizes = np.array(0.0 if error is None else error, dtype=np.float64)
    if sizes.shape not in ((), values.shape) or not (np.isfinite(sizes) & (sizes >= 0.0)).all():
        raise ValueError(f"error must be a length of at least 0 m, or one for each sample, or None, got {error!r}")
    coordinate, pixel, weight, intensity = pupil_grid(pupil, pixel_count)
    lit = weight > 0.0
    wanted = np.stack([axis[lit] for axis in np.meshgrid(coordinate, coordinate)], axis=1)
    _check_cover(place, wanted, pixel, pupil)
    result = np.full(weight.shape, np.nan)
    result[lit] = _interpolated(place, values, wanted, pupil.reach)
    varied = partial(_varied, place, values, pupil, np.broadcast_to(sizes, values.shape))
    options: dict[str, Any] = {"intensity": intensity, "radius": pupil.reach, "pupil": pupil, "varied": varied}
    return cls(result, weight, pixel, wavelength, **options)


def _varied(place: np.ndarray, values: np.ndarray, pupil: Pupil, sizes: np.ndarray) -> Variants:
    """Return some samples and how they change: to what the others predict, and by patterns of their own error."""
    turns = min(max(LEFT_OUT * EACH_LEFT_OUT // len(values), 1), LEFT_OUT)
    rows, changes = [], []
    for turn in range(turns):
        out = np.arange(len(values)) % LEFT_OUT == (turn + LEFT_OUT // 2) % LEFT_OUT
        rows.append(np.flatnonzero(out))
        changes.append(_interpolated(place[~out], values[~out], place[out], pupil.reach) - values[out])
    order = np.random.default_rng(0).permutation(sum(map(len, rows)))  # any part of them is a sample
    some, change = (np.concatenate(one)[order] for one in (rows, changes))
    still = Rays.still(len(some))
    causes = {"interpolation": Cause(like=(replace(still, opd=change),))}
    if sizes.any():
        draws = smooth_draws(place[some], pupil.reach, 1.0 / FACTOR)
        causes["sampling"] = Cause(draws=tuple(one * sizes[some] for one in draws))
    start, look = pupil.center + place[some] @ np.stack(pupil.axes), np.tile(pupil.normal, (len(some), 1))
    base = replace(still, opd=values[some])
    return Variants(start, look, np.full(len(some), 1.0 / len(some)), base, causes)


def _checked(points: Any, opd: Any, pupil: Pupil) -> tuple[np.ndarray, np.ndarray]:
    """Check the samples; return points in the pupil's plane [m], shape (n, 2), and OPD [m], shape (n,)."""
    refuse_masked(points, "points")
    refuse_masked(opd, "opd")
    # Copies: the error is measured when it is first read.
    place, values = np.array(points, dtype=np.float64), np.array(opd, dtype=np.float64)
    if place.ndim != 2 or place.shape[1] not in (2, 3) or values.shape != place.shape[:1]:
        raise ValueError(
            "points must have shape (n, 2), x and y in the pupil, or (n, 3), in space, and opd shape (n,), got "
            f"{place.shape} and {values.shape}"
        )
    bad = ~(np.isfinite(place).all(axis=1) & np.isfinite(values))
    if bad.any():
        raise ValueError(f"{int(bad.sum())} samples are not finite, the first is sample {int(np.argmax(bad))}")
    if place.shape[1] == 3:
        place = (place - pupil.center) @ np.stack(pupil.axes).T
    if len(place) < FEWEST:
        raise ValueError(f"a wavefront needs at least {FEWEST} samples, got {len(place)}")
    if len(np.unique(place, axis=0)) < len(place):
        raise ValueError("two samples are at the same point: give one sample for each point")
    return place, values


def _check_cover(place: np.ndarray, wanted: np.ndarray, pixel: float, pupil: Pupil) -> None:
    from scipy.spatial import cKDTree

    apart = cKDTree(place).query(wanted)[0]
    # The centre of a pixel on the rim may be outside the pupil, where samples are not required.
    outside = pupil.transmission(wanted[:, 0], wanted[:, 1]) == 0.0
    apart = np.maximum(apart - np.where(outside, np.sqrt(0.5) * pixel, 0.0), 0.0)
    reach = HOLE * pixel * np.sqrt(len(wanted) / len(place))
    if (apart > reach).any():
        share = 100.0 * float(np.mean(apart > reach))
        raise ValueError(
            f"{share:.3g} % of the pupil is farther than {reach:.3g} m from every sample: give samples there, in "
            "metres from the pupil's centre, or a smaller pupil"
        )


def _interpolated(place: np.ndarray, values: np.ndarray, wanted: np.ndarray, radius: float) -> np.ndarray:
    """Interpolate values at points `place` (n, 2) to points `wanted` (m, 2)."""
    from scipy.interpolate import CloughTocher2DInterpolator

    count = min(MODES, max(3, len(values) // PER_MODE))
    modes = zernike_modes(count, *(place.T / radius))
    coefficients = np.linalg.lstsq(modes.T, values, rcond=1e-9)[0]
    left = values - coefficients @ modes
    result = coefficients @ zernike_modes(count, *(wanted.T / radius))
    # In units of the radius and of the greatest residual: the interpolator's own tolerances are not relative.
    scale = max(float(np.abs(left).max()), 1e-300)
    more = CloughTocher2DInterpolator(place / radius, left / scale)(wanted / radius)
    beyond = ~np.isfinite(more)
    if beyond.any():
        more[beyond] = _beyond(place / radius, left / scale, wanted[beyond] / radius)
    return np.asarray(result + scale * more)


def _beyond(place: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Extrapolate to points outside all triangles, by a parabola fitted to the samples near each point."""
    from scipy.spatial import cKDTree

    near = cKDTree(place).query(wanted, min(ABOUT, len(place)))[1]
    beside = place[near] - wanted[:, None]
    x, y = np.moveaxis(beside / np.abs(beside).max(axis=(1, 2), keepdims=True), -1, 0)
    basis = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    return np.asarray(np.einsum("nk,nk->n", np.linalg.pinv(basis, rcond=1e-6)[:, 0], values[near]))
