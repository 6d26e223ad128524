"""Refractivity and index contrast from density; refractivities n - 1 are never differences of numbers near 1.

    Lorentz-Lorenz (the paper's eq 1):  (n^2 - 1) / (n^2 + 2) = 2/3 K rho
    Gladstone-Dale (eq 3):              n = 1 + K rho                     the linear limit, lower by (K rho)^2 / 6

A pulse travels by n_g = n + 2 s dn/ds, s = 1 / lambda^2, with the group constant K_g = K + 2 s dK/ds. A relation for
air is a row of `AIR`, a gas a row of species.py.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from aerokernels.flow import ciddor
from aerokernels.flow.species import WATER, Composition
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import LONGEST, SHORTEST, check_choice, check_wavelength
from aerokernels.medium import GroupIndex, IndexField, Upstream

RELATIONS = ("gladstone-dale", "lorentz-lorenz")
MODELS = ("paper", "ciddor", *RELATIONS)
# Eq 2 was fitted in the visible; below this wavelength air absorbs and its index rises faster.
SHORTEST_WAVELENGTH = 200e-9


@checked
def gladstone_dale_constant(wavelength: float, *, group: bool = False) -> float:
    """Return the Gladstone-Dale constant of air [m3/kg] at a vacuum wavelength [m], the paper's eq 2.

    K = 2.23e-4 (1 + 7.52e-3 / lambda^2), lambda in um; at 905 nm 0.46 % above Ciddor's dry air.

    Args:
        wavelength: [m].
        group: Return the group constant.

    Raises:
        TypeError: The wavelength is not one number.
        ValueError: A wavelength outside 0.2 to 20 um.
    """
    wavelength = check_wavelength(wavelength)
    if wavelength < SHORTEST_WAVELENGTH:
        raise ValueError(
            f"wavelength {wavelength:g} m is shorter than the {SHORTEST_WAVELENGTH * 1e9:g} nm down to which the "
            "Gladstone-Dale constant's formula holds: give metres, 905e-9 for 905 nm, or the constant itself"
        )
    micrometres = wavelength * 1e6
    return 2.23e-4 * (1.0 + (3.0 if group else 1.0) * 7.52e-3 / micrometres**2)


@checked
def index_contrast(
    density: float | np.ndarray,
    ambient_density: float,
    gladstone_dale: float | np.ndarray,
    relation: str = "gladstone-dale",
):
    """Return the contrast n - n_ambient of densities of any shape and an ambient density [kg/m3].

    The only difference taken is that of the densities. With an ambient density of 0 it is the refractivity n - 1.

    Raises:
        ValueError: An unknown relation, a constant outside 1e-5 to 1e-2 m3/kg, or densities for which Lorentz-Lorenz
            has no solution.
    """
    _check(gladstone_dale, relation)
    density = np.asarray(density, dtype=np.float64)
    difference = density - ambient_density
    if relation == "gladstone-dale":
        if np.ndim(difference) and np.ndim(gladstone_dale) == 0:
            difference *= gladstone_dale
            return difference
        return gladstone_dale * difference
    inside, outside = 1.0 - 2.0 / 3.0 * gladstone_dale * density, 1.0 - 2.0 / 3.0 * gladstone_dale * ambient_density
    if np.any(inside <= 0.0) or np.any(outside <= 0.0):
        greatest = float(np.max(gladstone_dale * np.maximum(density, ambient_density)))
        raise ValueError(
            f"Lorentz-Lorenz has no index where K times density is 1.5 or more, got {greatest:.3g}: no gas is so dense"
        )
    difference_of_squares = 2.0 * gladstone_dale * difference / (inside * outside)
    index = np.sqrt(1.0 + 2.0 * gladstone_dale * density / inside)
    ambient_index = np.sqrt(1.0 + 2.0 * gladstone_dale * ambient_density / outside)
    return difference_of_squares / (index + ambient_index)


def _check(gladstone_dale: float | np.ndarray, relation: str) -> None:
    check_choice(relation, "relation", RELATIONS)
    if not (np.size(gladstone_dale) and np.isfinite(gladstone_dale).all() and np.greater(gladstone_dale, 0.0).all()):
        raise ValueError(f"the Gladstone-Dale constant must be positive and finite, got {gladstone_dale!r} m3/kg")
    if np.min(gladstone_dale) < 1e-5 or np.max(gladstone_dale) > 1e-2:  # xenon has 1.2e-4, hydrogen 1.6e-3
        raise ValueError(
            f"a Gladstone-Dale constant of {np.max(gladstone_dale):g} m3/kg is outside the range of gases "
            "(1e-05 to 0.01 m3/kg): air has 2.25e-4 m3/kg, which is 0.225 cm3/g"
        )


class _AirRelation(NamedTuple):
    """A relation for air: wavelengths at which its constant is known [m], its relative uncertainty, source, and itself.

    The uncertainty of the group constant is the same, or `group_length` over the wavelength where that is more.
    """

    range: tuple[float, float]
    uncertainty: float
    source: str
    constant: Callable[..., float]
    group_length: float = 0.0


# Eq 2 exceeds Ciddor's constant by 1.2 % at 400 nm, 0.84 % at 532 nm, 0.46 % at 905 nm and 0.31 % at 1.6 um, its group
# constant by 2.5 %, 1.8 %, 0.9 % and 0.5 %.
AIR = {
    "paper": _AirRelation(
        (SHORTEST_WAVELENGTH, LONGEST), 1.2e-2, "the paper's eq 2",
        lambda wavelength, *, group, **moisture: gladstone_dale_constant(wavelength, group=group), 1e-8,
    ),
    "ciddor": _AirRelation(
        ciddor.RANGE, ciddor.UNCERTAINTY, "P. E. Ciddor, Applied Optics 35 (1996) 1566", ciddor.ciddor_constant
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class RefractivityModel:
    """A relation between density and refractivity. Build one with `refractivity_model`.

    Attributes:
        name: One of `MODELS`.
        form: "gladstone-dale" (linear in density) or "lorentz-lorenz".
        uncertainty: Relative uncertainty of n - 1 due to the constant; 0 for a constant given by the caller.
        range: Shortest and longest vacuum wavelength at which the constant is known [m].
        source: Where the constant comes from.
        given: The constant given by the caller [m3/kg], or None.
        composition: The mixture, or None.
        water: Mole fraction of water vapour, for "ciddor".
        co2: Mole fraction of carbon dioxide in the dry air, for "ciddor".
    """

    name: str
    form: str
    uncertainty: float
    range: tuple[float, float]
    source: str
    given: float | None = None
    composition: Composition | None = None
    water: float = 0.0
    co2: float = ciddor.STANDARD_CO2

    @property
    def is_one_gas(self) -> bool:
        """Whether the gas is the same in the field and around it."""
        return self.composition is None or self.composition.ambient is None

    def constant(self, wavelength: float, *, ambient: bool = False, group: bool = False):
        """Return the constant K [m3/kg] at a vacuum wavelength [m], an array if the composition varies in space.

        `ambient` returns that of the ambient gas, which is a number; `group` the group constant.

        Raises:
            ValueError: A wavelength outside the model's range.
        """
        if self.given is not None:
            return self.given
        if self.composition is not None:
            return self.composition.constant(wavelength, self.form, ambient=ambient, group=group)
        return self._air.constant(wavelength, water=self.water, co2=self.co2, group=group)

    @property
    def _air(self) -> _AirRelation:
        return AIR.get(self.name, AIR["paper"])

    def refractivity(self, density, wavelength: float, *, ambient: bool = False, group: bool = False):
        """Return the refractivity n - 1 at densities [kg/m3] of any shape and a vacuum wavelength [m].

        `ambient` returns that of the ambient gas, `group` n_g - 1 of the group index.

        Raises:
            ValueError: A wavelength outside the model's range, or a composition by cell of another shape.
        """
        constant = self._at(density, self.constant(wavelength, ambient=ambient))
        if not group:
            return index_contrast(density, 0.0, constant, self.form)
        of_group = self._at(density, self.constant(wavelength, ambient=ambient, group=True))
        if self.form == "gladstone-dale":
            return of_group * density
        # n_g = n + (K_g - K) dn/dK, and with a = 2/3 K rho dn/dK = rho / (n (1 - a)^2).
        excess = index_contrast(density, 0.0, constant, self.form)
        slope = density / ((1.0 + excess) * (1.0 - 2.0 / 3.0 * constant * density) ** 2)
        return excess + (of_group - constant) * slope

    def ambient_index(self, density: float, wavelength: float, *, group: bool = False) -> float:
        """Return the refractive index of the ambient gas at a density [kg/m3] and a vacuum wavelength [m]."""
        return 1.0 + float(self.refractivity(density, wavelength, ambient=True, group=group))

    def field_arguments(
        self, ambient_density: float, wavelength: float, column: float, group: bool, again: Callable[..., IndexField]
    ) -> dict[str, Any]:
        """Return ambient_index, wavelength and upstream of an index field, as IndexField's constructors take them.

        `column` is the rms error of columns of the density [kg/m2]; `again(group=True)` makes the field of the group
        index, and `group` says that it is the one that is being made.
        """
        uncertainty = self.uncertainty
        if uncertainty == self._air.uncertainty:
            uncertainty = max(uncertainty, self._air.group_length / wavelength)
        constant, of_group = (self.constant(wavelength, ambient=True, group=one) for one in (False, True))
        columns = float(np.max(self.constant(wavelength))) * column
        made = Upstream(columns, self.uncertainty, f"{self.name}: {self.source}")
        if group:
            made = replace(made, refractivity=uncertainty)
        else:
            ambient_index = self.ambient_index(ambient_density, wavelength, group=True)
            field = None if self.is_one_gas else partial(again, group=True)
            made = replace(made, group=GroupIndex(ambient_index, of_group / constant, uncertainty, field))
        index = self.ambient_index(ambient_density, wavelength, group=group)
        return {"ambient_index": index, "wavelength": wavelength, "upstream": made}

    def contrast(self, density, ambient_density: float, wavelength: float, *, group: bool = False):
        """Return the contrast n - n_ambient of densities of any shape and an ambient one [kg/m3] at a wavelength [m].

        `group` returns that of the group index.

        Raises:
            ValueError: A wavelength outside the model's range, or a composition by cell of another shape.
        """
        if self.is_one_gas and not group:
            return index_contrast(density, ambient_density, self.constant(wavelength), self.form)
        # Two gases have two constants. Both refractivities are small numbers, so their difference loses no digits.
        outside = self.refractivity(ambient_density, wavelength, ambient=True, group=group)
        return self.refractivity(density, wavelength, group=group) - outside

    @staticmethod
    def _at(density, inside):
        """Return the constants, one number or one for each cell, in the shape of the densities."""
        fits = np.size(inside) == np.size(density) and (
            min(np.ndim(inside), np.ndim(density)) <= 1 or np.shape(inside) == np.shape(density)
        )
        if np.ndim(inside) and not fits:
            raise ValueError(
                f"the composition has fractions of shape {np.shape(inside)}, the density shape {np.shape(density)}: "
                "give one fraction for each density, in the same order"
            )
        return np.reshape(inside, np.shape(density)) if np.ndim(inside) else inside


def default_relation(has_constant: bool, is_mixture: bool) -> str:
    """Return the relation where none is given: Ciddor's for air, unless the constant or the gas is another."""
    return "gladstone-dale" if has_constant or is_mixture else "ciddor"


@checked
def refractivity_model(
    relation: str | None = None, *, constant: float | None = None, composition=None
) -> RefractivityModel:
    """Return a refractivity model by name.

    Args:
        relation: One of `MODELS`: "paper", "ciddor", "gladstone-dale", "lorentz-lorenz". The last two take the paper's
            K(wavelength) unless `constant` or `composition` is given. None is "ciddor", or "gladstone-dale" where one
            of these is given.
        constant: K [m3/kg] for "gladstone-dale" or "lorentz-lorenz".
        composition: For these two a `Composition`, or mole fractions by species, {"N2": 0.79, "O2": 0.21} say. For
            "ciddor" the mole fractions {"H2O": in the moist air, "CO2": in the dry air}, each of which may be omitted.

    Raises:
        TypeError: A composition that is neither a mapping nor a Composition.
        ValueError: An unknown relation, species or fraction, or a constant or composition that the relation does not
            take.
    """
    relation = relation or default_relation(constant is not None, composition is not None)
    check_choice(relation, "relation", MODELS)
    if constant is not None and composition is not None:
        raise ValueError("give either a constant or a composition: a composition has a constant of its own")
    if relation not in RELATIONS and constant is not None:
        raise ValueError(f"relation {relation!r} has its own constant: with one of yours take 'gladstone-dale'")
    if relation == "paper" and composition is not None:
        raise ValueError("relation 'paper' is for air: with a composition take 'gladstone-dale' or 'ciddor'")
    if relation == "ciddor":
        return _of_air(relation, **_moist_air(composition))
    if constant is not None:
        index_contrast(0.0, 0.0, constant, relation)  # raises ValueError for a bad constant
        return RefractivityModel(relation, relation, 0.0, (SHORTEST, LONGEST), "given", given=float(constant))
    if composition is not None:
        mixture = composition if isinstance(composition, Composition) else Composition(composition)
        if not mixture.range[0] < mixture.range[1]:
            raise ValueError(f"the formulas of {', '.join(mixture.fractions)} have no wavelength in common")
        return RefractivityModel(
            relation, relation, mixture.uncertainty, mixture.range, mixture.source, composition=mixture
        )
    return _of_air(relation)


def _of_air(relation: str, **moisture: Any) -> RefractivityModel:
    air = AIR.get(relation, AIR["paper"])
    form = relation if relation in RELATIONS else "gladstone-dale"
    return RefractivityModel(relation, form, air.uncertainty, air.range, air.source, **moisture)


def _moist_air(composition) -> dict[str, float]:
    """Return the mole fractions of water vapour in moist air and of carbon dioxide in dry air."""
    fractions = {} if composition is None else composition
    if not isinstance(fractions, Mapping) or not set(fractions) <= {WATER, "CO2"}:
        raise ValueError(
            f"relation 'ciddor' is for air: its composition gives only the mole fractions of 'H2O' and 'CO2', got "
            f"{composition!r}; other gases go with relation 'gladstone-dale'"
        )
    water, co2 = float(fractions.get(WATER, 0.0)), float(fractions.get("CO2", ciddor.STANDARD_CO2))
    ciddor.ciddor_constant(905e-9, water=water, co2=co2)  # raises ValueError for bad fractions
    return {"water": water, "co2": co2}
