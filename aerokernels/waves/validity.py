r"""Verdict on ray optics: does light through a field behave as its rays predict?

Three numbers of the wavefront W over the distance D in which its light leaves the disturbed air tell why it may not:

    Fresnel number     l^2 / (lambda D), l the half period of the finest relevant phase; below about 1 that phase turns
                       into brightness before the light has left the air
    ray crossing       share of the pupil where det(1 + D grad grad W) < 0: behind a focus neighbours change places
    curvature          the greatest D |W''|: near 1 there is a focus

and one tells how much it matters: the Strehl ratio of a coarse split-step wave through the same air minus the one of
its rays through the same slabs (coarse_wave.py). Errors of the slabs affect both, so the difference represents
diffraction alone. The rays bend, to second order in their displacement: a wave contains the effect of bending on their
paths, as traced rays do, and it is not diffraction. Near foci no finite order gives the paths of rays: there the wave
is compared with the traced rays of the wavefront, and with straight rays if none are available (`Validity.error` is
infinite then).
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from ..display.quantities import Quantity
from ..inputs.arguments import checked
from ..inputs.checks import check_positive
from ..medium import IndexField
from ..pupils import Pupil
from ..wavefronts import Wavefront
from .coarse_wave import Slabs, WaveAndRays, finest_phase, slabs_of

# Default limit: the greatest change of the Strehl ratio for which rays are good.
GOOD = 1e-2


@dataclass(frozen=True)
class Validity:
    """Verdict on ray optics: the effect of diffraction, which rays ignore.

    Attributes:
        strehl_change: Strehl ratio of the wave minus the one of rays, both through the same samples.
        feature: Half period of the finest relevant phase [m]; infinite if there is none.
        distance: Length over which the light is disturbed [m].
        fresnel_number: feature^2 / (wavelength distance).
        crossed_share: Share of the pupil where rays cross.
        curvature: Greatest product of that distance and a focusing curvature of the wavefront.
        limit: The change of the Strehl ratio up to which rays are good.
        blocked: Share of the pupil's light that ends on the field's body; it is excluded from both Strehl ratios.
        rim_fresnel_number: Fresnel number of the light that passes the body's rim, up to the end of the box: below some
            tens the fringes of the rim extend over all of it. Infinite if no body is near.
        error: Error of the change, measured with half as many slabs; infinite if rays come near foci and no traced rays
            are available; NaN if not known.
    """

    strehl_change: float
    feature: float
    distance: float
    fresnel_number: float
    crossed_share: float
    curvature: float
    limit: float = GOOD
    blocked: float = 0.0
    rim_fresnel_number: float = float("inf")
    error: float = float("nan")

    @property
    def good(self) -> bool:
        """Whether rays give the Strehl ratio to within `limit`."""
        return abs(self.strehl_change) <= self.limit

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        size = Quantity(self.strehl_change, self.error if np.isfinite(self.error) else None).text(signed=True)
        change = f"diffraction changes the Strehl ratio by {size} (limit {self.limit:g}), according to a wave"
        change += " through the field"
        if np.isfinite(self.rim_fresnel_number):
            change += (
                f"; {100.0 * self.blocked:.2g} % of the light ends on the body, and the rest diffracts at its rim with "
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
    """Judge whether rays through a field give the Strehl ratio of a pupil, and what they neglect.

    Args:
        field: The refractive index.
        pupil: The pupil; light leaves it along its normal, or in the direction of the `wavefront`.
        wavelength: Vacuum wavelength [m]; None takes the field's own, or 905 nm if it has none.
        wavefront: The traced wavefront of this pupil, of 32 pixels across or more: near foci the wave is compared with
            its rays.
        limit: Greatest change of the Strehl ratio for which rays are good.

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
    if wavefront is not None and wavefront.direction is not None:
        pupil = replace(pupil, normal=np.asarray(wavefront.direction))  # type: ignore[type-var]
    slabs = slabs_of(field, pupil, wavelength)
    feature = finest_phase(np.where(slabs.light > 0.0, slabs.path, np.nan), slabs.wave.pixel, wavelength)
    crossings = crossings_of(slabs.path, slabs.wave.pixel, slabs.light, slabs.disturbed)
    traced = None
    if wavefront is not None and not slabs.blocked and _is_whole(wavefront, wavelength):
        traced = wavefront.strehl()
    # Where rays have crossed only traced rays are meaningful. Before they cross, a map's pixels may hide a grating.
    resolved = wavefront is not None and feature >= 4.0 * wavefront.pixel
    by_traced = traced is not None and (crossings.crossed > 0.0 or (crossings.near > 0.01 and resolved))
    comparison = WaveAndRays(slabs, straight=crossings.near > 0.1, traced=traced, by_traced=by_traced)
    change, error = comparison.change(limit)
    return Validity(
        strehl_change=change,
        feature=feature,
        distance=slabs.disturbed,
        fresnel_number=feature**2 / (wavelength * slabs.disturbed) if slabs.disturbed > 0.0 else math.inf,
        crossed_share=crossings.crossed,
        curvature=crossings.curvature,
        limit=limit,
        blocked=slabs.blocked,
        rim_fresnel_number=_rim_fresnel_number(slabs),
        error=error,
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
    edges = max(one.half_extent) * np.linspace(-1.0, 1.0, 33)
    return bool(np.allclose(one.coverage(edges, edges), other.coverage(edges, edges), rtol=1e-6, atol=1e-9))


def _is_whole(wavefront: Wavefront, wavelength: float) -> bool:
    """Return whether a map's Strehl ratio is that of all the pupil's light, with no term but piston removed."""
    whole = set(wavefront.removed) <= {"piston"} and wavefront.blocked <= 1e-3
    return whole and wavefront.wavelength == wavelength and len(wavefront.opd) >= 32


def _rim_fresnel_number(slabs: Slabs) -> float:
    """Return the Fresnel number of the light that passes a body; infinite if no body is near."""
    if slabs.opaque is None:
        return math.inf
    first = int(np.argmax(slabs.opaque.any(axis=(1, 2))))
    distance = slabs.end - (slabs.first + first * (slabs.last - slabs.first) / len(slabs.opaque))
    area = float(slabs.light.sum()) * slabs.wave.pixel * slabs.column_width
    return area / (math.pi * slabs.wave.wavelength * distance)


@dataclass(frozen=True)
class Crossings:
    """Crossing and focusing of rays over a distance."""

    crossed: float  # share of the pupil where rays cross
    curvature: float  # greatest focusing curvature times the distance
    # Share of the pupil near a focus, where this product exceeds 0.5: there the second order in their deflection does
    # not give the paths of rays.
    near: float


def crossings_of(path: np.ndarray, pixel: float, light: np.ndarray, distance: float) -> Crossings:
    """Return crossing and focusing over a distance [m], from paths [m] and light, without two pixels at the rim."""
    scale, inner = distance / (4.0 * pixel**2), path[2:-2]
    if path.shape[1] == 1:
        light = light[2:-2]
        half = 0.5 * scale * (path[4:] + path[:-4] - 2.0 * inner)
        middle, spread = half, np.abs(half)
    else:
        light, inner = light[2:-2, 2:-2], inner[:, 2:-2]
        row = scale * (path[4:, 2:-2] + path[:-4, 2:-2] - 2.0 * inner)
        column = scale * (path[2:-2, 4:] + path[2:-2, :-4] - 2.0 * inner)
        mixed = scale * (path[3:-1, 3:-1] + path[1:-3, 1:-3] - path[3:-1, 1:-3] - path[1:-3, 3:-1])
        middle, spread = 0.5 * (row + column), np.sqrt((0.5 * (row - column)) ** 2 + mixed**2)
    focusing = spread - middle  # light turns toward the delayed side: a negative curvature focuses
    known = (light > 0.0) & np.isfinite(focusing)
    light, focusing, middle = light[known], focusing[known], middle[known]
    whole = float(light.sum())
    if not whole > 0.0:
        return Crossings(0.0, 0.0, 0.0)
    crossed = (1.0 - focusing) * (1.0 + focusing + 2.0 * middle) < 0.0
    near = focusing > 0.5
    greatest = max(float(focusing.max()), 0.0)
    return Crossings(float(light[crossed].sum()) / whole, greatest, float(light[near].sum()) / whole)
