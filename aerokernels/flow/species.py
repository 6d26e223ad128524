"""Refractivity of gases by species, hot and ionised ones too; mixtures are in composition.py.

A published dispersion formula gives n - 1 at one reference state; over the density of the real gas there it gives the
species' constant K, and K = sum w K over mass fractions. Coefficients are those of the refractiveindex.info database
(CC0); virial coefficients of J. H. Dymond and E. B. Smith (Oxford, 1980). In dry air's proportions the constants agree
with Ciddor's to 5e-5, the group constants to 6e-5. Atoms, radicals and ions have their polarisability alpha,
K = 2 pi alpha N_A / M; free electrons K = -r_e lambda^2 N_A / (2 pi M).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.flow import ciddor, mathar
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import SAME, check_wavelength

_NORMAL = (273.15, 101325.0)
_BORZSONYI = "A. Borzsonyi et al., Appl. Opt. 47 (2008) 4856"
WATER = "H2O"
AVOGADRO, ELECTRON_RADIUS = 6.02214076e23, 2.8179403e-15  # [1/mol], [m]
LABORATORY = 293.15  # [K], about which the constants hold
HOTTEST = 1000.0  # [K], to which the polarisabilities of molecules were measured


@dataclass(frozen=True)
class Species:
    """A gas and its dispersion, with the vacuum wavelength lambda in um.

    "sum": n - 1 = c0 + sum a / (b - 1 / lambda^2). "sellmeier": n^2 - 1 = sum a lambda^2 / (lambda^2 - b). "vapour":
    that of Ciddor's moist air, in the infrared that of Mathar's. "polarisability": one number. "electron": free
    electrons, of a number density far below the critical one.

    Attributes:
        name: Chemical formula.
        molar_mass: [kg/mol].
        form: One of these names.
        coefficients: (c0, a, b, a, b, ...) for "sum", (a, b, a, b, ...) for "sellmeier", (alpha,) [1e-30 m3] for
            "polarisability".
        wavelength_range: Vacuum wavelengths for which the formula was fitted [m].
        temperature: Temperature of the reference state [K].
        pressure: Pressure of the reference state [Pa].
        virial: Second virial coefficient at that temperature [m3/mol].
        uncertainty: Relative uncertainty of the constant.
        source: The paper.
        thermal: (b, c) of the polarisability's 1 + b T + c T^2 [1/K], [1/K2] (K. Kerl, U. Hohm, H. Varchmin, Ber.
            Bunsenges. Phys. Chem. 96 (1992) 728), up to 1000 K.
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
    thermal: tuple[float, float] = (0.0, 0.0)

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
        wavelength = check_range(self, wavelength)
        if self.form in ("vapour", "polarisability", "electron"):
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
        if self.form == "vapour":  # at the density of the vapour, below 1e-2 kg/m3, the two forms agree to 1e-6
            visible = check_wavelength(wavelength) <= ciddor.RANGE[1] * (1.0 + SAME)
            vapour = ciddor.ciddor_constant if visible else mathar.mathar_constant
            return vapour(wavelength, water=1.0, group=group)
        if self.form == "polarisability":
            check_range(self, wavelength)
            return 2.0 * np.pi * self.coefficients[0] * 1e-30 * AVOGADRO / self.molar_mass
        if self.form == "electron":  # n_g - 1 = 1 - n
            check_range(self, wavelength)
            phase = -ELECTRON_RADIUS * wavelength**2 * AVOGADRO / (2.0 * np.pi * self.molar_mass)
            return -phase if group else phase
        excess = self.refractivity(wavelength)
        turned = self.refractivity(wavelength, group=True) - excess if group else 0.0
        if form == "lorentz-lorenz":
            turned *= 9.0 * (1.0 + excess) / (3.0 + excess * (2.0 + excess)) ** 2
            excess *= 1.5 * (2.0 + excess) / (3.0 + excess * (2.0 + excess))
        return (excess + turned) / self.reference_density

    def warmed(self, temperature):
        """Return K at temperatures [K] of any shape over K in the laboratory; above 1000 K as at 1000 K."""
        if not any(self.thermal):
            return 1.0
        b, c = self.thermal
        at = np.clip(np.asarray(temperature, dtype=np.float64), 0.0, HOTTEST)
        return (1.0 + at * (b + c * at)) / (1.0 + LABORATORY * (b + c * LABORATORY))


def check_range(gas: Species, wavelength: float) -> float:
    """Return a wavelength at which the formula of a gas holds; raise ValueError for another."""
    wavelength, (low, high) = check_wavelength(wavelength), gas.wavelength_range
    if not low * (1.0 - SAME) <= wavelength <= high * (1.0 + SAME):
        raise ValueError(
            f"wavelength {wavelength:g} m is outside {low * 1e6:g} to {high * 1e6:g} um, where the refractivity of "
            f"{gas.name} is known: {gas.source}"
        )
    return wavelength


def _gas(
    name, grams, form, coefficients, micrometres, virial, uncertainty, state, source, thermal=(0.0, 0.0)
) -> Species:
    """Return a species from numbers in the papers' units: g/mol, um, cm3/mol."""
    low, high = (float(f"{end}e-6") for end in micrometres)
    temperature, pressure = state
    return Species(
        name, grams * 1e-3, form, coefficients, (low, high), temperature, pressure, virial * 1e-6, uncertainty, source,
        thermal,
    )  # fmt: skip


def _particle(name: str, grams: float, polarisability: float, uncertainty: float, source: str) -> Species:
    """Return an atom, radical or ion from its polarisability [1e-30 m3], taken as the same at all wavelengths."""
    return _gas(name, grams, "polarisability", (polarisability,), (0.3, 24.0), 0.0, uncertainty, _NORMAL, source)


# name, g/mol, form, its coefficients, um, cm3/mol, relative uncertainty, (K, Pa), paper
_TABLE: list[tuple[Any, ...]] = [
    ("N2", 28.0134, "sum", (6.8552e-5, 3.243157e-2, 144.0), (0.4679, 2.0587), -10.3, 1e-4, _NORMAL,
     "E. R. Peck and B. N. Khanna, J. Opt. Soc. Am. 56 (1966) 1059", (1.8e-6, 0.0)),
    ("O2", 31.9988, "sum", (1.181494e-4, 9.708931e-3, 75.4), (0.4, 1.8), -17.3, 2e-4, (293.15, 101325.0),
     "J. Zhang, Z. H. Lu and L. J. Wang, Appl. Opt. 47 (2008) 3143; P. Kren, Appl. Opt. 50 (2011) 6484",
     (-2.369e-6, 8.687e-9)),
    ("Ar", 39.948, "sum", (6.7867e-5, 3.0182943e-2, 144.0), (0.4679, 2.0587), -21.1, 1e-4, _NORMAL,
     "E. R. Peck and D. J. Fisher, J. Opt. Soc. Am. 54 (1964) 1362"),
    ("CO2", 44.0095, "sum", (0.0, 1.54489e-6, 0.0584738, 0.083091927, 210.9241, 0.0028764190, 60.122959),
     (0.480126, 1.817228), -150.0, 3e-4, _NORMAL,
     "J. G. Old, K. L. Gentili and E. R. Peck, J. Opt. Soc. Am. 61 (1971) 89"),
    ("He", 4.002602, "sum", (0.0, 0.01470091, 423.98), (0.4801, 2.0586), 11.9, 3e-4, _NORMAL,
     "C. R. Mansfield and E. R. Peck, J. Opt. Soc. Am. 59 (1969) 199"),
    ("H2", 2.01588, "sum", (0.0, 0.0148956, 180.7, 0.0049037, 92.0), (0.168, 1.6945), 13.7, 3e-4, _NORMAL,
     "E. R. Peck and S. Hung, J. Opt. Soc. Am. 67 (1977) 1550", (5.87e-6, 7.544e-9)),
    ("Ne", 20.1797, "sellmeier", (9154.48e-8, 656.97e-6, 4018.63e-8, 5.728e-3), (0.4, 1.0), 10.8, 3e-3,
     (273.0, 100000.0), _BORZSONYI),
    ("Kr", 83.798, "sellmeier", (26102.88e-8, 2.01e-6, 56946.82e-8, 10.043e-3), (0.4, 1.0), -62.8, 3e-3,
     (273.0, 100000.0), _BORZSONYI),
    ("Xe", 131.293, "sellmeier", (103701.61e-8, 12.75e-3, 31228.61e-8, 0.561e-3), (0.4, 1.0), -154.0, 3e-3,
     (273.0, 100000.0), _BORZSONYI),
    # Fitted to moist air: the uncertainty is 1 % of the vapour's contribution.
    (WATER, 18.015, "vapour", (), (0.3, 24.0), -1240.0, 1e-2, (293.15, 1333.0), "Ciddor (1996), Mathar (2007)"),
    ("e-", 5.48579909e-4, "electron", (), (0.1, 24.0), 0.0, 1e-6, _NORMAL, "the dispersion of a cold plasma"),
]  # fmt: skip
_ATOMS = (
    "R. A. Alpher and D. R. White, Phys. Fluids 2 (1959) 162; S. Karl et al., AIAA 2003-4252; CRC Handbook, 95th ed."
)
_IONS = "polarisabilities of ions in their ground state, computed or from Rydberg spectra"
# name, g/mol, 1e-30 m3, relative uncertainty: for neutral ones half the difference between the sources, and dispersion
_PARTICLES = [
    ("O", 15.9994, 0.7864, 2.5e-2, _ATOMS),
    ("N", 14.0067, 1.1068, 1.5e-2, _ATOMS),
    ("NO", 30.0061, 1.7246, 2e-2, _ATOMS),
    ("OH", 17.0073, 1.10, 5e-2, "computed for the ground state"),
    ("CH4", 16.0425, 2.62, 1.5e-2, "CRC Handbook, 95th ed., and the refractivity at the sodium line"),
    ("N+", 14.0062, 0.559, 0.1, _IONS),
    ("O+", 15.9989, 0.345, 0.1, _IONS),
    ("NO+", 30.0056, 1.021, 0.1, _IONS),
    ("N2+", 28.0129, 2.386, 0.1, _IONS),
    ("O2+", 31.9983, 0.238, 0.5, _IONS),
]
SPECIES: dict[str, Species] = {row[0]: _gas(*row) for row in _TABLE} | {row[0]: _particle(*row) for row in _PARTICLES}
SPECIES_NAMES = tuple(SPECIES)


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
