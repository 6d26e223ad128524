"""Refractivity and index contrast from density; refractivities n - 1 are never differences of numbers near 1.

    Lorentz-Lorenz (the paper's eq 1):  (n^2 - 1) / (n^2 + 2) = 2/3 K rho
    Gladstone-Dale (eq 3):              n = 1 + K rho                     the linear limit, lower by (K rho)^2 / 6

A pulse travels by n_g = n + 2 s dn/ds, s = 1 / lambda^2, with the group constant K_g = K + 2 s dK/ds. A relation for
air is a row of `AIR`, a gas a row of species.py.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from aerokernels.flow import ciddor
from aerokernels.flow.air import AIR, Band
from aerokernels.flow.composition import Composition
from aerokernels.flow.species import WATER
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.checks import LONGEST, SAME, SHORTEST, check_choice, check_wavelength
from aerokernels.medium import GroupIndex, IndexField, Upstream

RELATIONS = ("gladstone-dale", "lorentz-lorenz")
MODELS = ("paper", "ciddor", *RELATIONS, "mathar", "auto")


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
    return _contrast(density, ambient_density, gladstone_dale, relation)


def _contrast(density, ambient_density: float, gladstone_dale, relation: str):
    """Return the contrast; the constant of an ionised mixture may have any sign."""
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


@dataclass(frozen=True, eq=False)
class RefractivityModel:
    """A relation between density and refractivity. Build one with `refractivity_model`.

    Attributes:
        name: One of `MODELS`.
        form: "gladstone-dale" (linear in density) or "lorentz-lorenz".
        uncertainty: Relative uncertainty of n - 1 due to the constant, the greatest of the model's bands; 0 for a
            constant given by the caller. See `uncertainty_at`.
        range: Shortest and longest vacuum wavelength at which the constant is known [m].
        source: Where the constant comes from.
        given: The constant given by the caller [m3/kg], or None.
        composition: The mixture, or None.
        water: Mole fraction of water vapour, for "auto", "ciddor" and "mathar".
        co2: Mole fraction of carbon dioxide in the dry air, for the same.
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
        return self._band(wavelength).constant(wavelength, water=self.water, co2=self.co2, group=group)

    def uncertainty_at(self, wavelength: float) -> float:
        """Return the relative uncertainty of n - 1 at a vacuum wavelength [m], due to the constant."""
        if self.composition is not None:
            return self.composition.uncertainty_at(wavelength)
        return 0.0 if self.given is not None else self._band(wavelength).uncertainty

    def _band(self, wavelength: float) -> Band:
        """Return the first band that holds at a wavelength; the constant of a wrong one names its range."""
        bands = AIR.get(self.name, AIR["paper"])
        for band in bands:
            if band.low * (1.0 - SAME) <= check_wavelength(wavelength) <= band.high * (1.0 + SAME):
                return band
        if self.name != "auto":
            return bands[0]
        listed = ", ".join(f"{1e6 * band.low:g} to {1e6 * band.high:g}" for band in bands)
        raise ValueError(
            f"wavelength {wavelength:g} m is outside the ranges of air's relations, {listed} um (Ciddor's and Mathar's "
            "bands, between which air absorbs): choose a wavelength there, relation 'paper', or give a constant"
        )

    def refractivity(self, density, wavelength: float, *, ambient: bool = False, group: bool = False):
        """Return the refractivity n - 1 at densities [kg/m3] of any shape and a vacuum wavelength [m].

        `ambient` returns that of the ambient gas, `group` n_g - 1 of the group index.

        Raises:
            ValueError: A wavelength outside the model's range, or a composition by cell of another shape.
        """
        constant = self._at(density, self.constant(wavelength, ambient=ambient))
        if not group:
            return _contrast(density, 0.0, constant, self.form)
        of_group = self._at(density, self.constant(wavelength, ambient=ambient, group=True))
        if self.form == "gladstone-dale":
            return of_group * density
        # n_g = n + (K_g - K) dn/dK, and with a = 2/3 K rho dn/dK = rho / (n (1 - a)^2).
        excess = _contrast(density, 0.0, constant, self.form)
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
        source, of_phase = f"{self.name}: {self.source}", self.uncertainty_at(wavelength)
        uncertainty = of_phase
        if self.given is None and self.composition is None:
            band = self._band(wavelength)
            uncertainty = max(of_phase, band.group_length / wavelength)
            source = f"{band.relation if self.name == 'auto' else self.name}: {band.source}"
        constant, of_group = (self.constant(wavelength, ambient=True, group=one) for one in (False, True))
        columns = float(np.max(np.abs(self.constant(wavelength)))) * column
        upstream = Upstream(columns, of_phase, source)
        if group:
            upstream = replace(upstream, refractivity=uncertainty)
        else:
            ambient_index = self.ambient_index(ambient_density, wavelength, group=True)
            field = None if self.is_one_gas else partial(again, group=True)
            upstream = replace(upstream, group=GroupIndex(ambient_index, of_group / constant, uncertainty, field))
        index = self.ambient_index(ambient_density, wavelength, group=group)
        return {"ambient_index": index, "wavelength": wavelength, "upstream": upstream}

    def contrast(self, density, ambient_density: float, wavelength: float, *, group: bool = False):
        """Return the contrast n - n_ambient of densities of any shape and an ambient one [kg/m3] at a wavelength [m].

        `group` returns that of the group index.

        Raises:
            ValueError: A wavelength outside the model's range, or a composition by cell of another shape.
        """
        if self.is_one_gas and not group:
            return _contrast(density, ambient_density, self.constant(wavelength), self.form)
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
    """Return the relation where none is given: "auto" for air, unless the constant or the gas is another."""
    return "gladstone-dale" if has_constant or is_mixture else "auto"


@checked
def refractivity_model(
    relation: str | None = None, *, constant: float | None = None, composition=None
) -> RefractivityModel:
    """Return a refractivity model by name.

    Args:
        relation: One of `MODELS`. "auto", which None is too, takes "ciddor" for air where it holds, 0.3 to 1.69 um, and
            "mathar" in the infrared windows up to 24 um; with `constant` or the `composition` of another gas it is
            "gladstone-dale". "paper" is eq 2. "gladstone-dale" and "lorentz-lorenz" take the paper's K(wavelength)
            unless `constant` or `composition` is given.
        constant: K [m3/kg] for "gladstone-dale" or "lorentz-lorenz".
        composition: For these two a `Composition`, or mole fractions by species, {"N2": 0.79, "O2": 0.21} say. For
            air the mole fractions {"H2O": in the moist air, "CO2": in the dry air}, each of which may be omitted.

    Raises:
        TypeError: A composition that is neither a mapping nor a Composition.
        ValueError: An unknown relation, species or fraction, or a constant or composition that the relation does not
            take.
    """
    check_choice(relation or "auto", "relation", MODELS)
    if relation in (None, "auto"):
        relation = default_relation(constant is not None, composition is not None and not _is_moisture(composition))
    if constant is not None and composition is not None:
        raise ValueError("give either a constant or a composition: a composition has a constant of its own")
    if relation not in RELATIONS and constant is not None:
        raise ValueError(f"relation {relation!r} has its own constant: with one of yours take 'gladstone-dale'")
    if relation == "paper" and composition is not None:
        raise ValueError("relation 'paper' is for air: with a composition take 'gladstone-dale' or 'ciddor'")
    if relation in ("auto", "ciddor", "mathar"):
        return _of_air(relation, **_moist_air(relation, composition))
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
    bands = AIR.get(relation, AIR["paper"])
    form = relation if relation in RELATIONS else "gladstone-dale"
    ends = (bands[0].low, bands[-1].high)
    source = "; ".join(dict.fromkeys(band.source for band in bands))
    return RefractivityModel(relation, form, max(band.uncertainty for band in bands), ends, source, **moisture)


def _is_moisture(composition) -> bool:
    """Return whether a composition gives the vapour and the carbon dioxide in air, and not a gas of these two."""
    if not isinstance(composition, Mapping) or not set(composition) <= {WATER, "CO2"}:
        return False
    return all(np.ndim(share) == 0 for share in composition.values()) and sum(composition.values()) < 0.5


def _moist_air(relation: str, composition) -> dict[str, float]:
    """Return the mole fractions of water vapour in moist air and of carbon dioxide in dry air."""
    fractions = {} if composition is None else composition
    if not isinstance(fractions, Mapping) or not set(fractions) <= {WATER, "CO2"}:
        raise ValueError(
            f"relation {relation!r} is for air: its composition gives only the mole fractions of 'H2O' and 'CO2', got "
            f"{composition!r}; other gases go with relation 'gladstone-dale'"
        )
    water, co2 = float(fractions.get(WATER, 0.0)), float(fractions.get("CO2", ciddor.STANDARD_CO2))
    ciddor.check_fractions(water, co2)
    return {"water": water, "co2": co2}
