"""Random interferometers before random flows of closed form, sampled well and badly: does the error told hold?

Three kinds of air, each faded out at the faces of its box: "waves" (sine waves of random directions), "blobs" (bells of
Gauss) and "layers" (tanh layers, as shocks). Each is sampled on a grid of 1.5 to 12 nodes to its smallest length, in
any geometry, under any interpolant of grids, and read by `fldi_response`. The truth is the interferometer in the
closed form, its light summed over a fine grid of rays and many Gauss points along them, by nothing of the package.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..fldi import FLDI, fldi_response
from ..medium import IndexField

KINDS = ("waves", "blobs", "layers")
GEOMETRIES = ("planar", "axisymmetric", "volume")
INTERPOLATIONS = ("cubic", "linear", "monotone")
# Half the box [m], and nodes along a side at most: volumes are sampled less finely.
HALF, MOST_NODES, MOST_NODES_VOLUME = 4e-3, 241, 65
# Of the truth: rays across a beam, its radii, layers along it.
RAYS, REACH, LAYERS = 61, 3.3, 400


@dataclass(frozen=True, eq=False)
class DrawnReading:
    """Air, its samples and an instrument.

    Attributes:
        kind: Of KINDS.
        contrast: The closed form, of points (n, 3) [m].
        field: Its samples.
        instrument: The interferometer.
        nodes: Nodes to the smallest length of the air.
    """

    kind: str
    contrast: Callable[[np.ndarray], np.ndarray]
    field: IndexField
    instrument: FLDI
    nodes: float


@dataclass(frozen=True)
class ReadingCheck:
    """A phase beside the truth, in radians.

    Attributes:
        phase: What the response says.
        error: What it says that it may be off by.
        truth: The closed form's phase.
    """

    phase: float
    error: float
    truth: float

    @property
    def missed(self) -> float:
        """How far the phase is off [rad]."""
        return abs(self.phase - self.truth)

    @property
    def covered(self) -> bool:
        """Whether the error holds it, but for what rounding and the truth's own sums leave."""
        return self.missed <= self.error + 1e-6 * abs(self.truth) + 1e-10


def draw_reading(seed: int, kind: str | None = None, geometry: str | None = None) -> DrawnReading:
    """The reading of a seed."""
    rng = np.random.default_rng([23, seed])
    kind = KINDS[rng.integers(len(KINDS))] if kind is None else kind
    geometry = GEOMETRIES[rng.integers(len(GEOMETRIES))] if geometry is None else geometry
    interpolation = INTERPOLATIONS[rng.choice(3, p=(0.6, 0.2, 0.2))]
    nodes = _log_uniform(rng, 1.5, 12.0)
    most = MOST_NODES_VOLUME if geometry == "volume" else MOST_NODES
    smallest = max(_log_uniform(rng, 1e-4, 2e-3), 2.0 * HALF * nodes / (most - 1))
    local = _air(rng, kind, {"volume": 3}.get(geometry, 2), smallest)

    def contrast(points: np.ndarray) -> np.ndarray:
        if geometry == "axisymmetric":
            return local(np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=1))
        return local(points if geometry == "volume" else points[:, 1:])

    count = int(np.ceil(2.0 * HALF * nodes / smallest)) + 1
    counts = {"axisymmetric": (count // 2 + 1, count), "planar": (count, count)}.get(geometry, (count,) * 3)
    low = [0.0 if geometry == "axisymmetric" and axis == 0 else -HALF for axis in range(len(counts))]
    axes = [np.linspace(first, HALF, number) for first, number in zip(low, counts, strict=True)]
    mesh = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    field = IndexField.from_samples(
        local(mesh).reshape(counts),
        origin=low,
        spacing=[axis[1] - axis[0] for axis in axes],
        geometry=geometry,
        interpolation=interpolation,
    )
    return DrawnReading(kind, contrast, field, _instrument(rng, geometry), nodes)


def check_reading(drawn: DrawnReading) -> ReadingCheck:
    """The response beside the truth."""
    found = fldi_response(drawn.field, drawn.instrument)
    axis = drawn.instrument.axis
    slant = float(np.hypot(axis[1], axis[2])) if drawn.field.geometry == "planar" else 1.0
    truth = true_phase(drawn.contrast, drawn.instrument, slant)
    return ReadingCheck(float(found.phase), float(found.error), truth)


def true_phase(contrast: Callable[[np.ndarray], np.ndarray], instrument: FLDI, slant: float = 1.0) -> float:
    """Phase of the detected light [rad] through air of closed form that ends within HALF of the origin on each axis.

    `slant` is the part of the beams' direction that leads out of the air: less than 1 in a planar one, endless along x.
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


def _air(rng: np.random.Generator, kind: str, axes: int, smallest: float) -> Callable[[np.ndarray], np.ndarray]:
    """Contrast at points (n, axes): of a kind, faded out at the faces, even across r = 0 by its window alone."""
    strength = _log_uniform(rng, 1e-8, 3e-6)
    count = int(rng.integers(1, 5))
    toward = rng.normal(size=(count, axes))
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    size = smallest * np.exp(rng.uniform(0.0, 1.0, count))
    place = rng.uniform(-0.5, 0.5, (count, axes)) * HALF
    share, turn = rng.uniform(-1.0, 1.0, count), rng.uniform(0.0, 2.0 * np.pi, count)

    def contrast(points: np.ndarray) -> np.ndarray:
        rest = np.clip((HALF - np.abs(points)) / (0.6 * HALF), 0.0, 1.0)
        inside = (rest > 0.0).all(axis=1)
        if not inside.all():
            found = np.zeros(len(points))
            if inside.any():
                found[inside] = contrast(points[inside])
            return found
        total = np.zeros(len(points))
        for each in range(count):
            if kind == "blobs":
                total += share[each] * np.exp(-((points - place[each]) ** 2).sum(axis=1) / (2.0 * size[each] ** 2))
                continue
            along = (points - place[each]) @ toward[each]
            if kind == "waves":
                total += share[each] * np.sin(np.pi * along / size[each] + turn[each])
            else:
                total += share[each] * np.tanh(2.0 * along / size[each])
        return np.asarray(strength * total * np.prod(np.sin(0.5 * np.pi * rest) ** 4, axis=1))

    return contrast


def _instrument(rng: np.random.Generator, geometry: str) -> FLDI:
    """An interferometer whose beams go through the box, never along a planar field's endless axis."""
    axis = rng.normal(size=3) * (0.3, 1.0, 1.0) if geometry == "planar" else rng.normal(size=3)
    waist = _log_uniform(rng, 4e-6, 1e-4)
    return FLDI(
        separation=_log_uniform(rng, 2e-5, 1e-3),
        waist=waist,
        focus=rng.uniform(-1.2, 1.2, 3) * (0.0 if geometry == "planar" else 1.0, 1.0, 1.0) * 0.5 * HALF,
        axis=axis,
        direction=np.cross(axis, rng.normal(size=3)),
        divergence=None if rng.random() < 0.5 else _log_uniform(rng, 3e-3, 0.1),
    )


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
