"""Ray bundles and pupils: where light starts, in which direction, and with what share of the whole."""

from dataclasses import dataclass, field

import numpy as np

from .read_only import ReadOnly
from .sobol import sobol_points

SAMPLINGS = ("sobol", "gauss", "grid", "random")


def as_vector(value, name: str) -> np.ndarray:
    """Return `value` as a finite float64 vector of shape (3,), or refuse it by name."""
    vector = np.asarray(value, dtype=np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{name} must be three finite numbers (x, y, z), got {value!r}")
    return vector


def as_unit_vector(value, name: str) -> np.ndarray:
    """Return `value` normalised to length 1, shape (3,), or refuse a zero one by name."""
    vector = as_vector(value, name)
    greatest = np.abs(vector).max()
    if greatest == 0.0:
        raise ValueError(f"{name} must not be the zero vector")
    # Scaled first: the square of a very long or short vector's length would overflow or vanish.
    vector = vector / greatest
    return vector / np.linalg.norm(vector)


def transverse_axes(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors that complete `normal` to a right-handed frame; x and y where `normal` is +z."""
    helper = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.9 else np.array([0.0, 0.0, 1.0])
    first = np.cross(helper, normal)
    first /= np.linalg.norm(first)
    return first, np.cross(normal, first)


def _check_count(count: int, what: str = "ray_count") -> int:
    if not isinstance(count, (int, np.integer)) or count < 1:
        raise ValueError(f"{what} must be a whole number of at least 1, got {count!r}")
    return int(count)


def unit_disc_samples(count: int, sampling: str, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points in the unit disc, shape (n, 2), and weights that sum to 1, shape (n,).

    "sobol" (scrambled, equal weights), "random" (equal weights) give exactly `count` points; "gauss" (Gauss-Legendre
    in r^2, equispaced in angle: exact for polynomials) and "grid" (the cells of a square grid whose centres lie in
    the disc) give about `count`.
    """
    count = _check_count(count)
    if sampling not in SAMPLINGS:
        raise ValueError(f"sampling {sampling!r} is not known: choose one of {', '.join(SAMPLINGS)}")
    if sampling == "grid":
        side = max(1, round(np.sqrt(4.0 * count / np.pi)))
        axis = (np.arange(side) + 0.5) * 2.0 / side - 1.0
        x, y = (a.ravel() for a in np.meshgrid(axis, axis, indexing="ij"))
        inside = x**2 + y**2 <= 1.0
        points = np.stack([x[inside], y[inside]], axis=1)
        return points, np.full(len(points), 1.0 / len(points))
    if sampling == "gauss":
        ring_count = max(1, round(np.sqrt(count / 4.0)))
        angle_count = max(1, round(count / ring_count))
        node, weight = np.polynomial.legendre.leggauss(ring_count)
        radius = np.sqrt(0.5 * (node + 1.0))
        angle = 2.0 * np.pi * (np.arange(angle_count) + 0.5) / angle_count
        points = np.stack([np.outer(radius, np.cos(angle)).ravel(), np.outer(radius, np.sin(angle)).ravel()], axis=1)
        return points, np.repeat(0.5 * weight / angle_count, angle_count)
    if sampling == "sobol":
        square = sobol_points(count, 2, seed)
    else:
        square = np.random.default_rng(seed).random((count, 2))
    radius, angle = np.sqrt(square[:, 0]), 2.0 * np.pi * square[:, 1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1), np.full(count, 1.0 / count)


@dataclass(frozen=True, eq=False)
class Disc:
    """A flat circular pupil.

    Attributes:
        radius: Radius [m].
        center: Centre [m], shape (3,).
        normal: Direction in which the pupil looks (made a unit vector), shape (3,).

    Raises:
        ValueError: A radius that is not positive, or a centre or normal that is not three finite numbers.
    """

    radius: float
    center: np.ndarray = field(default_factory=lambda: np.zeros(3))
    normal: np.ndarray = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    def __post_init__(self):
        """Check and normalise."""
        if not (np.isfinite(self.radius) and self.radius > 0.0):
            raise ValueError(f"the radius of a Disc must be positive, got {self.radius!r}")
        object.__setattr__(self, "center", as_vector(self.center, "Disc center"))
        object.__setattr__(self, "normal", as_unit_vector(self.normal, "Disc normal"))

    @property
    def area(self) -> float:
        """Area [m2]."""
        return float(np.pi * self.radius**2)

    @property
    def axes(self) -> tuple[np.ndarray, np.ndarray]:
        """The two unit vectors in the pupil's plane: x and y where it looks along z."""
        return transverse_axes(self.normal)

    def sample(self, count: int, sampling: str = "sobol", seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Points in the pupil [m], shape (n, 3), and weights that sum to 1, shape (n,)."""
        flat, weight = unit_disc_samples(count, sampling, seed)
        first, second = self.axes
        points = self.center + self.radius * (flat[:, :1] * first + flat[:, 1:] * second)
        return points, weight


@dataclass(frozen=True, eq=False)
class RayBundle(ReadOnly):
    """Rays to trace.

    Attributes:
        position: Start points [m], shape (ray_count, 3).
        direction: Unit tangents, shape (ray_count, 3); normalised here.
        weight: Share of each ray in means over the bundle, sums to 1, shape (ray_count,).

    Raises:
        ValueError: Shapes that disagree, numbers that are not finite, zero directions, negative weights.
    """

    position: np.ndarray
    direction: np.ndarray
    weight: np.ndarray | None = None

    def __post_init__(self):
        """Check, normalise, and make read-only copies."""
        position = np.atleast_2d(np.array(self.position, dtype=np.float64))
        direction = np.atleast_2d(np.array(self.direction, dtype=np.float64))
        if position.ndim != 2 or position.shape[1] != 3 or len(position) == 0:
            raise ValueError(f"ray positions must have shape (ray_count, 3), got {np.shape(self.position)}")
        if direction.ndim != 2 or direction.shape[1] != 3:
            raise ValueError(f"ray directions must have shape (ray_count, 3), got {np.shape(self.direction)}")
        if len(direction) == 1 and len(position) > 1:
            direction = np.repeat(direction, len(position), axis=0)
        if position.shape != direction.shape:
            raise ValueError(f"{len(position)} ray positions but {len(direction)} directions: give one for each")
        for name, array in (("position", position), ("direction", direction)):
            bad = ~np.isfinite(array).all(axis=1)
            if bad.any():
                raise ValueError(f"{bad.sum()} ray {name}s are not finite, the first is ray {int(np.argmax(bad))}")
        scale = np.abs(direction).max(axis=1)
        if (scale == 0.0).any():
            zero = int(np.argmax(scale == 0.0))
            raise ValueError(f"{int((scale == 0.0).sum())} ray directions are zero, the first is ray {zero}")
        # Directions that are unit vectors already stay as they are, to the last bit: a part of a bundle is that part.
        with np.errstate(over="ignore"):
            turned = ~(np.abs(np.linalg.norm(direction, axis=1) - 1.0) <= 4e-16)
        direction[turned] /= scale[turned, None]
        direction[turned] /= np.linalg.norm(direction[turned], axis=1, keepdims=True)
        weight = np.full(len(position), 1.0) if self.weight is None else np.array(self.weight, dtype=np.float64)
        if weight.shape != (len(position),) or not np.isfinite(weight).all() or (weight < 0).any() or weight.sum() <= 0:
            raise ValueError("ray weights must be finite, not negative and not all zero, one for each ray")
        for name, array in (("position", position), ("direction", direction), ("weight", weight / weight.sum())):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    @property
    def ray_count(self) -> int:
        """Number of rays."""
        return len(self.position)

    def __len__(self) -> int:
        """Number of rays."""
        return len(self.position)

    def __getitem__(self, rows) -> "RayBundle":
        """The rays of a slice or index array."""
        return RayBundle(self.position[rows], self.direction[rows], np.atleast_1d(np.asarray(self.weight)[rows]))

    @classmethod
    def collimated(
        cls, pupil: Disc, ray_count: int = 1024, *, direction=None, sampling: str = "sobol", seed: int = 0
    ) -> "RayBundle":
        """Parallel rays through a pupil, along its normal unless a `direction` is given."""
        points, weight = pupil.sample(ray_count, sampling, seed)
        along = pupil.normal if direction is None else as_unit_vector(direction, "direction")
        return cls(points, np.tile(along, (len(points), 1)), weight)

    @classmethod
    def divergent(
        cls, apex, axis, half_angle: float, ray_count: int = 1024, *, sampling: str = "sobol", seed: int = 0
    ) -> "RayBundle":
        """Rays from the point `apex` [m] into the cone of `half_angle` [rad] about `axis`, uniform in solid angle."""
        if not (0.0 < half_angle <= np.pi):
            raise ValueError(f"half_angle must lie in (0, pi] rad, got {half_angle!r}")
        flat, weight = unit_disc_samples(ray_count, sampling, seed)
        normal = as_unit_vector(axis, "axis")
        first, second = transverse_axes(normal)
        # Equal areas of the disc map to equal solid angles: 1 - cos(polar) is linear in the disc's r^2.
        squared = np.sum(flat**2, axis=1)
        lag = squared * 2.0 * np.sin(0.5 * half_angle) ** 2
        sine = np.sqrt(lag * (2.0 - lag))
        azimuth = np.arctan2(flat[:, 1], flat[:, 0])
        across = np.cos(azimuth)[:, None] * first + np.sin(azimuth)[:, None] * second
        direction = (1.0 - lag)[:, None] * normal + sine[:, None] * across
        return cls(np.tile(as_vector(apex, "apex"), (len(flat), 1)), direction, weight)

    @classmethod
    def through(
        cls,
        pupil: Disc,
        from_point,
        ray_count: int = 1024,
        *,
        sampling: str = "sobol",
        seed: int = 0,
        toward_point: bool = False,
    ) -> "RayBundle":
        """Rays from the point `from_point` [m] through the pupil's points.

        With `toward_point` the same lines are launched the other way: from the pupil's points toward the point,
        which by reciprocity see the same optical path.
        """
        points, weight = pupil.sample(ray_count, sampling, seed)
        apex = as_vector(from_point, "from_point")
        line = points - apex
        if toward_point:
            return cls(points, -line, weight)
        return cls(np.tile(apex, (len(points), 1)), line, weight)
