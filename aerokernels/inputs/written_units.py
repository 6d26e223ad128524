"""Parse units as files write them in attributes and names: "kg m-3", "kilogram / meter ** 3", "hPa", "0.2 kg/m3".

`units.quantity` reads what a user types: a number and one unit of a short list. Programs write products and quotients
of units beside their arrays, in many spellings; this module converts them to a factor to SI.
"""

import re
from dataclasses import dataclass
from fractions import Fraction

LONGEST = 200  # characters of a unit; an attribute may have millions
LEAST = Fraction(1, 10**100)  # factor of a unit to SI, and the inverse of the greatest
NONE = (0, 0, 0, 0)
# Exponents of metre, kilogram, second and kelvin.
DIMENSIONS = {"length": (1, 0, 0, 0), "density": (-3, 1, 0, 0), "pressure": (-1, 1, -2, 0), "temperature": (0, 0, 0, 1),
              "time": (0, 0, 1, 0)}  # fmt: skip
ARTICLES = {name: f"a {name}" for name in DIMENSIONS}
_FORCE = (1, 1, -2, 0)
_POUND, _INCH = 0.45359237, 0.0254
# Units that accept a prefix, by their symbols and by their names.
_SYMBOLS: dict[str, tuple[float, tuple[int, int, int, int]]] = {
    "m": (1.0, DIMENSIONS["length"]), "g": (1e-3, (0, 1, 0, 0)), "s": (1.0, DIMENSIONS["time"]),
    "K": (1.0, DIMENSIONS["temperature"]), "Pa": (1.0, DIMENSIONS["pressure"]), "bar": (1e5, DIMENSIONS["pressure"]),
    "N": (1.0, _FORCE), "L": (1e-3, (3, 0, 0, 0)), "l": (1e-3, (3, 0, 0, 0)),
}  # fmt: skip
_NAMES = {"meter": "m", "metre": "m", "gram": "g", "second": "s", "kelvin": "K", "pascal": "Pa", "bar": "bar",
          "newton": "N", "liter": "L", "litre": "L"}  # fmt: skip
_PREFIXES = {"n": 1e-9, "u": 1e-6, "m": 1e-3, "c": 1e-2, "d": 1e-1, "h": 1e2, "k": 1e3, "M": 1e6, "G": 1e9}
_PREFIX_NAMES = {"nano": 1e-9, "micro": 1e-6, "milli": 1e-3, "centi": 1e-2, "deci": 1e-1, "hecto": 1e2, "kilo": 1e3,
                 "mega": 1e6, "giga": 1e9}  # fmt: skip
_OTHERS = {
    "in": (_INCH, (1, 0, 0, 0)), "inch": (_INCH, (1, 0, 0, 0)), "inches": (_INCH, (1, 0, 0, 0)),
    "ft": (12 * _INCH, (1, 0, 0, 0)), "foot": (12 * _INCH, (1, 0, 0, 0)), "feet": (12 * _INCH, (1, 0, 0, 0)),
    "micron": (1e-6, (1, 0, 0, 0)), "microns": (1e-6, (1, 0, 0, 0)), "cc": (1e-6, (3, 0, 0, 0)),
    "lb": (_POUND, (0, 1, 0, 0)), "lbm": (_POUND, (0, 1, 0, 0)),
    "slug": (_POUND * 9.80665 / (12 * _INCH), (0, 1, 0, 0)), "slugs": (_POUND * 9.80665 / (12 * _INCH), (0, 1, 0, 0)),
    "lbf": (_POUND * 9.80665, _FORCE),
    "psi": (_POUND * 9.80665 / _INCH**2, DIMENSIONS["pressure"]),
    "psf": (_POUND * 9.80665 / (12 * _INCH) ** 2, DIMENSIONS["pressure"]),
    "atm": (101325.0, DIMENSIONS["pressure"]), "Torr": (101325.0 / 760.0, DIMENSIONS["pressure"]),
    "Kg": (1.0, (0, 1, 0, 0)), "KG": (1.0, (0, 1, 0, 0)), "KPa": (1e3, DIMENSIONS["pressure"]),
    "PA": (1.0, DIMENSIONS["pressure"]), "pa": (1.0, DIMENSIONS["pressure"]),
    "mb": (100.0, DIMENSIONS["pressure"]), "dyn": (1e-5, _FORCE), "dyne": (1e-5, _FORCE),
    "sec": (1.0, DIMENSIONS["time"]), "min": (60.0, DIMENSIONS["time"]), "minute": (60.0, DIMENSIONS["time"]),
    "minutes": (60.0, DIMENSIONS["time"]), "hour": (3600.0, DIMENSIONS["time"]), "hours": (3600.0, DIMENSIONS["time"]),
    "day": (86400.0, DIMENSIONS["time"]), "days": (86400.0, DIMENSIONS["time"]),
    "degK": (1.0, DIMENSIONS["temperature"]),
    "degR": (5.0 / 9.0, DIMENSIONS["temperature"]), "rankine": (5.0 / 9.0, DIMENSIONS["temperature"]),
}  # fmt: skip
# Temperature scales with another zero: factor, and the offset added after scaling.
_CELSIUS, _FAHRENHEIT = (1.0, 273.15), (5.0 / 9.0, 459.67 * 5.0 / 9.0)
_FROM_ANOTHER_ZERO = {
    **dict.fromkeys(("degc", "c", "celsius", "degreescelsius", "degreecelsius", "degreesc", "degreec"), _CELSIUS),
    **dict.fromkeys(("degf", "f", "fahrenheit", "degreesfahrenheit", "degreefahrenheit", "degreef"), _FAHRENHEIT),
}
_NO_UNIT = {"", "1", "-", "--", "none", "dimensionless", "nondimensional", "normalized", "normalised", "unitless"}
# Units of ratios, and powers of ten as they are written.
_RATIOS = {"%": 1e-2, "percent": 1e-2, "permille": 1e-3, "ppm": 1e-6, "ppb": 1e-9}
_POWER_OF_TEN = re.compile(r"(?:1(?:\.0*)?)?(?:[eE]|[x*]?10(?:\^|\*\*)?)([-+]\d{1,2})")
_SPELLING = str.maketrans(
    {
        "µ": "u",
        "μ": "u",
        "·": " ",
        "⋅": " ",
        "×": " ",
        "⁻": "-",
        "¹": "1",
        "²": "2",
        "³": "3",
        "⁶": "6",
        "⁹": "9",
        "{": "(",
        "}": ")",
    }
)
_TOKEN = re.compile(r"(?P<over>/)|(?P<open>\()|(?P<close>\))|(?P<one>1(?![\d.]))|(?P<unit>[A-Za-z]+)"
                    r"(?:\^?(?:\((?P<inner>[-+]?\d{1,2})\)|(?P<power>[-+]?\d{1,2})))?|[\s.*]+")  # fmt: skip

_NUMBER = re.compile(r"(\d{1,30}(?:\.\d{0,30})?(?:[eE][-+]?\d{1,3})?)[\s*]+(?=[A-Za-z(])")  # 0.2 kg/m3


@dataclass(frozen=True)
class WrittenUnit:
    """A unit: a value v in this unit is factor v + offset in SI.

    Attributes:
        factor: Scale to SI.
        offset: SI value of the unit's zero.
        exponents: Exponents of metre, kilogram, second and kelvin.
    """

    factor: float
    offset: float
    exponents: tuple[int, ...]


def written_unit(text: str) -> WrittenUnit | None:
    """Return the unit that a text names; None for a text without a known unit."""
    if len(text) > LONGEST:
        return None
    plain = text.strip().translate(_SPELLING).replace("**", "^").replace("°", "deg")
    if (found := _FROM_ANOTHER_ZERO.get(re.sub(r"[\s_]", "", plain.lower()))) is not None:
        return WrittenUnit(*found, DIMENSIONS["temperature"])
    plain = re.sub(r"\s*(\^|/)\s*", r"\1", re.sub(r"\bper\b", "/", plain))
    number = _NUMBER.match(plain)
    # Exact, so that a g/cm3 is 1000 kg/m3 and not its neighbour.
    factor, exponents, at = Fraction(number[1] if number else 1), list(NONE), number.end() if number else 0
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
            one = _one(match["unit"])
            if one is None:
                return None
            power = int(match["power"] or match["inner"] or 1) * sign * group[-1]
            if abs(power) > 9:
                return None
            factor *= Fraction(repr(one[0])) ** power
            exponents = [own + power * other for own, other in zip(exponents, one[1], strict=True)]
            sign = 1
    if not any(exponents) or len(group) > 1 or not LEAST < factor < 1 / LEAST:
        return None
    return WrittenUnit(float(factor), 0.0, tuple(exponents))


def is_no_unit(text: str) -> bool:
    """Return whether a text is empty or says that there is no unit."""
    return text.strip().lower().replace(" ", "") in _NO_UNIT


def unit_of(text: str, dimension: str) -> WrittenUnit:
    """Return the unit of a `dimension` that a text names; an empty text, or "1", means SI.

    Raises:
        ValueError: No known unit, or a unit of another dimension.
    """
    if is_no_unit(text):
        return WrittenUnit(1.0, 0.0, DIMENSIONS[dimension])
    found = written_unit(text)
    if found is None or found.exponents != DIMENSIONS[dimension]:
        raise ValueError(f"{text.strip()[:60]!r} is no unit of {ARTICLES[dimension]} that is known")
    return found


def ratio_of(text: str) -> float:
    """Return the value of 1 in the unit of a ratio that a text names: 1e-6 for "ppm", "1e-6" and "10^-6".

    An empty text, or "1", is 1.

    Raises:
        ValueError: No known unit of a ratio.
    """
    plain = re.sub(r"\s", "", text[:LONGEST].translate(_SPELLING))
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
    end = name[-LONGEST:]  # the search takes a time proportional to the square of the length
    match = re.search(r"[\[(<{]([^\[\](){}<>]*(?:\([^()]*\))?[^\[\](){}<>]*)[\])>}]\s*$", end)
    return match[1].strip() if match else ""


def _one(word: str) -> tuple[float, tuple[int, ...]] | None:
    """Return a single unit with or without a prefix."""
    if word in _OTHERS:
        return _OTHERS[word]
    if word in _SYMBOLS:
        return _SYMBOLS[word]
    for symbol, (factor, exponents) in _SYMBOLS.items():
        if word.endswith(symbol) and word[: -len(symbol)] in _PREFIXES:
            return _times(_PREFIXES[word[: -len(symbol)]], factor), exponents
    lower = word.lower()
    lower = lower.removesuffix("s") if lower.removesuffix("s") != lower and len(lower) > 3 else lower
    for name, symbol in _NAMES.items():
        prefix = lower[: -len(name)]
        if lower.endswith(name) and (not prefix or prefix in _PREFIX_NAMES):
            factor, exponents = _SYMBOLS[symbol]
            return _times(_PREFIX_NAMES.get(prefix, 1.0), factor), exponents
    return None


def _times(prefix: float, factor: float) -> float:
    return float(Fraction(repr(prefix)) * Fraction(repr(factor)))
