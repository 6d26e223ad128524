"""Random bundles through random fields of every kind.

`draw(seed)` makes a case: geometry, field, stop, bundle, method, precision and tolerance, determined by its seed alone.
bundle_check.py traces it and compares it with the reference.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane

WAVE = 905e-9
GEOMETRIES = ("volume", "planar", "axisymmetric")
FEATURES = ("blob", "corner", "layer", "cells", "noise", "waves", "everywhere")
STOPS = ("box", "within", "face", "beyond", "far", "arc")
BUNDLES = ("along z", "beam", "beam from within", "fan", "crossing", "faces", "spanwise", "mixed")


@dataclass
class Case:
    """One bundle through one field; `kind` names the random choices in words."""

    seed: int
    kind: dict[str, str]
    field: IndexField
    rays: RayBundle
    settings: dict = field(default_factory=dict)

    def __str__(self) -> str:
        """Describe the case in one line."""
        return f"seed {self.seed}: " + ", ".join(self.kind.values())


def draw(seed: int, **fixed: str) -> Case:
    """Return the case of a seed; `fixed` holds entries of `kind` that replace random ones."""
    rng = np.random.default_rng([seed, 20])

    def pick(name, options, shares=None) -> str:
        drawn = str(rng.choice(options, p=shares))
        return fixed.get(name, drawn)

    kind = {"geometry": pick("geometry", GEOMETRIES), "feature": pick("feature", FEATURES)}
    kind["contrast"] = pick("contrast", ("2^-30", "1e-6", "1e-5", "1e-4", "1e-3"), (0.15, 0.15, 0.25, 0.3, 0.15))
    kind["interpolation"] = pick("interpolation", ("cubic", "monotone", "linear"), (0.9, 0.05, 0.05))
    kind["stop"] = pick("stop", STOPS)
    kind["bundle"] = pick("bundle", BUNDLES)
    kind["count"] = pick("count", ("300", "5000"))
    kind["method"] = pick("method", ("auto", "adaptive"), (0.75, 0.25))
    kind["precision"] = pick("precision", ("float32", "float64"))
    kind["tolerance"] = pick("tolerance", ("1e-2", "1e-3", "1e-4"), (0.2, 0.6, 0.2))
    medium = _draw_field(kind, rng)
    rays = _draw_rays(kind, medium, rng)
    settings = {
        "until": _draw_stop(kind, medium, rays, rng),
        "method": kind["method"],
        "precision": kind["precision"],
        "tolerance": float(kind["tolerance"]),
        "wavelength": WAVE,
    }
    return Case(seed, kind, medium, rays, settings)


def _draw_field(kind, rng) -> IndexField:
    """A field of 12 to 49 nodes a side, 1e-5 to 1e-3 m apart."""
    axes = 3 if kind["geometry"] == "volume" else 2
    # Few enough nodes that the reference is fast.
    shape = rng.integers(12, 26 if axes == 3 else 50, axes)
    if axes == 3 and kind["count"] == "300":
        shape = rng.integers(9, 14, 3)
    spacing = 10.0 ** rng.uniform(-5.0, -3.0) * 2.0 ** rng.uniform(-0.5, 0.5, axes)
    origin = -0.5 * spacing * (shape - 1) + rng.choice([0.0, 1.0]) * rng.normal(0.0, 1.0, axes) * spacing * shape
    if kind["geometry"] == "axisymmetric":
        origin[0] = 0.0
    size = float(2.0**-30 if kind["contrast"] == "2^-30" else kind["contrast"]) * rng.choice([-1.0, 1.0])
    return IndexField.from_samples(
        size * _shape_of(kind["feature"], shape, rng),
        origin=origin,
        spacing=spacing,
        geometry=kind["geometry"],
        ambient_index=float(rng.choice([1.0, 1.000273, 1.33], p=[0.4, 0.4, 0.2])),
        interpolation=kind["interpolation"],
    )


def _shape_of(feature: str, shape, rng) -> np.ndarray:
    """Samples of absolute value at most 1."""
    nodes = np.stack(np.meshgrid(*[np.arange(n, dtype=float) for n in shape], indexing="ij"), axis=-1)
    last = shape - 1.0
    if feature == "everywhere":
        return np.exp(-np.abs(nodes @ (rng.normal(0.0, 1.0, len(shape)) / last)))
    if feature == "noise":
        return rng.uniform(-1.0, 1.0, shape)
    if feature == "waves":
        smooth = gaussian_filter(rng.standard_normal(shape), rng.uniform(1.0, 4.0), mode="nearest")
        return smooth / np.abs(smooth).max()
    if feature == "layer":
        normal = rng.normal(0.0, 1.0, len(shape))
        normal /= np.linalg.norm(normal)
        depth = (nodes - rng.uniform(0.3, 0.7, len(shape)) * last) @ normal
        return 0.5 * (1.0 + np.tanh(depth / rng.uniform(0.2, 2.0)))
    if feature == "cells":
        total = np.zeros(shape)
        for _ in range(int(rng.integers(1, 4))):
            middle = rng.uniform(0.1, 0.9, len(shape)) * last
            total += np.exp(-np.sum(((nodes - middle) / rng.uniform(0.6, 1.5)) ** 2, axis=-1))
        return total / max(1.0, total.max())
    middle = rng.uniform(0.3, 0.7, len(shape)) * last
    width = rng.uniform(0.1, 0.25) * last
    if feature == "corner":
        middle = rng.choice([0.12, 0.88], len(shape)) * last
        width = rng.uniform(0.04, 0.1) * last + 0.5
    return np.exp(-np.sum(((nodes - middle) / width) ** 2, axis=-1))


def box_of(medium: IndexField) -> tuple[np.ndarray, np.ndarray]:
    """The corners of a field's box [m]; where it has no end in x, as far as in its other directions."""
    low, high = medium.box
    reach = 0.5 * (high[1:] - low[1:]).max()
    return np.where(np.isfinite(low), low, -reach), np.where(np.isfinite(high), high, reach)


def _draw_rays(kind, medium, rng) -> RayBundle:
    count, (low, high) = int(kind["count"]), box_of(medium)
    size, middle = high - low, 0.5 * (low + high)
    diagonal = float(np.linalg.norm(size))

    def inside(n):
        return rng.uniform(low, high, (n, 3))

    def beam(n, from_within=False):
        """Parallel rays at any angle that start in one plane."""
        if kind["bundle"] == "along z" or rng.random() < 0.3:
            along = np.array([0.0, 0.0, rng.choice([-1.0, 1.0])])
            if kind["bundle"] != "along z":
                along[:2] = rng.normal(0.0, 0.05, 2)
        else:
            along = rng.normal(0.0, 1.0, 3)
        along /= np.linalg.norm(along)
        aim = inside(n)
        start = aim - ((aim - middle) @ along)[:, None] * along  # in the plane through the middle
        away = 0.0 if from_within else diagonal * rng.uniform(0.3, 1.5)
        if kind["bundle"] == "along z":
            away = (0.5 * size[2] + diagonal * rng.uniform(0.0, 0.5)) * rng.choice([1.0, 1.0, 0.3])
        return start - away * along, np.tile(along, (n, 1))

    def fan(n):
        apex = middle + diagonal * rng.uniform(0.4, 1.5) * _directions(rng, 1)[0]
        return np.tile(apex, (n, 1)), inside(n) - apex

    def crossing(n):
        """From places outside, inside and on faces to places inside: every face at every angle, some beside the box."""
        start = middle + rng.uniform(-1.0, 1.0, (n, 3)) * size * rng.choice([0.5, 0.9], n)[:, None]
        aim = inside(n) + rng.choice([0.0, 0.3], n)[:, None] * rng.normal(0.0, 1.0, (n, 3)) * size
        return start, aim - start

    def faces(n):
        """On the faces, along them, and within a hundredth of a cell of them."""
        start, along = inside(n), _directions(rng, n)
        axis, rows = rng.integers(0 if kind["geometry"] != "planar" else 1, 3, n), np.arange(n)
        off = rng.choice([0.0, 0.0, 1e-9, 1e-2, -1e-2], n) * float(np.min(medium.spacing))
        start[rows, axis] = np.where(rng.random(n) < 0.5, low[axis] + off, high[axis] - off)
        along[rows, axis] *= rng.choice([0.0, 1e-6, 1e-3, 1.0], n)
        return start - rng.choice([0.0, 1.0], n)[:, None] * 0.5 * diagonal * along, along

    def spanwise(n):
        along = np.concatenate(
            [np.ones((n, 1)), 10.0 ** rng.uniform(-5.0, -1.0) * rng.normal(0.0, 1.0, (n, 2))], axis=1
        )
        start = inside(n)
        start[:, 0] = low[0]
        return start, along * rng.choice([-1.0, 1.0])

    makers: Any = {
        "along z": [beam],
        "beam": [beam],
        "beam from within": [lambda n: beam(n, True)],
        "fan": [fan],
        "crossing": [crossing],
        "faces": [faces],
        "spanwise": [spanwise],
        "mixed": [beam, fan, crossing, faces],
    }[kind["bundle"]]
    parts = [make(count // len(makers)) for make in makers]
    return RayBundle(np.concatenate([p for p, _ in parts]), np.concatenate([d for _, d in parts]))


def _directions(rng, count) -> np.ndarray:
    along = rng.normal(0.0, 1.0, (count, 3))
    return along / np.linalg.norm(along, axis=1)[:, None]


def _draw_stop(kind, medium, rays, rng):
    low, high = box_of(medium)
    diagonal = float(np.linalg.norm(high - low))
    if kind["stop"] == "box":
        return None
    if kind["stop"] == "arc":
        return ArcLength(diagonal * rng.choice([0.3, 1.0, 5.0]))
    along = rays.direction.mean(axis=0)
    along = along / np.linalg.norm(along) if np.linalg.norm(along) > 0.1 else np.array([0.0, 0.0, 1.0])
    # Perpendicular to the bundle, or oblique by up to 85 degrees.
    across = np.cross(along, _directions(rng, 1)[0])
    across /= np.linalg.norm(across)
    obliquity = np.tan(np.deg2rad(rng.choice([0.0, rng.uniform(0.0, 60.0), rng.uniform(60.0, 85.0)])))
    normal = along + obliquity * across
    if abs(along[2]) == 1.0 and rng.random() < 0.7:
        normal = np.array([0.0, 0.0, 1.0])
    middle = 0.5 * (low + high)
    if kind["stop"] == "within":
        return Plane(rng.uniform(low, high), normal)
    if kind["stop"] == "face":
        axis = int(np.abs(along).argmax())
        return Plane(np.where(along > 0.0, high, low), np.eye(3)[axis])
    # A spanwise path may be inside the field over its whole length, so the farthest planes are not used for it.
    farthest = 1.5 if kind["bundle"] == "spanwise" else 4.0
    way = diagonal * (rng.uniform(0.5, 3.0) if kind["stop"] == "beyond" else 10.0 ** rng.uniform(1.0, farthest))
    return Plane(middle + way * along, normal)
