"""Refractivity of gases by species, and of their mixtures.

A published dispersion formula gives n - 1 at one reference state; over the density of the real gas there it gives the
species' constant K, and K = sum w K over mass fractions. Coefficients are those of the refractiveindex.info database
(CC0); virial coefficients of J. H. Dymond and E. B. Smith (Oxford, 1980). In dry air's proportions the constants agree
with Ciddor's to 5e-5, the group constants to 6e-5.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from aerokernels.flow import ciddor
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import SAME, check_wavelength

# The sum of fractions may differ from 1 by this much, as rounded fractions do; they are then scaled to a sum of 1.
SUM_TOLERANCE = 2e-3
_NORMAL = (273.15, 101325.0)
_BORZSONYI = "A. Borzsonyi et al., Appl. Opt. 47 (2008) 4856"
WATER = "H2O"


@dataclass(frozen=True)
class Species:
    """A gas and its dispersion, with the vacuum wavelength lambda in um.

    "sum": n - 1 = c0 + sum a / (b - 1 / lambda^2). "sellmeier": n^2 - 1 = sum a lambda^2 / (lambda^2 - b). "ciddor":
    the vapour of Ciddor's moist air.

    Attributes:
        name: Chemical formula.
        molar_mass: [kg/mol].
        form: "sum", "sellmeier" or "ciddor".
        coefficients: (c0, a, b, a, b, ...) for "sum", (a, b, a, b, ...) for "sellmeier".
        wavelength_range: Vacuum wavelengths for which the formula was fitted [m].
        temperature: Temperature of the reference state [K].
        pressure: Pressure of the reference state [Pa].
        virial: Second virial coefficient at that temperature [m3/mol].
        uncertainty: Relative uncertainty of the constant.
        source: The paper.
    """

    name: str
    molar_mass: float
    form: str
    coefficients: tuple[float, ...]
    wavelength_range: tuple[float, float]
    temperature: float
    pressure: float
    virial: float
    uncertainty: float
    source: str

    @property
    def reference_density(self) -> float:
        """Density of the real gas at the reference state [kg/m3]."""
        ideal = self.pressure / (8.314462618 * self.temperature)  # [J/(mol K)]
        return self.molar_mass * ideal / (1.0 + self.virial * ideal)

    def refractivity(self, wavelength: float, *, group: bool = False) -> float:
        """Return the refractivity n - 1, or n_g - 1, at the reference state, by the published formula.

        Raises:
            ValueError: A wavelength outside the formula's range.
        """
        wavelength, (low, high) = check_wavelength(wavelength), self.wavelength_range
        if not low * (1.0 - SAME) <= wavelength <= high * (1.0 + SAME):
            raise ValueError(
                f"wavelength {wavelength:g} m is outside {low * 1e6:g} to {high * 1e6:g} um, where the refractivity of "
                f"{self.name} is known: {self.source}"
            )
        if self.form == "ciddor":
            return self.constant(wavelength, group=group) * self.reference_density
        square = 1.0 / (wavelength * 1e6) ** 2
        constant = self.coefficients[: len(self.coefficients) % 2]
        numbers = self.coefficients[len(constant) :]
        pairs = list(zip(numbers[::2], numbers[1::2], strict=True))
        if self.form == "sum":
            excess = sum(constant) + sum(a / (b - square) for a, b in pairs)
            return excess + 2.0 * square * sum(a / (b - square) ** 2 for a, b in pairs) if group else excess
        squares = sum(a / (1.0 - b * square) for a, b in pairs)  # n^2 - 1
        index = float(np.sqrt(1.0 + squares))
        excess = squares / (1.0 + index)
        return excess + square / index * sum(a * b / (1.0 - b * square) ** 2 for a, b in pairs) if group else excess

    def constant(self, wavelength: float, form: str = "gladstone-dale", *, group: bool = False) -> float:
        """Return the constant K [m3/kg] at a vacuum wavelength [m].

        `form` is "gladstone-dale", K = (n - 1) / rho, or "lorentz-lorenz", K = 3/2 (n^2 - 1) / (n^2 + 2) / rho; `group`
        returns the group constant.

        Raises:
            ValueError: A wavelength outside the formula's range.
        """
        if self.form == "ciddor":  # at the density of the vapour, below 1e-2 kg/m3, the two forms agree to 1e-6
            return ciddor.ciddor_constant(wavelength, water=1.0, group=group)
        excess = self.refractivity(wavelength)
        turned = self.refractivity(wavelength, group=True) - excess if group else 0.0
        if form == "lorentz-lorenz":
            turned *= 9.0 * (1.0 + excess) / (3.0 + excess * (2.0 + excess)) ** 2
            excess *= 1.5 * (2.0 + excess) / (3.0 + excess * (2.0 + excess))
        return (excess + turned) / self.reference_density


def _gas(name, grams, form, coefficients, micrometres, virial, uncertainty, state, source) -> Species:
    """Return a species from numbers in the papers' units: g/mol, um, cm3/mol."""
    low, high = (float(f"{end}e-6") for end in micrometres)
    temperature, pressure = state
    return Species(
        name, grams * 1e-3, form, coefficients, (low, high), temperature, pressure, virial * 1e-6, uncertainty, source
    )


# name, g/mol, form, its coefficients, um, cm3/mol, relative uncertainty, (K, Pa), paper
_TABLE = [
    ("N2", 28.0134, "sum", (6.8552e-5, 3.243157e-2, 144.0), (0.4679, 2.0587), -10.3, 1e-4, _NORMAL,
     "E. R. Peck and B. N. Khanna, J. Opt. Soc. Am. 56 (1966) 1059"),
    ("O2", 31.9988, "sum", (1.181494e-4, 9.708931e-3, 75.4), (0.4, 1.8), -17.3, 2e-4, (293.15, 101325.0),
     "J. Zhang, Z. H. Lu and L. J. Wang, Appl. Opt. 47 (2008) 3143; P. Kren, Appl. Opt. 50 (2011) 6484"),
    ("Ar", 39.948, "sum", (6.7867e-5, 3.0182943e-2, 144.0), (0.4679, 2.0587), -21.1, 1e-4, _NORMAL,
     "E. R. Peck and D. J. Fisher, J. Opt. Soc. Am. 54 (1964) 1362"),
    ("CO2", 44.0095, "sum", (0.0, 1.54489e-6, 0.0584738, 0.083091927, 210.9241, 0.0028764190, 60.122959),
     (0.480126, 1.817228), -150.0, 3e-4, _NORMAL,
     "J. G. Old, K. L. Gentili and E. R. Peck, J. Opt. Soc. Am. 61 (1971) 89"),
    ("He", 4.002602, "sum", (0.0, 0.01470091, 423.98), (0.4801, 2.0586), 11.9, 3e-4, _NORMAL,
     "C. R. Mansfield and E. R. Peck, J. Opt. Soc. Am. 59 (1969) 199"),
    ("H2", 2.01588, "sum", (0.0, 0.0148956, 180.7, 0.0049037, 92.0), (0.168, 1.6945), 13.7, 3e-4, _NORMAL,
     "E. R. Peck and S. Hung, J. Opt. Soc. Am. 67 (1977) 1550"),
    ("Ne", 20.1797, "sellmeier", (9154.48e-8, 656.97e-6, 4018.63e-8, 5.728e-3), (0.4, 1.0), 10.8, 3e-3,
     (273.0, 100000.0), _BORZSONYI),
    ("Kr", 83.798, "sellmeier", (26102.88e-8, 2.01e-6, 56946.82e-8, 10.043e-3), (0.4, 1.0), -62.8, 3e-3,
     (273.0, 100000.0), _BORZSONYI),
    ("Xe", 131.293, "sellmeier", (103701.61e-8, 12.75e-3, 31228.61e-8, 0.561e-3), (0.4, 1.0), -154.0, 3e-3,
     (273.0, 100000.0), _BORZSONYI),
    # Fitted to moist air: the uncertainty is 1 % of the vapour's contribution.
    (WATER, 18.015, "ciddor", (), (0.3, 1.69), -1240.0, 1e-2, (293.15, 1333.0), "Ciddor (1996)"),
]  # fmt: skip
SPECIES: dict[str, Species] = {row[0]: _gas(*row) for row in _TABLE}
SPECIES_NAMES = tuple(SPECIES)


@dataclass(frozen=True, eq=False)
class Composition:
    """The composition of a gas: fractions of species, the same everywhere or one for each cell of a density field.

    Attributes:
        fractions: Fraction of each species, by chemical formula (`SPECIES_NAMES`): a number, or an array with one entry
            for each density. Their sum must be within 0.2 % of 1; they are scaled to a sum of 1.
        basis: "mole" or "mass".
        ambient: Fractions of the gas around the field; None where `fractions` are numbers that hold there too.

    Raises:
        TypeError: Fractions that are not a mapping.
        ValueError: An unknown species or basis, a fraction below 0 or not finite, a sum that is not 1, fractions of
            different shapes, or fractions by cell without `ambient`.
    """

    fractions: Mapping[str, object]
    basis: str = "mole"
    ambient: Mapping[str, object] | None = None
    _mass: tuple[dict[str, np.ndarray], dict[str, np.ndarray]] = field(init=False, repr=False)

    def __post_init__(self):
        """Check the fractions and turn them into mass fractions."""
        if self.basis not in ("mole", "mass"):
            raise ValueError(f"the basis of fractions is 'mole' or 'mass', got {self.basis!r}")
        inside = self._mass_fractions(self.fractions)
        if self.ambient is None and any(share.ndim for share in inside.values()):
            raise ValueError(
                "fractions that vary from cell to cell need `ambient`, the fractions of the gas around them"
            )
        outside = inside if self.ambient is None else self._mass_fractions(self.ambient)
        if any(share.ndim for share in outside.values()):
            raise ValueError("the fractions of the ambient gas must be numbers, one for each species")
        object.__setattr__(self, "_mass", (inside, outside))

    def _mass_fractions(self, fractions) -> dict[str, np.ndarray]:
        if not isinstance(fractions, Mapping) or not fractions:
            raise TypeError(f"fractions must map species to numbers, {{'N2': 0.79, 'O2': 0.21}} say, got {fractions!r}")
        shares = {}
        for name, value in fractions.items():
            molar_mass(name)
            share = np.asarray(value, dtype=np.float64)
            if not (np.isfinite(share).all() and (share >= 0.0).all()):
                raise ValueError(f"the fraction of {name} must be finite and not negative, got {value!r}")
            shares[name] = share
        shapes = {share.shape for share in shares.values() if share.ndim}
        if len(shapes) > 1:
            raise ValueError(
                f"the fractions of {', '.join(shares)} have the shapes {', '.join(map(str, sorted(shapes)))}: give one "
                "fraction of each species for each density"
            )
        total = np.asarray(sum(shares.values()))
        if not (np.abs(total - 1.0) <= SUM_TOLERANCE).all():
            worst = float(total.ravel()[np.argmax(np.abs(total - 1.0))])
            raise ValueError(f"the fractions of {', '.join(shares)} add up to {worst:.6g}, not to 1: complete them")
        if self.basis == "mole":
            shares = {name: share * molar_mass(name) for name, share in shares.items()}
            total = np.asarray(sum(shares.values()))
        return {name: share / total for name, share in shares.items()}

    def constant(self, wavelength: float, form: str = "gladstone-dale", *, ambient: bool = False, group: bool = False):
        """Return the constant K [m3/kg] of the mixture at a vacuum wavelength [m], a number or an array: sum of w K.

        `form` is "gladstone-dale" or "lorentz-lorenz": see Species.constant; `ambient` returns the constant of the
        ambient gas, `group` the group constant.

        Raises:
            ValueError: A wavelength outside the range of one of the species' formulas.
        """
        shares = self._mass[ambient]
        total = sum(share * species_constant(name, wavelength, form, group=group) for name, share in shares.items())
        return float(total) if np.ndim(total) == 0 else total

    @property
    def range(self) -> tuple[float, float]:
        """Vacuum wavelengths at which every species' formula holds [m]."""
        bands = [SPECIES[name].wavelength_range for name in self._names]
        return max(low for low, _ in bands), min(high for _, high in bands)

    @property
    def uncertainty(self) -> float:
        """Relative uncertainty of the constant: the greatest among those of its species."""
        return max(SPECIES[name].uncertainty for name in self._names)

    @property
    def source(self) -> str:
        """The papers from which the constants come."""
        return "; ".join(dict.fromkeys(SPECIES[name].source for name in self._names))

    @property
    def _names(self) -> tuple[str, ...]:
        """Species with a fraction above 0 anywhere, in the field or around it."""
        present = {name for shares in self._mass for name, share in shares.items() if share.any()}
        return tuple(name for name in SPECIES_NAMES if name in present)


def molar_mass(name: str) -> float:
    """Return the molar mass of a species [kg/mol]."""
    if name not in SPECIES_NAMES:
        raise ValueError(f"species {name!r} is not known: choose one of {', '.join(SPECIES_NAMES)}")
    return SPECIES[name].molar_mass


@checked
def species_constant(name: str, wavelength: float, form: str = "gladstone-dale", *, group: bool = False) -> float:
    """Return the constant K of a species [m3/kg] at a vacuum wavelength [m]: refractivity over density.

    `name` is one of `SPECIES_NAMES`; `form` and `group` as in Species.constant.

    Raises:
        ValueError: An unknown species, or a wavelength outside the range of its formula.
    """
    molar_mass(name)
    return SPECIES[name].constant(wavelength, form, group=group)
