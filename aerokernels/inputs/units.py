"""Units: quantities such as "905 nm" that a user types, and units as files write them, to SI numbers.

`quantity` reads a number and one unit of a short list. It serves the edges (scene files, command line) and nothing
else: all internal numbers are SI. Programs write products and quotients of units beside their arrays, in many
spellings: "kg m-3", "kilogram / meter ** 3", "hPa", "0.2 kg/m3". `written_unit` converts these to a factor to SI.
"""

import math
import re
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal, DecimalException
from fractions import Fraction


def _prefixed(unit: str, powers: dict[str, int]) -> dict[str, float]:
    """Return the factors to SI of a unit with prefixes, by their powers of ten."""
    return {f"{prefix}{unit}": float(f"1e{power}") for prefix, power in powers.items()}


# For each dimension: its noun in messages, its SI unit, and the factor from each unit to SI.
_DIMENSIONS: dict[str, tuple[str, str, dict[str, float]]] = {
    "length": ("a length", "m", _prefixed("m", {"n": -9, "u": -6, "m": -3, "c": -2, "": 0, "k": 3})),
    "time": ("a time", "s", _prefixed("s", {"f": -15, "p": -12, "n": -9, "u": -6, "m": -3, "": 0})),
    "angle": (
        "an angle",
        "rad",
        {**_prefixed("rad", {"u": -6, "m": -3, "": 0}), "arcsec": math.pi / 648e3, "deg": math.pi / 180},
    ),
    "power": ("a power", "W", _prefixed("W", {"n": -9, "u": -6, "m": -3, "": 0, "k": 3, "M": 6})),
    "pressure": (
        "a pressure",
        "Pa",
        {**_prefixed("Pa", {"": 0, "h": 2, "k": 3, "M": 6}), "mbar": 1e2, "bar": 1e5, "atm": 101325.0},
    ),
    "temperature": ("a temperature", "K", {"K": 1.0, "degC": 1.0}),
    "density": ("a density", "kg/m3", {"kg/m3": 1.0, "g/m3": 1e-3, "g/L": 1.0, "g/cm3": 1e3}),
    "speed": ("a speed", "m/s", _prefixed("m/s", {"": 0, "k": 3})),
    "frequency": ("a frequency", "Hz", _prefixed("Hz", {"": 0, "k": 3, "M": 6, "G": 9})),
    "voltage": ("a voltage", "V", _prefixed("V", {"u": -6, "m": -3, "": 0})),
    "responsivity": (
        "a responsivity",
        "V/W",
        {**_prefixed("V/W", {"": 0, "m": -3, "k": 3}), "V/mW": 1e3, "V/uW": 1e6, "mV/uW": 1e3},
    ),
    "current": ("a current", "A", _prefixed("A", {"p": -12, "n": -9, "u": -6, "m": -3, "": 0})),
    "photodiode responsivity": ("a photodiode's responsivity", "A/W", _prefixed("A/W", {"": 0, "m": -3})),
    "noise current density": (
        "a noise current density",
        "A/rtHz",
        _prefixed("A/rtHz", {"": 0, "n": -9, "p": -12, "f": -15}),
    ),
    "resistance": ("a resistance", "Ohm", _prefixed("Ohm", {"": 0, "k": 3, "M": 6})),
    "gladstone-dale": ("a Gladstone-Dale constant", "m3/kg", {"m3/kg": 1.0, "cm3/g": 1e-3}),
    "dimensionless": ("a plain number", "", {"": 1.0, "%": 1e-2}),
}
_CELSIUS = 273.15  # [K], added to degrees
# Other spellings of the same unit: the micro sign and the Greek mu, exponents, degrees, roots, the ohm and omega.
_SPELLING = {"µ": "u", "μ": "u", "³": "3", "^": "", "°C": "degC", "°": "deg", "percent": "%"}
_SPELLING |= {"sqrt(Hz)": "rtHz", "√Hz": "rtHz", "\u03a9": "Ohm", "\u2126": "Ohm", "ohm": "Ohm"}
_PATTERN = re.compile(r"([+-]?(?:\d[\d_]*\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)

DIMENSIONS = tuple(_DIMENSIONS)


def quantity(value: float | str, dimension: str) -> float:
    """Return a quantity of one of `DIMENSIONS` as an SI number.

    `value` is a number, which is SI already, or a text: a number, an optional blank, and a unit ("905 nm", "10deg",
    "0.63 MPa", "30 %"), or none for SI. Raises a TypeError or a ValueError, which names the value and the units that
    are accepted.
    """
    noun, _, units = _DIMENSIONS[dimension]
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise TypeError(f"{value!r} is not {noun}: {_accepted(dimension)}")
    number = math.inf
    if not isinstance(value, str):
        number = float(value)
    else:
        match = _PATTERN.fullmatch(value.strip())
        if match is None:
            raise ValueError(f"{value!r} is not {noun}: {_accepted(dimension)}")
        unit = match[2].strip()
        for written, meant in _SPELLING.items():
            unit = unit.replace(written, meant)
        if unit and unit not in units:
            remedy = _in_si(float(match[1].replace("_", "")), unit, dimension) or _accepted(dimension)
            raise ValueError(f"{value!r} is not {noun}, {_what_unit_is(unit)}: {remedy}")
        with suppress(DecimalException, OverflowError):
            # Multiply as decimals, so that "6 ns" is the float 6e-9 and not its neighbour.
            zero = Decimal(repr(_CELSIUS if unit == "degC" else 0.0))
            number = float(Decimal(match[1]) * Decimal(repr(units.get(unit, 1.0))) + zero)
    if not math.isfinite(number):
        raise ValueError(f"{value!r} is not finite: {_accepted(dimension)}")
    return number


def si_unit(dimension: str) -> str:
    """Return the SI unit of one of `DIMENSIONS`, as `quantity` writes it: "m" for "length", "" for "dimensionless"."""
    return _DIMENSIONS[dimension][1]


def _accepted(dimension: str) -> str:
    noun, si_unit, units = _DIMENSIONS[dimension]
    if not si_unit:
        return "give a number such as 0.3, or a percentage such as '30 %'"
    return f"give {noun} such as '1 {si_unit}', in one of {', '.join(units)}; a bare number is in {si_unit}"


def _in_si(number: float, unit: str, dimension: str) -> str:
    """Return a quantity in a unit that files may have, but not scenes, as what to write; empty for other units."""
    written = written_unit(unit)
    if written is None or written.exponents != EXPONENTS.get(dimension):
        return ""
    return f"write '{number * written.factor + written.offset:.9g} {si_unit(dimension)}'"


def _what_unit_is(unit: str) -> str:
    for noun, _, units in _DIMENSIONS.values():
        if unit in units:
            return f"{unit} measures {noun}"
        for known in units:
            if unit.lower() == known.lower():
                return f"{unit!r} is not a known unit (did you mean {known}?)"
    return f"{unit!r} is not a known unit"


LONGEST_TEXT = 200  # characters of a unit; an attribute may have millions
# Exponents of metre, kilogram, second and kelvin.
EXPONENTS = {"length": (1, 0, 0, 0), "density": (-3, 1, 0, 0), "pressure": (-1, 1, -2, 0), "temperature": (0, 0, 0, 1),
             "time": (0, 0, 1, 0)}  # fmt: skip
_LENGTH, _PRESSURE, _TIME, _KELVIN = (EXPONENTS[name] for name in ("length", "pressure", "time", "temperature"))
_MASS, _VOLUME, _FORCE = (0, 1, 0, 0), (3, 0, 0, 0), (1, 1, -2, 0)
_POUND, _INCH, _GRAVITY = 0.45359237, 0.0254, 9.80665
_FOOT = 12 * _INCH
# Units that accept a prefix, by their symbols and by their names.
_SYMBOLS: dict[str, tuple[float, tuple[int, int, int, int]]] = {
    "m": (1.0, _LENGTH), "g": (1e-3, _MASS), "s": (1.0, _TIME), "K": (1.0, _KELVIN), "Pa": (1.0, _PRESSURE),
    "bar": (1e5, _PRESSURE), "N": (1.0, _FORCE), "L": (1e-3, _VOLUME), "l": (1e-3, _VOLUME),
}  # fmt: skip
_NAMES = {"meter": "m", "metre": "m", "gram": "g", "second": "s", "kelvin": "K", "pascal": "Pa", "bar": "bar",
          "newton": "N", "liter": "L", "litre": "L"}  # fmt: skip
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "h": 1e2, "k": 1e3, "M": 1e6, "G": 1e9}
_PREFIX_NAMES = dict(zip(("nano", "micro", "milli", "centi", "deci", "hecto", "kilo", "mega", "giga"),
                         _PREFIXES, strict=True))  # fmt: skip
_OTHERS = {
    **dict.fromkeys(("in", "inch", "inches"), (_INCH, _LENGTH)),
    **dict.fromkeys(("ft", "foot", "feet"), (_FOOT, _LENGTH)),
    **dict.fromkeys(("micron", "microns"), (1e-6, _LENGTH)), "cc": (1e-6, _VOLUME),
    **dict.fromkeys(("lb", "lbm"), (_POUND, _MASS)), **dict.fromkeys(("Kg", "KG"), (1.0, _MASS)),
    **dict.fromkeys(("slug", "slugs"), (_POUND * _GRAVITY / _FOOT, _MASS)),
    "lbf": (_POUND * _GRAVITY, _FORCE), **dict.fromkeys(("dyn", "dyne"), (1e-5, _FORCE)),
    "psi": (_POUND * _GRAVITY / _INCH**2, _PRESSURE), "psf": (_POUND * _GRAVITY / _FOOT**2, _PRESSURE),
    "atm": (101325.0, _PRESSURE), "Torr": (101325.0 / 760.0, _PRESSURE), "mb": (100.0, _PRESSURE),
    "KPa": (1e3, _PRESSURE), **dict.fromkeys(("PA", "pa"), (1.0, _PRESSURE)),
    "sec": (1.0, _TIME), **dict.fromkeys(("min", "minute", "minutes"), (60.0, _TIME)),
    **dict.fromkeys(("hour", "hours"), (3600.0, _TIME)), **dict.fromkeys(("day", "days"), (86400.0, _TIME)),
    "degK": (1.0, _KELVIN), **dict.fromkeys(("degR", "rankine"), (5.0 / 9.0, _KELVIN)),
}  # fmt: skip


# Both with all prefixes; names, in lower case, also in the plural.
_PREFIXED = {f"{prefix}{symbol}": (float(Fraction(repr(scale)) * Fraction(repr(factor))), powers)
             for symbol, (factor, powers) in _SYMBOLS.items()
             for prefix, scale in _PREFIXES.items()} | _SYMBOLS  # fmt: skip
_NAMED = {f"{prefix}{name}{ending}": _PREFIXED[short + symbol] for name, symbol in _NAMES.items()
          for prefix, short in {"": "", **_PREFIX_NAMES}.items() for ending in ("", "s")}  # fmt: skip
# Temperature scales with another zero: factor, and the offset added after scaling.
_FROM_ANOTHER_ZERO = {
    **dict.fromkeys(("degc", "c", "celsius", "degreescelsius", "degreecelsius", "degreesc", "degreec"),
                    (1.0, _CELSIUS)),
    **dict.fromkeys(("degf", "f", "fahrenheit", "degreesfahrenheit", "degreefahrenheit", "degreef"),
                    (5.0 / 9.0, 459.67 * 5.0 / 9.0)),
}  # fmt: skip
_NO_UNIT = {"", "1", "-", "--", "none", "dimensionless", "nondimensional", "normalized", "normalised", "unitless"}
# Units of ratios, and powers of ten as they are written.
_RATIOS = {"%": 1e-2, "percent": 1e-2, "permille": 1e-3, "ppm": 1e-6, "ppb": 1e-9}
_POWER_OF_TEN = re.compile(r"(?:1(?:\.0*)?)?(?:[eE]|[x*]?10(?:\^|\*\*)?)([-+]\d{1,2})")
_SIGNS = str.maketrans(dict(zip("µμ·⋅×⁻¹²³⁶⁹{}", "uu   -12369()", strict=True)))
_TOKEN = re.compile(r"(?P<over>/)|(?P<open>\()|(?P<close>\))|(?P<one>1(?![\d.]))|(?P<unit>[A-Za-z]+)"
                    r"(?:\^?(?:\((?P<inner>[-+]?\d{1,2})\)|(?P<power>[-+]?\d{1,2})))?|[\s.*]+")  # fmt: skip

_NUMBER = re.compile(r"(\d{1,30}(?:\.\d{0,30})?(?:[eE][-+]?\d{1,3})?)[\s*]+(?=[A-Za-z(])")  # 0.2 kg/m3


@dataclass(frozen=True)
class WrittenUnit:
    """A unit: a value v in this unit is factor v + offset in SI."""

    factor: float
    offset: float
    exponents: tuple[int, ...]  # of metre, kilogram, second and kelvin


def written_unit(text: str) -> WrittenUnit | None:
    """Return the unit that a text names; None for a text without a known unit."""
    if len(text) > LONGEST_TEXT:
        return None
    plain = text.strip().translate(_SIGNS).replace("**", "^").replace("°", "deg")
    if (found := _FROM_ANOTHER_ZERO.get(re.sub(r"[\s_]", "", plain.lower()))) is not None:
        return WrittenUnit(*found, EXPONENTS["temperature"])
    plain = re.sub(r"\s*(\^|/)\s*", r"\1", re.sub(r"\bper\b", "/", plain))
    number = _NUMBER.match(plain)
    # Exact, so that a g/cm3 is 1000 kg/m3 and not its neighbour.
    factor, exponents, at = Fraction(number[1] if number else 1), [0, 0, 0, 0], number.end() if number else 0
    sign, group = 1, [1]
    while at < len(plain):
        match = _TOKEN.match(plain, at)
        if match is None:
            return None
        at = match.end()
        if match["over"]:
            sign = -1
        elif match["open"]:
            group.append(group[-1] * sign)
            sign = 1
        elif match["close"]:
            if len(group) == 1:
                return None
            group.pop()
        elif match["unit"]:
            word = match["unit"]
            one = _OTHERS.get(word) or _PREFIXED.get(word) or _NAMED.get(word.lower())
            if one is None:
                return None
            power = int(match["power"] or match["inner"] or 1) * sign * group[-1]
            if abs(power) > 9:
                return None
            factor *= Fraction(repr(one[0])) ** power
            exponents = [own + power * other for own, other in zip(exponents, one[1], strict=True)]
            sign = 1
    if not any(exponents) or len(group) > 1 or not Fraction(1, 10**100) < factor < 10**100:
        return None
    return WrittenUnit(float(factor), 0.0, tuple(exponents))


def is_no_unit(text: str) -> bool:
    """Return whether a text is empty or says that there is no unit."""
    return text.strip().lower().replace(" ", "") in _NO_UNIT


def unit_of(text: str, dimension: str) -> WrittenUnit:
    """Return the unit of a `dimension` that a text names; empty, or "1", means SI; raises a ValueError for others."""
    if is_no_unit(text):
        return WrittenUnit(1.0, 0.0, EXPONENTS[dimension])
    found = written_unit(text)
    if found is None or found.exponents != EXPONENTS[dimension]:
        raise ValueError(f"{text.strip()[:60]!r} is no unit of a {dimension} that is known")
    return found


def ratio_of(text: str) -> float:
    """Return the value of 1 in the unit of a ratio that a text names: 1e-6 for "ppm", "1e-6" and "10^-6", 1 for "".

    Raises a ValueError for any other unit.
    """
    plain = re.sub(r"\s", "", text[:LONGEST_TEXT].translate(_SIGNS))
    if is_no_unit(text):
        return 1.0
    if plain.lower() in _RATIOS:
        return _RATIOS[plain.lower()]
    if (power := _POWER_OF_TEN.fullmatch(plain)) is not None:
        return float(f"1e{power[1]}")
    raise ValueError(f"{text.strip()[:60]!r} is no unit of a ratio that is known")


def unit_in_name(name: str) -> str:
    """Return the unit at the end of an array's name, in brackets or after a comma: "x [mm]", "x, mm"; else empty."""
    inside = in_brackets(name)
    if written_unit(inside) is not None:
        return inside
    after = name.rpartition(",")[2] if "," in name else ""
    return after.strip() if written_unit(after) is not None else ""


def in_brackets(name: str) -> str:
    """Return the text in brackets at the end of an array's name, as in "x [mm]"; empty if there is none."""
    end = name[-LONGEST_TEXT:]  # the search takes a time proportional to the square of the length
    match = re.search(r"[\[(<{]([^\[\](){}<>]*(?:\([^()]*\))?[^\[\](){}<>]*)[\])>}]\s*$", end)
    return match[1].strip() if match else ""
