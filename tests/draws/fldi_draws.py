"""Random interferometers in random flows of closed form, sampled well and badly, to test the reported error.

`fldi_response` reads sampled air of closed form (closed_air.py). The truth is the interferometer in the closed form:
its light summed over a fine grid of rays and many Gauss points along them, independently of the package.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from aerokernels.fldi import FLDI, fldi_response

from .closed_air import HALF, DrawnAir, draw_air, log_uniform

# Range of the air's contrast.
STRENGTHS = (1e-8, 3e-6)
# For the truth: rays across a beam, their reach in beam radii, layers along it.
RAYS, REACH, LAYERS = 61, 3.3, 400


@dataclass(frozen=True, eq=False)
class DrawnReading:
    """Air, its samples, and an instrument."""

    air: DrawnAir
    instrument: FLDI


@dataclass(frozen=True)
class ReadingCheck:
    """A phase beside the truth, in radians.

    Attributes:
        phase: The phase of the response.
        error: Its reported error.
        truth: The phase in the closed form.
    """

    phase: float
    error: float
    truth: float

    @property
    def missed(self) -> float:
        """Error of the phase [rad]."""
        return abs(self.phase - self.truth)

    @property
    def covered(self) -> bool:
        """Whether the reported error covers it, apart from rounding and the truth's own quadrature error."""
        return self.missed <= self.error + 1e-6 * abs(self.truth) + 1e-10


def draw_reading(seed: int, kind: str | None = None, geometry: str | None = None) -> DrawnReading:
    """Return the reading of a seed."""
    rng = np.random.default_rng([23, seed])
    air = draw_air(rng, STRENGTHS, kind, geometry)
    return DrawnReading(air, _instrument(rng, air.field.geometry))


def check_reading(drawn: DrawnReading) -> ReadingCheck:
    """Compare the response with the truth."""
    found = fldi_response(drawn.air.field, drawn.instrument)
    axis = drawn.instrument.axis
    slant = float(np.hypot(axis[1], axis[2])) if drawn.air.field.geometry == "planar" else 1.0
    truth = true_phase(drawn.air.contrast, drawn.instrument, slant)
    return ReadingCheck(float(found.phase), float(found.error), truth)


def true_phase(contrast: Callable[[np.ndarray], np.ndarray], instrument: FLDI, slant: float = 1.0) -> float:
    """Phase of the detected light [rad] through air of closed form that ends within HALF of the origin on each axis.

    `slant` is the part of the beams' direction that leads out of the air: less than 1 in planar air, endless along x.
    """
    side = np.linspace(-REACH, REACH, RAYS)
    u, v = (axis.ravel() for axis in np.meshgrid(side, side))
    kept = np.hypot(u, v) <= REACH
    u, v = u[kept], v[kept]
    light = np.exp(-2.0 * (u**2 + v**2))
    middle = -float(instrument.focus @ instrument.axis)
    reach = 2.0 * HALF + abs(float(instrument.divergence or 0.0)) * 2.0 * REACH * (abs(middle) + 2.0 * HALF)
    reach /= slant
    ends = np.linspace(middle - reach, middle + reach, LAYERS + 1)
    node, weight = np.polynomial.legendre.leggauss(3)
    path = np.zeros((2, len(u)))
    for first, last in pairwise(ends):
        for place, share in zip(0.5 * (first + last) + 0.5 * (last - first) * node, weight, strict=True):
            radius = float(np.hypot(instrument.waist, np.tan(instrument.divergence) * place))
            across = radius * (u[:, None] * instrument.direction + v[:, None] * instrument.normal)
            for beam, sign in enumerate((0.5, -0.5)):
                points = instrument.focus + place * instrument.axis + across
                points = points + sign * instrument.separation * np.asarray(instrument.direction)
                path[beam] += 0.5 * (last - first) * share * contrast(points)
    difference = 2.0 * np.pi / instrument.wavelength * (path[0] - path[1])
    mean = float(light @ difference / light.sum())
    return mean + float(np.angle(light @ np.exp(1j * (difference - mean))))


def _instrument(rng: np.random.Generator, geometry: str) -> FLDI:
    """An interferometer whose beams cross the box, never along a planar field's endless axis."""
    axis = rng.normal(size=3) * (0.3, 1.0, 1.0) if geometry == "planar" else rng.normal(size=3)
    waist = log_uniform(rng, 4e-6, 1e-4)
    return FLDI(
        separation=log_uniform(rng, 2e-5, 1e-3),
        waist=waist,
        focus=rng.uniform(-1.2, 1.2, 3) * (0.0 if geometry == "planar" else 1.0, 1.0, 1.0) * 0.5 * HALF,
        axis=axis,
        direction=np.cross(axis, rng.normal(size=3)),
        divergence=None if rng.random() < 0.5 else log_uniform(rng, 3e-3, 0.1),
    )
