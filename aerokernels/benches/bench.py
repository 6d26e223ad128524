"""A bench with its optics: a source of some size, the lens before the flow, the plane in focus, and the sensor.

The knife edge passes the light of the source's angles t with t_cut + e_cut > edge, e_cut being the deflection across
the edge. Each of the source's points is traced on its own through the pixels' places in the plane in focus. Reference:
G. S. Settles, Schlieren and Shadowgraph Techniques (Springer, 2001), sections 2.3, 3.2 and 3.4.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_choice, check_count
from ..medium import IndexField
from ..pupils import Disc, Pupil, Rectangle
from ..sensor import Sensor
from .line_of_sight import LineOfSight, line_of_sight

# An edge is sought in one of many equal parts of the source, then in one of as many parts of that: 2^60 in all.
PARTS, ROUNDS = 64, 10


@checked
@dataclass(frozen=True)
class Bench:
    """The optics of a bench.

    Attributes:
        source_size: Width of the source across the knife edge, or a disc's diameter [m]. None takes the width of a
            `source` that is a pupil: twice the greatest distance from its centre across the edge.
        focal_length: Focal length of the lens or mirror that collimates the source's light [m].
        source: "slit" (no width along the edge), "disc", "square", or any pupil, such as an `Annulus` or a `Mask`, of
            which only the shape counts, scaled to the width `source_size`: its first axis is across the edge, and a
            mask's weights are amplitudes.
        source_points: Points of the source along its width, each traced on its own; as many along the edge.
        focus: The plane in focus, along the light from the middle of the field [m].
        sensor: Adds noise and grey levels; None leaves the brightness as it is.
        seed: Seed of the noise.

    Raises:
        TypeError: `sensor` is no Sensor.
        ValueError: A number is out of range, or the source is unknown.
    """

    source_size: float | None
    focal_length: float
    source: str | Pupil = "slit"
    source_points: int = 1
    focus: float = 0.0
    sensor: Sensor | None = None
    seed: int = 0

    def __post_init__(self):
        """Check the values."""
        check_source(self.source)
        if self.source_size is None and isinstance(self.source, Pupil):
            object.__setattr__(self, "source_size", 2.0 * self.source.half_extent[0])
        for name in ("source_size", "focal_length"):
            value = getattr(self, name)
            if value is None or not (np.ndim(value) == 0 and np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value!r}: give a positive length in metres")
        if self.angle > 0.5:
            raise ValueError(f"a source of {self.angle:.3g} rad is too large: check source_size and focal_length")
        check_count(self.source_points, "source_points", 1, 64)
        if not np.isfinite(self.focus):
            raise ValueError(f"focus = {self.focus}: give the plane in focus in metres from the field's middle")
        if self.sensor is not None and not isinstance(self.sensor, Sensor):
            raise TypeError(f"sensor must be a Sensor, got {type(self.sensor).__name__}")

    @property
    def angle(self) -> float:
        """Full angle of the source seen from the flow [rad]."""
        assert self.source_size is not None
        return self.source_size / self.focal_length

    @property
    def sensitivity(self) -> float:
        """Change of light per deflection for a slit [1 / rad]: focal length over source size."""
        return 1.0 / self.angle

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Return points of the source: angles across and along the edge [rad], shape (n, 2), and shares, shape (n,)."""
        if self._shape is None:
            middle = self._middles(self.angle)
            return np.stack([middle, np.zeros(len(middle))], axis=1), np.full(len(middle), 1.0 / len(middle))
        shape, unit = self._shape, self._unit
        sides = [unit * 2.0 * half for half in shape.half_extent]
        edges = [side / unit * (np.arange(self.source_points + 1) / self.source_points - 0.5) for side in sides]
        share = light_in(shape, *edges)
        across, along = np.meshgrid(*(self._middles(side) for side in sides))
        lit = share > 0.0
        return np.stack([across[lit], along[lit]], axis=1), share[lit] / share[lit].sum()

    def passed(self, point: np.ndarray, deflection: np.ndarray, cut_off: float) -> np.ndarray:
        """Return the share of the light about a point (2,) of the source that passes, for deflections [rad]."""
        half = 0.5 * self.angle / self.source_points
        ends = np.array([point[0] - half, point[0] + half])
        strip = None
        if self._shape is not None:
            high = self._unit * self._shape.half_extent[1] / self.source_points
            strip = point[1] - high, point[1] + high
        return 1.0 - self._share_below(self.edge(cut_off) - np.asarray(deflection), ends, strip)

    def held_back(self, place: np.ndarray) -> np.ndarray:
        """Return the share of the source's light from angles below `place` across the edge [rad]."""
        return self._share_below(place, 0.5 * self.angle * np.array([-1.0, 1.0]), None)

    def edge(self, cut_off: float) -> float:
        """Return the position of the edge, as an angle from the source's middle [rad]."""
        if self._shape is None:
            return (cut_off - 0.5) * self.angle
        ends = 0.5 * self.angle * np.array([-1.0, 1.0])
        for _ in range(ROUNDS):
            places = np.linspace(ends[0], ends[1], PARTS + 1)
            beyond = np.clip(np.searchsorted(self.held_back(places), cut_off), 1, PARTS)
            ends = places[beyond - 1 : beyond + 1]
        return float(ends.mean())

    def _share_below(self, place: np.ndarray, ends: np.ndarray, strip: tuple[float, float] | None) -> np.ndarray:
        """Return the share of the light between two angles across the edge that comes from angles below `place`."""
        first, whole = self._below(ends, strip)
        return np.asarray((self._below(np.clip(place, *ends), strip) - first) / (whole - first))

    def _below(self, place: np.ndarray, strip: tuple[float, float] | None) -> np.ndarray:
        """Return the light from angles below `place` across the edge, in a strip of angles along it; None for all."""
        if self._shape is None:
            return np.asarray(place)
        reach = self._unit * self._shape.half_extent[1]
        low, high = (-reach, reach) if strip is None else strip
        return light_below(self._shape, np.asarray(place) / self._unit, low / self._unit, high / self._unit)

    @property
    def _shape(self) -> Pupil | None:
        return shape_of(self.source)

    @property
    def _unit(self) -> float:
        """Angle per unit length of the shape [rad / m]."""
        assert self._shape is not None
        return 0.5 * self.angle / self._shape.half_extent[0]

    def _middles(self, side: float) -> np.ndarray:
        edges = side * (np.arange(self.source_points + 1) / self.source_points - 0.5)
        return np.asarray(0.5 * (edges[1:] + edges[:-1]))


# Positions of an edge evaluated together.
BLOCK = 1 << 14  # speed only


def check_source(source: str | Pupil) -> None:
    """Check that `source` is a known name or a pupil."""
    if not isinstance(source, Pupil):
        check_choice(source, "source", ("slit", "disc", "square"))


def shape_of(source: str | Pupil) -> Pupil | None:
    """Return the shape, of any size; None for a slit, which has no width along the edge."""
    if isinstance(source, Pupil):
        return source
    return Disc(1.0) if source == "disc" else Rectangle(2.0, 2.0) if source == "square" else None


def light_in(shape: Pupil, x_edges: np.ndarray, y_edges: np.ndarray) -> np.ndarray:
    """Return the light below positions on the first axis, in a strip between two positions on the second."""
    areas = np.diff(y_edges)[:, None] * np.diff(x_edges)
    return np.asarray(shape.coverage(x_edges, y_edges, 2) * areas)


def light_below(shape: Pupil, place: np.ndarray, low: float, high: float) -> np.ndarray:
    """Return the light below positions on the first axis, within a strip between two positions on the second."""
    reach = shape.half_extent[0]
    places = np.clip(np.ravel(place), -reach, reach)
    edges, where = np.unique(np.concatenate([[-reach], places]), return_inverse=True)
    light, strip = np.zeros(len(edges)), np.array([low, high])
    for first in range(0, len(edges) - 1, BLOCK):
        part = edges[first : first + BLOCK + 1]
        light[first + 1 : first + len(part)] = light_in(shape, part, strip)[0]
    return np.asarray(np.cumsum(light)[where[1:]].reshape(np.shape(place)))


def light_of_source(
    field: IndexField | LineOfSight,
    bench: Bench,
    bright: float,
    light_of: Callable[[LineOfSight, np.ndarray], np.ndarray],
    options: dict[str, Any],
) -> tuple[np.ndarray, LineOfSight, np.ndarray]:
    """Trace the light of each point of a bench's source and sum what `light_of` makes of it in each pixel, (ny, nx).

    Points are across an edge that brightens toward the angle `bright` from right toward up [rad]. Also returns the rays
    of the middlemost point, and a mask of the pixels whose light is known for all points.
    """
    if isinstance(field, LineOfSight):
        raise TypeError("a bench traces light of its own: give the field in place of light that was traced")
    points, shares = bench.points()
    right, up = math.cos(bright), math.sin(bright)
    tilts = points @ np.array([[right, up], [-up, right]])
    total, known, middle = np.zeros(()), np.ones((), dtype=bool), int(np.argmin(np.hypot(*tilts.T)))
    for number, (point, share, tilt) in enumerate(zip(points, shares, tilts, strict=True)):
        traced = line_of_sight(field, tilt=(tilt[0], tilt[1]), focus=bench.focus, **options)
        total, known = total + share * light_of(traced, point), known & traced.known
        if number == middle:
            middle_rays = traced
    return total, middle_rays, known


# Bisections in the search for the size whose weights have the right variance; cells across a shape that give its
# variance.
HALVINGS, CELLS = 50, 1024


def blurred(irradiance: np.ndarray, source: str | Pupil, size: float, pitch: tuple[float, float]) -> np.ndarray:
    """Convolve a picture, shape (ny, nx), with the image of a source, `size` [m] wide along the horizontal.

    `size` is negative if the image is inverted; `pitch` is the spacing of the pixels along either axis [m]; a slit has
    no width along the vertical.
    """
    from scipy.ndimage import convolve, convolve1d

    shape = shape_of(source) or Rectangle(2.0, 2.0)
    scale = abs(size) / (2.0 * shape.half_extent[0])
    axes = (0, 1) if shape_of(source) else (0,)
    drawn = [_fitted(shape, axis, scale * shape.half_extent[axis], pitch[axis]) for axis in axes]
    if isinstance(shape, Rectangle):  # separable
        for axis, (_, light) in zip(axes, drawn, strict=True):
            irradiance = convolve1d(irradiance, light / light.sum(), axis=1 - axis, mode="nearest")
        return np.asarray(irradiance)
    weights = light_in(shape, drawn[0][0], drawn[1][0])
    if size < 0.0:
        weights = weights[::-1, ::-1]
    return np.asarray(convolve(irradiance, weights / weights.sum(), mode="nearest"))


def _fitted(shape: Pupil, axis: int, half: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the edges of pixels along an axis of a shape, in its units, and the light between them.

    The shape, of half the size `half` [m] over pixels `step` [m] apart, is scaled such that this light has the shape's
    own mean square distance from its centre.
    """
    reach, other = shape.half_extent[axis], shape.half_extent[1 - axis]

    def light_between(edges: np.ndarray) -> np.ndarray:
        ends = np.array([-other, other])
        return np.ravel(light_in(shape, edges, ends) if axis == 0 else light_in(shape, ends, edges))

    fine = np.linspace(-reach, reach, CELLS + 1)
    light = light_between(fine)
    cell = fine[1] - fine[0]
    square = float(light @ ((0.5 * (fine[1:] + fine[:-1])) ** 2 + cell**2 / 12.0) / light.sum())
    wanted = square * (half / reach) ** 2
    low, high = max(half - step, 1e-6 * step), half + step
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        count = int(np.ceil(middle / step - 0.5 + 1e-9)) if middle > 0.5 * step else 0
        edges = np.arange(-count - 0.5, count + 1.0) * step
        weights = light_between(edges * reach / middle)
        place = 0.5 * (edges[1:] + edges[:-1])
        low, high = (middle, high) if float(weights @ place**2) < wanted * weights.sum() else (low, middle)
    return edges * reach / middle, weights
