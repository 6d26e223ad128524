r"""A verdict on ray optics: does light through this field do what its rays say?

Three numbers of the wavefront W over the distance D that its light takes to leave the disturbed air tell why not:

    Fresnel number     l^2 / (lambda D), l the half period of the finest phase that matters; below about 1 that phase
                       turns into brightness before it is out
    ray crossing       share of the pupil where det(1 + D grad grad W) < 0: behind a focus neighbours change places
    curvature          the greatest D |W''|: near 1 there is a focus

and one says how much: the Strehl ratio of a wave through the same air, less that of its rays through the same slabs,
on a window coarse enough to cost little and fine enough for that finest phase (diffraction.py). What the slabs lack is
lacking in both, so the difference stands for diffraction alone. The rays bend, to second order in how far they go
aside: a wave holds what that does to their paths, as traced rays do, and it is no diffraction. Near foci no order tells
where they go: there the wave is compared with the traced rays of the wavefront, and with straight ones where none are
at hand (`Validity.error` is infinite then).

Beside a traced wavefront the verdict should cost little, a twentieth of what the wavefront itself did on the same new
field: its plan, the field's way to the engine, the rays and their map. So it is asked in this order:

    the rays     of a map that holds the finest phase: half of it on either side of free space of the length over which
                 the light is disturbed (screens.py). Where that changes the Strehl ratio by far less than is allowed,
                 no rays cross and nothing is near a focus, the rays have answered for themselves.
    the bounds   of the field's derivatives (bounds.py), beside a map too coarse to hold the finest phase: they prove
                 that rays are good, or say nothing.
    a wave       where it costs little beside the wavefront (`affordable`), or where the caller asks for it; of one
                 column before the rays, beside a map so fine that it costs next to nothing.

What none of them answers is not decided, and `reason` says so: a fan of 16 rays costs as much processor time as a few
hundred calls of NumPy, and no wave goes through a field in a twentieth of that. Nobody but a wave is asked where there
is no wavefront.
"""

import weakref
from dataclasses import replace
from typing import Any

import numpy as np

from ..inputs.arguments import checked
from ..medium import IndexField
from ..pupils import Pupil
from ..tracing.lines import box_size
from ..wavefront import Wavefront
from .bounds import GREATEST_BOUND, change_bound
from .coarse_wave import RESOLVED, TracedMap, by_waves, finest_and_squares, fresnel_number, is_one_column
from .screens import MapPaths, disturbance, paths_of, screens_answer, stride_of
from .shadows import is_clear
from .slabs import is_summed
from .verdict import FEWEST_MAPPED, GOOD, Validity

# The share of the limit that the rays' own answer must stay below.
CLEAR = 0.3
# The least Fresnel number of the pupil, over the way to where the air is at rest again, times limit and Strehl ratio:
# rays know nothing of the air beside the pupil's, and with strong phases much hangs on little light. Where the rays'
# answer was off by 0.01 or more it was 0.13 at most. No less light than LEAST_STREHL counts.
BESIDE_PUPIL, LEAST_STREHL = 0.16, 0.25
# The least Fresnel number with which they answer: at 1.8 two screens have said -0.0009 of a wave's +0.039.
FEWEST_FRESNEL = 4.0
# Cells times rays beside which a wave through sampled layers is cheap: it takes 0.05 to 0.2 s, and a ray through a mesh
# 4 us a cell.
LAYERS_WORTH = 8e5
# Pixels across a map of whose rays a wave of one column, 1.5 to 2.5 ms, is a twentieth.
COLUMN_WORTH = 128
# Pixels by which pupils are compared; verdicts kept with a field.
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
    """Whether rays through a field give the Strehl ratio of a pupil, and what they leave out.

    Beside a `wavefront` traced on a processor it costs a few hundredths of the processor time which that took on a new
    field (preparation, rays and map; docs/conventions.md has how much, and what it costs beside a GPU's), and says "not
    decided" where nothing so cheap decides.

    Args:
        field: The refractive index.
        pupil: The pupil; light leaves it along its normal, or in the direction of the `wavefront`.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm where it has none.
        wavefront: Its traced wavefront, whose finest phase is then looked at, and which may answer by itself at a small
            part of its own cost; None looks at straight rays and asks a wave.
        limit: The change of the Strehl ratio up to which rays are good.
        waves: Whether a wave may be asked where nothing cheaper answers: True whatever it costs, False never; None
            where it is cheap beside the wavefront, and where there is no wavefront.

    Raises:
        TypeError: `field` or `pupil` of the wrong kind.
        ValueError: A pupil that does not see the field, or is not that of the wavefront; a number that makes no sense.
    """
    if not isinstance(field, IndexField):
        raise TypeError(f"field must be an IndexField, got {type(field).__name__}")
    if not isinstance(pupil, Pupil):
        raise TypeError(f"pupil must be a Disc, Annulus, Rectangle, Polygon or Mask, got {type(pupil).__name__}")
    if not (np.isfinite(limit) and limit > 0.0):
        raise ValueError(f"limit must be positive, got {limit!r}")
    wavelength = field.wavelength_for(wavelength)
    feature, look, paths, told_by = None, pupil.normal, None, None
    if wavefront is not None:
        if wavefront.pupil is not None and not _same_light(wavefront.pupil, pupil):
            raise ValueError(f"wavefront was traced for another pupil, {wavefront.pupil!r}: give that one")
        if wavefront.direction is not None:
            look = np.asarray(wavefront.direction)
        if len(wavefront.opd) >= FEWEST_MAPPED:
            paths = paths_of(wavefront)
            found, squares = finest_and_squares(paths.path, paths.pixel, wavelength)
            # What is as fine as the map's own pixels may be finer: then waves look for it anew.
            feature = found if found >= RESOLVED * paths.pixel else None
            told_by = (len(paths.path), squares, wavefront.wavelength, wavefront.blocked, wavefront.removed)
    # A verdict is kept with the field: it is one of the field, the light, and the map, which its pixels and squares
    # tell from one that was traced more or less exactly.
    key = ("verdict", weakref.ref(pupil), look.tobytes(), wavelength, limit, told_by)
    told: Validity | None = field.held(key)
    if told is not None:
        return told
    seen = None
    if wavefront is not None:
        if paths is not None and feature is not None:
            # A wave says more than two screens, and is asked at once where it costs next to nothing.
            cheap = is_one_column(field, look) and len(wavefront.opd) >= COLUMN_WORTH
            if waves is False or not cheap or not affordable(field, look, wavefront):
                answer = by_rays(field, pupil, look, wavefront, paths, wavelength, feature, limit)
                if answer is not None:
                    return _kept(field, key, answer)
        if waves is None:
            waves = affordable(field, look, wavefront)
        if not waves or paths is None:
            answer = by_bounds(field, pupil, look, wavefront, wavelength, limit)
            if answer.decided or not waves:
                return answer
        if paths is not None and _is_whole(wavefront, wavelength):
            seen = TracedMap(paths.strehl, paths.pixel)
    through = pupil if look is pupil.normal else replace(pupil, normal=look)  # type: ignore[type-var]
    return _kept(field, key, by_waves(field, through, wavelength, feature, limit, seen))


def _kept(field: IndexField, key: tuple[Any, ...], answer: Validity) -> Validity:
    """An answer, kept with the field."""
    kept: Validity = field.derive(key, lambda: answer, KEPT)
    return kept


def _is_whole(wavefront: Wavefront, wavelength: float) -> bool:
    """Whether a wavefront's Strehl ratio is that of all the pupil's light, with nothing but piston taken out."""
    removed = set(wavefront.removed) <= {"piston"}
    return removed and wavefront.wavelength == wavelength and wavefront.blocked <= 1e-3


def affordable(field: IndexField, look: np.ndarray, wavefront: Wavefront) -> bool:
    """Whether a wave through a field costs little beside a traced wavefront, by counts, on any machine alike.

    Through slabs that are sums over coefficients it takes 2 to 8 ms, which no map of fewer pixels across than
    FEWEST_MAPPED is worth; sampled layers take as long as many rays.
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
    """The verdict of the field's own bounds beside a wavefront of any map: rays are good, or it is not decided."""
    whole = wavefront.wavelength == wavelength and wavefront.blocked <= 1e-3
    found = change_bound(field, pupil, look, wavelength)
    proven = whole and found.change <= min(limit, GREATEST_BOUND)
    unknown = float("nan")
    return Validity(
        strehl_change=0.0 if proven else unknown,
        feature=unknown,
        distance=found.distance if proven else unknown,
        fresnel_number=unknown,
        crossed_share=0.0 if proven else unknown,
        curvature=found.curvature if proven else unknown,
        limit=limit,
        answered_by="bounds" if proven else "nobody",
        bound=found.change if whole else float("inf"),
    )


def _same_light(one: Pupil, other: Pupil) -> bool:
    """Whether two pupils let the same light through: their place, and their weights on a coarse grid."""
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
    """The verdict of a traced wavefront alone, that holds its finest phase; None where it leaves a doubt."""
    if wavefront.wavelength != wavelength or wavefront.blocked > 1e-3 or "focus" in wavefront.removed:
        return None
    # Screens have pixels as coarse as that; where those do not hold the finest phase there is a doubt.
    if feature < RESOLVED * wavefront.pixel * stride_of(len(wavefront.opd), wavefront.pixel, feature):
        return None
    if not is_clear(field, pupil, look, wavelength):
        return None
    # Two screens at the pupil stand for what lies between them and it only where its light is not spread before, and
    # where a feature keeps its shape on the way.
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
