"""Check the blocks of a data set: coordinates, the corners of cells, and blocks that repeat one mesh."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from aerokernels.flow.gas import GAMMA_AIR, GAS_CONSTANT_AIR
from aerokernels.flow.reading.arrays import in_si_units, plain_name
from aerokernels.flow.reading.dataset import Block, Dataset, ReadError, check_points
from aerokernels.flow.reading.density import (
    PRESSURE_NAMES,
    TEMPERATURE_NAMES,
    DensityChoice,
    Reference,
    scalar_array,
    usual_name,
)
from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.units import is_no_unit, unit_in_name


def check_blocks(path, dataset: Dataset) -> None:
    """Check that points have finite coordinates and that cells refer to existing points.

    Raises:
        ReadError: The block, the fault and the remedy.
    """
    if not dataset.blocks or not any(len(block.points) for block in dataset.blocks):
        raise ReadError(path, "it has no points", "give a file with a mesh and its arrays")
    for block in dataset.blocks:
        check_points(path, block.points, block.name)
        if block.shape is not None and math.prod(block.shape) != len(block.points):
            raise ReadError(path, f"a grid of {block.shape} points has {len(block.points)}", "write it again")
        if block.cells is not None:
            _check_cells(path, block)


def check_repeated_blocks(path, blocks: Sequence[Block], densities: list[tuple[np.ndarray, str]]) -> None:
    """Reject blocks on the same mesh with other densities: several times or cases of one flow.

    Raises:
        ReadError: The names of two such blocks.
    """
    for k, block in enumerate(blocks):
        for n in range(k):
            (one, where), (other, elsewhere) = densities[k], densities[n]
            if where == elsewhere and _same_mesh(block, blocks[n]) and not np.array_equal(one, other, equal_nan=True):
                names = " and ".join(repr(blocks[i].name or f"block {i + 1}") for i in (n, k))
                what = f"{names} have the same mesh and other densities: several times or cases of one flow"
                raise ReadError(path, what, "write each to a file of its own")


def with_blanks(dataset: Dataset) -> Dataset:
    """Return the dataset with the cells or points blanked where an array `iblank` is 0, as overset grids state it."""
    return replace(dataset, blocks=[_blanked(block) for block in dataset.blocks])


def _blanked(block: Block) -> Block:
    if block.blank is not None:
        return block
    for arrays, count in ((block.cell_data, block.cell_count), (block.point_data, len(block.points))):
        for name in (name for name in arrays if plain_name(name, True) == "iblank"):
            values = np.asarray(arrays[name])
            if values.shape == (count,) and values.dtype.kind in "iuf" and (values == 0).any():
                return replace(block, blank=values == 0)
    return block


def _same_mesh(one: Block, other: Block) -> bool:
    if one.shape != other.shape or len(one.points) != len(other.points) or one.cell_count != other.cell_count:
        return False
    if one.cells is None or other.cells is None:
        return one.shape is not None and np.array_equal(one.points, other.points)
    if one.cells.faces is not None or not np.array_equal(one.cells.points, other.cells.points):
        return False
    return np.array_equal(one.cells.types, other.cells.types) and np.array_equal(one.points, other.points)


def _check_cells(path, block: Block) -> None:
    cells = block.cells
    assert cells is not None
    start, points = cells.start, cells.points
    fits = len(start) == len(cells.types) + 1 and (not len(start) or (start[0] == 0 and start[-1] == len(points)))
    if not fits or (np.diff(start) < 0).any():
        raise ReadError(path, f"the cells of block {block.name!r} do not agree with their own counts", "write it again")
    if len(points) and not (0 <= points.min() and points.max() < len(block.points)):
        cell = int(np.searchsorted(start, int(np.argmax((points < 0) | (points >= len(block.points)))), "right")) - 1
        raise ReadError(
            path, f"cell {cell} has corners beyond the {len(block.points)} points that there are", "write it again"
        )


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
