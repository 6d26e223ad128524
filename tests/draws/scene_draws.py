"""Random scenes that combine features which are difficult to trace, each with its truth.

The air is a sum of Gaussian blobs and tanh layers, some of them one cell thin (needles, thin shocks), sampled on a grid
of 24 to 72 nodes a side that may be too coarse for them, in a box that may cut the disturbed air, with or without a
round body; volume, planar or axisymmetric. Rays are collimated, slanted, divergent or in random directions, and there
is a pupil.

Truth: the formula instead of the grid: rays of the exact medium by the fourth-order Runge-Kutta method in small fixed
steps, from where they leave the body (an exact circle) to the stop. The box is the whole flow: the formula counts
between the places where the straight ray enters and leaves it, which a bent ray misses by a part in 1e5 of a step.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aerokernels.medium import Body, IndexField
from aerokernels.rays import Disc, RayBundle
from aerokernels.tracing import Plane
from aerokernels.tracing.lines import box_span
from aerokernels.tracing.stop import plane_beyond

RAYS = 5000
WAVELENGTH = 905e-9
PUPIL_POINTS = 9600


@dataclass(frozen=True)
class Air:
    """A sum of features: contrast n - 1 and its gradient, as a formula of the place [m].

    Attributes:
        geometry: "volume", "planar" or "axisymmetric".
        blobs: Rows of (amplitude, centre (3), inverse widths (3)) of Gaussians.
        layers: Rows of (amplitude, unit normal (3), offset, thickness) of tanh layers.
        thinnest: Width of the finest feature [m].
    """

    geometry: str
    blobs: np.ndarray
    layers: np.ndarray
    thinnest: float

    def local(self, point: np.ndarray) -> np.ndarray:
        """Coordinates in which the features are defined, shape (n, 3)."""
        if self.geometry == "planar":
            return point * [0.0, 1.0, 1.0]
        if self.geometry == "axisymmetric":
            radius = np.hypot(point[:, 0], point[:, 1])
            return np.stack([np.zeros_like(radius), radius, point[:, 2]], axis=1)
        return point

    def contrast(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Contrast, shape (n,), and its gradient [1/m], shape (n, 3)."""
        place = self.local(point)
        value = np.zeros(len(point))
        slope = np.zeros((len(point), 3))
        for row in self.blobs:
            for mirror in (1.0, -1.0) if self.geometry == "axisymmetric" and row[2] != 0.0 else (1.0,):
                # A ring off the axis is the sum of two blobs, so that the field is even in r.
                off = (place - row[1:4] * [1.0, mirror, 1.0]) * row[4:7]
                here = row[0] * np.exp(-np.einsum("ij,ij->i", off, off))
                value += here
                slope -= 2.0 * here[:, None] * off * row[4:7]
        for row in self.layers:
            shape = np.tanh((place @ row[1:4] - row[4]) / row[5])
            value += row[0] * 0.5 * (1.0 + shape)
            slope += (row[0] * 0.5 * (1.0 - shape**2) / row[5])[:, None] * row[1:4]
        if self.geometry == "planar":
            slope[:, 0] = 0.0  # the features have slopes along x if their centres are off the plane x = 0
        if self.geometry == "axisymmetric":
            radius = np.where(place[:, 1] > 0.0, place[:, 1], 1.0)
            slope = np.stack([slope[:, 1] * point[:, 0] / radius, slope[:, 1] * point[:, 1] / radius, slope[:, 2]], 1)
        return value, slope


def true_opd(
    air: Air, start: np.ndarray, direction: np.ndarray, stop: Plane, step: float, field: IndexField | None = None
) -> np.ndarray:
    """OPD [m] at the plane of rays of the exact medium, ambient index 1, shape (n,).

    In deviation form along the straight ray: t is the distance along it, `turn` and `place` are the deviations of
    momentum and position. Outside the box of the field, if one is given, the air is ambient.
    """
    whole = ((stop.point - start) @ stop.normal) / (direction @ stop.normal)
    begin, end = np.zeros(len(start)), whole
    if field is not None:
        span = box_span(field, start, direction)
        begin = np.where(span.meets, np.minimum(span.enter, whole), 0.0)
        end = np.where(span.meets, np.minimum(span.leave, whole), 0.0)
    start = start + begin[:, None] * direction
    reach, whole = end - begin, whole - begin
    count = max(8, int(np.ceil(float(reach.max()) / step)))
    h = (reach / count)[:, None]
    place = np.zeros_like(start)  # deviation from the straight ray
    turn = np.zeros_like(start)  # n dr/ds less its first value
    first, _ = air.contrast(start)
    turn += first[:, None] * direction
    path = np.zeros(len(start))

    def rate(t, place, turn):
        m, slope = air.contrast(start + t * direction + place)
        index = (1.0 + m)[:, None]
        momentum = direction + turn
        ahead = np.einsum("ij,ij->i", momentum, direction)[:, None]
        # Everything per unit of t, the distance along d: dr/dt = T / (T . d).
        return (momentum / ahead - direction, index * slope / ahead, (index**2 / ahead)[:, 0] - 1.0)

    t = np.zeros((len(start), 1))
    for _ in range(count):
        a = rate(t, place, turn)
        b = rate(t + 0.5 * h, place + 0.5 * h * a[0], turn + 0.5 * h * a[1])
        c = rate(t + 0.5 * h, place + 0.5 * h * b[0], turn + 0.5 * h * b[1])
        d = rate(t + h, place + h * c[0], turn + h * c[1])
        place = place + h / 6.0 * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
        turn = turn + h / 6.0 * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
        path = path + h[:, 0] / 6.0 * (a[2] + 2.0 * b[2] + 2.0 * c[2] + d[2])
        t = t + h
    # The ray is beside the straight one at the same t: the remaining distance to the plane is flown straight.
    heading = direction + turn
    m, _ = air.contrast(start + t * direction + place)
    rest = -(place @ stop.normal) / (heading @ stop.normal)
    near = path + rest * np.linalg.norm(heading, axis=1) * (1.0 + m)
    if field is None:
        return near
    unit = heading / np.linalg.norm(heading, axis=1)[:, None]
    ahead = (stop.point - start - t * direction - place) @ stop.normal / (unit @ stop.normal)
    beyond = np.where(reach > 0.0, path + ahead - (whole - reach), 0.0)
    return np.where(reach < whole, beyond, near)


@dataclass(frozen=True)
class Scene:
    """A random scene."""

    seed: int
    air: Air
    field: IndexField
    rays: RayBundle
    pupil: Disc
    look: np.ndarray
    stop: Plane
    far: Plane
    sphere: tuple[np.ndarray, float] | None
    kind: str

    def leave_body(self, start: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Starts moved to where rays leave the body, and which rays the body blocks."""
        if self.sphere is None:
            return start, np.zeros(len(start), dtype=bool)
        centre, radius = self.sphere
        keep = np.array([0.0, 1.0, 1.0]) if self.air.geometry == "planar" else np.ones(3)
        off, way = (start - centre) * keep, direction * keep
        a, b = np.einsum("ij,ij->i", way, way), np.einsum("ij,ij->i", off, way)
        c = np.einsum("ij,ij->i", off, off) - radius**2
        root = np.sqrt(np.maximum(b * b - a * c, 0.0))
        inside = c < 0.0
        leave = np.where(inside, (-b + root) / a, 0.0)
        blocked = ~inside & (b * b > a * c) & (-b - root > 0.0)
        return start + leave[:, None] * direction, blocked

    @property
    def step(self) -> float:
        """Step of the true rays [m]."""
        return min(0.5 * self.air.thinnest, 0.5e-3)

    @cached_property
    def true_strehl(self) -> tuple[float, float] | None:
        """Strehl ratio over PUPIL_POINTS points, and its sampling error; None where the body blocks all of them."""
        count = np.arange(PUPIL_POINTS) + 0.5
        radius, angle = self.pupil.radius * np.sqrt(count / PUPIL_POINTS), np.pi * (1.0 + 5.0**0.5) * count
        side = np.cross(self.look, [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        other = np.cross(self.look, side)
        position = self.pupil.center + np.outer(radius * np.cos(angle), side) + np.outer(radius * np.sin(angle), other)
        direction = np.tile(self.look, (PUPIL_POINTS, 1))
        start, blocked = self.leave_body(position, direction)
        if blocked.all():
            return None
        opd = true_opd(self.air, start[~blocked], direction[~blocked], self.far, self.step, self.field)
        phasor = np.exp(2j * np.pi / WAVELENGTH * opd)
        halves = [float(np.abs(phasor[k::2].mean()) ** 2) for k in (0, 1)]
        # Estimated sampling error, with twice as many points as either half.
        return float(np.abs(phasor.mean()) ** 2), 0.5 * abs(halves[0] - halves[1])


def draw(seed: int) -> Scene:
    """A random scene."""
    rng = np.random.default_rng(seed)
    geometry = str(rng.choice(["volume", "planar", "axisymmetric"]))
    half, length = rng.uniform(4e-3, 8e-3), rng.uniform(10e-3, 25e-3)
    nodes = int(rng.integers(24, 49 if geometry == "volume" else 97))
    cell = 2.0 * half / nodes
    air = _air(rng, geometry, half, length, cell)
    cut = rng.random() < 0.3
    margin = 1.0 if cut else 2.2
    wide, long = half * margin, length * margin
    along, across = int(np.ceil(long / cell)), int(np.ceil(2.0 * wide / cell))
    z = cell * np.arange(along + 1) - 0.5 * cell * along
    y = cell * np.arange(across + 1) - 0.5 * cell * across
    if geometry == "axisymmetric":
        y = cell * np.arange(across // 2 + 1)
    axes = (y, y, z) if geometry == "volume" else (y, z)
    nodes_at = np.meshgrid(*axes, indexing="ij")
    point = np.stack([n.ravel() for n in (*[np.zeros_like(nodes_at[0])] * (3 - len(axes)), *nodes_at)], axis=1)
    samples = air.contrast(point)[0].reshape(nodes_at[0].shape)
    sphere = body = None
    if geometry != "volume" and rng.random() < 0.3:
        radius = half * rng.uniform(0.2, 0.45)
        sphere = (np.array([0.0, 0.0, -0.5 * length * rng.uniform(0.2, 0.8)]), radius)
        angle = np.linspace(0.0, np.pi if geometry == "axisymmetric" else 2.0 * np.pi, 1001)
        profile = np.stack([radius * np.sin(angle), sphere[0][2] + radius * np.cos(angle)], axis=1)
        if geometry == "axisymmetric":
            profile[[0, -1], 0] = 0.0
        body = Body(profile if geometry == "axisymmetric" else profile[:-1], geometry)
    field = IndexField.from_samples(
        samples,
        origin=tuple(axis[0] for axis in axes),
        spacing=(cell,) * len(axes),
        geometry=geometry,
        body=body,
        interpolation=str(rng.choice(["cubic", "cubic", "cubic", "linear", "monotone"])),
    )
    kind = str(rng.choice(["along z", "slanted", "divergent", "without order"]))
    begin = -0.5 * length * rng.uniform(0.9, 1.3)
    rays = _rays(rng, kind, half * rng.uniform(0.3, 0.8), begin)
    centre = np.array([0.0, 0.0, begin]) if sphere is None or rng.random() < 0.5 else sphere[0]
    radius = half * rng.uniform(0.2, 0.7) if sphere is None or centre[2] == begin else 0.6 * sphere[1]
    tilt = rng.choice([0.0, 0.0, 0.1, 0.4])
    look = np.array([0.0, np.sin(tilt), np.cos(tilt)])
    angle = rng.choice([0.0, 0.0, 0.3, 1.0])
    normal = np.array([0.0, np.sin(angle), np.cos(angle)])
    stop = Plane((0.0, 0.0, 0.5 * length * margin * rng.uniform(1.0, 1.5) + half * np.tan(angle)), normal)
    # The wavefront of a pupil is taken at the plane of the estimate, just beyond the box: farther on it changes.
    far = plane_beyond(field, Disc(radius, centre, look), look)
    described = f"{geometry} {field.interpolation} {nodes} nodes{' cut' * cut}{' body' * (body is not None)} {kind}"
    return Scene(seed, air, field, rays, Disc(radius, centre, look), look, stop, far, sphere, described)


def _air(rng, geometry: str, half: float, length: float, cell: float) -> Air:
    blobs, layers, thinnest = [], [], half
    strength = 10.0 ** rng.uniform(-6.0, -3.7)
    for _ in range(rng.integers(1, 5)):
        width = half * rng.uniform(0.25, 0.6)
        blobs.append(_blob(rng, geometry, half, length, strength * rng.uniform(-1.0, 1.0), width))
        thinnest = min(thinnest, width)
    for _ in range(rng.choice([0, 0, 1, 3])):  # about one cell wide, so that few rays meet it
        width = cell * rng.uniform(0.7, 2.0)
        blobs.append(_blob(rng, geometry, half, length, strength * rng.uniform(-1.0, 1.0), width))
        thinnest = min(thinnest, width)
    if rng.random() < 0.3:
        thickness = cell * 10.0 ** rng.uniform(-0.3, 1.0)
        angle = 0.5 * np.pi if geometry == "axisymmetric" else rng.uniform(0.2, 2.9)
        normal = [0.0, np.cos(angle), np.sin(angle)]
        # The layer is on the side of the start and ends in undisturbed air ahead.
        layers.append([strength * rng.uniform(-0.5, 0.5), *(-np.array(normal)), -0.2 * half, thickness])
        thinnest = min(thinnest, thickness)
    return Air(geometry, np.array(blobs), np.array(layers).reshape(-1, 6), thinnest)


def _blob(rng, geometry: str, half: float, length: float, amplitude: float, width: float) -> list[float]:
    centre = rng.uniform(-0.5, 0.5, 3) * [half, half, length]
    if geometry == "axisymmetric" and rng.random() < 0.5:
        centre[1] = 0.0
    return [amplitude, *centre, *(1.0 / (width * rng.uniform(0.7, 1.4, 3)))]


def _rays(rng, kind: str, half: float, begin: float) -> RayBundle:
    position = np.c_[rng.uniform(-half, half, (RAYS, 2)), np.full(RAYS, begin)]
    direction = np.tile([0.0, 0.0, 1.0], (RAYS, 1))
    if kind == "slanted":
        direction[:, :2] = rng.uniform(-0.3, 0.3, 2)
    elif kind == "divergent":
        direction = position - [0.0, 0.0, begin - half * rng.uniform(4.0, 20.0)]
    elif kind == "without order":
        direction[:, :2] = rng.normal(0.0, 0.05, (RAYS, 2))
    return RayBundle(position, direction)
