"""Convert quantities with units, such as "905 nm", to SI numbers.

Units are accepted at the edges (scene files, command line) and nowhere else: all internal numbers are SI.
"""

import math
import re
from decimal import Decimal, DecimalException

# For each dimension: its noun in messages, its SI unit, and the factor from each unit to SI.
_DIMENSIONS: dict[str, tuple[str, str, dict[str, float]]] = {
    "length": ("a length", "m", {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3}),
    "time": ("a time", "s", {"fs": 1e-15, "ps": 1e-12, "ns": 1e-9, "us": 1e-6, "ms": 1e-3, "s": 1.0}),
    "angle": (
        "an angle",
        "rad",
        {"urad": 1e-6, "mrad": 1e-3, "rad": 1.0, "arcsec": math.pi / 648e3, "deg": math.pi / 180},
    ),
    "power": ("a power", "W", {"nW": 1e-9, "uW": 1e-6, "mW": 1e-3, "W": 1.0, "kW": 1e3, "MW": 1e6}),
    "pressure": (
        "a pressure",
        "Pa",
        {"Pa": 1.0, "hPa": 1e2, "kPa": 1e3, "MPa": 1e6, "mbar": 1e2, "bar": 1e5, "atm": 101325.0},
    ),
    "temperature": ("a temperature", "K", {"K": 1.0, "degC": 1.0}),
    "density": ("a density", "kg/m3", {"kg/m3": 1.0, "g/m3": 1e-3, "g/L": 1.0, "g/cm3": 1e3}),
    "speed": ("a speed", "m/s", {"m/s": 1.0, "km/s": 1e3}),
    "frequency": ("a frequency", "Hz", {"Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9}),
    "voltage": ("a voltage", "V", {"uV": 1e-6, "mV": 1e-3, "V": 1.0}),
    "responsivity": (
        "a responsivity",
        "V/W",
        {"V/W": 1.0, "mV/W": 1e-3, "kV/W": 1e3, "V/mW": 1e3, "V/uW": 1e6, "mV/uW": 1e3},
    ),
    "current": ("a current", "A", {"pA": 1e-12, "nA": 1e-9, "uA": 1e-6, "mA": 1e-3, "A": 1.0}),
    "photodiode responsivity": ("a photodiode's responsivity", "A/W", {"A/W": 1.0, "mA/W": 1e-3}),
    "noise current density": (
        "a noise current density",
        "A/rtHz",
        {"A/rtHz": 1.0, "nA/rtHz": 1e-9, "pA/rtHz": 1e-12, "fA/rtHz": 1e-15},
    ),
    "resistance": ("a resistance", "Ohm", {"Ohm": 1.0, "kOhm": 1e3, "MOhm": 1e6}),
    "gladstone-dale": ("a Gladstone-Dale constant", "m3/kg", {"m3/kg": 1.0, "cm3/g": 1e-3}),
    "dimensionless": ("a plain number", "", {"": 1.0, "%": 1e-2}),
}
# Added after scaling.
_OFFSET = {"degC": 273.15}
# Other spellings of the same unit: the micro sign and the Greek mu, exponents, degrees, roots, the ohm and omega.
_SPELLING = {"µ": "u", "μ": "u", "³": "3", "^": "", "°C": "degC", "°": "deg", "percent": "%"}
_SPELLING |= {"sqrt(Hz)": "rtHz", "√Hz": "rtHz", "\u03a9": "Ohm", "\u2126": "Ohm", "ohm": "Ohm"}
_PATTERN = re.compile(r"([+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)

DIMENSIONS = tuple(_DIMENSIONS)


def quantity(value: float | str, dimension: str) -> float:
    """Return a quantity as an SI number.

    Args:
        value: A number, which is SI already, or a text: a number, an optional blank, and a unit ("905 nm", "10deg",
            "0.63 MPa", "30 %"). A text without a unit is SI.
        dimension: One of `DIMENSIONS`, such as "length" or "angle".

    Returns:
        The quantity in the SI unit of its dimension (m, s, rad, W, Pa, K, kg/m3, Hz, V, V/W, A, A/W, A/rtHz, Ohm,
        m3/kg, 1).

    Raises:
        TypeError: `value` is neither a number nor a text.
        ValueError: No number, an unknown unit, a unit of another dimension, a number that is not finite, or an unknown
            dimension. The message names the value and the units that are accepted.

    Examples:
        >>> quantity("905 nm", "length")
        9.05e-07
    """
    if dimension not in _DIMENSIONS:
        raise ValueError(f"dimension {dimension!r} is not known: choose one of {', '.join(DIMENSIONS)}")
    noun, _, units = _DIMENSIONS[dimension]
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise TypeError(f"{value!r} is not {noun}: {_accepted(dimension)}")
    if not isinstance(value, str):
        return _finite(float(value), value, dimension)
    match = _PATTERN.fullmatch(value.strip())
    if match is None:
        raise ValueError(f"{value!r} is not {noun}: {_accepted(dimension)}")
    unit = match[2].strip()
    for written, meant in _SPELLING.items():
        unit = unit.replace(written, meant)
    if unit and unit not in units:
        raise ValueError(f"{value!r} is not {noun}, {_what_unit_is(unit)}: {_accepted(dimension)}")
    try:
        # Multiply as decimals, so that "6 ns" is the float 6e-9 and not its neighbour.
        number = float(Decimal(match[1]) * Decimal(repr(units.get(unit, 1.0))) + Decimal(repr(_OFFSET.get(unit, 0.0))))
    except (DecimalException, OverflowError):
        number = math.inf
    return _finite(number, value, dimension)


def si_unit(dimension: str) -> str:
    """Return the SI unit of one of `DIMENSIONS`, as `quantity` writes it: "m" for "length", "" for "dimensionless"."""
    return _DIMENSIONS[dimension][1]


def _finite(number: float, value: float | str, dimension: str) -> float:
    if not math.isfinite(number):
        raise ValueError(f"{value!r} is not finite: {_accepted(dimension)}")
    return number


def _accepted(dimension: str) -> str:
    noun, si_unit, units = _DIMENSIONS[dimension]
    if not si_unit:
        return "give a number such as 0.3, or a percentage such as '30 %'"
    return f"give {noun} such as '1 {si_unit}', in one of {', '.join(units)}; a bare number is in {si_unit}"


def _what_unit_is(unit: str) -> str:
    for noun, _, units in _DIMENSIONS.values():
        if unit in units:
            return f"{unit} measures {noun}"
        for known in units:
            if unit.lower() == known.lower():
                return f"{unit!r} is not a known unit (did you mean {known}?)"
    return f"{unit!r} is not a known unit"
