r"""A symmetric pupil as a fan of rays: axisymmetric field, pupil on its axis, rays along it.

The optical path difference W then depends on the distance r from the axis alone, and with u = (r / R)^2 a mean over the
disc is one over a line, of which the smooth substitution u = p(t) makes one over a period:

    1 / (pi R^2) \int f dA = \int_0^1 f(u) du = \int_0^1 f(p(t)) p'(t) dt,    p = t^3 (10 - 15 t + 6 t^2)
    <x> = <y> = <x y> = <x W> = <y W> = 0,    <x^2> = <y^2> = <r^2> / 2

A replicate takes equidistant t at a random offset, which is free of bias, and weights p'(t), which are scaled to sum to
the number of its rays. With n points the error falls as n^-3 where W is smooth, as n^-2 where it has a kink, and as
n^-1 where it jumps or rays are lost at an edge (on such substitutions: I. H. Sloan, S. Joe, Lattice Methods for
Multiple Integration (1994)).
"""

import numpy as np

from ..medium import IndexField
from ..rays import Disc, RayBundle
from .pupil_sums import MOMENT_COUNT, PUPIL_OUTPUTS
from .status import RayStatus
from .trace import run_plan

# Rays of a replicate: on the shipped fields their sampling error is below that of a million rays over the disc.
FAN_RAYS = 512
# Fewer rays than this do not know the sum of the weights to 1e-6: the disc is then as good.
LEAST_RAYS = 32
# A standard error of the Strehl ratio above this tells of an edge: then the fan takes as many rays as were asked for.
SETTLED = 1e-5
# How far from the axis, over the pupil's radius, and how far off its direction [rad] counts as rounding.
ROUNDING = 1e-9


def asymmetry(field: IndexField, pupil: Disc, look: np.ndarray) -> str | None:
    """What breaks the symmetry about the z axis, in words; None where nothing does."""
    if field.geometry != "axisymmetric":
        return f"the field is {'a volume' if field.geometry == 'volume' else field.geometry}, not axisymmetric"
    aside = float(np.hypot(*pupil.center[:2]))
    if aside > ROUNDING * pupil.radius:
        return f"the pupil's centre lies {aside:.3g} m from the axis of symmetry, x = y = 0"
    for name, vector in (("the pupil's normal", pupil.normal), ("the look direction", look)):
        angle = float(np.arctan2(np.hypot(*vector[:2]), abs(vector[2])))
        if angle > ROUNDING:
            return f"{name} makes an angle of {angle:.3g} rad with the axis of symmetry, z"
    return None


def choose_fan(
    field: IndexField, pupil: Disc, look: np.ndarray, per_replicate: int, replicates: int, symmetry
) -> tuple[int, str]:
    """Rays of a replicate's fan, 0 for a disc, and why.

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
        obstacle = f"a fan takes at least {replicates * LEAST_RAYS} rays"
    elif obstacle is None:
        count = int(np.clip(per_replicate, LEAST_RAYS, FAN_RAYS))
        return count, (
            f"axisymmetric field, pupil and rays on the axis: a fan of {replicates} x {count} rays instead of "
            f"{per_replicate * replicates:,} over the disc"
        )
    elif forced:
        raise ValueError(
            f"symmetry=True, but {obstacle}: move what is off the axis, or leave symmetry at 'auto' to trace the disc"
        )
    return 0, f"rays over the whole disc: {obstacle}"


def fan_points(count: int, replicates: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Squared distances from the axis over the pupil's radius, ascending, and weights; both (replicates, count)."""
    offset = np.random.default_rng(seed).random((replicates, 1))
    t = (np.arange(count) + offset) / count
    weight = (t * (1.0 - t)) ** 2
    return t**3 * (10.0 - 15.0 * t + 6.0 * t**2), weight * count / weight.sum(axis=1, keepdims=True)


def reduce_fan(
    field, pupil, look, until, plan, wavelength, per_replicate, replicates, seed, with_tilt, by_radius=False
):
    """Trace a fan and sum: moments (replicates, MOMENT_COUNT), phasors (replicates,), evaluations, seconds.

    A symmetric wavefront has no tilt, so `with_tilt` changes nothing, nor does `by_radius`. The rays leave the pupil
    along its first axis.
    """
    squared, weight = fan_points(per_replicate, replicates, seed)
    # Replicates take turns, so that neighbours in the launch are neighbours in the field.
    distance = pupil.radius * np.sqrt(squared.T.reshape(-1, 1))
    rays = RayBundle(pupil.center + distance * pupil.axes[0], look)
    arrays, seconds = run_plan(field, rays, plan, until, wavelength, PUPIL_OUTPUTS)
    status, path, error, looked = (
        arrays[name].reshape(per_replicate, replicates).T
        for name in ("status", "opd", "step_error", "evaluation_count")
    )
    good = status == RayStatus.OK
    weight, opd = np.where(good, weight, 0.0), np.where(good, path, 0.0)
    moments = np.zeros((replicates, MOMENT_COUNT))
    moments[:, 0] = weight.sum(axis=1)
    moments[:, 3] = (weight * opd).sum(axis=1)
    moments[:, [4, 6]] = 0.5 * pupil.radius**2 * (weight * squared).sum(axis=1, keepdims=True)
    moments[:, 9] = (weight * opd**2).sum(axis=1)
    moments[:, 10] = np.where(good, error, 0.0).max(axis=1)
    moments[:, 11] = looked.sum(axis=1)
    # From the mean on, as on the disc: what is left of the phases is small, and so is its rounding.
    piston = moments[:, 3].sum() / (moments[:, 0].sum() or 1.0)
    phasors = (weight * np.exp(2j * np.pi / wavelength * (opd - piston))).sum(axis=1)
    return moments, phasors, int(moments[:, 11].sum()), dict(seconds)
