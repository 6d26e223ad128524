"""Random fields that are formulas, sampled on grids: what the coverage of an error budget is counted on.

Planar fields on 24 to 64 nodes a side and volumes on 24 to 40: "smooth" (random plane waves, 6 to 20 cells long),
"shocked" (tanh layers, curved and aslant, 0.2 to 6 cells thick, over a smooth background) or "noisy" (smooth plus white
noise of the samples, which the formula does not have). Rays from z = 0 within 0.1 rad of the axis.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerokernels.benchmark.scenes import Formula, integrate, potential_of
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle

CELL = 1e-4
KINDS = ("smooth", "shocked", "noisy")
Value = Callable[..., np.ndarray]


@dataclass(frozen=True, eq=False)
class DrawnField:
    """A field and its formula.

    Attributes:
        kind: Of KINDS.
        value: The contrast of the formula at (x, y, z) [m]; the ambient index is 1.
        field: Its samples, cubic, linear or monotone.
        length: Side of the box [m].
        thinnest: Thickness of its finest layer [m].
    """

    kind: str
    value: Value
    field: IndexField
    length: float
    thinnest: float

    def rays(self, ray_count: int, seed: int) -> RayBundle:
        """Rays from z = 0, within 0.1 rad of the axis."""
        rng = np.random.default_rng([seed, 1])
        position = np.c_[rng.uniform(-0.3, 0.3, (ray_count, 2)) * self.length, np.zeros(ray_count)]
        slope = rng.uniform(-0.1, 0.1, (ray_count, 2))
        return RayBundle(position, np.c_[slope, np.ones(ray_count)])

    def exact_opd(self, rays: RayBundle) -> np.ndarray:
        """OPD [m] of the formula's own rays on the plane z = `length`, to 1e-7 wave, shape (ray_count,)."""
        potential = potential_of(complex_slopes(self.value), 1.0)
        longest = min(2.0 * CELL, self.thinnest)
        return integrate(potential, 1.0, self.length, longest, rays, tolerance=1e-8).opd


def complex_slopes(value: Value) -> Formula:
    """An analytic function of (x, y, z) with its derivatives by x and y, by complex steps: exact to rounding."""
    step = 1e-20

    def formula(x, y, z):
        # Both slopes by one call, as in `smooth_formula`.
        across_x, across_y = np.array([[1j * step], [0.0]]), np.array([[0.0], [1j * step]])
        ahead = value(x + across_x, y + across_y, z)
        return ahead[0].real, ahead.imag / step

    return formula


def smooth_formula(rng, amplitude: float, longest: float, shortest: float):
    """A sum of plane waves in y and z [m] (and x), faded to nothing nowhere: value and slope across."""
    drawn = [(rng.normal(size=3), rng.uniform(0.0, 2.0 * np.pi), rng.uniform(shortest, longest)) for _ in range(5)]
    waves = np.array([2.0 * np.pi / length / np.linalg.norm(way) * way for way, _, length in drawn])
    phases = np.array([phase for _, phase, _ in drawn])

    def value(x, y, z):
        # All waves by one call: for few rays it is calls that cost.
        rows = (-1, *(1,) * np.ndim(x))
        along_x, along_y, along_z, phase = (each.reshape(rows) for each in (*waves.T, phases))
        return amplitude / len(waves) * np.sin(along_x * x + along_y * y + (along_z * z + phase)).sum(axis=0)

    return value


def shock_formula(rng, amplitude: float, thickness: float, middle: float):
    """A curved tanh layer aslant to the axis."""
    slope, curve, place = rng.uniform(-0.8, 0.8), rng.uniform(-100.0, 100.0), middle * rng.uniform(0.6, 1.4)
    tilt = rng.uniform(-0.3, 0.3)

    def value(x, y, z):
        distance = (z - place - slope * y - tilt * x - curve * y * y) / np.sqrt(1.0 + slope**2 + tilt**2)
        return amplitude * 0.5 * (1.0 + np.tanh(distance / thickness))

    return value


def draw(kind: str, in_volume: bool, seed: int) -> DrawnField:
    """The field of a kind and seed, a volume or planar."""
    rng = np.random.default_rng(seed)
    count = rng.integers(24, 40 if in_volume else 64)
    amplitude = 10.0 ** rng.uniform(-5.0, -3.3)
    size = CELL * (count - 1)
    z = CELL * np.arange(count)
    y = z - 0.5 * size
    thickness = CELL * 10.0 ** rng.uniform(np.log10(0.2), np.log10(6.0)) if kind == "shocked" else size
    shortest = CELL * rng.uniform(6.0, 12.0)
    background = smooth_formula(rng, amplitude * (0.3 if kind == "shocked" else 1.0), 2.0 * shortest, shortest)
    layer = shock_formula(rng, amplitude, thickness, 0.5 * size) if kind == "shocked" else None

    def value(px, py, pz):
        px = px if in_volume else 0.0 * px
        total = background(px, py, pz)
        return total if layer is None else total + layer(px, py, pz)

    interpolation = str(rng.choice(["cubic", "cubic", "linear", "monotone"]))
    axes = (y, y, z) if in_volume else (y, z)
    nodes = np.meshgrid(*axes, indexing="ij")
    samples = value(*nodes) if in_volume else value(np.zeros_like(nodes[0]), *nodes)
    if kind == "noisy":
        samples = samples + 0.05 * amplitude * rng.standard_normal(samples.shape)
    field = IndexField.from_samples(
        samples,
        origin=tuple(axis[0] for axis in axes),
        spacing=(CELL,) * len(axes),
        geometry="volume" if in_volume else "planar",
        interpolation=interpolation,
    )
    return DrawnField(kind, value, field, float(z[-1]), thickness)
