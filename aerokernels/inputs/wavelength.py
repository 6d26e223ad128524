"""Check vacuum wavelengths, and choose the wavelength at which a field is evaluated."""

import math
from typing import SupportsFloat

import numpy as np

# The source paper's laser; the default if neither the call nor the field has a wavelength.
DEFAULT_WAVELENGTH = 905e-9
# Air is opaque below, and no laser rangefinder works above. The limits mostly catch wavelengths in a wrong unit.
SHORTEST, LONGEST = 0.1e-6, 24e-6
# Wavelengths with a smaller relative difference are the same number written in two ways, as 905e-9 and 0.905e-6.
SAME = 1e-6


def check_wavelength(wavelength: SupportsFloat) -> float:
    """Return a vacuum wavelength [m]; the message for a wrong one suggests the unit it may be in.

    Raises a TypeError for no single number, a ValueError outside 0.1 to 24 um.
    """
    if isinstance(wavelength, (bool, str, bytes)):
        raise TypeError(f"wavelength must be a number of metres, got {wavelength!r}: give 905e-9 for 905 nm")
    try:
        length = float(wavelength)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"wavelength must be a number of metres, got {wavelength!r}: give 905e-9 for 905 nm") from None
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(
            f"wavelength must be a positive length in metres, got {wavelength!r}: give metres, 905e-9 for 905 nm"
        )
    if not SHORTEST <= length <= LONGEST:
        raise ValueError(f"wavelength {length:g} m is outside 0.1 to 24 um: give metres, {_meant(length)}")
    return length


def _meant(length: float) -> str:
    """Return the wavelength that a number outside the range may have been meant to be."""
    for unit, size in (("nm", 1e-9), ("um", 1e-6), ("mm", 1e-3), ("angstrom", 1e-10)):
        if SHORTEST <= length * size <= LONGEST:
            return f"{length * size:g} for {length:g} {unit}"
    return "905e-9 for 905 nm"


def field_wavelength(own: float | None, requested: SupportsFloat | None) -> float:
    """Return the wavelength [m] at which a field is evaluated: its own, the requested one, or the paper's laser's.

    A field that was made from contrasts has none of its own. Errors are those of `check_wavelength`; a ValueError also
    where the field was made for another wavelength.
    """
    if requested is None:
        return DEFAULT_WAVELENGTH if own is None else own
    wavelength = check_wavelength(requested)
    if own is None:
        return wavelength
    if abs(wavelength - own) > SAME * own:
        raise ValueError(
            f"wavelength {wavelength:g} m was requested, but the index field was made for {own:g} m: make the "
            f"index field at that wavelength, index_field(wavelength={wavelength:g}), or leave wavelength out"
        )
    return own


def check_spectrum(wavelengths, weights=None) -> tuple[np.ndarray, np.ndarray]:
    """Return vacuum wavelengths [m], shape (n,), and weights that sum to 1.

    `weights` are fractions of the light's energy of any sum, shape (n,); None: equal.

    Raises:
        TypeError: As `check_wavelength`.
        ValueError: As `check_wavelength`; no wavelengths; weights of another shape, negative, not finite or all 0.
    """
    if wavelengths is None:
        raise ValueError("weights need their wavelengths: give both")
    lengths = np.atleast_1d(np.asarray(wavelengths))
    if lengths.ndim != 1 or not len(lengths):
        raise ValueError(f"wavelengths must be numbers [m], shape (n,), got shape {lengths.shape}")
    checked = np.array([check_wavelength(one) for one in lengths])
    shares = np.ones(len(checked)) if weights is None else np.atleast_1d(np.asarray(weights, dtype=np.float64))
    if shares.shape != checked.shape:
        raise ValueError(f"weights must be of shape {checked.shape}, one for each wavelength, got {shares.shape}")
    if not (np.isfinite(shares).all() and (shares >= 0.0).all() and shares.sum() > 0.0):
        raise ValueError("weights must be finite, not negative and not all 0")
    return checked, shares / shares.sum()
