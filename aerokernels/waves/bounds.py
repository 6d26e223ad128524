r"""Proof that rays are good, from bounds of the field alone, without rays or waves; cached on the field.

Light that reaches the pupil from a plane wave behind the field is D exp(i k W), with W the path of straight rays. The
wave's Strehl ratio is the squared mean of this over the pupil. The rays neglect D, which to first order in 1 / k obeys

    ln D = -1/2 \int (z - z_p) lap m dz  -  i k / 2 \int |grad W|^2 dz  +  i / (8 k) \int (z - z_p)^2 lap lap m dz

along lines from the pupil at z_p through the contrast m: brightness, slanted paths, and diffraction. The paths of bent
rays differ from W by k L |grad W|^2 at most. A mean of numbers of size 1 changes by no more than they do, and its
square by twice that:

    |change| <= \int (z - z_p) |lap m| dz  +  2 k L T^2  +  1/(4 k) \int (z - z_p)^2 |lap lap m| dz

with T = \int |grad m| dz. Also, if the phase on all lines is within P of its mean, both Strehl ratios are within P^2 of
1. A common tilt turns the light as a whole and is left out of T. Products of such terms are neglected.

A cubic spline and its derivatives are bounded by differences of its coefficients, and each coefficient along z counts
as one cell of the integrals. The differences are evaluated plane by plane over the pupil's light, plus a margin of some
diffraction widths sqrt(lambda L).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..derived import cached_on
from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..pupils import Pupil
from ..tracing.lines import box_size
from .shadows import FRINGES, is_clear

# Greatest bound that counts as a proof: the neglected terms are of the order of its square.
GREATEST_BOUND = 0.1
# The last term is not refined if it is below this share of the other terms; bounds up to ENOUGH are not refined.
LITTLE, ENOUGH = 0.25, 5e-3
# Coefficients processed together; length of z from which on NumPy's own reduction is fast; bounds cached on a field.
PART_SIZE, LONG, KEPT = 1 << 16, 128, 8


@dataclass(frozen=True)
class ChangeBound:
    """Upper bounds of the effects of the air.

    Attributes:
        change: Bound of |Strehl ratio of the wave minus the one of rays|; infinite if nothing is known.
        curvature: Bound of the curvature of the rays' wavefront times the distance from the pupil.
        distance: Distance from the pupil to where the light has left the field [m].
    """

    change: float
    curvature: float
    distance: float


@cached_on("field", KEPT)
def change_bound(field: IndexField, pupil: Pupil, look: np.ndarray, wavelength: float) -> ChangeBound:
    """Return the bound for light that leaves a pupil along the unit vector `look`."""
    wave_number, samples = 2.0 * math.pi / wavelength, field.samples
    if not is_clear(field, pupil, look, wavelength):
        return ChangeBound(math.inf, math.inf, math.inf)
    low, high = samples.extremes if isinstance(samples, UniformGrid) else (samples.values.min(), samples.values.max())
    # Outside the box the contrast is zero.
    weak = (0.5 * wave_number * float(max(high, 0.0) - min(low, 0.0)) * box_size(field)) ** 2
    found = ChangeBound(weak, math.inf, math.inf)
    along_z = abs(abs(float(look[2])) - 1.0) < 1e-15
    if isinstance(samples, UniformGrid) and samples.interpolation == "cubic" and along_z:
        finer = _along_z(field, samples, pupil, float(look[2]), wave_number)
        found = finer if finer is not None and finer.change < weak else found
    return found


def _along_z(field: IndexField, grid: UniformGrid, pupil: Pupil, sign: float, wave_number: float) -> ChangeBound | None:
    """Return the bound for light along z of a cubic grid, from coefficients around the pupil's light; None if none."""
    spacing, place = float(grid.spacing[-1]), grid.origin[-1] + grid.spacing[-1] * np.arange(-1, grid.shape[-1] + 1)
    # The pupil's plane may be slanted to the light: then a part of it is farther away.
    slant = pupil.reach * math.sqrt(max(1.0 - float(pupil.normal[2]) ** 2, 0.0))
    distance = sign * (place - float(pupil.center[2])) + slant
    length = float(distance.max()) + pupil.reach
    ahead = np.flatnonzero(distance > -2.0 * spacing)
    margin = FRINGES * math.sqrt(2.0 * math.pi / wave_number * length)
    coefficients = _coefficients(field, grid, pupil, margin) if len(ahead) else None
    if coefficients is None:
        return None
    in_front = slice(int(ahead[0]), int(ahead[-1]) + 1)
    coefficients, distance = coefficients[..., in_front], np.maximum(distance[in_front], 0.0)
    axisymmetric = field.geometry == "axisymmetric"
    # Slope over radius is a mean of second derivatives between the axis and that radius.
    directions = 2.0 if axisymmetric else 1.0
    # The coefficients are those of the potential, which is the contrast times the ambient index.
    scale, steps = spacing / grid.ambient_index, grid.spacing[:-1]
    share = scale / (4.0 * wave_number)
    planes, rest, curvature, second = _Planes(coefficients.shape), 0.0, math.inf, np.zeros(len(distance))
    for part in _parts(coefficients, 2):
        firsts = planes.add(part)
        # The radial slope points in all directions around the axis: it has no common tilt.
        low, high = planes.low, planes.high
        steep = np.maximum(high, -low) if axisymmetric else 0.5 * (high - low)
        turn = scale * float(np.sqrt(np.sum((steep / steps[:, None]) ** 2, axis=0)).sum())
        rest = 2.0 * wave_number * length * turn**2
        if rest <= GREATEST_BOUND:
            planes.add_second(firsts)
            second = directions * np.sum(planes.second / steps[:, None] ** 2, axis=0)
            curvature = scale * float((distance * second).sum())
            rest += curvature
        if rest > GREATEST_BOUND:  # further parts can only increase it
            curvature = math.inf
            break
    # Fourth differences are at most four times the second ones; they are computed only if that bound is large.
    diffraction = share * float((distance**2 * second).sum()) * 4.0 * directions * len(steps) / float(steps.min()) ** 2
    if diffraction > LITTLE * rest and ENOUGH < rest + diffraction and rest <= GREATEST_BOUND:
        fourth = np.zeros((len(steps), len(distance)))
        for part in _parts(coefficients, 4):
            for axis, found in enumerate(fourth):
                np.maximum(found, _greatest(_differences(part, axis, 4)), out=found)
        roots = directions * np.sum(np.sqrt(fourth) / steps[:, None] ** 2, axis=0)
        diffraction = share * float((distance * roots) @ (distance * roots))
    change = rest + diffraction if math.isfinite(curvature) else math.inf
    if change > ENOUGH:
        to_phase = 0.5 * scale * wave_number
        change = min(change, (to_phase * _spread(coefficients, math.sqrt(GREATEST_BOUND) / to_phase)) ** 2)
    return ChangeBound(change, curvature, length)


class _Planes:
    """Extremes of differences of coefficients in each plane across z, over the parts added so far.

    Attributes:
        low: Least first difference along each axis, shape (axes, planes).
        high: Greatest first difference.
        second: Greatest absolute second difference.
    """

    def __init__(self, shape: tuple[int, ...]):
        """Start without parts."""
        count = len(shape) - 1, shape[-1]
        self.low, self.high, self.second = np.full(count, np.inf), np.full(count, -np.inf), np.zeros(count)

    def add(self, part: np.ndarray) -> list[np.ndarray]:
        """Add a part; return its first differences along each axis."""
        firsts = [_differences(part, axis) for axis in range(len(self.low))]
        for first, low, high in zip(firsts, self.low, self.high, strict=True):
            np.maximum(high, _over(np.maximum, first), out=high)
            np.minimum(low, _over(np.minimum, first), out=low)
        return firsts

    def add_second(self, firsts: list[np.ndarray]) -> None:
        """Add the second differences of a part, given its first ones."""
        for axis, (first, second) in enumerate(zip(firsts, self.second, strict=True)):
            np.maximum(second, _greatest(_differences(first, axis)), out=second)


def _spread(coefficients: np.ndarray, much: float) -> float:
    """Return the sum over planes of the coefficients' range in each; infinite if a few lines already exceed `much`."""
    few = coefficients[tuple(slice(None, None, max(1, (count - 1) // 2)) for count in coefficients.shape[:-1])]
    high, low = _over(np.maximum, few), _over(np.minimum, few)
    if float(np.sum(high - low)) > much:
        return math.inf
    high, low = np.full(coefficients.shape[-1], -np.inf), np.full(coefficients.shape[-1], np.inf)
    for part in _parts(coefficients, 0):
        np.maximum(high, _over(np.maximum, part), out=high)
        np.minimum(low, _over(np.minimum, part), out=low)
    return float(np.sum(high - low))


def _parts(coefficients: np.ndarray, order: int) -> Iterator[np.ndarray]:
    """Yield parts of coefficients along the first axis that fit a processor's cache, overlapping by `order`.

    In single precision, minus one line along z, since a common value does not matter. Rounding of the differences can
    only increase the bound.
    """
    line = coefficients[(0,) * (coefficients.ndim - 1)]
    rows = max(PART_SIZE // coefficients[0].size, 2 * order)
    for start in range(0, max(len(coefficients) - order, 1), rows):
        part = coefficients[start : start + rows + order]
        yield np.subtract(part, line, out=np.empty(part.shape, dtype=np.float32), casting="same_kind")


def _differences(values: np.ndarray, axis: int, order: int = 1) -> np.ndarray:
    """Return `numpy.diff` of the values, in half of its time for small arrays."""
    ahead = (slice(None),) * axis
    for _ in range(order):
        values = values[(*ahead, slice(1, None))] - values[(*ahead, slice(None, -1))]
    return values


def _greatest(values: np.ndarray) -> np.ndarray:
    """Return the greatest absolute value in each plane across the last axis; zero if there are no values."""
    if not values.size:
        return np.zeros(values.shape[-1])
    return _over(np.maximum, np.abs(values, out=values))


def _over(extreme: np.ufunc, values: np.ndarray) -> np.ndarray:
    """Return the extreme in each plane across the last axis, by halving: NumPy's reduction is slow for short lines."""
    values = values.reshape(-1, values.shape[-1])
    if values.shape[-1] > LONG:
        return np.asarray(extreme.reduce(values, axis=0))
    while len(values) > 1:
        half = (len(values) + 1) // 2  # for an odd number the middle line is compared with itself
        values = extreme(values[:half], values[-half:])
    return np.asarray(values[0])


def _coefficients(field: IndexField, grid: UniformGrid, pupil: Pupil, margin: float) -> np.ndarray | None:
    """Return the coefficients for the pupil's light with a margin around it [m]; None if it leaves the box."""
    reach = pupil.reach + margin
    if field.geometry == "axisymmetric":
        ends = [(0.0, float(np.hypot(*pupil.center[:2])) + reach)]
    else:
        ends = [(float(middle) - reach, float(middle) + reach) for middle in pupil.center[3 - grid.samples.ndim : 2]]
    part = []
    for axis, (low, high) in enumerate(ends):
        first, last = (np.array([low, high]) - grid.origin[axis]) / grid.spacing[axis]
        if first < -1e-9 or last > grid.shape[axis] - 1 + 1e-9:
            return None
        # A point of cell i depends on coefficients i to i + 3.
        part.append(slice(math.floor(first + 1e-9), math.ceil(last - 1e-9) + 3))
    return grid.coefficients[tuple(part)]
