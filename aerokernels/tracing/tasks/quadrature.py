r"""Quadrature over a pupil: radial where field, pupil and rays are symmetric, else by lattices where it is smooth.

    1 / (pi R^2) \int f dA = \int_0^1 f(u) du = \int_0^1 f(p(t)) p'(t) dt,   u = (r / R)^2,  p = t^3 (10 - 15 t + 6 t^2)

A replicate takes equidistant t, or a rank-1 lattice (I. H. Sloan, S. Joe, Lattice Methods for Multiple Integration
(1994)), at a random shift: see docs/theory/quadrature.md.
"""

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.pupils import SquareMap
from aerokernels.pupils.square_map import RING
from aerokernels.rays import Pupil, RayBundle

# Rays of a replicate: on the shipped fields their sampling error is below that of a million rays over the disc.
RADIAL_RAYS = 512
# Fewer rays than this do not give the sum of the weights to 1e-6: the disc is then as accurate.
LEAST_RAYS = 32
# Rays of a replicate that are tried first for new values of a field: errors on the shipped fields are 6e-8 to 2e-6.
FEWER_RAYS = 128
# The greatest distance of the rays of all replicates, as a multiple of the pupil's radius over the number of rays.
WIDEST = 1.7
# A standard error of the Strehl ratio above this indicates an edge: then the requested number of rays is taken.
SETTLED = 1e-5
# Distances from the axis, over the pupil's radius, and angles with it [rad] that count as rounding.
ROUNDING = 1e-9


def asymmetry(field: IndexField, pupil: Pupil, look: np.ndarray) -> str | None:
    """What breaks the symmetry about the z axis, in words; None where nothing does."""
    if field.geometry != "axisymmetric":
        return f"the field is {'a volume' if field.geometry == 'volume' else field.geometry}, not axisymmetric"
    if field.upstream is not None and field.upstream.absorption is not None and not field.upstream.absorption.symmetric:
        return "the absorption is a function of its own"
    if pupil.inner_ratio is None:
        return f"the pupil is a {type(pupil).__name__}, not round"
    aside = float(np.hypot(*pupil.center[:2]))
    if aside > ROUNDING * pupil.reach:
        return f"the pupil's centre is {aside:.3g} m from the axis of symmetry, x = y = 0"
    for name, vector in (("the pupil's normal", pupil.normal), ("the look direction", look)):
        angle = float(np.arctan2(np.hypot(*vector[:2]), abs(vector[2])))
        if angle > ROUNDING:
            return f"{name} makes an angle of {angle:.3g} rad with the axis of symmetry, z"
    return None


def choose_radial(
    field: IndexField,
    pupil: Pupil,
    look: np.ndarray,
    per_replicate: int,
    replicates: int,
    symmetry,
    most: int = RADIAL_RAYS,
) -> tuple[int, str]:
    """Rays of a replicate in radial quadrature, at most `most`, or 0 for the whole disc, and the reason in words.

    Raises:
        ValueError: `symmetry` is not "auto", "off", True or False; or True where the set-up is not symmetric.
    """
    if symmetry not in ("auto", "off") and not isinstance(symmetry, (bool, np.bool_)):
        raise ValueError(f"symmetry must be 'auto', 'off', True or False, got {symmetry!r}")
    forced = symmetry not in ("auto", "off") and bool(symmetry)
    if symmetry != "auto" and not forced:
        return 0, "rays over the whole disc: symmetry is off"
    obstacle = asymmetry(field, pupil, look)
    if obstacle is None and per_replicate < LEAST_RAYS and not forced:
        obstacle = f"radial quadrature takes at least {replicates * LEAST_RAYS} rays"
    elif obstacle is None:
        count = int(np.clip(per_replicate, LEAST_RAYS, most))
        return count, (
            f"axisymmetric field, pupil and rays on the axis: radial quadrature by {replicates} x {count} rays instead "
            f"of {per_replicate * replicates:,} over the disc"
        )
    elif forced:
        raise ValueError(
            f"symmetry=True, but {obstacle}: move what is off the axis, or leave symmetry at 'auto' to trace the disc"
        )
    return 0, f"rays over the whole disc: {obstacle}"


def radial_points(count: int, replicates: int, seed: int | None) -> tuple[np.ndarray, np.ndarray]:
    """Squared distances from the axis over the pupil's radius, ascending, and weights; both (replicates, count)."""
    offset = np.random.default_rng(seed).random((replicates, 1))
    t = (np.arange(count) + offset) / count
    weight = (t * (1.0 - t)) ** 2
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2), weight * count / weight.sum(axis=1, keepdims=True)


def fewer_rays(field: IndexField, pupil: Pupil, replicates: int) -> int:
    """FEWER_RAYS, or RADIAL_RAYS where so few rays would be too far apart for the field's cells."""
    widest = WIDEST * pupil.reach / (replicates * FEWER_RAYS)
    return FEWER_RAYS if widest <= RESOLVED * float(np.min(field.spacing)) else RADIAL_RAYS


def radial_bundle(pupil: Pupil, look: np.ndarray, count: int) -> RayBundle:
    """Parallel rays along the pupil's first axis, each in the middle of an equal share of the pupil's area."""
    hole = (pupil.inner_ratio or 0.0) ** 2
    place = np.sqrt(hole + (1.0 - hole) * (np.arange(count) + 0.5) / count)
    return RayBundle(pupil.center + pupil.reach * place[:, None] * pupil.axes[0], look[None])


# Points of a replicate's lattices, each with its generator; in steps of 1.6 and 2.6.
LATTICES = {144: 89, 233: 144, 610: 377, 1597: 987, 4181: 2584, 10946: 6765, 28657: 17711}
# The distance of rays over the width of a cell: a grid holds nothing narrower.
RESOLVED = 0.75
# Standard errors of the Strehl ratio up to which a lattice is sufficient: where it is chosen, and at any seed.
ENOUGH, ACCEPTED = 3e-6, 6e-6


def lattice_sizes(field: IndexField, pupil: Pupil, per_replicate: int, replicates: int, bundle: str) -> tuple[int, ...]:
    """Points of the lattices that may be tried for a replicate, in ascending order; none where lattices do not pay."""
    if bundle not in ("auto", "off"):
        raise ValueError(f"bundle {bundle!r} is not known: choose one of auto, off")
    asked = per_replicate * replicates
    # Lattices are tried only if at least this many rays are requested.
    if bundle == "off" or asked < 100_000:
        return ()
    # Rays that leave obliquely are closer than their points, so the area of the pupil itself is taken.
    width, height = (2.0 * extent for extent in pupil.half_extent)
    share = 1.0 if pupil.inner_ratio is None else 0.25 * np.pi * (1.0 - pupil.inner_ratio**2)
    least = share * width * height / (RESOLVED * float(np.min(field.spacing))) ** 2
    # The greatest number of rays of a lattice, over the requested number.
    return tuple(n for n in LATTICES if least <= n * replicates <= 0.5 * asked)


def smoothed_axes(of_square: SquareMap) -> int:
    """Bits of the axes of the unit square that need the substitution: all but the angle of a ring."""
    return 1 if of_square.shape == RING else 3


def may_still_settle(errors: dict[int, float], size: int) -> bool:
    """Whether a lattice of `size` points might be sufficient, by the standard errors of smaller lattices by size."""
    if not errors:
        return True
    last = max(errors)
    # The greatest power of the number of points by which an error that is still too great is expected to fall.
    return errors[last] * (last / size) ** 4.0 <= ENOUGH


def lattice_order(size: int, by_radius: bool) -> np.ndarray:
    """An order of a lattice's points in which neighbours are close, whatever the shift, int32, shape (size,)."""
    index = np.arange(size)
    rings = 1 if by_radius else max(1, int(np.sqrt(size) / 4.0))
    ring = index if by_radius else index * rings // size
    return np.lexsort((index * LATTICES[size] % size, ring)).astype(np.int32)


def lattice_points(size: int, smoothed: int, seeds: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of the unit square (n, 2) and weights (n,) of a replicate, as the kernels make them.

    `seeds` are its two, uint32, the shift in units of 2^-32; `smoothed` is that of `smoothed_axes`.
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
