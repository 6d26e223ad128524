"""A bench with its optics: a source of some size, the lens before the flow, the plane in focus, and the sensor.

A source of the size h behind a lens of focal length f lights the flow from angles of -h / 2f to h / 2f. The knife edge
stands where the source is imaged again: of the source's light it lets through what comes from angles t with

    t_cut + e_cut > edge,      the edge being where a share `cut_off` of the undisturbed light is held back

e_cut the deflection across the edge. Of a slit that is the straight line of slope f / h that `schlieren` draws; of a
disc it bends at both ends. Taken as one point (`source_points` = 1) the source lights the flow along the axis alone;
more points are each traced on their own, through the place of a pixel in the plane in focus, so that what lies out of
focus is blurred. A ray is drawn where it comes from in the plane in focus, with the light of the square about it:
schlieren out of focus is partly a shadowgraph.

Reference: G. S. Settles, Schlieren and Shadowgraph Techniques (Springer, 2001), sections 2.3, 3.2 and 3.4.
"""

from dataclasses import dataclass

import numpy as np

from ..arguments import checked
from ..checks import check_choice
from ..pupils import Disc, area_below
from ..sensor import Sensor

SOURCES = ("slit", "disc", "square")


@checked
@dataclass(frozen=True)
class Bench:
    """The optics of a bench.

    Attributes:
        source_size: Width of the source across the knife edge, or a disc's diameter [m].
        focal_length: Focal length of the lens or mirror that makes the source's light parallel [m].
        source: "slit" (of no width along the edge), "disc" or "square".
        source_points: Points of the source along its width that are traced, each on its own.
        focus: The plane in focus, along the light from the middle of the field [m].
        sensor: Makes grey levels and noise; None: brightness as it is.
        seed: Draws the noise.

    Raises:
        TypeError: `sensor` is no Sensor.
        ValueError: A number that makes no sense, or an unknown source.
    """

    source_size: float
    focal_length: float
    source: str = "slit"
    source_points: int = 1
    focus: float = 0.0
    sensor: Sensor | None = None
    seed: int = 0

    def __post_init__(self):
        """Check."""
        for name in ("source_size", "focal_length"):
            value = getattr(self, name)
            if not (np.ndim(value) == 0 and np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value!r}: give a positive length in metres")
        if self.angle > 0.5:
            raise ValueError(f"a source of {self.angle:.3g} rad is too large: check source_size and focal_length")
        check_choice(self.source, "source", SOURCES)
        count = self.source_points
        if isinstance(count, bool) or not isinstance(count, (int, np.integer)) or not 1 <= count <= 64:
            raise ValueError(f"source_points {count!r}: give a whole number from 1 to 64")
        if not np.isfinite(self.focus):
            raise ValueError(f"focus = {self.focus}: give the plane in focus in metres from the field's middle")
        if self.sensor is not None and not isinstance(self.sensor, Sensor):
            raise TypeError(f"sensor must be a Sensor, got {type(self.sensor).__name__}")

    @property
    def angle(self) -> float:
        """Full angle of the source seen from the flow [rad]."""
        return self.source_size / self.focal_length

    @property
    def sensitivity(self) -> float:
        """Change of light per deflection at a slit's edge [1 / rad]: focal length over source size."""
        return 1.0 / self.angle

    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Points of the source: angles across the edge and along it [rad], shape (n, 2), and shares, shape (n,)."""
        edges = self.angle * (np.arange(self.source_points + 1) / self.source_points - 0.5)
        middle = 0.5 * (edges[1:] + edges[:-1])
        if self.source == "slit":
            return np.stack([middle, np.zeros(len(middle))], axis=1), np.full(len(middle), 1.0 / len(middle))
        share = np.ones((len(middle), len(middle)))
        if self.source == "disc":
            share = Disc(0.5 * self.angle).coverage(edges, edges)
        across, along = np.meshgrid(middle, middle)
        lit = share > 0.0
        return np.stack([across[lit], along[lit]], axis=1), share[lit] / share[lit].sum()

    def passed(self, point: np.ndarray, deflection: np.ndarray, cut_off: float) -> np.ndarray:
        """Share of the light of one point's part of the source that passes the edge, of the deflection's shape.

        Args:
            point: The point's angles across the edge and along it [rad], shape (2,).
            deflection: Deflections across the edge [rad].
            cut_off: Share of the undisturbed light that is held back.
        """
        half = 0.5 * self.angle / self.source_points
        place = np.clip(self.edge(cut_off) - np.asarray(deflection), point[0] - half, point[0] + half)
        first, whole = (self._below(point[0] + side * half, point[1], half) for side in (-1.0, 1.0))
        return np.asarray(1.0 - (self._below(place, point[1], half) - first) / (whole - first))

    def _below(self, place, along: float, half: float) -> np.ndarray:
        """Light from angles below a place across the edge, of the strip of this half width at an angle along it."""
        if self.source != "disc":
            return np.asarray(place)
        radius = 0.5 * self.angle
        low, high = (np.clip((along + side * half) / radius, -1.0, 1.0) for side in (-1.0, 1.0))
        x = np.clip(np.asarray(place) / radius, -1.0, 1.0)
        return np.asarray(area_below(x, high) - area_below(x, low))

    def held_back(self, place: np.ndarray) -> np.ndarray:
        """Share of the source's light from angles below a place across the edge [rad]."""
        part = np.clip(2.0 * np.asarray(place) / self.angle, -1.0, 1.0)
        if self.source == "disc":
            return np.asarray(0.5 + (np.arcsin(part) + part * np.sqrt(1.0 - part**2)) / np.pi)
        return np.asarray(0.5 * (1.0 + part))

    def edge(self, cut_off: float) -> float:
        """Where the edge stands, as an angle from the source's middle [rad]."""
        if self.source != "disc":
            return (cut_off - 0.5) * self.angle
        low, high = -0.5 * self.angle, 0.5 * self.angle
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if float(self.held_back(np.asarray(middle))) < cut_off else (low, middle)
        return 0.5 * (low + high)
