"""The vacuum wavelength: what is none is refused, and a field is evaluated at the one it was made for."""

import math
from typing import SupportsFloat

# The laser of the source paper; what calls take where neither they nor the field name one.
DEFAULT_WAVELENGTH = 905e-9
# Air is opaque below, and no laser rangefinder works beyond. The range mostly catches a wavelength in the wrong unit.
SHORTEST, LONGEST = 0.1e-6, 20e-6
# Two wavelengths that differ by less than this share are the same number written in two ways, as 905e-9 and 0.905e-6.
SAME = 1e-6


def check_wavelength(wavelength: SupportsFloat) -> float:
    """A vacuum wavelength [m], or a refusal that says which unit it was perhaps given in.

    Raises:
        TypeError: It is not one number.
        ValueError: It is not a positive length, or lies outside 0.1 to 20 um.
    """
    if isinstance(wavelength, (bool, str, bytes)):
        raise TypeError(f"wavelength must be a number of metres, got {wavelength!r}: give 905e-9 for 905 nm")
    try:
        length = float(wavelength)
    except (TypeError, ValueError):
        raise TypeError(f"wavelength must be a number of metres, got {wavelength!r}: give 905e-9 for 905 nm") from None
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(
            f"wavelength must be a positive length in metres, got {wavelength!r}: give metres, 905e-9 for 905 nm"
        )
    if not SHORTEST <= length <= LONGEST:
        raise ValueError(f"wavelength {length:g} m is outside 0.1 to 20 um: give metres, {_meant(length)}")
    return length


def _meant(length: float) -> str:
    """The wavelength that a number outside the range was perhaps meant to be."""
    for unit, size in (("nm", 1e-9), ("um", 1e-6), ("mm", 1e-3), ("angstrom", 1e-10)):
        if SHORTEST <= length * size <= LONGEST:
            return f"{length * size:g} for {length:g} {unit}"
    return "905e-9 for 905 nm"


def field_wavelength(made_for: float | None, asked: SupportsFloat | None) -> float:
    """The wavelength [m] that a field is evaluated at: its own, the one asked for, or that of the paper's laser.

    Args:
        made_for: The field's own [m], or None where it is made of contrasts that belong to no wavelength.
        asked: What the caller gave [m], or None.

    Raises:
        TypeError: As `check_wavelength`.
        ValueError: As `check_wavelength`; or the field was made for another wavelength.
    """
    if asked is None:
        return DEFAULT_WAVELENGTH if made_for is None else made_for
    wavelength = check_wavelength(asked)
    if made_for is None:
        return wavelength
    if abs(wavelength - made_for) > SAME * made_for:
        raise ValueError(
            f"wavelength {wavelength:g} m is asked for, but the index field was made for {made_for:g} m: make the "
            f"index field at that wavelength, index_field(wavelength={wavelength:g}), or leave wavelength out"
        )
    return made_for
