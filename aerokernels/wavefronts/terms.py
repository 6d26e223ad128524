r"""Fit and remove piston, tilt and focus of a wavefront by least squares; mean phasor of a wavefront.

Several terms are fitted together, always with the mean: OPD ~ c + a x + b y + d (x^2 + y^2). The slopes a, b [rad] are
the angle by which the beam that leaves the pupil is deflected.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..tracing.variants.paths import Rays
from ..zernike import zernike_modes

# Terms that can be removed.
TERMS = ("piston", "tilt", "focus")
# An rms of ten thousand waves [m]: the caller most likely gave nanometres or waves.
GREATEST_OPD = 1e-2


@dataclass(frozen=True)
class TiltFit:
    """Least-squares plane of a wavefront.

    Attributes:
        piston: Mean optical path difference [m].
        tilt: Slopes along the pupil's two axes [rad], shape (2,).
        residual_rms: Root mean square of the OPD without them [m].
    """

    piston: float
    tilt: np.ndarray
    residual_rms: float


def check_wavefront(opd, weights) -> tuple[np.ndarray, np.ndarray]:
    """Return the OPD as flat float64 and weights that sum to 1. Samples of weight 0 may have any value, also NaN."""
    opd = np.asarray(opd, dtype=np.float64).ravel()
    if weights is not None and np.size(weights) == opd.size:
        opd = np.where(np.asarray(weights).ravel() == 0.0, 0.0, opd)
    if opd.size == 0 or not np.isfinite(opd).all():
        bad = int((~np.isfinite(opd)).sum())
        raise ValueError(f"the wavefront must be finite and not empty, got {bad} bad of {opd.size} samples")
    if weights is None:
        return opd, np.full(opd.size, 1.0 / opd.size)
    weights = np.asarray(weights, dtype=np.float64).ravel()
    if weights.shape != opd.shape or not np.isfinite(weights).all() or (weights < 0).any() or weights.sum() <= 0.0:
        raise ValueError(
            f"weights must be finite, not negative, not all zero, one for each of the {opd.size} samples; "
            f"got {weights.size}"
        )
    return opd, weights / weights.sum()


def check_metres(opd: np.ndarray, weights: np.ndarray) -> None:
    """Check that the rms of a flat wavefront, with weights that sum to 1, is plausible in metres."""
    rms = float(np.sqrt(weighted_mean(weights, np.square(opd - weighted_mean(weights, opd)))))
    if rms > GREATEST_OPD:
        raise ValueError(
            f"the wavefront's rms is {rms:.3g} m, more than {GREATEST_OPD:g} m: give metres, 50e-9 for 50 nm, waves "
            "times the wavelength"
        )


def weighted_mean(weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the mean of values, shape (n,) or (n, k), by weights that sum to 1.

    By NumPy's own sum: the last bits of a BLAS product depend on the number of threads.
    """
    return np.sum(weights.reshape(-1, *[1] * (values.ndim - 1)) * values, axis=0)


def _fitted(basis: np.ndarray, weights: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return the factors (k,) of columns (n, k) that fit values (n,) by weighted least squares.

    Sums by einsum have the same bits on any number of threads. In a pupil that is a line or a point the slope across it
    is undetermined: the least-norm solution is zero.
    """
    weighted = (basis * weights[:, None]).T
    products = np.einsum("kn,nm->km", weighted, basis), np.einsum("kn,n->k", weighted, values)
    return np.linalg.lstsq(*products, rcond=1e-12)[0]


@checked
def fit_tilt(opd: Numbers, points: Numbers, weights: Numbers | None = None) -> TiltFit:
    """Fit piston and tilt by weighted least squares.

    Args:
        opd: Optical path difference [m], shape (n,).
        points: Coordinates in the pupil's plane [m], shape (n, 2).
        weights: Weight of each sample, or None for equal weights.

    Raises:
        ValueError: Shapes disagree, numbers are not finite, or weights are negative or all zero.
    """
    opd, weights = check_wavefront(opd, weights)
    centred = _centred(points, weights)
    piston = float(weighted_mean(weights, opd))
    tilt = _fitted(centred, weights, opd - piston)
    residual = opd - piston - centred @ tilt
    return TiltFit(piston, tilt, float(np.sqrt(weighted_mean(weights, residual**2))))


def _centred(points, weights: np.ndarray) -> np.ndarray:
    """Return the points (n, 2) about their mean by weights (n,) that sum to 1."""
    points = np.asarray(points, dtype=np.float64)
    if points.shape != (weights.size, 2) or not np.isfinite(points).all():
        raise ValueError(f"points must be finite, of shape ({weights.size}, 2) like the wavefront, got {points.shape}")
    return points - weighted_mean(weights, points)


def map_points(opd, points):
    """Return the given points, or for a map (a two-axis array) its pixel coordinates about the middle; else None."""
    if points is None and np.ndim(opd) == 2:
        rows, columns = np.indices(np.shape(opd), dtype=np.float64)
        height, width = np.shape(opd)
        return np.stack([rows.ravel() - 0.5 * (height - 1), columns.ravel() - 0.5 * (width - 1)], axis=1)
    return points


def remove_terms(opd, remove, points=None, weights=None) -> np.ndarray:
    """Return the wavefront without the named terms [m]: "piston", "tilt", "focus", fitted together.

    "focus" is the square of the distance from the origin of `points`, the pupil's centre.

    Raises:
        ValueError: A term is unknown, or "tilt" or "focus" is to be removed and there are no points to fit over.
    """
    remove = check_terms(remove)
    opd, weights = check_wavefront(opd, weights)
    if points is None and (fitted := [term for term in remove if term != "piston"]):
        raise ValueError(
            f"removing '{fitted[0]}' needs the positions of the samples: give the wavefront as a map (two axes), "
            "or points, the pupil coordinates of the samples, shape (n, 2)"
        )
    return _without(opd, weights, points, remove)


def _without(opd: np.ndarray, weights: np.ndarray, points, terms: Iterable[str]) -> np.ndarray:
    """Return a flat wavefront, finite and with weights that sum to 1, without terms fitted together with its mean."""
    if "tilt" in terms or "focus" in terms:
        centred = _centred(points, weights)
        basis = centred
        if "focus" in terms:
            size = np.sqrt(weighted_mean(weights, np.sum(centred**2, axis=1))) or 1.0
            columns = [*(centred.T / size)] if "tilt" in terms else []
            # About the mean of the points where tilt is fitted too, which absorbs the difference; else the origin.
            square = np.sum((centred if "tilt" in terms else np.asarray(points, np.float64)) ** 2, axis=1) / size**2
            basis = np.stack([*columns, square - weighted_mean(weights, square)], axis=1)
        opd = opd - basis @ _fitted(basis, weights, opd - np.sum(weights * opd))
    return opd - np.sum(weights * opd) if "piston" in terms else opd


def remove_named(
    opd: np.ndarray, weights: np.ndarray, points: np.ndarray, removed: tuple[str, ...], radius: float
) -> np.ndarray:
    """Return the wavefront without terms of `remove_terms` and Zernike polynomials "Z4", ...: see `Wavefront.removed`.

    Points (n, 2) and the radius of the polynomials' disc are in metres; weights sum to 1.
    """
    flat = opd if set(TERMS).isdisjoint(removed) else _without(*check_wavefront(opd, weights), points, removed)
    others = set(removed).difference(TERMS)
    indices = others and [int(name[1:]) for name in others if name[:1] == "Z" and name[1:].isdigit()]
    if not indices:
        return flat
    modes, root = zernike_modes(max(indices), *(points.T / radius)).T, np.sqrt(weights)
    fitted = np.linalg.lstsq(modes * root[:, None], flat * root, rcond=1e-9)[0]
    chosen = np.array(sorted(set(indices))) - 1
    return np.asarray(flat - modes[:, chosen] @ fitted[chosen])


def mean_phasor(opd: np.ndarray, weights: np.ndarray, wavelength: float) -> complex:
    """Return <exp(i k OPD)> over flat samples whose weights sum to 1; its squared magnitude is the Strehl ratio."""
    return complex(np.sum(weights * np.exp(2j * np.pi / wavelength * opd)))


def check_terms(remove) -> tuple[str, ...]:
    """Return the terms to remove as a tuple of known names; reject unknown ones."""
    if not isinstance(remove, (str, list, tuple, set, frozenset)):
        raise TypeError(f"remove must be names of terms, among {', '.join(TERMS)}, got {remove!r}")
    remove = (remove,) if isinstance(remove, str) else tuple(remove)
    unknown = [term for term in remove if not isinstance(term, str) or term not in TERMS]
    if unknown:
        parts = tuple(" ".join(map(str, remove)).replace(",", " ").replace("+", " ").split())
        remedy = f"write {parts}" if set(parts) <= set(TERMS) else f"choose from {', '.join(TERMS)}"
        raise ValueError(f"cannot remove {unknown}: {remedy}")
    return remove


# The numbers, in order.
NUMBERS = ("value", "marechal", "opd_rms", "boresight_x", "boresight_y")


@dataclass(frozen=True, eq=False)
class PupilNumbers:
    """Computes NUMBERS: Strehl ratio, Marechal's, OPD rms [m], and the beam's deflection along two axes [rad]."""

    points: np.ndarray  # coordinates of the rays across the pupil [m], shape (n, 2)
    weight: np.ndarray  # their shares, shape (n,)
    wavelength: float  # vacuum wavelength [m]
    remove: tuple[str, ...] = ("piston",)  # terms removed before the first three

    def __call__(self, rays: Rays) -> np.ndarray:
        """Return NUMBERS of rays, shape (5,)."""
        path, weight = check_wavefront(rays.opd, self.weight)
        opd = _without(path, weight, self.points, (*self.remove, "piston"))
        square = np.sum(self.weight * opd**2)
        phasor = np.sum(self.weight * np.exp(2j * np.pi / self.wavelength * opd))
        marechal = np.exp(-((2.0 * np.pi / self.wavelength) ** 2) * square)
        tilt = _fitted(_centred(self.points, weight), weight, path - np.sum(weight * path))
        return np.array([abs(complex(phasor)) ** 2, marechal, np.sqrt(square), *tilt])
