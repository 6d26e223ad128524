r"""Verdict on ray optics: does light through a field behave as its rays predict?

The change of the Strehl ratio by diffraction is that of a coarse split-step wave minus the one of bent rays through the
same slabs, of second order in their displacement: errors of the slabs affect both. Near foci no finite order gives the
paths of rays: there the wave is compared with traced rays. docs/theory/waves.md explains the numbers.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..derived import key_of
from ..display.quantities import Quantity
from ..inputs.arguments import checked
from ..inputs.checks import check_positive
from ..inputs.kinds import wrong_kind
from ..medium import IndexField
from ..pupils import Pupil
from ..tracing.lines import box_size
from ..wavefronts import Wavefront
from .layers import along_z, mean_layers, path_range
from .split_step import Layers, plane_wave
from .wave import Wave, propagated

# Default limit: the greatest change of the Strehl ratio for which rays are good.
GOOD = 1e-2
# Most slabs of the disturbed air.
FINEST = 64


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
        rim_fresnel_number: Fresnel number of the light that passes the body's rim, up to the end of the box; infinite
            if no body is near.
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
        raise wrong_kind(field, "field", "an IndexField")
    if not isinstance(pupil, Pupil):
        raise wrong_kind(pupil, "pupil", "a Disc, Annulus, Rectangle, Polygon or Mask")
    check_positive(limit, "limit")
    wavelength = field.wavelength_for(wavelength)
    if wavefront is not None and wavefront.pupil is not None and key_of(wavefront.pupil) != key_of(pupil):
        raise ValueError(f"wavefront was traced for another pupil, {wavefront.pupil!r}: give that one")
    if wavefront is not None and wavefront.direction is not None:
        pupil = replace(pupil, normal=np.asarray(wavefront.direction))  # type: ignore[type-var]
    slabs = slabs_of(field, pupil, wavelength)
    feature = finest_phase(np.where(slabs.light > 0.0, slabs.path, np.nan), slabs.wave.pixel, wavelength)
    crossed, curvature, near = crossings_of(slabs.path, slabs.wave.pixel, slabs.light, slabs.disturbed)
    traced = None
    if wavefront is not None and not slabs.blocked and wavefront.wavelength == wavelength and len(wavefront.opd) >= 32:
        # Its Strehl ratio must be that of all the pupil's light, with no term but piston removed.
        if set(wavefront.removed) <= {"piston"} and wavefront.blocked <= 1e-3:
            traced = wavefront.strehl()
    # Where rays have crossed only traced rays are meaningful. Before they cross, a map's pixels may hide a grating.
    resolved = wavefront is not None and feature >= 4.0 * wavefront.pixel
    by_traced = traced is not None and (crossed > 0.0 or (near > 0.01 and resolved))
    change, error = _change(slabs, limit, straight=near > 0.1, traced=traced, by_traced=by_traced)
    return Validity(
        strehl_change=change,
        feature=feature,
        distance=slabs.disturbed,
        fresnel_number=feature**2 / (wavelength * slabs.disturbed) if slabs.disturbed > 0.0 else math.inf,
        crossed_share=crossed,
        curvature=curvature,
        limit=limit,
        blocked=slabs.blocked,
        rim_fresnel_number=_rim_fresnel_number(slabs),
        error=error,
    )


def _rim_fresnel_number(slabs: "Slabs") -> float:
    """Return the Fresnel number of the light that passes a body; infinite if no body is near."""
    if slabs.opaque is None:
        return math.inf
    first = int(np.argmax(slabs.opaque.any(axis=(1, 2))))
    distance = slabs.end - (slabs.first + first * (slabs.last - slabs.first) / len(slabs.opaque))
    rows, columns = slabs.wave.amplitude.shape
    area = float(slabs.light.sum()) * slabs.wave.pixel**2 * (rows if columns == 1 else 1)
    return area / (math.pi * slabs.wave.wavelength * distance)


@dataclass(frozen=True, eq=False)
class Slabs:
    """FINEST slabs of equal thickness of the disturbed air in the view of a window."""

    wave: Wave  # the pupil's light on the window
    # Optical paths [m], float32, shape (FINEST, rows, columns), without a delay common to all lines of a slab.
    paths: np.ndarray
    opaque: np.ndarray | None  # masks of where light ends on a body, of the same shape; None if it does not
    light: np.ndarray  # amplitude of the light whose rays pass the body, shape (rows, columns)
    first: float  # start of the slabs along the line of sight [m]
    last: float  # end of the slabs [m]
    end: float  # end of the field's box [m]
    disturbed: float  # length over which the light is disturbed [m]

    @property
    def path(self) -> np.ndarray:
        """Optical paths of straight lines [m], shape (rows, columns)."""
        return np.asarray(self.paths.sum(axis=0, dtype=np.float64))

    @property
    def blocked(self) -> float:
        """Share of the light that ends on a body."""
        amplitude = self.wave.amplitude.real
        return max(1.0 - float((self.light**2).sum() / (amplitude**2).sum()), 0.0)

    def wave_sum(self, count: int) -> complex:
        """Return the sum of the wave behind so many screens over that of the light."""
        start = propagated(self.wave, self.first, paraxial=True)
        layers = Layers(self.paths, self.opaque, self.last - self.first, paraxial=True)
        return complex(layers.through(start, count).sum()) / float(self.light.sum())

    def ray_strehl(self, count: int, straight: bool) -> float:
        """Return the Strehl ratio of rays through so many screens, with their phases at their starts."""
        path = self.path
        if not straight:
            screens = self.paths.reshape(count, -1, *self.paths.shape[1:]).sum(axis=1)
            path = path + bending(screens, self.wave.pixel, (self.last - self.first) / count, self.end - self.last)
        total = (self.light * np.exp(2j * np.pi / self.wave.wavelength * path)).sum()
        return float(abs(total / self.light.sum()) ** 2)


def slabs_of(field: IndexField, pupil: Pupil, wavelength: float) -> Slabs:
    """Return the slabs of a field in the view of a pupil, on pixels that resolve the finest phase."""
    from scipy.fft import next_fast_len
    from scipy.ndimage import distance_transform_edt

    reach, flat = max(pupil.half_extent), field.geometry == "planar" and abs(float(pupil.normal[0])) < 1e-15
    begin, end = path_range(field, plane_wave(pupil, wavelength, 16, 1.0, field.ambient_index))
    # The light of a pupil diffracts by some widths sqrt(wavelength distance); the fringes of a rim reach farther.
    fringes = 0.0 if field.body is None else 4.0 * math.sqrt(wavelength * box_size(field))
    half = max(min(1.15 * reach + 2.0 * math.sqrt(wavelength * end), 4.0 * reach), reach + fringes)

    def window(pixels: float) -> Wave:
        wave = plane_wave(pupil, wavelength, next_fast_len(math.ceil(pixels)), half / reach, field.ambient_index)
        if not flat:
            return wave
        edges = wave.pixel * (np.arange(len(wave.amplitude) + 1) - len(wave.amplitude) // 2 - 0.5)
        return replace(wave, amplitude=pupil.coverage(edges[[0, -1]], edges), incident=None)

    least, most = (256, 512) if flat else (96, 192 if along_z(field, pupil.normal) else 96)
    first, last, disturbed = _disturbed(field, window(least // 4), begin, end)
    for pixels in (least, most):
        wave = window(max(pixels, 32.0 * half / reach))
        paths, opaque = mean_layers(field, wave, first, last, FINEST, most_parts=None if most > least else 1)
        # The delay of a line common to a slab would cost digits of the differences.
        paths -= paths[:, :1, :1]
        lit = wave.amplitude.real > 0.0
        feature = finest_phase(np.where(lit, paths.sum(axis=0), np.nan), wave.pixel, wavelength)
        # A rim makes fringes as fine as the pixels allow.
        if 3.0 * wave.pixel <= feature and (opaque is None or not opaque.any()):
            break
    light = wave.amplitude.real
    if opaque is not None and opaque.any():
        dark = np.asarray(opaque.any(axis=0))
        light = np.where(dark, 0.0, light)
        if not light.any():
            raise ValueError("the body blocks all of the pupil's light: move the pupil, or turn its normal")
        # They continue into the shadow from beside it, so that the rim makes no slope.
        row, column = distance_transform_edt(dark, return_distances=False, return_indices=True)
        paths = paths[:, row, column]
    else:
        opaque = None
    return Slabs(wave, paths, opaque, light, first, last, end, disturbed)


def finest_phase(path: np.ndarray, pixel: float, wavelength: float) -> float:
    """Return the half period [m] of the finest phase of a map above 0.03 rad rms; infinite if there is none.

    `path` [m] is NaN outside the pupil, shape (n, n) or (n, 1). A component of period p has its full amplitude in
    second differences at a distance of p / 2, four times its own; they do not depend on tilt and the pupil's edge.
    """
    wave_number, stride = 2.0 * np.pi / wavelength, 1
    while 2 * stride < len(path):
        squares = 0.0
        for lines in (path, path.T) if path.shape[1] > 1 else (path,):
            second = lines[2 * stride :] + lines[: -2 * stride] - 2.0 * lines[stride:-stride]
            known = np.isfinite(second)
            squares += float(np.square(second[known]).sum()) / max(int(known.sum()), 1)
        if wave_number * math.sqrt(squares / 8.0) > 0.06:
            return stride * pixel
        stride *= 2
    return math.inf


def _disturbed(field: IndexField, wave: Wave, begin: float, end: float) -> tuple[float, float, float]:
    """Return between which distances [m] the air differs across a coarse window, and the length of the disturbance.

    At either end a phase of 0.01 rad is left out. The length is that of an even distribution of the same variance.
    """
    paths, opaque = mean_layers(field, wave, begin, end, 4 * FINEST, most_parts=4)
    step, wave_number = (end - begin) / len(paths), 2.0 * np.pi / wave.wavelength
    lit = wave.amplitude.real > 0.0
    first, last = begin, end
    if opaque is None or not opaque.any():
        phase = wave_number * (paths.max(axis=(1, 2)) - paths.min(axis=(1, 2)))
        known = np.flatnonzero((np.cumsum(phase) > 0.01) & (np.cumsum(phase[::-1])[::-1] > 0.01))
        if len(known):
            first, last = begin + step * max(int(known[0]) - 1, 0), begin + step * min(int(known[-1]) + 2, len(paths))
    elif (lit & ~opaque.any(axis=0)).any():
        lit &= ~opaque.any(axis=0)
    variance, place = paths[:, lit].var(axis=1, dtype=np.float64), np.arange(len(paths))
    total = float(variance.sum())
    if not total > 0.0:
        return first, last, 0.0
    middle = float(place @ variance) / total
    square = float((place - middle) ** 2 @ variance) / total
    return first, last, step * math.sqrt(12.0 * square + 1.0)


def _change(slabs: Slabs, limit: float, straight: bool, traced: float | None, by_traced: bool) -> tuple[float, float]:
    """Return the Strehl ratio of the wave minus the one of the rays, and its error, well enough for a limit.

    The number of slabs is doubled; the error is the difference from half as many, and that of the slabs' rays from the
    `traced` Strehl ratio. It is infinite if `straight` rays, near foci, are not replaced `by_traced` ones. With an
    opaque wall the result does not converge smoothly: then all slabs are used, and the error is NaN.
    """
    rays: Callable[[int], float] = partial(slabs.ray_strehl, straight=straight)
    if by_traced and traced is not None:
        rays = partial(lambda ratio, count: ratio, traced)
    if slabs.opaque is not None:
        return abs(slabs.wave_sum(FINEST)) ** 2 - slabs.ray_strehl(FINEST, straight), math.nan
    count, before, now = 2, (slabs.wave_sum(2), rays(2)), (slabs.wave_sum(4), rays(4))
    while True:
        count *= 2
        change, doubt = (abs(one[0]) ** 2 - one[1] for one in (now, before))
        # Of a wave alone the complex sums are compared: two Strehl ratios may agree by chance.
        doubt = abs(now[0] - before[0]) * (abs(now[0]) + abs(before[0])) if by_traced else abs(change - doubt)
        if count >= FINEST or doubt <= max(0.05 * limit, 0.5 * abs(abs(change) - limit)):
            break
        before, now = now, (slabs.wave_sum(2 * count), rays(2 * count))
    if straight and not by_traced:
        return change, math.inf
    return change, max(doubt, 0.0 if traced is None else abs(now[1] - traced))


def bending(paths: np.ndarray, pixel: float, step: float, after: float) -> np.ndarray:
    """Return the excess optical path of bent rays over straight ones through screens [m], at the start of each ray.

    `paths` has those of the screens [m], (count, rows, columns), `step` [m] apart, with a free distance `after` the
    last. To second order in d, rays with deflection t and displacement d get d grad p + d H d / 2 from a screen of path
    p with the curvature H, and t^2 z / 2 from free space of a length z; t += grad p + H d, and d += t z.
    """
    axes = [axis for axis in (0, 1) if paths.shape[axis + 1] > 1]
    excess, reach = np.zeros(paths.shape[1:]), max(paths.shape[1:]) * pixel
    turn, aside = np.zeros((2, len(axes), *excess.shape))
    for number, path in enumerate(paths.astype(np.float64)):
        slopes = np.array([np.gradient(path, pixel, axis=axis) for axis in axes])
        if number:
            more = sum(
                np.gradient(slopes, pixel, axis=axis + 1) * moved for axis, moved in zip(axes, aside, strict=True)
            )
            excess += (aside * (slopes + 0.5 * more)).sum(axis=0)
            slopes += more
        turn += slopes
        distance = 0.5 * step + after if number == len(paths) - 1 else step
        excess += 0.5 * distance * (turn**2).sum(axis=0)
        # Slopes of the jump at the box's side, where there is no light, must not overflow.
        aside = np.clip(aside + distance * turn, -reach, reach)
    return excess


def crossings_of(path: np.ndarray, pixel: float, light: np.ndarray, distance: float) -> tuple[float, float, float]:
    """Return crossing and focusing over a distance [m], from paths [m] and light, without two pixels at the rim.

    The share of the pupil where rays cross; the greatest focusing curvature times the distance; and the share where
    this product exceeds 0.5, near a focus, where the second order in deflection does not give the paths of rays.
    """
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
        return 0.0, 0.0, 0.0
    crossed = (1.0 - focusing) * (1.0 + focusing + 2.0 * middle) < 0.0
    near = focusing > 0.5
    greatest = max(float(focusing.max()), 0.0)
    return float(light[crossed].sum()) / whole, greatest, float(light[near].sum()) / whole
