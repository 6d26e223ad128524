r"""Verdict on ray optics: does light through a field behave as its rays predict?

Three numbers of the wavefront W over the distance D in which its light leaves the disturbed air tell why it may not:

    Fresnel number     l^2 / (lambda D), l the half period of the finest relevant phase; below about 1 that phase turns
                       into brightness before the light has left the air
    ray crossing       share of the pupil where det(1 + D grad grad W) < 0: behind a focus neighbours change places
    curvature          the greatest D |W''|: near 1 there is a focus

and one tells how much it matters: the Strehl ratio of a wave through the same air minus the one of its rays through the
same slabs, on a window that is coarse enough to be cheap and fine enough for that finest phase (diffraction.py). Errors
of the slabs affect both, so the difference represents diffraction alone. The rays bend, to second order in their
displacement: a wave contains the effect of bending on their paths, as traced rays do, and it is not diffraction. Near
foci no finite order gives the paths of rays: there the wave is compared with the traced rays of the wavefront, and with
straight rays if none are available (`Validity.error` is infinite then).

Beside a traced wavefront the verdict should be cheap: a twentieth of the cost of the wavefront on the same new field,
which is its plan, the transfer of the field to the engine, the rays and their map. So these are evaluated in order:

    the rays     of a map that resolves the finest phase: half of the phase on either side of free space over the length
                 in which the light is disturbed (screens.py). If that changes the Strehl ratio by far less than the
                 limit, no rays cross and none is near a focus, the traced wavefront decides by itself.
    the bounds   of the field's derivatives (bounds.py), for a map too coarse to resolve the finest phase: they prove
                 that rays are good, or decide nothing.
    a wave       if it is cheap compared with the wavefront (`affordable`), or if the caller requests it. A wave of one
                 column is evaluated before the rays if the map is so fine that the wave costs next to nothing.

If none of them decides, the verdict is "not decided", and `reason` says so: a fan of 16 rays costs as much processor
time as a few hundred calls of NumPy, and no wave can be propagated through a field in a twentieth of that. Without a
wavefront only a wave is evaluated.
"""

from dataclasses import replace

import numpy as np

from ..derived import cached_on
from ..inputs.arguments import checked
from ..inputs.checks import check_positive
from ..medium import IndexField
from ..pupils import Pupil
from ..tracing.lines import box_size
from ..wavefront import Wavefront
from .bounds import GREATEST_BOUND, change_bound
from .coarse_wave import RESOLVED, by_waves, finest_and_squares, fresnel_number, is_one_column
from .screens import MapPaths, disturbance, paths_of, screens_answer, stride_of
from .shadows import is_clear
from .slabs import is_summed
from .verdict import FEWEST_MAPPED, GOOD, Validity

# The rays decide if their change of the Strehl ratio is below this share of the limit.
CLEAR = 0.3
# Rays decide only if the pupil's Fresnel number, over the distance to undisturbed air, times limit and Strehl ratio is
# at least this: rays ignore the air beside the pupil, and with strong phases the result depends on little light. Where
# the rays were wrong by 0.01 or more it was 0.13 at most. The Strehl ratio counts as LEAST_STREHL at least.
BESIDE_PUPIL, LEAST_STREHL = 0.16, 0.25
# Rays decide only at this Fresnel number or above: at 1.8 two screens gave -0.0009 where a wave gave +0.039.
FEWEST_FRESNEL = 4.0
# Cells times rays of a wavefront from which on a wave through sampled layers is cheap: it takes 0.05 to 0.2 s, and a
# ray through a mesh 4 us a cell.
LAYERS_WORTH = 8e5
# Pixels across a map whose rays take twenty times as long as a wave of one column, 1.5 to 2.5 ms.
COLUMN_WORTH = 128
# Terms that may be removed from a wavefront whose rays decide: others change where rays cross and focus.
FLAT_TERMS = {"piston", "tilt", "Z1", "Z2", "Z3"}
# Pixels across the grid on which pupils are compared; verdicts cached on a field.
SAME_PIXELS, KEPT = 32, 8


@checked
def validity(
    field: IndexField,
    pupil: Pupil,
    *,
    wavelength: float | None = None,
    wavefront: Wavefront | None = None,
    limit: float = GOOD,
    waves: bool | None = None,
) -> Validity:
    """Judge whether rays through a field give the Strehl ratio of a pupil, and what they neglect.

    With a `wavefront` traced on a CPU it costs a few hundredths of the CPU time of that wavefront on a new field
    (preparation, rays and map; docs/validity-measured.md has figures, also for GPUs), and is "not decided" if nothing
    so cheap decides.

    Args:
        field: The refractive index.
        pupil: The pupil; light leaves it along its normal, or in the direction of the `wavefront`.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm if it has none.
        wavefront: The traced wavefront of this pupil: its finest phase is used, and it may decide by itself at a small
            part of its own cost. None takes the phase of straight rays and evaluates a wave.
        limit: Greatest change of the Strehl ratio for which rays are good.
        waves: Whether to evaluate a wave if nothing cheaper decides: True always, False never; None if it is cheap
            compared with the wavefront (then with at most 16 slabs, see `Validity.error`), or if there is no wavefront.

    Raises:
        TypeError: `field` or `pupil` is of the wrong type.
        ValueError: The pupil does not see the field, or is not the wavefront's; or a number is out of range.
    """
    if not isinstance(field, IndexField):
        raise TypeError(f"field must be an IndexField, got {type(field).__name__}")
    if not isinstance(pupil, Pupil):
        raise TypeError(f"pupil must be a Disc, Annulus, Rectangle, Polygon or Mask, got {type(pupil).__name__}")
    check_positive(limit, "limit")
    wavelength = field.wavelength_for(wavelength)
    if wavefront is not None and wavefront.pupil is not None and not _same_light(wavefront.pupil, pupil):
        raise ValueError(f"wavefront was traced for another pupil, {wavefront.pupil!r}: give that one")
    return _judged(field, pupil, wavelength, wavefront, limit, waves)


@cached_on("field", KEPT)
def _judged(
    field: IndexField, pupil: Pupil, wavelength: float, wavefront: Wavefront | None, limit: float, waves: bool | None
) -> Validity:
    feature, look, paths, resolved = None, pupil.normal, None, True
    if wavefront is not None:
        if wavefront.direction is not None:
            look = np.asarray(wavefront.direction)
        if len(wavefront.opd) >= FEWEST_MAPPED:
            paths = paths_of(wavefront)
            feature = finest_and_squares(paths.path, paths.pixel, wavelength)[0]
            # A phase as fine as the map's pixels may be finer in the field: then the wave measures it again.
            resolved = feature >= RESOLVED * paths.pixel
    # A wave that the caller did not request may be limited.
    seen, limited = None, wavefront is not None and waves is None
    if wavefront is not None:
        if paths is not None and feature is not None and resolved:
            # A wave is more reliable than two screens, and is evaluated at once where it costs next to nothing.
            cheap = is_one_column(field, look) and len(wavefront.opd) >= COLUMN_WORTH
            if waves is False or not cheap or not affordable(field, look, wavefront):
                answer = by_rays(field, pupil, look, wavefront, paths, wavelength, feature, limit)
                if answer is not None:
                    return answer
        if waves is None:
            waves = affordable(field, look, wavefront)
        if not waves or paths is None:
            answer = by_bounds(field, pupil, look, wavefront, wavelength, limit)
            if answer.decided or not waves:
                return answer
        if paths is not None and _is_whole(wavefront, wavelength):
            seen = paths
    through = pupil if np.array_equal(look, pupil.normal) else replace(pupil, normal=look)  # type: ignore[type-var]
    return by_waves(field, through, wavelength, feature, limit, seen, resolved, limited)


def _is_whole(wavefront: Wavefront, wavelength: float) -> bool:
    """Return whether a wavefront's Strehl ratio is that of all the pupil's light, with no term but piston removed."""
    removed = set(wavefront.removed) <= {"piston"}
    return removed and wavefront.wavelength == wavelength and wavefront.blocked <= 1e-3


def affordable(field: IndexField, look: np.ndarray, wavefront: Wavefront) -> bool:
    """Return whether a wave through a field is cheap compared with a traced wavefront, by operation counts.

    The result does not depend on the machine. Through slabs that are sums over coefficients a wave takes 2 to 8 ms, too
    long for a map of fewer than FEWEST_MAPPED pixels across; sampled layers take as long as many rays.
    """
    if len(wavefront.opd) < FEWEST_MAPPED:
        return False
    if field.body is None and is_summed(field, look):
        return True
    cells = box_size(field) / float(np.min(field.spacing))
    return int(np.count_nonzero(wavefront.weight)) * cells >= LAYERS_WORTH


def by_bounds(
    field: IndexField, pupil: Pupil, look: np.ndarray, wavefront: Wavefront, wavelength: float, limit: float
) -> Validity:
    """Return the verdict of the field's own bounds, for a wavefront of any map: rays are good, or it is not decided."""
    whole = wavefront.wavelength == wavelength and wavefront.blocked <= 1e-3
    found = change_bound(field, pupil, look, wavelength)
    bound = found.change if whole else float("inf")
    if not bound <= min(limit, GREATEST_BOUND):  # also where it is NaN
        return Validity(limit=limit, answered_by="nobody", bound=bound)
    return Validity(
        strehl_change=0.0,
        distance=found.distance,
        crossed_share=0.0,
        curvature=found.curvature,
        limit=limit,
        answered_by="bounds",
        bound=bound,
    )


def _same_light(one: Pupil, other: Pupil) -> bool:
    """Return whether two pupils transmit the same light: their position, and their weights on a coarse grid."""
    if one is other:
        return True
    if not all(
        np.allclose(getattr(one, name), getattr(other, name), rtol=1e-9, atol=1e-12)
        for name in ("half_extent", "center", "normal")
    ):
        return False
    edges = max(one.half_extent) * np.linspace(-1.0, 1.0, SAME_PIXELS + 1)
    return bool(np.allclose(one.coverage(edges, edges), other.coverage(edges, edges), rtol=1e-6, atol=1e-9))


def by_rays(
    field: IndexField,
    pupil: Pupil,
    look: np.ndarray,
    wavefront: Wavefront,
    paths: MapPaths,
    wavelength: float,
    feature: float,
    limit: float,
) -> Validity | None:
    """Return the verdict of a traced wavefront that resolves its finest phase; None if it does not decide."""
    if wavefront.wavelength != wavelength or wavefront.blocked > 1e-3 or not set(wavefront.removed) <= FLAT_TERMS:
        return None
    # The screens' pixels may be coarser than the map's: they must resolve the finest phase too.
    if feature < RESOLVED * wavefront.pixel * stride_of(len(wavefront.opd), wavefront.pixel, feature):
        return None
    if not is_clear(field, pupil, look, wavelength):
        return None
    # Two screens at the pupil represent the air between only if the light has not spread before, and if features keep
    # their shape along the path.
    air = disturbance(field, pupil, look)
    of_pupil = fresnel_number(min(pupil.half_extent), wavelength, air.until)
    if of_pupil * limit * LEAST_STREHL < BESIDE_PUPIL and of_pupil * limit * paths.strehl < BESIDE_PUPIL:
        return None
    if fresnel_number(feature, wavelength, air.length) < FEWEST_FRESNEL:
        return None
    found = screens_answer(field, pupil, look, paths, feature)
    if found is None or not abs(found.change) <= CLEAR * limit:
        return None
    crossings = found.crossings
    return Validity(
        strehl_change=found.change,
        feature=feature,
        distance=found.length,
        fresnel_number=fresnel_number(feature, wavelength, found.length),
        crossed_share=crossings.crossed,
        curvature=crossings.curvature,
        limit=limit,
        answered_by="rays",
    )
