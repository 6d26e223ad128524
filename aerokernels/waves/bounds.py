r"""A proof that rays are good, by bounds of the field alone: no ray, no wave, and kept with the field.

Light that comes back to the pupil from a plane wave behind the field is D exp(i k W), with W the straight rays' path.
The wave's Strehl ratio is that of the pupil's mean of it; the rays lack D, which to first order in 1 / k obeys

    ln D = -1/2 \int (z - z_p) lap m dz  -  i k / 2 \int |grad W|^2 dz  +  i / (8 k) \int (z - z_p)^2 lap lap m dz

along lines from the pupil at z_p through the contrast m: brightness, paths that are aslant, and diffraction. The rays'
own paths differ from W by k L |grad W|^2 at most. A mean of numbers of size 1 moves by no more than they do, its square
by twice that:

    |change| <= \int (z - z_p) |lap m| dz  +  2 k L T^2  +  1/(4 k) \int (z - z_p)^2 |lap lap m| dz

with T = \int |grad m| dz, and air whose phase stays within P of its mean on all lines leaves either Strehl ratio within
P^2 of 1. A tilt that all the light shares turns it as a whole and is left out of T. What is neglected are products of
such terms.

A cubic spline and its derivatives lie between the differences of its coefficients, and one coefficient along z stands
for one cell of the integrals. They are looked at plane by plane where light of the pupil goes, some widths
sqrt(lambda L) of its diffraction more.
"""

import math
import weakref
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..pupils import Pupil
from ..tracing.lines import box_size
from .shadows import FRINGES, is_clear

# The greatest bound that is a proof of anything: what it neglects is of the order of its square.
GREATEST_BOUND = 0.1
# The share of the rest of a bound up to which its last term is not looked at closely, and the bound up to which nobody
# asks for a smaller one.
LITTLE, ENOUGH = 0.25, 5e-3
# Coefficients that are looked at together, along z so many that NumPy is quick for them; bounds kept for a field.
PART_SIZE, LONG, KEPT = 1 << 16, 128, 8


@dataclass(frozen=True)
class ChangeBound:
    """What the air can change at most.

    Attributes:
        change: Strehl ratio by waves less that by rays, its greatest size; infinite where nothing is known.
        curvature: The greatest curvature of the rays' wavefront times the distance from the pupil.
        distance: From the pupil to where the light has left the field [m].
    """

    change: float
    curvature: float
    distance: float


def change_bound(field: IndexField, pupil: Pupil, look: np.ndarray, wavelength: float) -> ChangeBound:
    """The bound for light that leaves a pupil along the unit vector `look`."""
    key = ("bound of the wave's change", weakref.ref(pupil), look.tobytes(), wavelength)
    found: ChangeBound = field.derive(key, lambda: _change_bound(field, pupil, look, wavelength), KEPT)
    return found


def _change_bound(field: IndexField, pupil: Pupil, look: np.ndarray, wavelength: float) -> ChangeBound:
    wave_number, samples = 2.0 * math.pi / wavelength, field.samples
    if not is_clear(field, pupil, look, wavelength):
        return ChangeBound(math.inf, math.inf, math.inf)
    low, high = samples.extremes if isinstance(samples, UniformGrid) else (samples.values.min(), samples.values.max())
    # Beside the box there is no contrast.
    weak = (0.5 * wave_number * float(max(high, 0.0) - min(low, 0.0)) * box_size(field)) ** 2
    found = ChangeBound(weak, math.inf, math.inf)
    along_z = abs(abs(float(look[2])) - 1.0) < 1e-15
    if isinstance(samples, UniformGrid) and samples.interpolation == "cubic" and along_z:
        finer = _along_z(field, samples, pupil, float(look[2]), wave_number)
        found = finer if finer is not None and finer.change < weak else found
    return found


def _along_z(field: IndexField, grid: UniformGrid, pupil: Pupil, sign: float, wave_number: float) -> ChangeBound | None:
    """The bound of light along z of a cubic grid, by its coefficients about the pupil's light; None: too great."""
    spacing, place = float(grid.spacing[-1]), grid.origin[-1] + grid.spacing[-1] * np.arange(-1, grid.shape[-1] + 1)
    # A pupil's plane may be aslant to the light: then some of it is farther off.
    slant = pupil.reach * math.sqrt(max(1.0 - float(pupil.normal[2]) ** 2, 0.0))
    way = sign * (place - float(pupil.center[2])) + slant
    length = float(way.max()) + pupil.reach
    ahead = np.flatnonzero(way > -2.0 * spacing)
    margin = FRINGES * math.sqrt(2.0 * math.pi / wave_number * length)
    held = _held(field, grid, pupil, margin) if len(ahead) else None
    if held is None:
        return None
    in_front = slice(int(ahead[0]), int(ahead[-1]) + 1)
    held, way = held[..., in_front], np.maximum(way[in_front], 0.0)
    round_about = field.geometry == "axisymmetric"
    # Slope over radius is a mean of second derivatives from the axis on.
    ways = 2.0 if round_about else 1.0
    # The coefficients are those of the potential, which is the contrast times the ambient index.
    scale, steps = spacing / grid.ambient_index, grid.spacing[:-1]
    share = scale / (4.0 * wave_number)
    planes, rest, curvature, second = _Planes(held.shape), 0.0, math.inf, np.zeros(len(way))
    for part in _parts(held, 2):
        firsts = planes.take(part)
        # The radial slope points every way about the axis: it has no tilt in common.
        low, high = planes.low, planes.high
        steep = np.maximum(high, -low) if round_about else 0.5 * (high - low)
        turn = scale * float(np.sqrt(np.sum((steep / steps[:, None]) ** 2, axis=0)).sum())
        rest = 2.0 * wave_number * length * turn**2
        if rest <= GREATEST_BOUND:
            planes.take_bends(firsts)
            second = ways * np.sum(planes.second / steps[:, None] ** 2, axis=0)
            curvature = scale * float((way * second).sum())
            rest += curvature
        if rest > GREATEST_BOUND:  # what is not looked at yet adds to it
            curvature = math.inf
            break
    # Fourth differences are at most four times the second ones, and are not formed where that is little.
    diffraction = share * float((way**2 * second).sum()) * 4.0 * ways * len(steps) / float(steps.min()) ** 2
    if diffraction > LITTLE * rest and ENOUGH < rest + diffraction and rest <= GREATEST_BOUND:
        fourth = np.zeros((len(steps), len(way)))
        for part in _parts(held, 4):
            for axis, found in enumerate(fourth):
                np.maximum(found, _greatest(_differences(part, axis, 4)), out=found)
        roots = ways * np.sum(np.sqrt(fourth) / steps[:, None] ** 2, axis=0)
        diffraction = share * float((way * roots) @ (way * roots))
    change = rest + diffraction if math.isfinite(curvature) else math.inf
    if change > ENOUGH:
        to_phase = 0.5 * scale * wave_number
        change = min(change, (to_phase * _spread(held, math.sqrt(GREATEST_BOUND) / to_phase)) ** 2)
    return ChangeBound(change, curvature, length)


class _Planes:
    """Extremes of differences of coefficients in each plane across z, of the parts taken so far.

    Attributes:
        low: Least first difference along each axis, shape (axes, planes).
        high: The greatest.
        second: The greatest size of a second difference.
    """

    def __init__(self, shape: tuple[int, ...]):
        """None are taken yet."""
        count = len(shape) - 1, shape[-1]
        self.low, self.high, self.second = np.full(count, np.inf), np.full(count, -np.inf), np.zeros(count)

    def take(self, part: np.ndarray) -> list[np.ndarray]:
        """Add a part; its first differences along each axis."""
        firsts = [_differences(part, axis) for axis in range(len(self.low))]
        for first, low, high in zip(firsts, self.low, self.high, strict=True):
            np.maximum(high, _over(np.maximum, first), out=high)
            np.minimum(low, _over(np.minimum, first), out=low)
        return firsts

    def take_bends(self, firsts: list[np.ndarray]) -> None:
        """Add the second differences of a part, by its first ones."""
        for axis, (first, second) in enumerate(zip(firsts, self.second, strict=True)):
            np.maximum(second, _greatest(_differences(first, axis)), out=second)


def _spread(held: np.ndarray, much: float) -> float:
    """The sum over all planes of how coefficients differ in each; infinite where that is much on a few lines."""
    few = held[tuple(slice(None, None, max(1, (count - 1) // 2)) for count in held.shape[:-1])]
    high, low = _over(np.maximum, few), _over(np.minimum, few)
    if float(np.sum(high - low)) > much:
        return math.inf
    high, low = np.full(held.shape[-1], -np.inf), np.full(held.shape[-1], np.inf)
    for part in _parts(held, 0):
        np.maximum(high, _over(np.maximum, part), out=high)
        np.minimum(low, _over(np.minimum, part), out=low)
    return float(np.sum(high - low))


def _parts(held: np.ndarray, order: int) -> Iterator[np.ndarray]:
    """Parts of coefficients along the first axis that a processor's cache holds, and so many more for differences.

    In single precision, less those of one line along z: what all share makes no difference. What rounding adds to the
    differences makes the bound greater.
    """
    line = held[(0,) * (held.ndim - 1)]
    rows = max(PART_SIZE // held[0].size, 2 * order)
    for start in range(0, max(len(held) - order, 1), rows):
        part = held[start : start + rows + order]
        yield np.subtract(part, line, out=np.empty(part.shape, dtype=np.float32), casting="same_kind")


def _differences(values: np.ndarray, axis: int, order: int = 1) -> np.ndarray:
    """What `numpy.diff` gives, in half of its time for small arrays."""
    ahead = (slice(None),) * axis
    for _ in range(order):
        values = values[(*ahead, slice(1, None))] - values[(*ahead, slice(None, -1))]
    return values


def _greatest(values: np.ndarray) -> np.ndarray:
    """The greatest size in each plane across the last axis; zero where there are none."""
    if not values.size:
        return np.zeros(values.shape[-1])
    return _over(np.maximum, np.abs(values, out=values))


def _over(extreme: np.ufunc, values: np.ndarray) -> np.ndarray:
    """The extreme in each plane across the last axis, by halves: lines are short, and NumPy would go one by one."""
    values = values.reshape(-1, values.shape[-1])
    if values.shape[-1] > LONG:
        return np.asarray(extreme.reduce(values, axis=0))
    while len(values) > 1:
        half = (len(values) + 1) // 2  # of an odd number the middle line is compared with itself
        values = extreme(values[:half], values[-half:])
    return np.asarray(values[0])


def _held(field: IndexField, grid: UniformGrid, pupil: Pupil, margin: float) -> np.ndarray | None:
    """Coefficients that the pupil's light depends on, with so much around it [m]; None where it leaves the box."""
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
