"""Check what was read: coordinates, corners of cells, blocks that repeat one mesh, numbers that are hardly in SI."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from aerokernels.flow.gas import GAMMA_AIR, GAS_CONSTANT_AIR
from aerokernels.flow.reading.arrays import plain_name, unit_of_array
from aerokernels.flow.reading.dataset import Block, Dataset, ReadError, check_points
from aerokernels.flow.reading.density import PRESSURE_NAMES, TEMPERATURE_NAMES, DensityChoice, scalar_array, usual_name
from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.units import is_no_unit, unit_in_name


def check_blocks(path, blocks: Sequence[Block]) -> None:
    """Check that points have finite coordinates and that cells and faces refer to existing points."""
    if not any(len(block.points) for block in blocks):
        raise ReadError(path, "it has no points", "give a file with a mesh and its arrays")
    for block in blocks:
        check_points(path, block.points, block.name)
        count, cells = len(block.points), block.cells
        if block.shape is not None and math.prod(block.shape) != count:
            raise ReadError(path, f"a grid of {block.shape} points has {count}", "write it again")
        if cells is None:
            continue
        start, points = cells.start, cells.points
        fits = len(start) == len(cells.types) + 1 and (not len(start) or (start[0] == 0 and start[-1] == len(points)))
        if not fits or (np.diff(start) < 0).any():
            fault = f"the cells of block {block.name!r} do not agree with their own counts"
            raise ReadError(path, fault, "write it again")
        if len(points) and not (0 <= points.min() and points.max() < count):
            cell = int(np.searchsorted(start, int(np.argmax((points < 0) | (points >= count))), "right")) - 1
            raise ReadError(path, f"cell {cell} has corners beyond the {count} points that there are", "write it again")
        of_faces = np.empty(0) if cells.faces is None else cells.faces.points
        if len(of_faces) and not (0 <= of_faces.min() and of_faces.max() < count):
            raise ReadError(path, f"faces have corners beyond the {count} points that there are", "write it again")


def check_repeated_blocks(path, blocks: Sequence[Block], densities: list[tuple[np.ndarray, str]]) -> None:
    """Reject blocks on the same mesh with other densities: several times or cases of one flow."""
    for k, block in enumerate(blocks):
        for n in range(k):
            (one, where), (other, elsewhere) = densities[k], densities[n]
            if where == elsewhere and _same_mesh(block, blocks[n]) and not np.array_equal(one, other, equal_nan=True):
                names = " and ".join(repr(blocks[i].name or f"block {i + 1}") for i in (n, k))
                what = f"{names} have the same mesh and other densities: several times or cases of one flow"
                raise ReadError(path, what, "write each to a file of its own")


def with_blanks(dataset: Dataset) -> Dataset:
    """Return the dataset with the cells or points blanked where an array `iblank` is 0, as overset grids state it."""

    def blanked(block: Block) -> Block:
        for arrays, count in ((block.cell_data, block.cell_count), (block.point_data, len(block.points))):
            for name in (name for name in arrays if block.blank is None and plain_name(name, True) == "iblank"):
                values = np.asarray(arrays[name])
                if values.shape == (count,) and values.dtype.kind in "iuf" and (values == 0).any():
                    return replace(block, blank=values == 0)
        return block

    return replace(dataset, blocks=[blanked(block) for block in dataset.blocks])


def _same_mesh(one: Block, other: Block) -> bool:
    if one.shape != other.shape or len(one.points) != len(other.points) or one.cell_count != other.cell_count:
        return False
    if one.cells is None or other.cells is None:
        return one.shape is not None and np.array_equal(one.points, other.points)
    if one.cells.faces is not None or not np.array_equal(one.cells.points, other.cells.points):
        return False
    return np.array_equal(one.cells.types, other.cells.types) and np.array_equal(one.points, other.points)


COLDEST = 4.0  # [K] helium is liquid below it
# Total energies, of a volume or of a mass.
ENERGY_NAMES = ("energy", "totalenergy", "energystagnationdensity", "energystagnation", "rhoe", "etot", "e")


def said_of_units(path: Any, dataset: Dataset, choice: DensityChoice, densities: list[tuple[np.ndarray, str]]) -> str:
    """Return a remark for the provenance, and warn, where numbers without a unit cannot be in SI; empty elsewhere.

    Where a file has a density beside pressure and temperature, p / (rho R T) is far from 1 in a non-dimensional one:
    1/400 where pressures are scaled by rho a^2 and the gas is air. Where the density follows from them, temperatures
    are near 1. Beside a pressure alone, or a total energy E, the temperature p / (rho R) or at most
    (gamma - 1) E / (rho R) is some thousandths of a kelvin.
    """
    first = choice.density or choice.temperature
    assert first is not None
    if choice.reference.stated - {"operating_pressure", "length"}:
        return ""
    if dataset.scaled:  # which is in the provenance already
        warn_caller(f"{path}: {dataset.scaled}; where they are in SI, say so by a reference of 1")
        return ""
    if _has_unit(dataset, first) or not all(isinstance(block.cell_data, dict) for block in dataset.blocks):
        return ""  # nor of fields that would be read now
    try:
        fault = _not_in_si(path, dataset, choice, densities)
    except ReadError:  # of arrays that nobody asked for
        return ""
    if not fault:
        return ""
    unit, dimension = ("K", "temperature") if choice.density is None else ("kg/m3", "density")
    remark = (
        f"{first!r} was taken in {unit}, but {fault}: if the file is non-dimensional, give its reference values "
        f"(reference={{'{dimension}': ...}}, flow.file.reference_{dimension})"
    )
    warn_caller(f"{path}: {remark}")
    return f"; {remark}"


def _not_in_si(path: Any, dataset: Dataset, choice: DensityChoice, densities: list[tuple[np.ndarray, str]]) -> str:
    """Return why the numbers cannot be in SI; empty where they may be."""

    def median(name: str, dimension: str, of) -> float:
        """The median of a function of a density and an array beside it; NaN where the array is at other places."""
        parts = []
        for block, (density, where) in zip(dataset.blocks, densities, strict=True):
            own, place = scalar_array(path, block, name, where)
            if place != where:
                return np.nan
            if dimension:
                unit = unit_of_array(path, name, dataset.units.get(name, ""), dimension)
                own = own * unit.factor + unit.offset
            with np.errstate(all="ignore"):
                parts.append(of(density, own))
        every = np.concatenate(parts)
        every = every[np.isfinite(every)]
        return float(np.median(every)) if len(every) else np.nan

    constant = dataset.gas_constant or GAS_CONSTANT_AIR
    pressure, temperature = (usual_name(path, dataset, names) for names in (PRESSURE_NAMES, TEMPERATURE_NAMES))
    if choice.density is None or (temperature is not None and pressure is None):
        coldest = choice.temperature or temperature
        assert coldest is not None
        half = median(coldest, "", lambda _, own: own)
        if not half < COLDEST or _has_unit(dataset, coldest):
            return ""
        return f"{'' if choice.density is None else f'of {coldest!r} '}half of it is below {half:.3g} K"
    if temperature is not None and pressure is not None:
        ratio = median(pressure, "pressure", lambda density, own: own / (constant * density)) / median(
            temperature, "temperature", lambda _, own: own
        )
        # Gas constants differ from that of air by up to 14 (hydrogen), scales of non-dimensional files by hundreds.
        apart = 0.0 < ratio < 1.0 / 30.0 or ratio > 30.0
        return f"{pressure!r} / (R {temperature!r}) is {ratio:.2g} times as much" if apart else ""
    if (beside := pressure or usual_name(path, dataset, ENERGY_NAMES)) in (None, choice.density):
        return ""
    assert beside is not None
    if pressure is not None:
        share = 1.0 / constant  # a pressure of which more than a hundredth is 0 or less is relative to another
        half = median(beside, "pressure", lambda density, own: np.where((own <= 0.0).mean() > 0.01, np.nan,
                                                                        share * own / density))  # fmt: skip
    else:  # an upper bound: of a mass or of a volume, whichever gives more, with the energy of the motion
        share = (GAMMA_AIR - 1.0) / constant
        half = median(beside, "", lambda density, own: share * own / np.minimum(density, 1.0))
    # [K] of air that is no plasma, by the gas constant of its molecules: above it units are mixed.
    if not (0.0 < half < COLDEST or (pressure is not None and half > 5e4)):
        return ""
    return f"with {beside!r} half of the gas is {'below' if half < COLDEST else 'above'} {half:.2g} K"


def _has_unit(dataset: Dataset, name: str) -> bool:
    return bool(unit_in_name(name)) or not is_no_unit(dataset.units.get(name, ""))
