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
where they go; straight ones stand for them there.

Beside a traced wavefront there is a cheaper answer: half of its phase on either side of free space of the length over
which the light is disturbed, which the field is looked up on a few lines for. Where that changes the Strehl ratio by
far less than is allowed, no rays cross (the determinant is positive everywhere) and nothing is near a focus, the rays
have answered for themselves; otherwise the wave answers.
"""

import math
import weakref
from dataclasses import dataclass, replace

import numpy as np

from ..arguments import checked
from ..medium import IndexField
from ..pupils import Pupil
from ..wavefront import Wavefront
from .diffraction import Ways, window_of
from .layers import span_of
from .screens import WINDOW, crossings_of, fast_size, screens_answer, spread_along, stride_of
from .shadows import SlabsPastBody, fringes, is_clear, shadow_of
from .slabs import FINEST, LookingAlong, Slabs, slabs_of

# The greatest change of the Strehl ratio that rays may cost and still be good.
GOOD = 1e-2
# Phase [rad rms] that may be left out of what counts as the finest, and lines either way on which that is looked for.
UNSEEN, FEATURE_LINES = 0.03, 16
# The window of one column, where nothing varies along x, over the pupil; pixels to the finest half period, and in all
# at least; of one column, at least and at most; lines across that tell where along the way light is disturbed.
COLUMN_WINDOW, PER_FEATURE, LEAST_PIXELS, COLUMN_PIXELS, SLAB_LINES = 2.0, 4.0, 48, (256, 512), 16
# Rays are straight where they come near their foci (screens.py) over more than this share of the pupil.
GREATEST_SHARE = 0.1
# The share of the limit that the rays' own answer must stay below.
CLEAR = 0.1
# The least Fresnel number with which they answer: at 1.8 two screens have said -0.0009 of a wave's +0.039.
FEWEST_FRESNEL = 4.0
# The finest phase in pixels, and pixels across a map, by which it is resolved; pixels by which two pupils are compared,
# and verdicts kept with a field.
RESOLVED, FEWEST_MAPPED, SAME_PIXELS, KEPT = 4.0, 32, 32, 8


@dataclass(frozen=True)
class Validity:
    """What diffraction does that rays do not know of.

    Attributes:
        strehl_change: Strehl ratio by waves less that by rays, both through the same samples.
        feature: Half period of the finest phase that matters [m]; infinite where none does.
        distance: Length over which the light is disturbed, and has left the disturbance at its end [m].
        fresnel_number: feature^2 / (wavelength distance).
        crossed_share: Share of the pupil where rays have crossed.
        curvature: The greatest product of that distance and a curvature of the wavefront, of the sign that focuses.
        limit: The change of the Strehl ratio up to which rays are good.
        answered_by: "rays" where the traced wavefront left no doubt, "waves" where a wave was sent through the field.
        blocked: Share of the pupil's light that ends on the field's body: neither rays nor waves count it.
        rim_fresnel_number: Of the light that passes the body's rim, to where it leaves the box: below some tens the
            knife edge's fringes fill it; infinite where no body is near.
    """

    strehl_change: float
    feature: float
    distance: float
    fresnel_number: float
    crossed_share: float
    curvature: float
    limit: float = GOOD
    answered_by: str = "waves"
    blocked: float = 0.0
    rim_fresnel_number: float = float("inf")

    @property
    def good(self) -> bool:
        """Whether rays give the Strehl ratio to within `limit`."""
        return abs(self.strehl_change) <= self.limit

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        who = "the traced wavefront" if self.answered_by == "rays" else "a wave through the field"
        change = f"waves change the Strehl ratio by {self.strehl_change:+.2g}, {self.limit:g} being allowed, says {who}"
        if np.isfinite(self.rim_fresnel_number):
            change += (
                f"; {100.0 * self.blocked:.2g} % of the light ends on the body, past whose rim the rest diffracts with "
                f"a Fresnel number of {self.rim_fresnel_number:.2g}"
            )
        if self.good:
            return f"rays are good: {change}"
        why = f"the Fresnel number of the finest phase is {self.fresnel_number:.2g}"
        if self.crossed_share > 0.0:
            why = f"rays cross over {100.0 * self.crossed_share:.2g} % of the pupil"
        return f"rays are not good: {change}; {why}; see split_step"

    def __bool__(self) -> bool:
        """Whether rays are good."""
        return self.good


@checked
def validity(
    field: IndexField,
    pupil: Pupil,
    *,
    wavelength: float | None = None,
    wavefront: Wavefront | None = None,
    limit: float = GOOD,
) -> Validity:
    """Whether rays through a field give the Strehl ratio of a pupil, and what they leave out.

    Args:
        field: The refractive index.
        pupil: The pupil; light leaves it along its normal, or in the direction of the `wavefront`.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm where it has none.
        wavefront: Its traced wavefront, whose finest phase is then looked at, and which may answer by itself at a small
            part of its own cost; None looks at straight rays and asks a wave.
        limit: The change of the Strehl ratio up to which rays are good.

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
    feature, look = float("inf"), pupil.normal
    if wavefront is not None:
        if wavefront.pupil is not None and not _same_light(wavefront.pupil, pupil):
            raise ValueError(f"wavefront was traced for another pupil, {wavefront.pupil!r}: give that one")
        if wavefront.direction is not None:
            look = np.asarray(wavefront.direction)
        found = finest_feature(2.0 * np.pi / wavelength * wavefront.opd, wavefront.pixel)
        # What is as fine as the map's own pixels may be finer: then waves look for it anew.
        if found >= RESOLVED * wavefront.pixel and len(wavefront.opd) >= FEWEST_MAPPED:
            feature = found
            answer = by_rays(field, pupil, look, wavefront, wavelength, feature, limit)
            if answer is not None:
                return answer
        else:
            wavefront = None
    looked_for = wavefront is None
    # What a wave says is kept with the field: it is one of the field and the light, not of how rays were traced.
    key = ("verdict of a wave", weakref.ref(pupil), look.tobytes(), wavelength, feature, looked_for, limit)

    def ask() -> Validity:
        seen = pupil if look is pupil.normal else replace(pupil, normal=look)  # type: ignore[type-var]
        return by_waves(field, seen, wavelength, None if looked_for else feature, limit)

    told: Validity = field.derive(key, ask, KEPT)
    return told


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


def by_waves(field: IndexField, pupil: Pupil, wavelength: float, feature: float | None, limit: float) -> Validity:
    """The verdict of a wave through slabs of the field, see diffraction.py; a finest phase of None is looked for."""
    reach = max(pupil.half_extent)
    # In a planar field seen across its axis nothing varies along the first axis.
    flat = field.geometry == "planar" and abs(float(pupil.normal[0])) < 1e-15
    clear, half = is_clear(field, pupil, pupil.normal, wavelength), (COLUMN_WINDOW if flat else WINDOW) * reach
    if not clear:
        half = max(half, reach + fringes(field, wavelength))
    look = LookingAlong(pupil.center, pupil.normal, pupil.axes, half)
    begin, end = span_of(field, look.center, look.normal, look.axes, *(2 * [(-look.half, look.half)]))
    slabs: Slabs = (
        slabs_of(field, look, begin, end, wavelength) if clear else SlabsPastBody(field, look, begin, end, wavelength)
    )
    if feature is None:
        window = window_of(pupil, reach, COLUMN_PIXELS[1] if flat else 2 * slabs.most_pixels // 3, flat)
        path = slabs.taken(window.x, window.y, 1)[0]
        _, passes = shadow_of(slabs, window, wavelength, end)
        phase = np.where(passes, 2.0 * np.pi / wavelength * path, np.nan)
        feature = finest_feature(phase, window.pixel)
    least, most = COLUMN_PIXELS if flat else (LEAST_PIXELS, slabs.most_pixels)
    # Fringes of a rim are as fine as the pixels allow.
    pixels = fast_size(math.ceil(np.clip(2.0 * look.half * PER_FEATURE / feature, least, most))) if clear else most
    window = window_of(pupil, look.half, pixels, flat)
    distance = _slabs_length(slabs, pupil, flat)
    shadow, passes = shadow_of(slabs, window, wavelength, end)
    path = slabs.taken(window.x, window.y, 1)[0]
    crossings = crossings_of(path, window.pixel, window.amplitude * passes, distance)
    ways = Ways(
        window=window,
        slabs=slabs,
        passes=passes,
        before=slabs.first,
        after=end - slabs.last,
        wavelength=wavelength,
        ambient_index=field.ambient_index,
        straight=crossings.near > GREATEST_SHARE,
    )
    return Validity(
        strehl_change=ways.change(limit),
        feature=feature,
        distance=distance,
        fresnel_number=_fresnel_number(feature, wavelength, distance),
        crossed_share=crossings.crossed,
        curvature=crossings.curvature,
        limit=limit,
        blocked=shadow.blocked,
        rim_fresnel_number=shadow.fresnel_number,
    )


def _slabs_length(slabs: Slabs, pupil: Pupil, flat: bool) -> float:
    """The disturbed length [m], by lines through the slabs; of a flat one, which are alike along x, by one row."""
    place = max(pupil.half_extent) * (2.0 * (np.arange(SLAB_LINES) + 0.5) / SLAB_LINES - 1.0)
    lit = pupil.transmission(*np.meshgrid(place, place)) > 0.0
    across = np.zeros(1) if flat else place
    if flat:
        lit = lit.any(axis=1, keepdims=True)
    opaque = slabs.opaque(across, place, FINEST)
    if opaque is not None and (lit & ~opaque.any(axis=0)).any():
        lit &= ~opaque.any(axis=0)
    return spread_along(slabs.taken(across, place, FINEST)[:, lit], slabs.last - slabs.first)


def finest_feature(phase: np.ndarray, pixel: float) -> float:
    """Half period of the finest phase [m] that holds UNSEEN rad of a map, NaN outside the pupil; infinite if none does.

    By second differences at growing distance, which no tilt touches and no edge of the pupil: a component of period p
    holds its whole at a distance of p / 2.
    """
    count = len(phase)
    # Some lines either way say what all of them do: columns and, of a map of more than one, rows.
    part = slice(None, None, max(1, count // FEATURE_LINES))
    ways = [phase.T[part], phase[part]] if phase.shape[0] == phase.shape[1] else [phase.T[part]]
    lines = np.stack(ways)
    for stride in (2**power for power in range(int(np.log2(max(count // 2, 1))) + 1)):
        # Of a coarse difference every second part of it is looked at: the rest says the same.
        step = max(1, stride // 2)
        squares = _mean_squares(lines[..., ::step], stride // step)
        # Of a component that is sampled at its extremes the second difference is four times the amplitude.
        if np.sqrt(squares / 8.0) > 2.0 * UNSEEN:
            return stride * pixel
    return float("inf")


def _mean_squares(lines: np.ndarray, stride: int) -> float:
    """Mean squares of second differences along lines (ways, lines, n) at a distance of so many pixels, their sum."""
    second = lines[..., 2 * stride :] + lines[..., : -2 * stride]
    second -= 2.0 * lines[..., stride:-stride]
    total = 0.0
    for own in second:
        known = own[np.isfinite(own)]
        if len(known):
            total += float(np.einsum("i,i->", known, known)) / len(known)  # no BLAS: its threads take longer than that
    return total


def _fresnel_number(feature: float, wavelength: float, distance: float) -> float:
    """Of a feature [m] over a distance [m]; infinite where nothing is disturbed."""
    return feature**2 / (wavelength * distance) if distance > 0.0 else float("inf")


def by_rays(
    field: IndexField,
    pupil: Pupil,
    look: np.ndarray,
    wavefront: Wavefront,
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
    found = screens_answer(field, pupil, look, wavefront, wavelength, feature)
    if found is None or not abs(found.change) <= CLEAR * limit:
        return None
    # Two screens stand for what lies between them only where a feature keeps its shape on the way.
    if _fresnel_number(feature, wavelength, found.length) < FEWEST_FRESNEL:
        return None
    crossings = found.crossings
    return Validity(
        strehl_change=found.change,
        feature=feature,
        distance=found.length,
        fresnel_number=_fresnel_number(feature, wavelength, found.length),
        crossed_share=crossings.crossed,
        curvature=crossings.curvature,
        limit=limit,
        answered_by="rays",
    )
