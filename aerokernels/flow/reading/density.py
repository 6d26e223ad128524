"""Choose the density array of a file, and convert its values to kg/m3.

Density is taken directly, or from pressure and temperature by the ideal gas law, rho = p / (R T). Arrays of
non-dimensional files are multiplied by their references.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from aerokernels.flow.gas import GAS_CONSTANT_AIR, no_gas
from aerokernels.flow.reading.arrays import known_names, plain_name, unit_of_array
from aerokernels.flow.reading.dataset import FLAT, SOLID, Block, Dataset, ReadError
from aerokernels.inputs.checks import check_positive
from aerokernels.inputs.units import quantity

# Names that solvers use, in lower case, without blanks, punctuation and units.
DENSITY_NAMES = ("rho", "density", "massdensity", "dens", "conservative1", "ro", "q1")
# An absolute pressure comes first: beside one, "pressure" is relative to an operating pressure (as in Fluent's files).
PRESSURE_NAMES = ("absolutepressure", "p", "pressure", "staticpressure", "pres", "press")
TEMPERATURE_NAMES = ("temperature", "statictemperature", "t", "temp")


@dataclass(frozen=True)
class Reference:
    """Values in SI of 1 in a non-dimensional file: density [kg/m3], pressure [Pa], temperature [K], length [m].

    `operating_pressure` [Pa] is that to which the pressures of a file are relative (gauge pressures): it is added.
    `stated` names those that a caller states. The others are 1, and the units in the file apply to them.
    """

    density: float = 1.0
    pressure: float = 1.0
    temperature: float = 1.0
    length: float = 1.0
    operating_pressure: float = 0.0
    stated: frozenset[str] = frozenset()

    @classmethod
    def of(cls, reference) -> "Reference":
        """Return references from None, the density's alone, or a mapping by name; numbers in SI or texts with a unit.

        Raises:
            TypeError: A value of another kind.
            ValueError: An unknown name, or a value that is not positive.
        """
        if reference is None or isinstance(reference, cls):
            return reference or cls()
        if not isinstance(reference, Mapping):
            reference = {"density": reference}
        known = [name for name in cls.__annotations__ if name != "stated"]
        if unknown := set(reference) - set(known):
            raise ValueError(f"reference: {sorted(unknown)[0]!r} is not known: choose of {', '.join(known)}")
        values = {
            name: check_positive(quantity(value, name.removeprefix("operating_")), f"reference {name}")
            for name, value in reference.items()
        }
        return cls(**values, stated=frozenset(values))


@dataclass(frozen=True)
class DensityChoice:
    """The arrays that the density comes from: its own, or without one those of pressure and temperature."""

    path: object
    units: Mapping[str, str]  # of the file's arrays by name
    reference: Reference  # which replaces the file's own unit of a quantity
    density: str | None = None
    pressure: str | None = None
    temperature: str | None = None
    gas_constant: float = GAS_CONSTANT_AIR  # [J/(kg K)]

    @property
    def names(self) -> dict[str, str]:
        """The arrays that are needed, by dimension."""
        every = {name: getattr(self, name) for name in ("density", "pressure", "temperature")}
        return {dimension: name for dimension, name in every.items() if name is not None}

    def described(self) -> str:
        """Describe the choice, for the provenance."""
        if self.density is not None:
            return f"density from {self.density!r}"
        more = self.reference.operating_pressure
        added = f" + {more:.6g} Pa" if more else ""
        constant = f"R = {self.gas_constant:.6g} J/(kg K)"
        return f"density from {self.pressure!r}{added} and {self.temperature!r} with {constant}"

    def densities(self, arrays: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return the density [kg/m3] from the values of the arrays by dimension; overflows are rejected later."""
        with np.errstate(all="ignore"):
            values = {dimension: self._in_si(dimension, own) for dimension, own in arrays.items()}
            if self.density is not None:
                return values["density"]
            pressure = values["pressure"] + self.reference.operating_pressure
            return np.asarray(pressure / (self.gas_constant * values["temperature"]))

    def _in_si(self, dimension: str, values: np.ndarray) -> np.ndarray:
        """Return values in SI; densities that need no change keep the file's float32, which takes half the memory."""
        name = self.names[dimension]
        unit = unit_of_array(self.path, name, self.units.get(name, ""), dimension)
        if dimension in self.reference.stated:
            return np.asarray(values, np.float64) * getattr(self.reference, dimension)
        if (unit.factor, unit.offset) == (1.0, 0.0):
            return values if dimension == "density" else np.asarray(values, np.float64)
        return np.asarray(np.asarray(values, np.float64) * unit.factor + unit.offset)

    def of_block(self, block: Block) -> tuple[np.ndarray, str]:
        """Return the density [kg/m3] of a block, and whether it belongs to its "cell"s or its "point"s."""
        result: dict[str, np.ndarray] = {}
        places: list[str] = []
        for dimension, name in self.names.items():
            result[dimension], place = scalar_array(self.path, block, name, *places)
            places.append(place)
        if len(set(places)) > 1:
            both = " and ".join(self.names.values())
            raise ReadError(self.path, f"{both} are given at different places", "give both in cells")
        values, where = self.densities(result), places[0]
        self._refuse_no_gas(block, values, where)
        return values, where

    def _refuse_no_gas(self, block: Block, values: np.ndarray, where: str) -> None:
        blank = block.blank if block.blank is not None and len(block.blank) == len(values) else None
        types = block.cells.types if where == "cell" and block.cells is not None else np.empty(0)
        of_flow = next((own for kinds in (SOLID, FLAT) if (own := np.isin(types, kinds)).any()), None)
        if of_flow is not None and not of_flow.all():  # faces beside solid cells, lines and points beside flat cells
            blank = ~of_flow if blank is None else blank | ~of_flow
        if not (wrong := no_gas(values, blank)):
            return
        fault, count, first = wrong
        place = f"{where} {first}" + (f" of block {block.name!r}" if block.name else "")
        remedy = "repair the file, or give the reference of non-dimensional data"
        if fault in ("not finite", "not positive"):  # masked places are NaN, and solids often have the density 0
            remedy = "where there is no flow, say so by an array iblank that is 0 there; elsewhere repair the file"
        if fault == "not positive" and self.pressure is not None:
            gauge = "if the pressure is relative to an operating pressure, give it: "
            remedy = f"{gauge}reference = {{operating_pressure = ...}}; {remedy}"
        raise ReadError(
            self.path,
            f"{count} of {len(values)} densities from {' and '.join(self.names.values())} are {fault}, the first is "
            f"{float(values[first])!r} kg/m3 in {place}",
            remedy,
        )


def choose_density(path, dataset: Dataset, given, gas_constant: float | None, reference: Reference) -> DensityChoice:
    """Choose the arrays that the density comes from, by their usual names or as a caller names them.

    `given` and `gas_constant` are the options of `read`; None takes the file's own gas constant, or air's.
    """
    names = dataset.array_names()
    own = dataset.gas_constant or GAS_CONSTANT_AIR if gas_constant is None else gas_constant
    choice = DensityChoice(path, dataset.units, reference, gas_constant=check_positive(own, "gas_constant"))
    listed = ", ".join(names) if names else "none"
    held = dict.fromkeys(name for block in dataset.blocks for name in (*block.point_data, *block.cell_data))
    if some := [name for name in held if name not in names]:
        listed += f"; in some zones only: {', '.join(some)}"
    if isinstance(given, str):
        return replace(choice, density=found_name(path, given, names, listed, dataset.grouped))
    if isinstance(given, Mapping):
        if not {"pressure", "temperature"} <= set(given) <= {"pressure", "temperature", "gas_constant"}:
            raise ValueError(
                f"density: give an array's name, or a mapping of 'pressure' and 'temperature', got {given!r}"
            )
        constant = check_positive(float(given.get("gas_constant", own)), "gas_constant")
        pair: dict[str, Any] = {
            key: found_name(path, given[key], names, listed, dataset.grouped) for key in ("pressure", "temperature")
        }
        return replace(choice, **pair, gas_constant=constant)
    if given is not None:
        raise TypeError(f"density must be an array's name or a mapping, got {type(given).__name__}")
    if (density := usual_name(path, dataset, DENSITY_NAMES)) is not None:
        return replace(choice, density=density)
    pressure, temperature = (usual_name(path, dataset, known) for known in (PRESSURE_NAMES, TEMPERATURE_NAMES))
    if pressure is None or temperature is None:
        raise ReadError(
            path,
            f"no array is known for the density, nor for pressure and temperature (there are: {listed})",
            "name it: density = 'NAME', or density = {pressure = 'NAME', temperature = 'NAME'}",
        )
    return replace(choice, pressure=pressure, temperature=temperature)


def usual_name(path, dataset: Dataset, known: Sequence[str]) -> str | None:
    """Return the array with the first of the `known` names, the one in the fewest groups; None if there is none.

    Means over time count after all others. A "T" counts before a "t", which may be the time: it is not taken where it
    is the same everywhere.
    """
    usual = (name for name in dataset.array_names() if not _is_time(dataset, name))
    named = known_names(usual, known, dataset.grouped)
    if dataset.grouped:
        level = min((name.count("/") for name in named), default=0)
        named = [name for name in named if name.count("/") == level]
        if level and len(named) > 1:
            raise ReadError(path, f"several groups have such an array: {', '.join(named)}", "name one of them")
    return min(named, key=lambda name: name[-1:] == "t", default=None)


def _is_time(dataset: Dataset, name: str) -> bool:
    """Return whether an array called "t" is a time: it is the same everywhere."""
    if name.rsplit("/", 1)[-1].strip() != "t":
        return False
    held = [block.arrays(where) for block in dataset.blocks for where in ("cell", "point")]
    parts = [np.asarray(arrays[name]) for arrays in held if name in arrays]
    return len({value for part in parts if part.size for value in (part.min(), part.max())}) < 2


def scalar_array(path, block: Block, name: str, *first: str) -> tuple[np.ndarray, str]:
    """Return a scalar array of a block, and whether it belongs to "cell"s or "point"s; `first` is searched first."""
    place = next((place for place in (*first, "cell", "point") if name in block.arrays(place)), None)
    if place is None:
        raise ReadError(path, f"block {block.name!r} has no array {name!r}", "name an array that all blocks have")
    values = np.asarray(block.arrays(place)[name])
    count = block.cell_count if place == "cell" else len(block.points)
    if values.shape not in ((count,), (count, 1)):
        raise ReadError(path, f"array {name!r} has shape {values.shape} for {count} {place}s", "name a scalar array")
    if values.dtype == np.float16:
        raise ReadError(path, f"array {name!r} is float16, which has three digits", "write it as float32 or more")
    return values.reshape(-1) if values.dtype == np.float32 else values.reshape(-1).astype(np.float64), place


def found_name(path, name: str, names: list[str], listed: str, grouped: bool = False) -> str:
    """Return the array that a caller names, ignoring case and punctuation."""
    if name in names:
        return name
    alike = [other for other in names if plain_name(other, grouped) == plain_name(name, grouped)]
    if len(alike) == 1:
        return alike[0]
    raise ReadError(path, f"there is no array {name!r}", f"take one of {listed}")
