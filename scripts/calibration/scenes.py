"""Random scenes: a contrast at nodes or as averages of cells, its true integrals, a pupil and lines through the box.

A kind is made of words: turb3, turb5, turb8 (share of Nyquist in tenths), blob, shockA, shockB, shockC (tanh(x / w),
w of 0.1 to 0.5, 0.5 to 1.5 and 1.5 to 4 cells), ramp (in place of tanh), along (nearly in the planes of nodes), faded
(along z), planar, axi, across (axisymmetric, seen from the side), linear, averages.
"""

from dataclasses import dataclass

import numpy as np

from .truths import Formula, Sum, Waves

WIDTHS = {"A": (0.1, 0.5), "B": (0.5, 1.5), "C": (1.5, 4.0)}


@dataclass
class Scene:
    """A scene in units of cells.

    Attributes:
        data: Contrast at nodes, or averages of cells.
        truth: Its integrals along lines.
        geometry: "volume", "planar" or "axisymmetric".
        interpolation: Of the field.
        averages: Whether `data` are averages of cells.
        center: Centre of the pupil, in the middle of the box, shape (3,).
        way: Direction of the rays, shape (3,).
        radius: Radius of the pupil.
    """

    data: np.ndarray
    truth: object
    geometry: str
    interpolation: str
    averages: bool
    center: np.ndarray
    way: np.ndarray
    radius: float


def make(kind: str, seed: int) -> Scene:
    """Return a scene of a kind."""
    rng = np.random.default_rng([seed, sum(map(ord, kind))])
    averages = "averages" in kind
    count = 33 if averages else 49
    middle = 0.5 * (count - 1)
    geometry = "planar" if "planar" in kind else "axisymmetric" if "axi" in kind else "volume"
    radius = rng.uniform(6.0, 10.0) * (count - 1) / 48.0
    slant = np.tan(np.radians(rng.choice([0.0, rng.uniform(0.0, 10.0), rng.uniform(10.0, 25.0)])))
    turn = rng.uniform(0.0, 2.0 * np.pi) if geometry == "volume" else 0.5 * np.pi
    way = np.array([np.cos(turn) * slant, np.sin(turn) * slant, 1.0])
    center = np.full(3, middle)
    if geometry == "planar":
        center[0] = 0.0
    elif geometry == "volume":
        center[:2] += rng.uniform(-2.0, 2.0, 2)
    else:
        off = 0.0 if rng.random() < 0.3 else rng.uniform(0.0, middle - radius)
        center, way = np.array([0.0, off, middle]), np.array([0.0, 0.0, 1.0])
        if "across" in kind:
            center, way, radius = (
                np.array([rng.uniform(2.0, 8.0), 0.0, middle]),
                np.array([0.0, 1.0, 0.0]),
                rng.uniform(6.0, 10.0),
            )
    way = way / np.linalg.norm(way)
    parts = []
    if "turb" in kind:
        parts.append(
            Waves.random(rng, float(kind.split("turb")[1][0]) / 10.0, count, "faded" in kind, geometry == "planar")
        )
    if "blob" in kind:
        parts.append(Formula(_blobs(rng, geometry, center, radius, middle)))
    if "shock" in kind:
        parts.append(Formula(_shock(rng, kind, geometry, center, middle)))
    shape = (count,) * (3 if geometry == "volume" else 2)
    datas = [_data(part, geometry, shape, averages) for part in parts]
    factors = [1.0] * len(parts)
    if len(parts) == 2:
        factors[0] = float(rng.uniform(0.3, 2.0) / (4.0 * datas[0].std()))
    data = sum(factor * one for factor, one in zip(factors, datas, strict=True))
    truth = Sum(list(zip(factors, parts, strict=True)))
    return Scene(data, truth, geometry, "linear" if "linear" in kind else "cubic", averages, center, way, radius)


def _blobs(rng: np.random.Generator, geometry: str, center: np.ndarray, radius: float, middle: float):
    count = int(rng.integers(1, 6))
    width = np.exp(rng.uniform(0.0, np.log(8.0), count))
    place = center + rng.uniform(-1.0, 1.0, (count, 3)) * [radius, radius, 0.25 * middle]
    size = rng.choice([-1.0, 1.0], count) * rng.uniform(0.3, 1.0, count) / width
    ring = rng.uniform(0.0, radius, count)

    def call(points: np.ndarray) -> np.ndarray:
        found = np.zeros(points.shape[:-1])
        for k in range(count):
            if geometry == "axisymmetric":
                r, z = np.hypot(points[..., 0], points[..., 1]), (points[..., 2] - place[k, 2]) ** 2
                near = (np.exp(-((r + sign * ring[k]) ** 2 + z) / (2.0 * width[k] ** 2)) for sign in (-1.0, 1.0))
                found += size[k] * sum(near)
            else:
                first = 1 if geometry == "planar" else 0
                found += size[k] * np.exp(
                    -np.sum((points - place[k])[..., first:] ** 2, axis=-1) / (2.0 * width[k] ** 2)
                )
        return found

    return call


def _shock(rng: np.random.Generator, kind: str, geometry: str, center: np.ndarray, middle: float):
    width = np.exp(rng.uniform(*np.log(WIDTHS[kind.split("shock")[1][0]])))

    def profile(depth: np.ndarray) -> np.ndarray:
        if "ramp" in kind:
            return np.clip(0.5 + depth / (3.0 * width), 0.0, 1.0)
        return 0.5 + 0.5 * np.tanh(depth / width)

    if "along" not in kind and (geometry == "axisymmetric" or rng.random() < 0.4):
        big, apex = rng.uniform(15.0, 120.0), middle + rng.uniform(-3.0, 3.0)
        if "across" in kind:
            big, apex = rng.uniform(12.0, 26.0), middle - 10.0
        start = np.zeros(3) if geometry == "axisymmetric" else center * [1.0, 1.0, 0.0]
        start = start + np.array([0.0, 0.0, apex + big])
        if geometry == "volume":
            start[:2] += rng.uniform(-0.3, 0.3, 2) * big
        first = 1 if geometry == "planar" else 0
        return lambda points: profile(big - np.linalg.norm((points - start)[..., first:], axis=-1))
    slant = np.radians(rng.uniform(0.1, 3.0) if "along" in kind else rng.uniform(0.0, 70.0))
    turn = rng.uniform(0.0, 2.0 * np.pi) if geometry == "volume" else 0.5 * np.pi
    normal = np.array([np.sin(slant) * np.cos(turn), np.sin(slant) * np.sin(turn), np.cos(slant)])
    off = center @ normal + rng.uniform(-2.0, 2.0)
    return lambda points: profile(points @ normal - off)


def _data(part, geometry: str, shape: tuple[int, ...], averages: bool) -> np.ndarray:
    axes = [np.arange(float(count)) for count in shape]
    if isinstance(part, Waves) and not averages:
        return part.nodes(axes)
    sub, share = np.polynomial.legendre.leggauss(8) if averages else (np.zeros(1), np.full(1, 2.0))
    found = np.zeros(shape)
    for place in np.ndindex(*(len(sub),) * len(shape)):
        offset, weight = sub[list(place)] / 2.0, np.prod(share[list(place)] / 2.0)
        moved = [axis + one for axis, one in zip(axes, offset, strict=True)]
        if isinstance(part, Waves):
            found += weight * part.nodes(moved)
            continue
        points = np.stack(np.meshgrid(*moved, indexing="ij"), axis=-1)
        if len(shape) == 2:
            points = np.concatenate([np.zeros((*points.shape[:2], 1)), points], axis=-1)
        found += weight * part.call(points)
    return found
