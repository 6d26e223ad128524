"""Mixtures of gases: fractions of species, the same everywhere or one for each place of a field."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from aerokernels.flow.species import HOTTEST, SPECIES, SPECIES_NAMES, molar_mass, species_constant
from aerokernels.inputs.checks import warn_caller

# The sum of fractions may differ from 1 by this much, as rounded fractions do; they are then scaled to a sum of 1.
SUM_TOLERANCE = 2e-3


@dataclass(frozen=True, eq=False)
class Composition:
    """The composition of a gas: fractions of species, the same everywhere or one for each cell of a density field.

    Attributes:
        fractions: Fraction of each species, by chemical formula (`SPECIES_NAMES`): a number, or an array with one entry
            for each density. Their sum must be within 0.2 % of 1; they are scaled to a sum of 1.
        basis: "mole", "mass", or "density" for partial densities [kg/m3], which may have any sum.
        ambient: Fractions of the gas around the field; None where `fractions` are numbers that hold there too.
        temperature: [K], a number or one for each density, for the polarisabilities of N2, O2 and H2, which rise with
            it by up to 1 %; None takes those of the laboratory. Above 1000 K they are taken as at 1000 K, with a
            warning. The ambient gas is taken at that of the laboratory.

    Raises:
        TypeError: Fractions that are not a mapping.
        ValueError: An unknown species or basis, a fraction below 0 or not finite, a sum that is not 1, fractions of
            different shapes, or fractions by cell without `ambient`.
    """

    fractions: Mapping[str, object]
    basis: str = "mole"
    ambient: Mapping[str, object] | None = None
    temperature: object = None
    _mass: tuple[dict[str, np.ndarray], dict[str, np.ndarray]] = field(init=False, repr=False)

    def __post_init__(self):
        """Check the fractions and turn them into mass fractions."""
        if self.basis not in ("mole", "mass", "density"):
            raise ValueError(f"the basis of fractions is 'density', 'mole' or 'mass', got {self.basis!r}")
        inside = self._mass_fractions(self.fractions)
        if self.ambient is None and any(share.ndim for share in inside.values()):
            raise ValueError(
                "fractions that vary from cell to cell need `ambient`, the fractions of the gas around them"
            )
        outside = inside if self.ambient is None else self._mass_fractions(self.ambient)
        if any(share.ndim for share in outside.values()):
            raise ValueError("the fractions of the ambient gas must be numbers, one for each species")
        object.__setattr__(self, "_mass", (inside, outside))
        if self.temperature is not None:
            self._check_temperature()

    def _check_temperature(self) -> None:
        own = np.asarray(self.temperature, dtype=np.float64)
        if not (np.isfinite(own).all() and (own > 0.0).all()):
            raise ValueError("the temperatures of a composition must be finite and positive [K]")
        inside = [np.shape(share) for share in self._mass[0].values() if np.ndim(share)]
        if own.ndim and inside and own.shape != inside[0]:
            raise ValueError(f"temperatures have the shape {own.shape}, fractions {inside[0]}: give one each")
        hot = float(own.max())
        if hot > HOTTEST and any(any(SPECIES[name].thermal) for name in self._names):
            size = max(
                abs((1.0 + hot * (b + c * hot)) / (1.0 + HOTTEST * (b + c * HOTTEST)) - 1.0)
                for b, c in (SPECIES[name].thermal for name in self._names)
            )
            warn_caller(
                f"polarisabilities of molecules are known to {HOTTEST:g} K and taken as there up to {hot:g} K: their "
                f"polynomials in temperature, continued, would change n - 1 of a species by up to {size:.2g} of itself"
            )

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
        if self.basis == "density" and not (total > 0.0).all():
            raise ValueError(f"the partial densities of {', '.join(shares)} are all 0 at a place: give the gas there")
        if self.basis != "density" and not (np.abs(total - 1.0) <= SUM_TOLERANCE).all():
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
        total = sum(self._parts(wavelength, form, ambient, group).values())
        return float(total) if np.ndim(total) == 0 else total

    def _parts(self, wavelength: float, form: str, ambient: bool, group: bool) -> dict[str, np.ndarray]:
        """Return each species' share of the constant."""
        parts = {}
        for name, share in self._mass[ambient].items():
            parts[name] = share * species_constant(name, wavelength, form, group=group)
            if self.temperature is not None and not ambient:
                parts[name] = parts[name] * SPECIES[name].warmed(self.temperature)
        return parts

    @property
    def mass_fractions(self) -> dict[str, np.ndarray]:
        """Mass fraction of each species in the field, of sum 1: numbers, or one for each density."""
        return dict(self._mass[0])

    def uncertainty_at(self, wavelength: float) -> float:
        """Return the relative uncertainty of the constant where it is greatest, by each species' share of it."""
        worst = 0.0
        for ambient in (False, True):
            sizes = {
                name: np.abs(part) for name, part in self._parts(wavelength, "gladstone-dale", ambient, False).items()
            }
            doubt = sum(SPECIES[name].uncertainty * size for name, size in sizes.items())
            worst = max(worst, float(np.max(doubt / np.maximum(sum(sizes.values()), 1e-300))))
        return worst

    @property
    def range(self) -> tuple[float, float]:
        """Vacuum wavelengths at which every species' formula holds [m]."""
        bands = [SPECIES[name].wavelength_range for name in self._names]
        return max(low for low, _ in bands), min(high for _, high in bands)

    @property
    def uncertainty(self) -> float:
        """Relative uncertainty of the constant: the greatest among those of its species; see `uncertainty_at`."""
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
