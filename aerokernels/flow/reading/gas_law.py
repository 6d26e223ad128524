"""Find numbers that are hardly in SI: those of a non-dimensional file.

Some files state that they are, or their format does. Where a file has a density beside pressure and temperature,
p / (rho R T) is far from 1 in a non-dimensional one: 1/400 where pressures are scaled by rho a^2 and the gas is air.
Where the density follows from them, temperatures are near 1. Beside a pressure alone, or a total energy E, the
temperature p / (rho R) or at most (gamma - 1) E / (rho R) is some thousandths of a kelvin.
"""

from typing import Any

import numpy as np

from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.units import is_no_unit, unit_in_name

from ..gas import GAMMA_AIR, GAS_CONSTANT_AIR
from .array_units import in_si_units
from .dataset import Dataset, ReadError
from .density import PRESSURE_NAMES, TEMPERATURE_NAMES, DensityChoice, Reference, scalar_array, usual_name

# Gas constants differ from that of air by up to 14 (hydrogen), scales of non-dimensional files by hundreds.
APART = 30.0
COLDEST = 4.0  # [K] helium is liquid below it
HOTTEST = 5e4  # [K] of air that is no plasma, by the gas constant of its molecules: above it units are mixed
GAUGE_SHARE = 0.01  # of pressures that are 0 or less, above which they are relative to an operating pressure
# Total energies, of a volume or of a mass.
ENERGY_NAMES = ("energy", "totalenergy", "energystagnationdensity", "energystagnation", "rhoe", "etot", "e")
REMEDY = "if the file is non-dimensional, give its reference values (reference={{'{0}': ...}}, flow.file.reference_{0})"


def said_of_units(
    path: Any, dataset: Dataset, choice: DensityChoice, reference: Reference, densities: list[tuple[np.ndarray, str]]
) -> str:
    """Return a remark for the provenance, and warn, where numbers without a unit cannot be in SI; empty elsewhere.

    Args:
        path: The file, for messages.
        dataset: Its contents.
        choice: The arrays that the density comes from.
        reference: Reference values that the caller states.
        densities: Density [kg/m3] of each block, and whether it belongs to its "cell"s or its "point"s.
    """
    first = choice.density or choice.temperature
    assert first is not None
    if reference.given - {"operating_pressure", "length"}:
        return ""
    if dataset.scaled:  # which is in the provenance already
        warn_caller(f"{path}: {dataset.scaled}; where they are in SI, say so by a reference of 1")
        return ""
    if not is_no_unit(dataset.units.get(first, "")) or unit_in_name(first):
        return ""
    if not all(isinstance(block.cell_data, dict) for block in dataset.blocks):  # fields that would be read now
        return ""
    try:
        if choice.density is not None:
            found = _beside(path, dataset, first, densities)
        elif cold := _cold(path, dataset, first):
            found = f"{first!r} was taken in K, but {cold}: {REMEDY.format('temperature')}"
        else:
            return ""
    except ReadError:  # of arrays that nobody asked for
        return ""
    if found:
        warn_caller(f"{path}: {found}")
        return f"; {found}"
    return ""


def _cold(path: Any, dataset: Dataset, name: str) -> str:
    """Return a remark on temperatures without a unit that are too low for a gas."""
    median = _median([scalar_array(path, block, name)[0] for block in dataset.blocks])
    return f"half of it is below {median:.3g} K" if median < COLDEST else ""


def _beside(path: Any, dataset: Dataset, name: str, densities: list[tuple[np.ndarray, str]]) -> str:
    """Return a remark on a density that is far from what pressure and temperature beside it give."""
    pressure, temperature = (usual_name(path, dataset, names) for names in (PRESSURE_NAMES, TEMPERATURE_NAMES))
    if temperature is None:
        return _alone(path, dataset, name, densities, pressure)
    if pressure is None:
        if unit_in_name(temperature) or not is_no_unit(dataset.units.get(temperature, "")):
            return ""
        cold = _cold(path, dataset, temperature)
        told = f"{name!r} was taken in kg/m3, but of {temperature!r} {cold}: {REMEDY.format('density')}"
        return told if cold else ""
    constant = dataset.gas_constant or GAS_CONSTANT_AIR
    ratios = []
    for block, (density, where) in zip(dataset.blocks, densities, strict=True):
        values = {}
        for one, dimension in ((pressure, "pressure"), (temperature, "temperature")):
            own, place = scalar_array(path, block, one, where)
            if place != where:
                return ""
            values[dimension] = in_si_units(path, own, one, dataset.units.get(one, ""), dimension)
        with np.errstate(all="ignore"):
            ratios.append(values["pressure"] / (constant * density * values["temperature"]))
    ratio = _median(ratios)
    if not (0.0 < ratio < 1.0 / APART or ratio > APART):
        return ""
    return (
        f"{name!r} was taken in kg/m3, but {pressure!r} / (R {temperature!r}) is {ratio:.2g} times as much: "
        f"{REMEDY.format('density')}"
    )


def _alone(
    path: Any, dataset: Dataset, name: str, densities: list[tuple[np.ndarray, str]], pressure: str | None
) -> str:
    """Return a remark on a density by which a pressure, or a total energy, has the temperature of no gas."""
    beside = pressure if pressure is not None else usual_name(path, dataset, ENERGY_NAMES)
    if beside in (None, name):
        return ""
    assert beside is not None
    constant = dataset.gas_constant or GAS_CONSTANT_AIR
    temperatures = []
    for block, (density, where) in zip(dataset.blocks, densities, strict=True):
        own, place = scalar_array(path, block, beside, where)
        if place != where:
            return ""
        if pressure is not None:
            own = in_si_units(path, own, beside, dataset.units.get(beside, ""), "pressure")
            if (own <= 0.0).mean() > GAUGE_SHARE:
                return ""
            temperatures.append(own / (constant * density))
        else:  # an upper bound: of a mass or of a volume, whichever gives more, with the energy of the motion
            temperatures.append((GAMMA_AIR - 1.0) * own / (constant * np.minimum(density, 1.0)))
    median = _median(temperatures)
    if not (0.0 < median < COLDEST or (pressure is not None and median > HOTTEST)):
        return ""
    half = f"half of the gas is {'below' if median < COLDEST else 'above'} {median:.2g} K"
    return f"{name!r} was taken in kg/m3, but with {beside!r} {half}: {REMEDY.format('density')}"


def _median(parts: list[np.ndarray]) -> float:
    """Return the median of the finite values, NaN if there is none."""
    every = np.concatenate(parts)
    every = every[np.isfinite(every)]
    return float(np.median(every)) if len(every) else np.nan
