r"""Quadrature over a pupil with no more rays than its wavefront needs, by randomly shifted and periodised lattices.

A mean over the pupil is one over the unit square (pupils/square_map.py). Along an axis of the square on which the
integrand is not periodic the smooth substitution u = p(t) makes it so,

    \int_0^1 f(u) du = \int_0^1 f(p(t)) p'(t) dt,    p = t^3 (10 - 15 t + 6 t^2)

and a replicate takes the points of a Fibonacci lattice of n points and generator g at a random shift (a, b),

    t_i = (i + a) / n,  s_i = {i g / n + b},   a, b in (0, 1), n and g neighbours among the Fibonacci numbers,

which is free of bias because every shift of the lattice is equally likely. For a smooth wavefront the error falls about
as n^-3 (I. H. Sloan, S. Joe, Lattice Methods for Multiple Integration (1994)), compared with n^-1 to n^-1.5 for Sobol
points. The spread of the replicates gives the error; where it is not small enough, as at an edge that cuts the pupil,
Sobol points are taken, in the requested number.

A structure narrower than the distance of rays could lie between the rays of all replicates. A lattice is therefore
taken only if its rays are so close that each of the field's cells is met.
"""

import numpy as np

from ...medium import IndexField
from ...pupils import SquareMap
from ...pupils.square_map import RING
from ...rays import Pupil

# Points of a replicate's lattices, each with its generator; in steps of 1.6 and 2.6.
LATTICES = {144: 89, 233: 144, 610: 377, 1597: 987, 4181: 2584, 10946: 6765, 28657: 17711}
# Lattices are tried only if at least this many rays are requested.
LEAST_ASKED = 100_000
# The greatest number of rays of a lattice, over the requested number.
WORTH = 0.5
# The distance of rays over the width of a cell: a grid holds nothing narrower.
RESOLVED = 0.75
# Standard errors of the Strehl ratio up to which a lattice is sufficient: where it is chosen, and at any seed.
ENOUGH, ACCEPTED = 3e-6, 6e-6
# The greatest power of the number of points by which an error that is still too great is expected to fall.
FALL = 4.0


def lattice_sizes(field: IndexField, pupil: Pupil, per_replicate: int, replicates: int, bundle: str) -> tuple[int, ...]:
    """Points of the lattices that may be tried for a replicate, in ascending order; none where lattices do not pay.

    Raises:
        ValueError: `bundle` is neither "auto" nor "off".
    """
    if bundle not in ("auto", "off"):
        raise ValueError(f"bundle {bundle!r} is not known: choose one of auto, off")
    asked = per_replicate * replicates
    if bundle == "off" or asked < LEAST_ASKED:
        return ()
    # Rays that leave obliquely are closer than their points, so the area of the pupil itself is taken.
    width, height = (2.0 * extent for extent in pupil.half_extent)
    share = 1.0 if pupil.inner_ratio is None else 0.25 * np.pi * (1.0 - pupil.inner_ratio**2)
    least = share * width * height / (RESOLVED * float(np.min(field.spacing))) ** 2
    return tuple(n for n in LATTICES if least <= n * replicates <= WORTH * asked)


def smoothed_axes(of_square: SquareMap) -> int:
    """Bits of the axes of the unit square that need the substitution: all but the angle of a ring."""
    return 1 if of_square.shape == RING else 3


def may_still_settle(errors: dict[int, float], size: int) -> bool:
    """Whether a lattice of `size` points might be sufficient, by the standard errors of smaller lattices by size."""
    if not errors:
        return True
    last = max(errors)
    return errors[last] * (last / size) ** FALL <= ENOUGH


def lattice_order(size: int, by_radius: bool) -> np.ndarray:
    """An order of a lattice's points in which neighbours are close, whatever the shift, int32, shape (size,)."""
    index = np.arange(size)
    rings = 1 if by_radius else max(1, int(np.sqrt(size) / 4.0))
    ring = index if by_radius else index * rings // size
    return np.lexsort((index * LATTICES[size] % size, ring)).astype(np.int32)


def lattice_points(size: int, smoothed: int, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of the unit square (n, 2) and their weights (n,) of one replicate, as the kernels make them.

    Args:
        size: Points of the lattice.
        smoothed: See `smoothed_axes`.
        seeds: The replicate's two seeds, uint32: the shift a, b in units of 2^-32.
    """
    index = np.arange(size, dtype=np.int64)
    along, across = (seeds.astype(float) + 0.5) * 2.0**-32
    points = (index + along) / size, np.modf(index * LATTICES[size] % size / size + across)[0]
    square, weight = np.empty((size, 2)), np.ones(size)
    for axis, t in enumerate(points):
        if smoothed >> axis & 1:
            weight *= 30.0 * (t * (1.0 - t)) ** 2
            t = t**3 * (10.0 - 15.0 * t + 6.0 * t * t)
        square[:, axis] = t
    return square, weight
