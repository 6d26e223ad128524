"""The wind-tunnel model, the outer edge of the computed region, and the blocks of mesh between them. Lengths in mm.

x runs downstream from the nose tip, r is the distance from the axis. The body is a hemisphere, two cones, a cylinder,
a step with a slanted face and a second cylinder. The outer edge is a hyperbola of Billig's form for bow shocks,

    r^2 tan^2(b) / Rc^2 = (1 + (x + d) tan^2(b) / Rc)^2 - 1

with an apex radius Rc, an asymptote b and a stand-off d such that the bow shock stays inside at each Mach number.
"""

from dataclasses import astuple, dataclass
from math import cos, pi, radians, sin, sqrt, tan

import numpy as np

NOSE_RADIUS = 8.0
FORE_CONE, FORE_RADIUS = radians(10.0), 13.0
AFT_CONE, BODY_RADIUS = radians(22.0), 25.0
BODY_LENGTH = 20.0
STEP_FACE, STEP_RADIUS = radians(30.0), 38.0
STEP_LENGTH = 30.0

# Across the layer, and along the body in each block with the ratio of the last cell's length to the first.
CELLS_ACROSS = 80
BLOCKS = ((44, 1.0), (56, 2.6), (50, 0.85), (32, 1.0), (36, 1.1), (32, 1.6))
# How far the mesh line that leaves each corner of the body leans upstream, so that cells stay close to rectangular.
LEAN = tuple(radians(angle) for angle in (10.0, 10.0, 10.0, 10.0, 8.0, 0.0))
CURVE_POINTS = 401


@dataclass(frozen=True)
class OuterEdge:
    """The hyperbola: stand-off and apex radius [mm], angle of the asymptote [rad]."""

    stand_off: float
    apex_radius: float
    asymptote: float

    def radius(self, x: float) -> float:
        """Radius [mm] at a station x [mm]."""
        slope = tan(self.asymptote)
        reach = max(x + self.stand_off, 0.0)
        return self.apex_radius / slope * sqrt((1.0 + reach * slope**2 / self.apex_radius) ** 2 - 1.0)

    def station(self, radius):
        """Station x [mm] at a radius [mm], of any shape."""
        slope = tan(self.asymptote)
        return (
            np.sqrt(1.0 + (radius * slope / self.apex_radius) ** 2) - 1.0
        ) * self.apex_radius / slope**2 - self.stand_off

    def met_from(self, point: tuple[float, float], lean: float) -> tuple[float, float]:
        """Where a straight line from a body point meets the edge; `lean` is its angle from the radial direction."""
        low, high = 0.0, 400.0
        for _ in range(100):
            middle = 0.5 * (low + high)
            x, r = point[0] - middle * sin(lean), point[1] + middle * cos(lean)
            low, high = (low, middle) if r > self.radius(x) else (middle, high)
        return point[0] - low * sin(lean), point[1] + low * cos(lean)


OUTER_EDGE = {
    2.0: OuterEdge(6.0, 24.0, radians(37.0)),
    3.0: OuterEdge(4.4, 18.0, radians(28.0)),
    4.0: OuterEdge(4.0, 17.0, radians(25.0)),
}


MACH_RANGE = 1.5, 8.0


def outer_edge(mach: float) -> OuterEdge:
    """The outer edge at a Mach number: of the table, else linear in 1 / Mach between and beyond its entries.

    Raises:
        ValueError: A Mach number from which the bow shock is not known to stay inside.
    """
    if mach in OUTER_EDGE:
        return OUTER_EDGE[mach]
    if not MACH_RANGE[0] <= mach <= MACH_RANGE[1]:
        raise ValueError(f"Mach {mach:g} is outside {MACH_RANGE[0]:g} to {MACH_RANGE[1]:g}: give a mesh of its own")
    near = sorted(OUTER_EDGE, key=lambda known: abs(1.0 / known - 1.0 / mach))[:2]
    one, other = (OUTER_EDGE[known] for known in near)
    share = (1.0 / mach - 1.0 / near[0]) / (1.0 / near[1] - 1.0 / near[0])
    return OuterEdge(*(float(a + share * (b - a)) for a, b in zip(astuple(one), astuple(other), strict=True)))


def body_corners() -> list[tuple[float, float]]:
    """Corners of the outline (x, r) from the nose tip to the base."""
    corners = [(0.0, 0.0), (NOSE_RADIUS * (1.0 - sin(FORE_CONE)), NOSE_RADIUS * cos(FORE_CONE))]
    for angle, radius in ((FORE_CONE, FORE_RADIUS), (AFT_CONE, BODY_RADIUS)):
        x, r = corners[-1]
        corners.append((x + (radius - r) / tan(angle), radius))
    corners.append((corners[-1][0] + BODY_LENGTH, BODY_RADIUS))
    corners.append((corners[-1][0] + (STEP_RADIUS - BODY_RADIUS) / tan(STEP_FACE), STEP_RADIUS))
    corners.append((corners[-1][0] + STEP_LENGTH, STEP_RADIUS))
    return corners


def edge_corners(edge: OuterEdge) -> list[tuple[float, float]]:
    """Points of the outer edge (x, r) that the block boundaries lead to."""
    corners = body_corners()
    return [(-edge.stand_off, 0.0), *(edge.met_from(*pair) for pair in zip(corners[1:], LEAN, strict=True))]


def dome_curve() -> np.ndarray:
    """Points inside the dome's arc (x, r), end points left out."""
    angle = np.linspace(0.0, 0.5 * pi - FORE_CONE, CURVE_POINTS)[1:-1]
    return np.stack([NOSE_RADIUS * (1.0 - np.cos(angle)), NOSE_RADIUS * np.sin(angle)], axis=1)


def edge_curve(edge: OuterEdge, first: float, last: float) -> np.ndarray:
    """Points of the outer edge between two radii, evenly spaced along it, end points left out."""
    radius = np.linspace(first, last, CURVE_POINTS)
    curve = np.stack([edge.station(radius), radius], axis=1)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], CURVE_POINTS)
    return np.stack([np.interp(even, length, column) for column in curve.T], axis=1)[1:-1]


def cell_counts(scale: float) -> tuple[list[int], int]:
    """Cells along the body in each block, and across; `scale` multiplies both."""
    return [round(count * scale) for count, _ in BLOCKS], round(CELLS_ACROSS * scale)
