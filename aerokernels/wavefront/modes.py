"""Zernike coefficients of a wavefront, its structure function, and where its light goes."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from ..shown import shown
from ..zernike import zernike_modes
from .data import WavefrontMap
from .terms import weighted_mean
from .transfer import autocorrelation


@shown
@dataclass(frozen=True, eq=False)
class StructureFunction:
    """Mean square difference of the OPD over pairs of points.

    Attributes:
        separation: Distance of the points [m], shape (n,), ascending.
        value: <(OPD(x) - OPD(x + r))^2> [m2], shape (n,).
        pair_weight: Weight of the pairs that each value is a mean over, sums to 1, shape (n,).
        opd_error: Makes the error of the OPD [m]; `error` calls it.
    """

    separation: np.ndarray
    value: np.ndarray
    pair_weight: np.ndarray
    opd_error: Callable[[], float] | None = field(default=None, repr=False)

    @cached_property
    def error(self) -> np.ndarray:
        """What each value may be off by [m2], shape (n,); NaN where that is not known. Computed when first read.

        A difference of two points is off by at most 2 e, e that of the OPD, and its mean square by 4 e sqrt(D) + 4 e^2.
        """
        error = float("nan") if self.opd_error is None else self.opd_error()
        return 4.0 * error * np.sqrt(self.value) + 4.0 * error**2

    def plot(self, axes=None):
        """Draw its square root [nm] over the distance on matplotlib axes; returns the axes."""
        from .plots import plot_structure

        return plot_structure(self, axes)


def fit_zernike(wavefront: WavefrontMap, count: int) -> np.ndarray:
    """Coefficients of the first `count` Zernike polynomials [m] that fit best, shape (count,).

    Raises:
        ValueError: More polynomials than the pupil's samples tell apart.
    """
    opd, weight = wavefront.samples
    basis = zernike_modes(count, *(wavefront.points.T / wavefront.radius)).T
    root = np.sqrt(weight)[:, None]
    found, _, rank, _ = np.linalg.lstsq(basis * root, opd * root[:, 0], rcond=1e-9)
    if rank < count:
        raise ValueError(
            f"{count} Zernike polynomials are more than the pupil's {len(opd)} samples tell apart ({rank}): take "
            "fewer, or a greater pixel_count"
        )
    return np.asarray(found)


def zernike_surface(wavefront: WavefrontMap, coefficients: np.ndarray) -> np.ndarray:
    """The sum of Zernike polynomials of these coefficients [m], shape (n, n); NaN outside the pupil."""
    surface = np.full(wavefront.opd.shape, np.nan)
    modes = zernike_modes(len(coefficients), *(wavefront.points.T / wavefront.radius))
    surface[wavefront.lit] = coefficients @ modes
    return surface


def structure_function(wavefront: WavefrontMap) -> StructureFunction:
    """Structure function over rings of the width of a pixel, by correlation: every pair of pixels counts.

    D(r) = sum w w' (W - W')^2 / sum w w'.
    """
    weight = wavefront.weight
    opd, share = wavefront.samples
    flat = np.zeros(weight.shape)
    flat[wavefront.lit] = opd - weighted_mean(share, opd)  # smaller numbers, smaller rounding
    pairs = autocorrelation(weight).real
    square, cross = autocorrelation(weight * flat**2, weight).real, autocorrelation(weight * flat).real
    total = square + square[::-1, ::-1] - 2.0 * cross
    shift = np.arange(1 - len(weight), len(weight))
    distance = np.hypot(shift[:, None], shift)
    ring = np.rint(distance).astype(int).ravel()
    there = pairs.ravel() > 1e-9 * pairs.max()
    counts = np.bincount(ring[there], pairs.ravel()[there])
    sums = np.bincount(ring[there], total.ravel()[there])
    mean = np.bincount(ring[there], (pairs * distance).ravel()[there])
    kept = counts > 0.0
    counts = counts[kept]
    value = np.maximum(sums[kept] / counts, 0.0)
    distances, shares = wavefront.pixel * mean[kept] / counts, counts / counts.sum()
    return StructureFunction(distances, value, shares, partial(getattr, wavefront, "opd_error"))


def centroid(wavefront: WavefrontMap) -> np.ndarray:
    r"""Centroid of the point spread function [rad], shape (2,), along x and y: the mean slope of the OPD.

    By Parseval's theorem the centroid of |A|^2 is \int |A|^2 grad OPD / \int |A|^2; slopes are
    differences of neighbours.
    """
    intensity = np.asarray(wavefront.intensity)
    return np.array([_mean_slope(wavefront.opd, intensity, axis) for axis in (1, 0)]) / wavefront.pixel


def _mean_slope(opd: np.ndarray, intensity: np.ndarray, axis: int) -> float:
    """Mean difference of a map's neighbours along an axis, by intensity: central, or of second order at an edge."""
    opd, intensity = np.moveaxis(opd, axis, 0), np.moveaxis(intensity, axis, 0)
    # NaN outside the pupil spreads to the differences that there are not.
    step = np.diff(np.pad(opd, ((3, 3), (0, 0)), constant_values=np.nan), axis=0)
    count = len(opd)
    before, after = step[2 : count + 2], step[3 : count + 3]
    at_edges = np.where(
        np.isnan(before), 1.5 * after - 0.5 * step[4 : count + 4], 1.5 * before - 0.5 * step[1 : count + 1]
    )
    at_edges = np.where(np.isnan(at_edges), np.where(np.isnan(before), after, before), at_edges)
    slope = np.where(np.isnan(before) | np.isnan(after), at_edges, 0.5 * (before + after))
    there = np.isfinite(slope)
    return float((intensity * np.where(there, slope, 0.0)).sum() / intensity[there].sum()) if there.any() else np.nan
