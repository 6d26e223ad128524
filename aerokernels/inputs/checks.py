"""Check arguments, wavelengths among them: each function rejects a value by its name and states the remedy."""

import math
import os
import sys
import warnings
from collections.abc import Collection, Iterable
from pathlib import Path
from typing import Any, SupportsFloat

import numpy as np

from aerokernels.inputs.kinds import as_whole

# Of rays, pixels, samples: kernels number them by 32 bits.
GREATEST_COUNT = 2**31 - 1

# Times [s], samples, and the sample period [s], as `as_waveform` returns them.
Waveform = tuple[np.ndarray, np.ndarray, float]


def check_path(value: Any, name: str) -> Path:
    """Return a text or path-like of texts as a path; raises a TypeError or a ValueError for anything else."""
    if not isinstance(value, (str, os.PathLike)) or not isinstance(os.fspath(value), str):
        raise TypeError(f"{name} must be a text or a Path, got {type(value).__name__}")
    if "\0" in os.fspath(value):
        raise ValueError(f"{name} is {os.fspath(value)!r}: a path has no zero character")
    return Path(value)


def check_positive(value: float, name: str, unit: str = "") -> float:
    """Return `value` as a float that is positive and finite; raises a ValueError, or a TypeError for no number."""
    number = _as_number(value, name)
    if not (math.isfinite(number) and number > 0.0):
        raise ValueError(f"{name} must be positive and finite{f' [{unit}]' if unit else ''}, got {value!r}")
    return number


def check_at_least(value: float, name: str, least: float = -math.inf) -> float:
    """Return `value` as a float that is finite and not below `least`; errors as `check_positive`."""
    number = _as_number(value, name)
    if not (math.isfinite(number) and number >= least):
        bound = "" if least == -math.inf else f" and at least {least:g}"
        raise ValueError(f"{name} must be finite{bound}, got {value!r}")
    return number


def check_count(count: float, name: str = "ray_count", least: int = 1, most: int = GREATEST_COUNT) -> int:
    """Return a whole number from `least` to `most`, which may be given as a float; raises a ValueError for others."""
    number = as_whole(count)
    if number is None or not least <= number <= most:
        is_small = most >= GREATEST_COUNT and (number is None or number < least)
        limits = f"of at least {least}" if is_small else f"from {least} to {most}"
        raise ValueError(f"{name} must be a whole number {limits}, got {count!r}")
    return number


def check_share(value: float, name: str) -> float:
    """Return `value` as a float in [0, 1]; errors as `check_positive`."""
    number = _as_number(value, name)
    if not 0.0 <= number <= 1.0:
        raise ValueError(f"{name} must lie between 0 and 1 (a fraction, not per cent), got {value!r}")
    return number


def check_tilt(value: float) -> float:
    """Return a tilt as a float in (-pi/2, pi/2) [rad]; errors as `check_positive`."""
    number = _as_number(value, "tilt")
    if not abs(number) < 0.5 * math.pi:
        raise ValueError(f"tilt must lie between -pi/2 and pi/2 rad (not degrees), got {value!r}")
    return number


def remedy_of_angle(angle: float) -> str:
    """Return the remedy for an angle [rad] that is too great: beyond a right angle it was given in degrees."""
    if angle > 0.5 * math.pi:
        return f"the Mach number comes first, then the angle in radians, np.radians({angle:g})"
    return "take a smaller angle or a faster flow"


def check_aperture(diameter: float, distance: float) -> None:
    """Refuse a receiver that is wider than its target is far [m], because more light would return than was sent."""
    if diameter > distance:
        raise ValueError(
            f"a receiver of {diameter:g} m diameter is wider than its target is far, {distance:g} m: give both, "
            "receiver.diameter and target.distance, in metres, 12e-3 for 12 mm"
        )


def check_choice(value: str, name: str, choices: Collection[str]) -> str:
    """Return `value`, one of `choices`; raises a ValueError for another."""
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} {value!r} is not known: choose one of {', '.join(choices)}")
    return value


def as_finite_array(values, name: str) -> np.ndarray:
    """Return `values` as a float64 array; raises a ValueError for NaN and infinities, or a TypeError."""
    try:
        array = np.asarray(values)
    except ValueError:
        raise TypeError(f"{name} must hold real numbers, got rows of different lengths") from None
    if not (np.issubdtype(array.dtype, np.number) or array.dtype == bool) or np.iscomplexobj(array):
        raise TypeError(f"{name} must hold real numbers, got dtype {array.dtype}")
    array = array.astype(np.float64)
    bad = ~np.isfinite(array)
    if bad.any():
        place = int(np.argmax(bad))
        raise ValueError(f"{name}: {int(bad.sum())} of {array.size} values are not finite, the first at index {place}")
    return array


def as_waveform(time, voltage, least_count: int = 4) -> Waveform:
    """Return the times [s] and samples of a waveform as float64, shape (n,), and its sample period [s].

    Raises:
        ValueError: Shapes that disagree, too few samples, numbers that are not finite, times that do not increase
            evenly, or steps too long to be in seconds.
        TypeError: Values that are not real numbers.
    """
    times, values = as_finite_array(time, "time"), as_finite_array(voltage, "voltage")
    if times.ndim != 1 or times.shape != values.shape:
        raise ValueError(f"time and voltage must be lists of one length, got shapes {times.shape} and {values.shape}")
    if times.size < least_count:
        raise ValueError(f"a waveform needs at least {least_count} samples, got {times.size}")
    steps = np.diff(times)
    if not (steps > 0.0).all():
        raise ValueError(f"time must increase: it does not after sample {int(np.argmin(steps > 0.0))}; sort the record")
    period = float((times[-1] - times[0]) / (times.size - 1))
    if period > 1e-3:  # no rangefinder has a longer one: the times are in nanoseconds, or are sample numbers
        raise ValueError(
            f"time steps by {period:.3g} from sample to sample, and light goes {299_792_458.0 * period:.2g} m in so "
            "many seconds: give seconds, 1e-9 for 1 ns"
        )
    uneven = np.abs(steps - period) > 1e-3 * period
    if uneven.any():
        raise ValueError(
            f"time must increase in even steps: the step after sample {int(np.argmax(uneven))} is "
            f"{steps[np.argmax(uneven)]:.6g} s, the mean {period:.6g} s; resample the record first"
        )
    return times, values, period


def _as_number(value: Any, name: str) -> float:
    if type(value) is float:
        return value
    if isinstance(value, (bool, str)) or isinstance(value, (list, tuple)) or np.ndim(value) != 0:
        raise TypeError(f"{name} must be one number, got {value!r}")
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise TypeError(f"{name} must be one number, got {value!r}") from None


def listed(names: Iterable[object], none: str = "nothing") -> str:
    """Return the first 20 names, shortened, and how many more there are; `none` where there are none."""
    every = [str(name) for name in names]
    first = [name if len(name) <= 60 else f"{name[:60]}..." for name in every[:20]]
    return (", ".join(first) or none) + (f" and {len(every) - 20} more" if len(every) > 20 else "")


_FOLDER = str(Path(__file__).parents[1]) + os.sep


def warn_caller(message: str, category: type[Warning] = UserWarning) -> None:
    """Warn at the innermost line outside the package that led here, or at the outermost line of the thread."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_FOLDER):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


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
