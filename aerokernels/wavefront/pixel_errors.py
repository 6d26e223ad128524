"""Errors of a wavefront's Strehl ratio, rms, tilt and range due to its pixels, each sampled at its centre only.

Two errors are added as squares: twice the second-order deficit of the pixels' shares of the pupil (pixel_weights.py),
twice since the third order is left out; and the standard error of the mean over the four grids of every other row and
column, which represents variations from pixel to pixel. Without three pixels in a row they are NaN, not known.
"""

import math
from typing import Any

import numpy as np

from ..zernike import zernike_modes
from .pixel_weights import exact_weights, three_in_a_row
from .terms import mean_phasor, weighted_mean

SAFETY = 2.0
# Slices of every other row and column: four interleaved grids.
INTERLEAVED = tuple((slice(row, None, 2), slice(column, None, 2)) for row in (0, 1) for column in (0, 1))


def pixel_errors(wavefront: Any) -> dict[str, float]:
    """Return errors due to the pixels of "strehl", "opd_rms" [m], "tilt_x", "tilt_y" [rad] and "peak_to_valley" [m]."""
    opd, lit = wavefront.opd, wavefront.lit
    if not three_in_a_row(lit):
        return dict.fromkeys(("strehl", "opd_rms", "tilt_x", "tilt_y", "peak_to_valley"), math.nan)
    weight = np.asarray(wavefront.weight)
    exact = exact_weights(weight, wavefront.pixel, wavefront.aperture)

    def read(weights: np.ndarray) -> np.ndarray:
        flat = removed_again(wavefront, weights)[lit]
        return _numbers(flat, weights[lit], wavefront.points, wavefront.wavelength)

    lacking = SAFETY * np.abs(read(exact) - read(weight))
    y, x = np.meshgrid(wavefront.coordinate, wavefront.coordinate, indexing="ij")
    grids = []
    for every in INTERLEAVED:
        there = lit[every]
        if there.any():
            points = np.stack([x[every][there], y[every][there]], axis=1)
            # Removed terms are not fitted again: a fit on each grid would remove the differences between the grids.
            grids.append(_numbers(opd[every][there], weight[every][there], points, wavefront.wavelength))
    spread = np.std(grids, axis=0, ddof=1) / np.sqrt(len(grids)) if len(grids) > 1 else np.full(4, np.nan)
    names = ("strehl", "opd_rms", "tilt_x", "tilt_y")
    found = dict(zip(names, np.hypot(lacking, spread).tolist(), strict=True))
    return {**found, "peak_to_valley": _steps_at_extremes(opd)}


def zernike_pixel_errors(wavefront: Any, modes: np.ndarray) -> np.ndarray:
    """Return errors due to the pixels of Zernike coefficients [m], shape (count,).

    Args:
        wavefront: The wavefront.
        modes: The polynomials at its pixels, shape (lit count, count).
    """
    opd, lit = wavefront.opd, wavefront.lit
    if not three_in_a_row(lit):
        return np.full(modes.shape[1], np.nan)
    weight = np.asarray(wavefront.weight)
    exact = exact_weights(weight, wavefront.pixel, wavefront.aperture)

    def fit(values: np.ndarray, weights: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        return _fit(modes[pixels], values[pixels], weights[lit][pixels] / weights.sum())

    every_pixel, given = np.ones(len(modes), dtype=bool), opd[lit]
    by_exact = fit(removed_again(wavefront, exact)[lit], exact, every_pixel)
    lacking = SAFETY * np.abs(by_exact - fit(given, weight, every_pixel))
    grids = []
    for every in INTERLEAVED:
        some = np.zeros(lit.shape, dtype=bool)
        some[every] = True
        if np.count_nonzero(some[lit]) < modes.shape[1]:
            return np.full(modes.shape[1], np.nan)
        grids.append(fit(given, weight, some[lit]))
    return np.hypot(lacking, np.std(grids, axis=0, ddof=1) / np.sqrt(len(grids)))


def removed_again(wavefront: Any, weights: np.ndarray) -> np.ndarray:
    """Return the OPD map [m] with the removed terms fitted and removed again with other weights, shape (n, n).

    A fit with one sample for each pixel leaves a part of the terms in the wavefront.
    """
    lit, removed = wavefront.lit, wavefront.removed
    if not removed:
        return np.asarray(wavefront.opd)
    opd, points, weight = wavefront.opd[lit], wavefront.points, weights[lit] / weights[lit].sum()
    mean = weighted_mean(weight, opd)
    columns = [*((points - weighted_mean(weight, points)).T if "tilt" in removed else ())]
    if "focus" in removed:
        columns.append(np.sum(points**2, axis=1))
    flat = opd - mean
    if columns:
        basis = np.stack([column - weighted_mean(weight, column) for column in columns], axis=1)
        basis /= np.abs(basis).max(axis=0) + 1e-300
        flat = flat - basis @ _fit(basis, flat, weight)
    if "piston" not in removed:
        flat = flat + mean
    indices = [int(name[1:]) for name in removed if name[:1] == "Z" and name[1:].isdigit()]
    if indices:
        modes = zernike_modes(max(indices), *(points.T / wavefront.radius)).T
        chosen = np.array(indices) - 1
        flat = flat - modes[:, chosen] @ _fit(modes, flat, weight)[chosen]
    found = np.full(lit.shape, np.nan)
    found[lit] = flat
    return found


def _numbers(opd: np.ndarray, weight: np.ndarray, points: np.ndarray, wavelength: float) -> np.ndarray:
    """Return Strehl ratio, rms and both slopes of samples; some weights may be negative."""
    weight = weight / weight.sum()
    centred = points - weighted_mean(weight, points)
    flat = opd - weighted_mean(weight, opd)
    rms = np.sqrt(max(float(weighted_mean(weight, flat**2)), 0.0))
    scale = np.abs(centred).max() + 1e-300
    tilt = _fit(centred / scale, flat, weight) / scale
    return np.array([abs(mean_phasor(flat, weight, wavelength)) ** 2, rms, *tilt])


def _fit(basis: np.ndarray, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    weighted = (basis * weight[:, None]).T
    return np.asarray(np.linalg.lstsq(weighted @ basis, weighted @ values, rcond=1e-12)[0])


def _steps_at_extremes(opd: np.ndarray) -> float:
    """Return the sum of the greatest steps from the greatest and the least OPD to a neighbour [m].

    True extremes are between pixels.
    """
    found = 0.0
    for place in (np.nanargmax(opd), np.nanargmin(opd)):
        row, column = np.unravel_index(place, opd.shape)
        about = opd[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        found += float(np.nanmax(np.abs(about - opd[row, column])))
    return found
