r"""A focused laser differential interferometer, and its response to sine waves in closed form.

    w(z)^2 = w_0^2 + (theta z)^2,       H(K, z) = sin(K s / 2) / (K s / 2)  exp(-K^2 w(z)^2 / 8)

for the wave number K along the separation s (B. E. Schmidt, J. E. Shepherd, Appl. Opt. 54 (2015) 8459).
"""

import math
from dataclasses import dataclass, field

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import check_positive, check_wavelength
from ..medium import IndexField
from ..medium.grid import contrast_without_gradient
from ..pupils import as_unit_vector, as_vector, transverse_axes
from ..rays import RayBundle
from ..tracing.cuts import lost, may_lose
from ..tracing.lines import box_size, cell_along, cylinder_span, slab_span
from ..tracing.stop import ways_through


@checked
@dataclass(frozen=True, eq=False)
class FLDI:
    """An FLDI instrument.

    Attributes:
        separation: Distance between the two beams [m].
        waist: Radius of a beam at the focus, at 1 / e^2 of its intensity [m].
        focus: Point midway between the beams at their focus [m], shape (3,).
        axis: Direction of the beams, normalised, shape (3,).
        direction: Direction from the second beam to the first, projected across the axis and normalised, shape (3,);
            None takes the first transverse axis, x for beams along z.
        wavelength: Vacuum wavelength [m].
        divergence: Half angle of the beams far from the focus [rad]; None takes wavelength / (pi waist).

    Raises:
        TypeError: The wavelength is not a number.
        ValueError: A number is out of range, or the direction is along the axis.
    """

    separation: float
    waist: float
    focus: np.ndarray = field(default_factory=lambda: np.zeros(3))
    axis: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    direction: np.ndarray | None = None
    wavelength: float = 632.8e-9
    divergence: float | None = None

    def __post_init__(self):
        """Check and normalise the values."""
        axis = as_unit_vector(self.axis, "axis")
        direction = transverse_axes(axis)[0] if self.direction is None else as_unit_vector(self.direction, "direction")
        across = direction - (direction @ axis) * axis
        if np.linalg.norm(across) < 1e-6:
            raise ValueError("direction, from one beam to the other, must not lie along the axis")
        wavelength = check_wavelength(self.wavelength)
        waist = check_positive(self.waist, "waist")
        spread = wavelength / (np.pi * waist) if self.divergence is None else self.divergence
        if not (np.ndim(spread) == 0 and np.isfinite(spread) and 0.0 <= spread < 0.5 * np.pi):
            raise ValueError(f"divergence must be a half angle in [0, pi/2) rad, got {self.divergence!r}")
        checked = {
            "separation": check_positive(self.separation, "separation"),
            "waist": waist,
            "focus": as_vector(self.focus, "focus"),
            "axis": axis,
            "direction": across / np.linalg.norm(across),
            "wavelength": wavelength,
            "divergence": float(spread),
        }
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    @property
    def normal(self) -> np.ndarray:
        """Unit vector perpendicular to axis and direction, shape (3,)."""
        assert self.direction is not None
        return np.cross(self.axis, self.direction)

    @checked
    def radius(self, distance: Numbers) -> np.ndarray:
        """Return the radius of a beam [m] at distances from the focus along the axis [m], of their shape."""
        assert self.divergence is not None
        return np.hypot(self.waist, np.tan(self.divergence) * np.asarray(distance, dtype=np.float64))

    @checked
    def transfer(self, wave_number: Numbers, distance: Numbers = 0.0, *, angle: float = 0.0) -> np.ndarray:
        """Return H of a sine wave in a sheet, in closed form, of the arguments' common shape.

        Args:
            wave_number: Wave number, 2 pi over the wavelength of the sine [rad / m].
            distance: Distance from the focus to the sheet along the axis [m].
            angle: Angle between the wave's direction and the separation [rad].
        """
        wave_number, distance = (np.asarray(each, dtype=np.float64) for each in (wave_number, distance))
        if not (np.isfinite(wave_number).all() and np.isfinite(distance).all() and np.isfinite(angle)):
            raise ValueError("wave_number, distance and angle must be finite")
        try:
            np.broadcast_shapes(wave_number.shape, distance.shape)
        except ValueError:
            raise ValueError(
                f"wave_number and distance must have shapes that broadcast, got {wave_number.shape} and "
                f"{distance.shape}: for every pair give wave_number[:, None]"
            ) from None
        apart = np.sinc(wave_number * np.cos(angle) * self.separation / (2.0 * np.pi))
        return np.asarray(apart * np.exp(-((wave_number * self.radius(distance)) ** 2) / 8.0))

    @checked
    def transfer_through(self, wave_number: Numbers, half_length: float, *, angle: float = 0.0) -> np.ndarray:
        """Return the mean of H over sheets from -half_length to +half_length about the focus [m], in closed form."""
        from scipy.special import erf

        assert self.divergence is not None
        wave_number = np.asarray(wave_number, dtype=np.float64)
        grown = (
            np.abs(wave_number) * np.tan(self.divergence) * check_positive(half_length, "half_length") / np.sqrt(8.0)
        )
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.where(grown > 1e-9, 0.5 * np.sqrt(np.pi) * erf(grown) / grown, 1.0)
        return np.asarray(mean * self.transfer(wave_number, 0.0, angle=angle))


# Radii up to which a beam is traced; fewest and most rays across a beam; share of the light beyond REACH.
REACH, LEAST_RAYS, MOST_RAYS = 2.6, 20, 192
BEYOND_REACH = math.exp(-2.0 * REACH**2)
# Layers along the beams: per cell of fields with and without kinks, fewest, most; points interpolated together.
LAYERS_PER_CELL, LEAST_LAYERS, MOST_LAYERS, BLOCK = (2, 1), 8, 2048, 200_000
GAUSS = 0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0)


def crossed(field: IndexField, instrument: FLDI, focus: np.ndarray) -> tuple[float, float] | None:
    """Return the distances along the axis from a focus [m] between which light is in the field's box, or None."""
    low, high = field.box
    there = np.isfinite(low)
    away = np.linalg.norm(np.where(there, focus - low, 0.0)) + np.linalg.norm(np.where(there, focus - high, 0.0))
    ends = (-float(away), float(away))
    for _ in range(4):  # the range from the beams' widest radius, and that radius from the range
        reach = REACH * float(instrument.radius(np.asarray(ends)).max()) + 0.5 * instrument.separation
        found = _span_of_disc(field, focus, instrument.axis, reach)
        if found[0] > found[1]:
            return None
        if not np.isfinite(found).all():
            raise ValueError("the beams never leave the field: a planar field is infinite along x; turn the axis")
        ends = found
    return ends


def _span_of_disc(field: IndexField, focus: np.ndarray, axis: np.ndarray, reach: float) -> tuple[float, float]:
    """Return the range in which a disc moved along an axis touches the box [m]; first above second if nowhere.

    It is the path of the disc's middle through a box extended by the disc's reach along each axis.
    """
    low, high = field.box
    wider = reach * np.sqrt(np.maximum(1.0 - axis**2, 0.0))
    round_box = field.geometry == "axisymmetric"
    spans = [
        slab_span(focus[k : k + 1], axis[k : k + 1], low[k] - wider[k], high[k] + wider[k])
        for k in range(2 if round_box else 0, 3)
        if np.isfinite(low[k])
    ]
    if round_box:
        spans.append(cylinder_span(focus[None], axis[None], float(high[0]) + reach, 0.0))
    return max(float(first[0]) for first, _ in spans), min(float(last[0]) for _, last in spans)


def beam_grid(field: IndexField, instrument: FLDI, ends: tuple[float, float], rays: int | None):
    """Return positions of rays in units of the radius, shape (n, 2), and their shares of the light, shape (n,)."""
    widest = float(instrument.radius(np.asarray(ends)).max())
    assert instrument.direction is not None
    counts = [
        min(max(math.ceil(min(2.0 * REACH * widest / cell, MOST_RAYS)), LEAST_RAYS), MOST_RAYS) | 1
        for cell in cell_along(field, np.stack([instrument.direction, instrument.normal]))
    ]
    if rays is not None:
        counts = [int(rays) | 1, int(rays) | 1]
    lines = [np.linspace(-REACH, REACH, count) for count in counts]
    u, v = (axis.ravel() for axis in np.meshgrid(*lines))
    light = np.exp(-2.0 * (u**2 + v**2))
    every_other = [np.arange(count) % 2 == count // 2 % 2 for count in counts]
    coarse = np.logical_and.outer(every_other[1], every_other[0]).ravel()
    kept = u**2 + v**2 <= REACH**2
    light, coarse, u, v = light[kept], coarse[kept], u[kept], v[kept]
    half = np.where(coarse, light, 0.0)
    return np.stack([u, v], axis=1), light / light.sum(), half / half.sum()


def gathered(
    field: IndexField,
    instrument: FLDI,
    places: np.ndarray,
    focus: np.ndarray,
    ends: tuple[float, float],
    *,
    coarser: int = 1,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the optical paths [m] of the rays of both beams, the one toward `direction` first, and which rays pass.

    Both (2, n), for rays at `places` (n, 2) in units of a beam's radius, and the distances from the focus between which
    light is in the box [m]. Two Gauss points are used in the part of each layer, `coarser` times as thick, that is in
    the box.
    """
    cell = float(cell_along(field, instrument.axis[None])[0])
    wanted = LAYERS_PER_CELL[field.interpolation == "cubic"] * (ends[1] - ends[0]) / cell
    count = math.ceil(math.ceil(min(max(wanted, LEAST_LAYERS), MOST_LAYERS)) / coarser)
    edges = np.linspace(*ends, count + 1)
    thickness = (ends[1] - ends[0]) / count
    path, passes = np.zeros((2, len(places))), np.ones((2, len(places)), dtype=bool)
    block = max(1, BLOCK // len(places))  # speed only
    for begin in range(0, count, block):
        part = edges[begin : begin + block + 1]
        for beam, side in enumerate((0.5, -0.5)):
            spots = ray_points(
                instrument, places, focus, side, np.broadcast_to(part[:, None], (len(part), len(places)))
            )
            low, high = _in_box(field, field.local_coordinates(spots.reshape(-1, 3)).reshape(*spots.shape[:2], -1))
            for node in GAUSS:
                distance = part[:-1, None] + thickness * (low + node * (high - low))
                points = ray_points(instrument, places, focus, side, distance).reshape(-1, 3)
                contrast = contrast_without_gradient(field, points).reshape(distance.shape)
                path[beam] += 0.5 * thickness * np.einsum("ij,ij->j", high - low, contrast)
                if field.body is not None:
                    passes[beam] &= ~_in_body(field, points).reshape(distance.shape).any(axis=0)
    return path, passes


def ray_points(
    instrument: FLDI, places: np.ndarray, focus: np.ndarray, side: float, distance: np.ndarray
) -> np.ndarray:
    """Return points on the rays of one beam at distances (m, n) from the focus [m], shape (m, n, 3)."""
    first, second = instrument.direction, instrument.normal
    assert first is not None
    across = places[:, :1] * first + places[:, 1:] * second
    middle = focus + side * instrument.separation * first
    return middle + distance[..., None] * instrument.axis + instrument.radius(distance)[..., None] * across


def _in_box(field: IndexField, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the range, as shares of its length, in which each segment between points is in the box, shape (m, n)."""
    low, high = field.box
    if field.geometry == "axisymmetric":
        low, high = np.array([-np.inf, low[2]]), high[[0, 2]]
    elif field.geometry == "planar":
        low, high = low[1:], high[1:]
    first, last = np.zeros((len(local) - 1, local.shape[1])), np.ones((len(local) - 1, local.shape[1]))
    for axis in range(local.shape[2]):
        place = local[..., axis]
        if place.min() >= low[axis] and place.max() <= high[axis]:
            continue
        enters, leaves = slab_span(place[:-1], np.diff(place, axis=0), low[axis], high[axis])
        first, last = np.maximum(first, enters), np.minimum(last, leaves)
    missed = first >= last
    return np.where(missed, 0.0, first), np.where(missed, 0.0, last)


def _in_body(field: IndexField, points: np.ndarray) -> np.ndarray:
    """Return a mask of the points (n, 3) inside the field's body, shape (n,)."""
    body, local = field.body, field.local_coordinates(points)
    assert body is not None
    low, high = body.box
    inside = np.all((local >= low) & (local <= high), axis=1)
    inside[inside] = body.contains(local[inside])
    return inside


def truncated_share(
    field: IndexField, instrument: FLDI, focus: np.ndarray, ends: tuple[float, float] | None, reach: float
) -> float:
    """Return the share of the light of both beams that loses more than the tolerance by cuts."""
    tolerance = 1e-3 * instrument.wavelength
    if not may_lose(field, tolerance):
        return 0.0
    if ends is None:
        along, size = float(ways_through(field.box, focus, instrument.axis)[0]), box_size(field)
        ends = along - size, along + size
    u, v = (axis.ravel() for axis in np.meshgrid(*(2 * [np.linspace(-reach, reach, 33)])))
    places, light = np.stack([u, v], axis=1), np.exp(-2.0 * (u**2 + v**2)) * (u**2 + v**2 <= reach**2)
    over = np.zeros((2, len(light)), dtype=bool)
    for beam, side in enumerate((0.5, -0.5)):
        for end in ends:
            if end * (ends[0] + ends[1]) < 0.0 and ends[0] * ends[1] > 0.0:
                continue  # the whole box is on the other side of the focus
            # From the focus; from the middle of the range if the focus is this end.
            begin = 0.0 if abs(end) > 1e-6 * (ends[1] - ends[0]) else 0.5 * (ends[0] + ends[1])
            distance = np.repeat([[begin], [end]], len(light), axis=1)
            start, stop = ray_points(instrument, places, focus, side, distance)
            way = stop - start
            rays = RayBundle(start, way / np.linalg.norm(way, axis=1)[:, None])
            over[beam] |= np.abs(lost(field, rays, None, tolerance=tolerance)) > tolerance
    return float(light @ over.mean(axis=0) / light.sum())
