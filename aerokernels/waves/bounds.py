r"""A proof that rays are good, by bounds of the field alone: no ray, no wave, and kept with the field.

Light that comes back to the pupil from a plane wave behind the field is D exp(i k W), with W the straight rays' path.
The wave's Strehl ratio is that of the pupil's mean of it; the rays lack D, which to first order in 1 / k obeys

    ln D = -1/2 \int (z - z_p) lap m dz  -  i k / 2 \int |grad W|^2 dz  +  i / (8 k) \int (z - z_p)^2 lap lap m dz

along lines from the pupil at z_p through the contrast m: brightness, paths that are aslant, and diffraction. The rays'
own paths differ from W by k L |grad W|^2 at most. A mean of numbers of size 1 moves by no more than they do, its square
by twice that:

    |change| <= \int (z - z_p) |lap m| dz  +  2 k L T^2  +  1/(4 k) \int (z - z_p)^2 |lap lap m| dz

with T = \int |grad m| dz,
and air whose phase stays within P of its mean on all lines leaves either Strehl ratio within P^2 of 1. A tilt
that all the light shares turns it as a whole and is left out of T. What is neglected are products of such terms.

A cubic spline and its derivatives lie between the differences of its coefficients, and one coefficient along z stands
for one cell of the integrals. They are looked at plane by plane where light of the pupil goes, some widths
sqrt(lambda L) of its diffraction more.
"""

import math
import weakref
from dataclasses import dataclass

import numpy as np

from ..medium import IndexField
from ..medium.grid import UniformGrid
from ..pupils import Pupil
from ..tracing.lines import box_size
from .shadows import FRINGES, is_clear

# The share of the rest of a bound up to which its last term is not looked at closely; bounds kept for a field.
LITTLE, KEPT = 0.25, 8


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
    """The bound of light along z of a cubic grid, by its coefficients about the pupil's light; None if it sees past."""
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
    part = slice(int(ahead[0]), int(ahead[-1]) + 1)
    held, way = held[..., part], np.maximum(way[part], 0.0)
    across = tuple(range(held.ndim - 1))
    phase = 0.5 * wave_number * spacing * float(np.sum(held.max(axis=across) - held.min(axis=across)))
    round_about = field.geometry == "axisymmetric"
    # Slope over radius is a mean of second derivatives from the axis on.
    ways = 2.0 if round_about else 1.0
    # The coefficients are those of the potential, which is the contrast times the ambient index.
    scale = 1.0 / grid.ambient_index
    firsts = [np.diff(held, axis=axis) for axis in across]
    gradient = np.zeros(len(way))
    for axis, first in enumerate(firsts):
        # The radial slope points every way about the axis: it has no tilt in common.
        steep = _greatest(first) if round_about else 0.5 * (first.max(axis=across) - first.min(axis=across))
        gradient = np.hypot(gradient, scale * steep / grid.spacing[axis])
    aslant = 2.0 * wave_number * length * (spacing * float(gradient.sum())) ** 2
    weak = (scale * phase) ** 2
    if aslant > weak:
        return ChangeBound(weak, math.inf, length)
    second, changes = np.zeros(len(way)), []
    for axis, first in enumerate(firsts):
        step, change = float(grid.spacing[axis]), np.diff(first, axis=axis)
        changes.append((axis, step, change))
        second += ways * scale * _greatest(change) / step**2
    curvature = spacing * float((way * second).sum())
    rest = curvature + aslant
    # Fourth differences are at most four times the second ones, and are not formed where that is little.
    least = min(step for _, step, _ in changes)
    diffraction = float((way**2 * second).sum()) * 4.0 * ways * len(changes) / least**2
    if spacing * diffraction / (4.0 * wave_number) > LITTLE * rest:
        fourth = np.zeros(len(way))
        for axis, step, change in changes:
            fourth += ways * np.sqrt(scale * _greatest(np.diff(change, 2, axis=axis))) / step**2
        diffraction = float((way**2 * fourth**2).sum())
    return ChangeBound(min(rest + spacing * diffraction / (4.0 * wave_number), weak), curvature, length)


def _greatest(values: np.ndarray) -> np.ndarray:
    """The greatest size over all but the last axis; no array of sizes is made, which would take longer."""
    across = tuple(range(values.ndim - 1))
    return np.asarray(np.maximum(values.max(axis=across, initial=0.0), -values.min(axis=across, initial=0.0)))


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
