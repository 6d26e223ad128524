"""Random air of closed form, and its samples on a grid, for testing results on sampled fields.

Three kinds, each faded out at the faces of its box: "waves" (sine waves of random directions), "blobs" (Gaussians) and
"layers" (tanh layers, like shocks). Each is sampled on a grid of 1.5 to 12 nodes to its smallest length, in any
geometry, with any interpolant of grids.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from aerokernels.medium import IndexField

KINDS = ("waves", "blobs", "layers")
GEOMETRIES = ("planar", "axisymmetric", "volume")
INTERPOLATIONS = ("cubic", "linear", "monotone")
# Half the box [m], and the greatest number of nodes along a side: volumes are sampled less finely.
HALF, MOST_NODES, MOST_NODES_VOLUME = 4e-3, 241, 65


@dataclass(frozen=True, eq=False)
class DrawnAir:
    """Air of closed form and its samples.

    Attributes:
        kind: A name from KINDS.
        contrast: The closed form, of points (n, 3) [m]; zero outside a box of HALF to either side.
        field: Its samples.
        nodes: Nodes to its smallest length.
        smallest: That length [m].
    """

    kind: str
    contrast: Callable[[np.ndarray], np.ndarray]
    field: IndexField
    nodes: float
    smallest: float


def draw_air(
    rng: np.random.Generator, strengths: tuple[float, float], kind: str | None = None, geometry: str | None = None
) -> DrawnAir:
    """Random air of a kind and in a geometry, or of any; its contrast is between two `strengths`."""
    kind = KINDS[rng.integers(len(KINDS))] if kind is None else kind
    geometry = GEOMETRIES[rng.integers(len(GEOMETRIES))] if geometry is None else geometry
    interpolation = INTERPOLATIONS[rng.choice(3, p=(0.6, 0.2, 0.2))]
    nodes = log_uniform(rng, 1.5, 12.0)
    most = MOST_NODES_VOLUME if geometry == "volume" else MOST_NODES
    smallest = max(log_uniform(rng, 1e-4, 2e-3), 2.0 * HALF * nodes / (most - 1))
    local = _closed_form(rng, kind, {"volume": 3}.get(geometry, 2), smallest, strengths)

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
    return DrawnAir(kind, contrast, field, nodes, smallest)


def _closed_form(
    rng: np.random.Generator, kind: str, axes: int, smallest: float, strengths: tuple[float, float]
) -> Callable[[np.ndarray], np.ndarray]:
    """Contrast at points (n, axes) of a kind, faded out at the faces; only its window is even across r = 0."""
    strength = log_uniform(rng, *strengths)
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


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A random number whose logarithm is uniform between those of two numbers."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))
