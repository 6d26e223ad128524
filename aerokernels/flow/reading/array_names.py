"""What the names of a file's arrays mean: without units, brackets, punctuation and the words of a mean."""

import re
from collections.abc import Iterable, Sequence

from aerokernels.inputs.units import in_brackets, is_no_unit, written_unit

# Words in brackets that leave a quantity what it is; others, such as "total" and "gauge", make another one of it.
SAME_QUANTITY = ("static", "absolute", "abs", "thermodynamic", "mean", "average", "averaged", "avg", "si", "gas", "air",
                 "mixture", "fluid")  # fmt: skip
_MEAN = r"(?:time)?(?:mean|averaged?|avg|ave)"


def plain_name(name: str, grouped: bool = False) -> str:
    """Return a name in lower case, without blanks, punctuation and units; without groups if it is `grouped`.

    Elsewhere than in grouped names a slash is a quotient: "p/rho" is not a density.
    """
    plain = re.sub(r"[\[(<{].*", "", _without_comma(name).lower().replace("ρ", "rho"))
    return re.sub(r"[^a-z0-9]", "", plain.rsplit("/", 1)[-1] if grouped else plain)


def quantity_name(name: str, grouped: bool = False) -> str:
    """Return the plain name of the quantity that an array has; words in brackets count unless they are units.

    "Pressure (total)" is "pressuretotal" and no pressure, "T [K]" is "t", "<rho>" is "rho".
    """
    if (whole := re.fullmatch(r"\s*<([^<>]*)>\s*", name)) is not None:
        name = whole[1]
    rest = _without_comma(name)
    while inside := in_brackets(rest):
        if not (is_no_unit(inside) or written_unit(inside) is not None or inside.lower() in SAME_QUANTITY):
            return re.sub(r"[^a-z0-9]", "", name.lower())
        rest = rest[: rest.rfind(inside)].rstrip(" \t[(<{")
    return plain_name(rest, grouped)


def known_names(names: Iterable[str], known: Sequence[str], grouped: bool = False) -> list[str]:
    """Return those of `names` that are the first of the `known` quantities; means over time count after all others."""
    quantities = [(name, quantity_name(name, grouped)) for name in names]
    for is_it in (str.__eq__, _is_mean_of):
        for one in known:
            if found := [name for name, own in quantities if is_it(own, one)]:
                return found
    return []


def _is_mean_of(plain: str, quantity: str) -> bool:
    return re.fullmatch(rf"{_MEAN}(?:of)?{quantity}|{quantity}{_MEAN}", plain) is not None


def _without_comma(name: str) -> str:
    """Return a name without a unit that follows a comma, as in "Density, kg/m3"."""
    before, comma, unit = name.rpartition(",")
    return before if comma and written_unit(unit) is not None else name
