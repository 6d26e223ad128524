r"""Errors of transfer functions and other image quantities due to the pixels of a wavefront.

A pixel has one sample, at its centre, and the mean amplitude of its area. Errors are added as squares:

    the shares     the mean product of a point of one pixel and a point of another is w w' + c, |c| <= s s' by Cauchy
                   and Schwarz, s^2 = <|A|^2> - w^2; edges that coincide after the shift, as those of a rectangle
                   shifted along an edge, reach this bound
    the moments    twice the second-order deficit of the shares of edge pixels (pixel_weights.py)
    the halves     twice the change with pixels of half the side (half_pixels.py)
    the samples    the standard error of the mean over the four grids of every other row and column, and what that mean
                   differs by where the number is not linear in the transfer function

A number that needs its own grid, such as a width or a mean slope, is evaluated on the four coarser grids as well: their
mean minus the number on all pixels represents errors of some order in the pixel's side, their spread the rest, and the
exact weights represent what no coarser grid with the same edge pixels shows.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from operator import attrgetter
from typing import Any

import numpy as np

from .data import WavefrontMap
from .half_pixels import halved
from .modes import centroid_weights
from .pixel_errors import INTERLEAVED, SAFETY, pixel_errors
from .pixel_weights import exact_weights, three_in_a_row
from .point_spread import complex_amplitude
from .transfer import Transfer, autocorrelation, encircled, normalised_sensitivity, transfer_function

# Radii of the sum over light by its angle.
RADII = 65


def transfer_errors(wavefront: WavefrontMap, number: Callable[[Transfer], Any]) -> np.ndarray:
    """Return the error due to the pixels of what `number` computes from the transfer function."""
    return np.asarray(np.linalg.norm(_parts(wavefront, number), axis=0))


def otf_errors(wavefront: WavefrontMap) -> np.ndarray:
    """Return the error due to the pixels of each value of the transfer function, shape (n, n).

    Few pixels overlap at high frequencies: by chance their four grids may agree. So no part of an error is smaller than
    its root mean square over the frequency and its eight neighbours.
    """
    from scipy.ndimage import uniform_filter

    coincident, *others = _parts(wavefront, attrgetter("value"))
    about = (np.sqrt(np.maximum(uniform_filter(one**2, 3, mode="constant"), one**2)) for one in others)
    return np.asarray(np.linalg.norm(np.array([coincident, *about]), axis=0))


def sensitivity_errors(wavefront: WavefrontMap, fried: float) -> np.ndarray:
    """Return the error due to the pixels of PSSn, whose frequencies are as far apart as the pixels.

    The change by linear interpolation between the frequencies represents the error of the cubic one. Four grids that
    agree by chance have no neighbours here as those of a transfer function have: their error is two standard errors.
    """

    def number(otf: Transfer, cubic: bool = True) -> float:
        return normalised_sensitivity(otf, wavefront.wavelength, fried, cubic)

    transfer = transfer_function(wavefront)
    coincident, moments, halves, spread, mean = _parts(wavefront, number)
    by_spacing = number(transfer, False) - number(transfer)
    return np.asarray(np.linalg.norm(np.array([coincident, moments, halves, SAFETY * spread, mean, by_spacing])))


def _parts(wavefront: WavefrontMap, number: Callable[[Transfer], Any]) -> list[np.ndarray]:
    """Return the parts of the error of a number: by the shares, the moments, the halves, the samples, and their mean.

    The mean over the four grids differs from the number where that is not linear in the transfer function.
    """
    plain = np.asarray(number(transfer_function(wavefront)))
    if not three_in_a_row(wavefront.lit):
        return [np.full(plain.shape, np.nan)] * 5
    coincident, exact, halves, *grids = (np.asarray(number(one)) for one in _transfers(wavefront))
    spread = np.sqrt(np.var(grids, axis=0, ddof=1) / len(grids))
    return [
        np.abs(coincident - plain),
        SAFETY * np.abs(exact - plain),
        SAFETY * np.abs(halves - plain),
        spread,
        np.abs(np.mean(grids, axis=0) - plain),
    ]


def encircled_errors(wavefront: Any, angle: np.ndarray, center: np.ndarray, is_centroid: bool) -> np.ndarray:
    r"""Return the error due to the pixels of shares within angles [rad] about a point, of the angles' shape.

    If the point is the centroid, the change of the shares as it moves by its error is part of theirs.

    The transform treats pixels as points, which folds all light into wavelength / pixel. The light of square pixels
    decreases by sinc^2 with the angle, (pi^2 / 3) \int a^2 dE pixel^2 / wavelength^2 to second order.
    """
    read = transfer_errors(wavefront, lambda transfer: encircled(transfer, angle, center))
    radius = np.linspace(0.0, float(np.max(angle, initial=0.0)), RADII)
    energy = encircled(transfer_function(wavefront), radius, center)
    squares = np.concatenate([[0.0], np.cumsum(0.5 * (radius[1:] ** 2 + radius[:-1] ** 2) * np.diff(energy))])
    folded = (np.pi * wavefront.pixel / wavefront.wavelength) ** 2 / 3.0 * np.abs(squares)
    parts = [read, np.interp(angle, radius, np.minimum(folded, 1.0))]
    if is_centroid:
        transfer = transfer_function(wavefront)
        shares = encircled(transfer, angle, center)
        for move in np.diag(centroid_errors(wavefront)):
            moved = [encircled(transfer, angle, center + sign * move) for sign in (1.0, -1.0)]
            parts.append(np.max(np.abs(np.array(moved) - shares), axis=0))
    return np.asarray(np.linalg.norm(parts, axis=0))


def centroid_errors(wavefront: Any) -> np.ndarray:
    """Return the error of the centroid along x and y [rad], shape (2,), due to the OPD's error and the pixels.

    An OPD error e changes the centroid, a mean slope, by at most e along the whole rim.
    """
    rims = wavefront.opd_error * np.abs(centroid_weights(wavefront)).sum(axis=(1, 2))
    edges = pixel_errors(wavefront)
    pixels = grid_errors(wavefront, lambda one: one.centroid)
    return np.asarray(np.linalg.norm([rims, [edges["tilt_x"], edges["tilt_y"]], pixels], axis=0))


def _transfers(wavefront: WavefrontMap) -> Iterator[Transfer]:
    """Yield the transfer functions of coincident edges, exact weights, half pixels, and each interleaved grid."""
    weight, intensity = np.asarray(wavefront.weight), np.asarray(wavefront.intensity)
    lit, plain = wavefront.lit, transfer_function(wavefront)

    def wave(weights: np.ndarray) -> np.ndarray:
        return weights * complex_amplitude(wavefront.opd, lit.astype(np.float64), wavefront.wavelength)

    rest = np.sqrt(np.maximum(intensity - weight**2, 0.0))
    more, perfect = (autocorrelation(one) / wavefront.power for one in (wave(rest), rest))
    yield _at_rest(replace(plain, value=plain.value + more, perfect=plain.perfect + perfect.real))
    exact = exact_weights(weight, wavefront.pixel, wavefront.aperture)
    value, perfect = (autocorrelation(one) / wavefront.power for one in (wave(exact), exact))
    yield _at_rest(replace(plain, value=value, perfect=perfect.real))
    finer, shares = halved(wavefront)
    finest = shares * complex_amplitude(finer, (shares > 0.0).astype(np.float64), wavefront.wavelength)
    value, perfect = (autocorrelation(one)[1::2, 1::2] / (4.0 * wavefront.power) for one in (finest, shares))
    yield _at_rest(replace(plain, value=value, perfect=perfect.real))
    for every in INTERLEAVED:
        some = np.zeros(weight.shape)
        some[every] = 1.0
        power = float((some * intensity).sum())
        if power > 0.0:
            value, perfect = (_halves(some * one, one) / power for one in (wave(weight), weight))
            yield _at_rest(replace(plain, value=value, perfect=perfect.real))


def _halves(some: np.ndarray, all_of: np.ndarray) -> np.ndarray:
    """Return the correlation of some pixels with all, in both directions."""
    found = autocorrelation(some, all_of)
    return 0.5 * (found + found[::-1, ::-1].conj())


def _at_rest(transfer: Transfer) -> Transfer:
    middle = len(transfer.frequency) // 2
    transfer.value[middle, middle] = transfer.perfect[middle, middle] = 1.0
    return transfer


def grid_errors(wavefront: Any, number: Callable[[Any], Any]) -> np.ndarray:
    """Return the error due to the pixels of numbers that `number` computes on the wavefront's own grid."""
    plain = np.asarray(number(wavefront))
    odd = len(wavefront.opd) % 2
    grids = []
    maps = {name: np.pad(getattr(wavefront, name), (0, odd)) for name in ("opd", "weight", "intensity")}
    for every in INTERLEAVED:
        coarse = {name: values[every] for name, values in maps.items()}
        if coarse["weight"].any():
            grids.append(np.asarray(number(replace(wavefront, **coarse, pixel=2.0 * wavefront.pixel, pupil=None))))
    if len(grids) < 2 or not three_in_a_row(wavefront.lit):
        return np.full(plain.shape, np.nan)
    spread = np.std(grids, axis=0, ddof=1) / np.sqrt(len(grids))
    # Slivers with a negative exact weight are left out: a Wavefront allows none.
    exact = np.maximum(exact_weights(np.asarray(wavefront.weight), wavefront.pixel, wavefront.aperture), 0.0)
    second_order = SAFETY * (np.asarray(number(replace(wavefront, weight=exact, intensity=None))) - plain)
    return np.sqrt((np.mean(grids, axis=0) - plain) ** 2 + second_order**2 + spread**2)
