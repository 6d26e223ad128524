"""Relations between the density of air and its refractivity, by bands of wavelength: a relation is a row of `AIR`."""

from collections.abc import Callable
from typing import NamedTuple

from aerokernels.flow import ciddor, mathar
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import LONGEST, SAME, check_wavelength, warn_caller

# Eq 2 was fitted in the visible; below this wavelength air absorbs and its index rises faster.
SHORTEST_WAVELENGTH = 200e-9


@checked
def gladstone_dale_constant(wavelength: float, *, group: bool = False) -> float:
    """Return the Gladstone-Dale constant of air [m3/kg] at a vacuum wavelength [m], the paper's eq 2.

    K = 2.23e-4 (1 + 7.52e-3 / lambda^2), lambda in um; at 905 nm 0.46 % above Ciddor's dry air. Beyond 1.69 um the
    formula, which was fitted in the visible, is extrapolated, with a warning.

    Args:
        wavelength: [m].
        group: Return the group constant.

    Raises:
        TypeError: The wavelength is not one number.
        ValueError: A wavelength outside 0.2 to 24 um.
    """
    wavelength = check_wavelength(wavelength)
    if wavelength < SHORTEST_WAVELENGTH:
        raise ValueError(
            f"wavelength {wavelength:g} m is shorter than the {SHORTEST_WAVELENGTH * 1e9:g} nm down to which the "
            "Gladstone-Dale constant's formula holds: give metres, 905e-9 for 905 nm, or the constant itself"
        )
    if wavelength > ciddor.RANGE[1] * (1.0 + SAME):
        warn_caller(
            f"the paper's formula for the constant of air was fitted in the visible and is extrapolated to "
            f"{wavelength * 1e6:g} um, where it is 0.1 to 0.3 % too high: in the infrared windows take 'mathar'"
        )
    micrometres = wavelength * 1e6
    return 2.23e-4 * (1.0 + (3.0 if group else 1.0) * 7.52e-3 / micrometres**2)


class Band(NamedTuple):
    """A band of a relation for air: wavelengths [m], relative uncertainty, relation, source, and its constant.

    The uncertainty of the group constant is the same, or `group_length` over the wavelength where that is more.
    """

    low: float
    high: float
    uncertainty: float
    relation: str
    source: str
    constant: Callable[..., float]
    group_length: float = 0.0


# Eq 2 exceeds Ciddor's constant by 1.2 % at 400 nm, 0.84 % at 532 nm, 0.46 % at 905 nm and 0.31 % at 1.6 um, its group
# constant by 2.5 %, 1.8 %, 0.9 % and 0.5 %; in the infrared windows it exceeds Mathar's by 0.1 to 0.3 %.
AIR: dict[str, tuple[Band, ...]] = {
    "paper": (
        Band(
            SHORTEST_WAVELENGTH, LONGEST, 1.2e-2, "paper", "the paper's eq 2",
            lambda wavelength, *, group, **moisture: gladstone_dale_constant(wavelength, group=group), 1e-8,
        ),
    ),
    "ciddor": (
        Band(
            *ciddor.RANGE, ciddor.UNCERTAINTY, "ciddor", "P. E. Ciddor, Applied Optics 35 (1996) 1566",
            ciddor.ciddor_constant,
        ),
    ),
    "mathar": tuple(
        Band(
            band.low, band.high, band.uncertainty, "mathar", "R. J. Mathar, J. Opt. A 9 (2007) 470",
            mathar.mathar_constant,
        )
        for band in mathar.BANDS
    ),
}  # fmt: skip
# Ciddor's relation wherever it holds; where Mathar's takes over, at 1.69 um, dry air's constant rises by 2.6e-4.
AIR["auto"] = AIR["ciddor"] + AIR["mathar"]
