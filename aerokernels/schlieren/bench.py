"""A bench with its optics: a source of some size, the lens before the flow, the plane in focus, and the sensor.

A source of size h behind a lens of focal length f lights the flow from angles of -h / 2f to h / 2f. The knife edge is
where the source is imaged again: it passes the part of the source's light that comes from angles t with

    t_cut + e_cut > edge,      the edge being where a share `cut_off` of the undisturbed light is held back

e_cut is the deflection across the edge. For a slit the passed light is linear in e_cut with slope f / h, as in
`schlieren`; for a disc it is curved at both ends, for an annulus also at the rims of its hole. With one point
(`source_points` = 1) the source lights the flow along the axis only. With more points each is traced on its own,
through the position of each pixel in the plane in focus, so that parts of the flow out of focus are blurred. A ray is
drawn at its apparent origin in the plane in focus, with the light of the square around it: schlieren out of focus is
partly a shadowgraph.

Reference: G. S. Settles, Schlieren and Shadowgraph Techniques (Springer, 2001), sections 2.3, 3.2 and 3.4.
"""

from dataclasses import dataclass

import numpy as np

from ..inputs.arguments import checked
from ..inputs.checks import check_count
from ..pupils import Pupil
from ..sensor import Sensor
from .source_shape import check_source, light_below, light_in, shape_of

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
        """Return the share of light of one point's part of the source that passes the edge, of the deflection's shape.

        Args:
            point: The point's angles across the edge and along it [rad], shape (2,).
            deflection: Deflections across the edge [rad].
            cut_off: Share of the undisturbed light that is held back.
        """
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
