r"""Radial quadrature of a symmetric pupil: axisymmetric field, pupil on its axis, rays along it.

The optical path difference W then depends only on the distance r from the axis, and with u = (r / R)^2 a mean over the
disc becomes one over a line, which the smooth substitution u = p(t) makes periodic:

    1 / (pi R^2) \int f dA = \int_0^1 f(u) du = \int_0^1 f(p(t)) p'(t) dt,    p = t^3 (10 - 15 t + 6 t^2)
    <x> = <y> = <x y> = <x W> = <y W> = 0,    <x^2> = <y^2> = <r^2> / 2

On an annulus u runs from the square of the ratio of its radii to 1. A replicate takes equidistant t at a random offset,
which is free of bias, and weights p'(t), which are scaled to sum to the number of its rays. With n points the error
falls as n^-3 where W is smooth, as n^-2 where it has a kink, and as n^-1 where it jumps or rays are lost at an edge (on
such substitutions: I. H. Sloan, S. Joe, Lattice Methods for Multiple Integration (1994)).
"""

import numpy as np

from ...medium import IndexField
from ...rays import Pupil, RayBundle

# Rays of a replicate: on the shipped fields their sampling error is below that of a million rays over the disc.
RADIAL_RAYS = 512
# Fewer rays than this do not give the sum of the weights to 1e-6: the disc is then as accurate.
LEAST_RAYS = 32
# Rays of a replicate that are tried first for new values of a field: errors on the shipped fields are 6e-8 to 2e-6.
FEWER_RAYS = 128
# The greatest distance of the rays of all replicates: in cells, and as a multiple of the pupil's radius over the number
# of rays.
RESOLVED, WIDEST = 0.75, 1.7
# A standard error of the Strehl ratio above this indicates an edge: then the requested number of rays is taken.
SETTLED = 1e-5
# Distances from the axis, over the pupil's radius, and angles with it [rad] that count as rounding.
ROUNDING = 1e-9


def asymmetry(field: IndexField, pupil: Pupil, look: np.ndarray) -> str | None:
    """What breaks the symmetry about the z axis, in words; None where nothing does."""
    if field.geometry != "axisymmetric":
        return f"the field is {'a volume' if field.geometry == 'volume' else field.geometry}, not axisymmetric"
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
