"""Random rays through random fields on meshes that are not resampled: triangles cut in three, squares, bent squares.

`draw(seed)` makes a case that is determined by its seed alone.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import Delaunay

from aerokernels import IndexField, Plane, QuadMesh, RayBundle

FEATURES = ("blob", "layer", "shock", "noise", "waves", "smooth noise", "linear", "stripes")
MESHES = ("triangles", "triangles", "crowded triangles", "squares", "bent squares")
INTERPOLATIONS = ("bilinear", "bilinear", "bilinear", "bilinear-barron", "idw")
BUNDLES = ("along z", "tilted", "oblique", "fan", "crossing")
STOPS = ("slanted", "slanted", "steep", "right", "box", "far", "within")


@dataclass
class Case:
    """Rays through a field to a stop, with a tolerance in waves; `kind` names the random choices in words."""

    kind: str
    field: IndexField
    rays: RayBundle
    until: Plane | None
    tolerance: float


def draw(seed: int, ray_count: int) -> Case:
    """Return the case of a seed."""
    rng = np.random.default_rng([seed, 77])
    geometry, feature = str(rng.choice(["planar", "axisymmetric"])), str(rng.choice(FEATURES))
    shape, interpolation = str(rng.choice(MESHES)), str(rng.choice(INTERPOLATIONS))
    size, count = 0.02 * 10.0 ** rng.uniform(-0.5, 0.7), int(10.0 ** rng.uniform(1.7, 3.2))
    corner = size * np.array([-0.5 if geometry == "planar" else 0.0, -0.5])
    if "triangles" in shape:
        points, triangles = random_triangles(count, rng, shape == "crowded triangles")
        values = values_of(feature, points, rng)
        mesh, values = cut_in_three(size * points + corner, triangles, values, geometry)
    else:
        side = max(5, int(np.sqrt(count)))
        a, b = np.meshgrid(
            np.linspace(0.0, 1.0, side), np.linspace(0.0, 1.0, side + int(rng.integers(0, 5))), indexing="ij"
        )
        if shape == "bent squares":
            bump = np.sin(np.pi * a) * np.sin(np.pi * b)
            a = a + 0.12 * bump * np.sin(5.0 * b)
            b = b + 0.1 * bump * np.cos(4.0 * a)
        mesh = QuadMesh.structured(size * a + corner[0], size * b + corner[1], geometry)
        values = values_of(feature, np.stack([a.ravel(), b.ravel()], 1), rng)
    contrast = 10.0 ** rng.uniform(-6.0, -3.2) * rng.choice([-1.0, 1.0])
    ambient = float(rng.choice([1.0, 1.000273]))
    field = IndexField.from_mesh(mesh, contrast * values, ambient_index=ambient, interpolation=interpolation)
    rays, until, names = _rays_and_stop(field, size, ray_count, rng)
    kind = f"{geometry} {feature} on {shape}, {interpolation}, {len(mesh.cells)} cells, {names}"
    return Case(kind, field, rays, until, float(rng.choice([1e-2, 1e-3, 1e-4])))


def random_triangles(count: int, rng, crowded: bool) -> tuple[np.ndarray, np.ndarray]:
    """Points in the unit square, some of them crowded about a line, and the triangles between them."""
    side = np.linspace(0.0, 1.0, max(4, int(np.sqrt(count))))
    ends, inner = np.zeros_like(side), side[1:-1]
    edges = [(side, ends), (side, ends + 1.0), (ends[1:-1], inner), (ends[1:-1] + 1.0, inner)]
    points = rng.uniform(0.0, 1.0, (count, 2))
    if crowded:
        along, half = rng.uniform(0.0, 1.0, count // 2), count // 2
        points[:half] = np.stack([0.5 + 0.2 * (along - 0.5) + rng.normal(0.0, 0.03, half), along], 1)
        points = points[(points > 0.002).all(axis=1) & (points < 0.998).all(axis=1)]
    points = np.unique(np.concatenate([points, *(np.stack(edge, 1) for edge in edges)]), axis=0)
    triangles = Delaunay(points).simplices
    one, other = (points[triangles[:, k]] - points[triangles[:, 0]] for k in (1, 2))
    twice = one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0]
    longest = np.max([np.linalg.norm(edge, axis=1) for edge in (one, other, other - one)], axis=0)
    triangles[twice < 0.0] = triangles[twice < 0.0][:, ::-1]
    return points, triangles[np.abs(twice) > 1e-5 * longest**2]


def cut_in_three(points, triangles, values, geometry: str) -> tuple[QuadMesh, np.ndarray]:
    """Return a mesh of three quadrilaterals for each triangle, and values of which each triangle has a linear field."""
    ends = np.sort(np.concatenate([triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    edges, number = np.unique(ends, axis=0, return_inverse=True)
    ab, bc, ca = number.ravel().reshape(3, -1) + len(points)
    middle = np.arange(len(triangles)) + len(points) + len(edges)
    a, b, c = triangles.T
    cells = np.concatenate(
        [np.stack(part, 1) for part in ((a, ab, middle, ca), (b, bc, middle, ab), (c, ca, middle, bc))]
    )
    points, values = (np.concatenate([v, v[edges].mean(axis=1), v[triangles].mean(axis=1)]) for v in (points, values))
    return QuadMesh(points, cells, geometry), values


def values_of(feature: str, at: np.ndarray, rng) -> np.ndarray:
    """Values of the order of 1 at places in the unit square."""
    if feature == "blob":
        middle, width = rng.uniform(0.3, 0.7, 2), rng.uniform(0.1, 0.25, 2)
        return np.exp(-(((at - middle) / width) ** 2).sum(axis=1))
    if feature in ("layer", "shock"):
        angle = rng.uniform(0.0, 2.0 * np.pi)
        normal, width = np.array([np.cos(angle), np.sin(angle)]), 10.0 ** rng.uniform(-3.0, -1.0)
        depth = (at - rng.uniform(0.3, 0.7, 2)) @ normal
        return 0.5 * (1.0 + np.tanh(depth / width)) if feature == "layer" else (depth > 0.0).astype(float)
    if feature == "noise":
        return rng.uniform(-1.0, 1.0, len(at))
    if feature == "waves":
        waves = [(rng.normal(0.0, rng.uniform(1.0, 12.0), 2), rng.uniform(0.0, 7.0)) for _ in range(12)]
        return sum(np.cos(2.0 * np.pi * (at @ wave) + phase) for wave, phase in waves) / 6.0
    if feature == "smooth noise":
        return np.exp(-(((at - 0.5) / 0.2) ** 2).sum(axis=1)) + 0.05 * rng.uniform(-1.0, 1.0, len(at))
    if feature == "linear":
        return at @ rng.normal(0.0, 0.5, 2)
    return np.sin(2.0 * np.pi * rng.integers(2, 30) * at[:, 0]) * (1.0 + 0.3 * np.cos(3.0 * at[:, 1]))


def _rays_and_stop(field, size: float, count: int, rng) -> tuple[RayBundle, Plane | None, str]:
    low, high = (np.where(np.isfinite(end), end, side * size) for end, side in zip(field.box, (-0.5, 0.5), strict=True))
    middle, bundle = 0.5 * (low + high), str(rng.choice(BUNDLES))
    aim = rng.uniform(low + 0.02 * (high - low), high - 0.02 * (high - low), (count, 3))
    if bundle == "fan":
        heading = aim - (middle - [0.0, 0.0, 2.0 * size])
    elif bundle == "crossing":
        heading = rng.normal(0.0, 1.0, (count, 3)) * [0.3, 1.0, 1.0]
    elif bundle == "oblique":
        heading = np.tile(rng.normal(0.0, 1.0, 3) * [0.4, 1.0, 1.0], (count, 1))
    else:
        heading = np.tile([0.0, rng.normal(0.0, 0.15) if bundle == "tilted" else 0.0, 1.0], (count, 1))
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    start = aim - 3.0 * size * heading
    if bundle != "fan":
        start = aim - (((aim - middle) * heading).sum(axis=1) + 1.5 * size)[:, None] * heading
    stop, mean = str(rng.choice(STOPS)), heading.mean(axis=0) / np.linalg.norm(heading.mean(axis=0))
    across = np.cross(mean, rng.normal(0.0, 1.0, 3) if rng.random() < 0.4 else [1.0, 0.0, 0.0])
    across /= np.linalg.norm(across)
    slope = {"slanted": 0.1 * 10.0 ** rng.uniform(-0.5, 0.5), "steep": rng.uniform(0.5, 3.0), "right": 0.0}
    away = {"far": size * 10.0 ** rng.uniform(0.5, 2.0), "within": rng.uniform(-0.3, 0.3) * size}
    plane = Plane(middle + away.get(stop, 1.6 * size) * mean, mean + slope.get(stop, 0.1) * across)
    return RayBundle(start, heading), None if stop == "box" else plane, f"{bundle} to {stop}"
