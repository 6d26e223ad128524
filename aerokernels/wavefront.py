r"""Wavefronts over a pupil: piston and tilt, and the point spread function.

A wavefront is the optical path difference at points of a pupil. Its tilt is fitted by least squares: OPD ~ c + a x + b
y, with slopes a, b in radians, the angle by which the beam that leaves the pupil is deflected.
"""

from dataclasses import dataclass

import numpy as np

from .wavelength import check_wavelength

TERMS = ("piston", "tilt")
# A thousand waves and more about the mean: nanometres, or waves, that were taken for metres.
GREATEST_OPD = 1e-2


@dataclass(frozen=True)
class TiltFit:
    """Least-squares plane of a wavefront.

    Attributes:
        piston: Mean optical path difference [m].
        tilt: Slopes along the pupil's two axes [rad], shape (2,).
        residual_rms: Root mean square of what is left [m].
    """

    piston: float
    tilt: np.ndarray
    residual_rms: float


def check_wavefront(opd, weights) -> tuple[np.ndarray, np.ndarray]:
    """Flat float64 OPD and weights that sum to 1, or a refusal. Samples of weight 0 may be anything, NaN too."""
    opd = np.asarray(opd, dtype=np.float64).ravel()
    if weights is not None and np.size(weights) == opd.size:
        opd = np.where(np.asarray(weights).ravel() == 0.0, 0.0, opd)
    if opd.size == 0 or not np.isfinite(opd).all():
        bad = int((~np.isfinite(opd)).sum())
        raise ValueError(f"the wavefront must be finite and not empty, got {bad} bad of {opd.size} samples")
    if weights is None:
        return _in_metres(opd, np.full(opd.size, 1.0 / opd.size))
    weights = np.asarray(weights, dtype=np.float64).ravel()
    if weights.shape != opd.shape or not np.isfinite(weights).all() or (weights < 0).any() or weights.sum() <= 0.0:
        raise ValueError(
            f"weights must be finite, not negative, not all zero, one for each of the {opd.size} samples; "
            f"got {weights.size}"
        )
    return _in_metres(opd, weights / weights.sum())


def _in_metres(opd: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A wavefront as it is, unless it is so many waves that its unit must be another one."""
    rms = float(np.sqrt(weights @ np.square(opd - weights @ opd)))
    if rms > GREATEST_OPD:
        raise ValueError(
            f"the wavefront's rms is {rms:.3g} m, more than {GREATEST_OPD:g} m: give metres, 50e-9 for 50 nm, waves "
            "times the wavelength"
        )
    return opd, weights


def fit_tilt(opd, points, weights=None) -> TiltFit:
    """Fit piston and tilt.

    Args:
        opd: Optical path difference [m], shape (n,).
        points: Coordinates in the pupil's plane [m], shape (n, 2).
        weights: Share of each sample, or None for equal shares.

    Raises:
        ValueError: Shapes that disagree, numbers that are not finite, weights that make no sense.
    """
    opd, weights = check_wavefront(opd, weights)
    points = np.asarray(points, dtype=np.float64)
    if points.shape != (opd.size, 2) or not np.isfinite(points).all():
        raise ValueError(f"points must be finite, of shape ({opd.size}, 2) like the wavefront, got {points.shape}")
    piston = float(weights @ opd)
    centred = points - weights @ points
    flat = opd - piston
    # A pupil that is a line or a point has no slope across it: the least-norm solution is zero there.
    weighted = (centred * weights[:, None]).T
    tilt = np.linalg.lstsq(weighted @ centred, weighted @ flat, rcond=1e-12)[0]
    residual = flat - centred @ tilt
    return TiltFit(piston, tilt, float(np.sqrt(weights @ residual**2)))


def map_points(opd, points):
    """The points given, or the pixel coordinates of a wavefront that is a map (a two-axis array); else None."""
    if points is None and np.ndim(opd) == 2:
        rows, columns = np.indices(np.shape(opd), dtype=np.float64)
        return np.stack([rows.ravel(), columns.ravel()], axis=1)
    return points


def remove_terms(opd, remove, points=None, weights=None) -> np.ndarray:
    """The wavefront less the named terms [m].

    Raises:
        ValueError: An unknown term, or "tilt" without the points it is fitted over.
    """
    remove = check_terms(remove)
    opd, weights = check_wavefront(opd, weights)
    if "tilt" in remove:
        if points is None:
            raise ValueError(
                "removing 'tilt' needs to know where the samples lie: give the wavefront as a map (two axes), "
                "or points, the pupil coordinates of the samples, shape (n, 2)"
            )
        fit = fit_tilt(opd, points, weights)
        points = np.asarray(points, dtype=np.float64)
        opd = opd - (points - weights @ points) @ fit.tilt
    if "piston" in remove:
        opd = opd - weights @ opd
    return opd


def check_terms(remove) -> tuple[str, ...]:
    """The terms to remove, or a refusal of an unknown one."""
    remove = (remove,) if isinstance(remove, str) else tuple(remove)
    unknown = [term for term in remove if term not in TERMS]
    if unknown:
        raise ValueError(f"cannot remove {unknown}: choose from {', '.join(TERMS)}")
    return remove


@dataclass(frozen=True)
class PointSpread:
    """A point spread function.

    Attributes:
        intensity: Intensity over the peak of the undistorted pupil, shape (n, n); its greatest value is the Strehl
            ratio when tilt is left out of account.
        angle: Field angles of rows and columns [rad], shape (n,).
    """

    intensity: np.ndarray
    angle: np.ndarray


def point_spread_function(
    opd, mask, pixel: float, wavelength: float, *, padding: int = 8, half_width: float | None = None
) -> PointSpread:
    """Point spread function of a wavefront on a square grid, by the discrete Fourier transform of the pupil.

    A few rings need a small part of the transform only: with `half_width` that part is computed as two products with
    matrices (R. Soummer et al., Opt. Express 15 (2007) 15935), which gives the same values.

    Args:
        opd: Optical path difference on a square grid [m], shape (n, n); values outside `mask` are ignored.
        mask: Transmission of the pupil (0 to 1), shape (n, n).
        pixel: Grid spacing [m].
        wavelength: Wavelength [m].
        padding: Samples per wavelength / diameter: the pupil is padded to this many times its size.
        half_width: Greatest field angle wanted [rad], along either axis; None for all.

    Raises:
        TypeError: The wavelength is not one number.
        ValueError: Shapes that disagree, an empty pupil, a wavelength outside 0.1 to 20 um, numbers that make no sense.
    """
    opd, mask = np.asarray(opd, dtype=np.float64), np.asarray(mask, dtype=np.float64)
    if opd.ndim != 2 or opd.shape[0] != opd.shape[1] or opd.shape != mask.shape:
        raise ValueError(f"opd and mask must be square and of one shape, got {opd.shape} and {mask.shape}")
    wavelength = check_wavelength(wavelength)
    if not (np.isfinite(pixel) and pixel > 0.0 and padding >= 1):
        raise ValueError(f"pixel and padding must be positive, got {pixel!r} m and {padding!r}")
    if half_width is not None and not half_width >= 0.0:
        raise ValueError(f"half_width must be an angle of at least 0 rad, or None, got {half_width!r}")
    lit = mask > 0.0
    if not lit.any() or not np.isfinite(opd[lit]).all():
        raise ValueError("the pupil must not be empty and the wavefront in it must be finite")
    count = opd.shape[0]
    size = int(count * padding)
    field = mask * np.exp(2j * np.pi / wavelength * np.where(lit, opd, 0.0))
    angle = np.fft.fftshift(np.fft.fftfreq(size, pixel)) * wavelength
    if half_width is None:
        amplitude = np.fft.fftshift(np.fft.fft2(field, (size, size)))
    else:
        shown = np.abs(angle) <= half_width
        angle = angle[shown]
        frequency = np.arange(size)[shown] - size // 2
        # Whole turns are taken out in whole numbers, so that the phase is exact.
        turn = np.outer(frequency, np.arange(count)) % size
        transform = np.exp(-2j * np.pi / size * turn)
        amplitude = transform @ field @ transform.T
    return PointSpread(np.abs(amplitude) ** 2 / mask.sum() ** 2, angle)
