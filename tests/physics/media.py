"""Media with closed forms on grids, each with rays and their exact ends.

Lengths are of the order of a metre, so that the default tolerance, 9e-10 m of optical path, is below 1e-8 of a path.

Grids. Polynomials up to the third degree (parabolic, Luneburg, linear) are exact on any. Else a cubic spline of the
potential s = (n^2 - ambient^2) / 2 between nodes h apart is off by h^4 / 720 times the fourth derivative s4 in the
mean, which is little, but its slope by up to h^3 s4 / 125, with both signs in every cell. A ray that crosses cells
evenly does not see that; one that turns, with curvature c, runs along a row of cells for about sqrt(8 h / c) and is
deflected by up to h^3.5 s4 / (44 sqrt(c)) too much. Every grid here keeps that at a few 1e-9. Media that do not
depend on z have cells long in z.
"""

import functools

import numpy as np

from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane
from tests.physics.exact_ends import quadratic_ends, sech_ends, unit

from .closed_forms import (
    Case,
    build_field,
    exponential_ends,
    first_root,
    fish_eye_ends,
    fish_eye_sphere,
    power_ends,
)

N0 = 1.5


def across_z(z: float) -> Plane:
    """The plane z = const."""
    return Plane((0.0, 0.0, z), (0.0, 0.0, 1.0))


def parabolic(geometry: str, pitches: float, g=10.0, n0=N0, ambient=N0, reach=0.4) -> Case:
    """The rod n^2 = n0^2 (1 - g^2 r^2), r < reach / g: meridional, skew and helical rays over `pitches` 2 pi / g.

    Planar: r is |y|, and skew rays run along x as well. The potential is a parabola: 16 cells across are exact.
    """
    half = reach / g
    length = 2.0 * np.pi / g * pitches

    def index(points):
        square = points[..., 1] ** 2
        if geometry != "planar":
            square = square + points[..., 0] ** 2
        return n0 * np.sqrt(1.0 - g**2 * square)

    across = {"planar": [(-half, half, 16)], "axisymmetric": [(0.0, half, 8)], "volume": [(-half, half, 16)] * 2}
    field = build_field(index, geometry, [*across[geometry], (0.0, 1.001 * length, 16)], ambient)
    if geometry == "planar":
        start = half * np.array([[0.0, 0.75, 0.0], [0.0, -0.5, 0.0], [0.25, 0.0, 0.0], [0.0, 0.25, 0.0]])
        aim = reach * np.array([[0.0, 0.0, 0.0], [0.0, 0.4, 0.0], [0.25, -0.6, 0.0], [-0.5, 0.75, 0.0]])
    else:
        # The last is a helix: at radius 0.6 half with the tangential momentum n0 g r.
        turn = 0.6 / np.sqrt(1.0 - 2.0 * (0.6 * reach) ** 2)
        start = half * np.array([[0.75, 0, 0], [0.3, -0.4, 0], [0, 0, 0], [0.5, 0.25, 0], [0.6, 0, 0]])
        aim = reach * np.array([[0, 0, 0], [0, 0, 0], [0.4, 0.5, 0], [-0.25, 0.6, 0], [0, turn, 0]])
    rays = RayBundle(start, aim + np.array([0.0, 0.0, 1.0]))
    stiffness = np.array([geometry != "planar", True, False]) * (n0 * g) ** 2
    sigma = length / (index(start) * rays.direction[:, 2])
    ends = quadratic_ends(index, rays, sigma, stiffness=stiffness, panels=int(np.ceil(4.0 * pitches)))
    return Case(index, field, rays, across_z(length), ends, 1.0 / g)


def sech(geometry: str, periods: float, g=10.0, n0=N0, ambient=1.0, reach=1.2) -> Case:
    """A guide, n = n0 / cosh(g y), |y| < reach / g: rays of all slopes over `periods` 2 pi / g.

    Axisymmetric: meridional rays, which stay in their plane through the axis; the second starts on the axis. Planar:
    two rays run along x as well. 240 cells to the edge, g h = 0.005, s4 <= 8 n0^2 g^4: deflected by at most 1.6e-9.
    """
    length = 2.0 * np.pi / g * periods
    planar = geometry == "planar"

    def index(points):
        return n0 / np.cosh(g * (points[..., 1] if planar else np.hypot(points[..., 0], points[..., 1])))

    across = (-reach / g, reach / g, 480) if planar else (0.0, reach / g, 240)
    field = build_field(index, geometry, [across, (0.0, 1.001 * length, 16)], ambient)
    start = np.array([[0.0, 0.8, 0.0], [0.0, 0.0, 0.0], [0.0, -0.5, 0.0], [0.0, 0.2, 0.0], [0.0, 0.4, 0.0]])
    aim = np.array([[0.0, 0.0, 0.0], [0.0, 0.8, 0.0], [0.0, 0.4, 0.0], [0.0, -0.5, 0.0], [0.0, 0.25, 0.0]])
    if planar:
        aim[3:, 0] = [0.35, -0.25]
    rays = RayBundle(reach / g * start, reach * aim + np.array([0.0, 0.0, 1.0]))
    advance = length * np.linalg.norm(rays.direction[:, [0, 2]], axis=1) / rays.direction[:, 2]
    return Case(index, field, rays, across_z(length), sech_ends(rays, advance, n0, g), 1.0 / g)


def luneburg(geometry: str, towards=(0.0, 0.0, 1.0), focus: float = 1.0) -> Case:
    """The lens n^2 = 2 - r^2, R = 1 m: parallel rays from the rim, where n = 1, to the plane at `focus` R along them.

    The box holds the continuation beyond the rim, so that the kink that a lens in air has there is not seen. Planar: a
    cylinder lens, rays in the plane x = 0. The potential is a parabola: any grid is exact.
    """
    towards = unit(towards)

    def index(points):
        return np.sqrt(2.0 - np.sum(points**2, axis=-1))

    boxes = {
        "planar": [(-0.92, 0.92, 32), (-1.03, 1.03, 32)],
        "axisymmetric": [(0.0, 0.92, 16), (-1.03, 1.03, 32)],
        "volume": [(-0.65, 0.65, 32), (-0.65, 0.65, 32), (-1.03, 1.03, 32)],
    }
    field = build_field(index, geometry, boxes[geometry], 1.0)
    beside = {
        "planar": np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, -0.6, 0.0], [0.0, 0.9, 0.0]]),
        "axisymmetric": np.array([[0.0, 0.0, 0.0], [0.0, 0.3, 0.0], [0.36, -0.48, 0.0], [-0.8, 0.4, 0.0]]),
        "volume": np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, -0.25, 0.0], [-0.2, 0.2, 0.0]]),
    }[geometry]
    beside = beside - (beside @ towards)[:, None] * towards
    depth = np.sqrt(1.0 - np.sum(beside**2, axis=1))
    rays = RayBundle(beside - depth[:, None] * towards, towards[None])
    sigma = np.full(len(depth), 0.5 * np.pi) if focus == 1.0 else first_root(-depth, 1.0, focus)
    ends = quadratic_ends(index, rays, sigma, stiffness=(1.0, 1.0, 1.0))
    return Case(index, field, rays, Plane(focus * towards, towards), ends, 1.0)


def fish_eye(geometry: str, source=(0.0, 0.0, -1.0), stop: float | None = None) -> Case:
    """The lens n = n0 / (1 + r^2), R = 1 m: a fan from `source` to its antipodal image, or to the plane z = `stop`.

    Cells of 1/256, s4 <= 36 n0^2: deflected by at most 3e-9.
    """
    source = np.asarray(source, dtype=float)

    def index(points):
        return N0 / (1.0 + np.sum(points**2, axis=-1))

    across = {"planar": (-0.8, 0.8, 410), "axisymmetric": (0.0, 0.8, 205)}[geometry]
    field = build_field(index, geometry, [across, (-1.4, 1.4, 717)], 1.0)
    angle = np.radians([-70.0, -40.0, -10.0, 0.0, 25.0, 60.0])
    aim = np.stack([np.zeros(6), np.sin(angle), np.cos(angle)], axis=1)
    if geometry == "axisymmetric":
        aim[:, 0] = 0.4 * np.sin(2.0 * angle)
    rays = RayBundle(np.tile(source, (6, 1)), aim)
    if stop is None:
        until = Plane(-source / (source @ source), -source)
        turn = np.full(6, np.pi)
    else:
        until = across_z(stop)
        start, along = fish_eye_sphere(rays, 1.0)
        turn = first_root(start[:, 2] + stop * start[:, 3], along[:, 2] + stop * along[:, 3], stop)
    return Case(index, field, rays, until, fish_eye_ends(rays, turn, N0, 1.0), 1.0)


def linear(geometry: str) -> Case:
    """The medium n^2 = n0^2 + 2 f.r over 2 m: parabolas; where f points down, some rise and fall. Any grid is exact."""
    force = {"planar": (0.0, -0.5, 0.2), "axisymmetric": (0.0, 0.0, 0.3), "volume": (0.2, -0.4, 0.1)}[geometry]

    def index(points):
        return np.sqrt(N0**2 + 2.0 * points @ np.array(force))

    boxes = {
        "planar": [(-1.0, 1.0, 20), (0.0, 2.1, 20)],
        "axisymmetric": [(0.0, 1.0, 10), (0.0, 2.1, 20)],
        "volume": [(-1.0, 1.0, 20), (-1.0, 1.0, 20), (0.0, 2.1, 20)],
    }
    field = build_field(index, geometry, boxes[geometry], N0)
    start = np.array([[0.0, 0.4, 0.0], [0.0, -0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.1, 0.0]])
    aim = np.array([[0.0, -0.1, 1.0], [0.0, 0.5, 1.0], [0.0, 0.2, 1.0], [0.05, 0.1, 1.0]])
    if geometry != "planar":
        start[1:, 0], aim[1:, 0] = [0.1, -0.3, 0.2], [-0.2, 0.1, 0.05]
    rays = RayBundle(start, aim)
    length, fall = 2.0, force[2]
    kick = index(start) * rays.direction[:, 2]
    sigma = 2.0 * length / (kick + np.sqrt(kick**2 + 2.0 * fall * length))
    return Case(index, field, rays, across_z(length), quadratic_ends(index, rays, sigma, force=force), 1.0)


def exponential(length: float = 1.6) -> Case:
    """The medium n = n0 exp(y / L), L = 1 m, planar: rays fall, turn and rise again; two run along x as well.

    Cells of 0.005, s4 = 8 n^2: deflected by at most 1.6e-9.
    """

    def index(points):
        return N0 * np.exp(points[..., 1])

    field = build_field(index, "planar", [(-0.6, 0.6, 240), (0.0, 2.0, 16)], N0)
    start = np.array([[0.0, 0.4, 0.0], [0.0, 0.2, 0.0], [0.0, -0.2, 0.0], [0.0, 0.3, 0.0]])
    slope = np.radians([-55.0, -40.0, -30.0, -50.0])
    side = np.array([0.0, 0.0, 0.2, -0.15])
    aim = np.stack([np.sin(side), np.tan(slope), np.cos(side)], axis=1)
    rays = RayBundle(start, aim)
    ends = exponential_ends(rays, length / np.cos(side), N0, 1.0)
    return Case(index, field, rays, across_z(length), ends, 1.0)


def spherical(geometry: str, power: float) -> Case:
    """The medium n = n0 (r / R)^p about the origin, R = 1 m: rays past the centre, which lies outside the box.

    p = -1: logarithmic spirals; p = -1/2: Kepler's parabolas; p = 2: rays deflected away from the centre. The stop is a
    plane through the centre. Cells of 1/256, s4 <= 60 n^2 along the radius at r = 1: deflected by a few 1e-9; of 1/192
    where p = 2, s4 = 12 n^2: deflected by at most 3e-9.
    """

    def index(points):
        return N0 * np.sum(points**2, axis=-1) ** (0.5 * power)

    if power > 0.0:
        across = {"planar": [(-0.4, 0.3, 134)], "volume": [(-0.25, 0.25, 96), (-0.4, 0.3, 134)]}
        along = (0.7, 1.1, 77)
        start = np.array([[0.0, -0.3, 0.9], [0.0, -0.3, 0.85], [0.0, -0.35, 0.95]])
        aim = np.array([[0.0, 1.0, -0.3], [0.0, 1.0, -0.3], [0.0, 1.0, -0.4]])
        normal = (0.0, 1.0, -0.2)
    else:
        across = {"planar": [(-0.9, 0.9, 460)], "axisymmetric": [(0.0, 0.9, 230)]}
        along = (0.5, 1.5, 256)
        start = np.array([[0.0, -0.7, 0.7], [0.0, -0.8, 0.8], [0.0, -0.6, 0.9]])
        aim = np.array([[0.0, 1.0, 0.9], [0.0, 1.0, 0.7], [0.0, 1.0, 0.6]])
        normal = (0.0, 1.0, -0.7)
    field = build_field(index, geometry, [*across[geometry], along], N0)
    if geometry != "planar":
        start[1:, 0], aim[1:, 0] = [0.1, -0.2], [0.1, 0.3]
    rays = RayBundle(start, aim)
    return Case(index, field, rays, Plane((0.0, 0.0, 0.0), normal), power_ends(rays, normal, N0, power), 1.0)


CASES = {
    "parabolic planar": functools.partial(parabolic, "planar", 2.0),
    "parabolic axisymmetric": functools.partial(parabolic, "axisymmetric", 2.0),
    "parabolic volume": functools.partial(parabolic, "volume", 2.0),
    "sech planar": functools.partial(sech, "planar", 2.0),
    "sech axisymmetric": functools.partial(sech, "axisymmetric", 2.0),
    "Luneburg planar": functools.partial(luneburg, "planar"),
    "Luneburg axisymmetric": functools.partial(luneburg, "axisymmetric"),
    "Luneburg volume": functools.partial(luneburg, "volume", (0.2, -0.1, 1.0)),
    "Luneburg planar, half way": functools.partial(luneburg, "planar", focus=0.3),
    "fish-eye planar": functools.partial(fish_eye, "planar"),
    "fish-eye axisymmetric": functools.partial(fish_eye, "axisymmetric", (0.2, -0.1, -0.85)),
    "fish-eye planar, half way": functools.partial(fish_eye, "planar", (0.0, 0.1, -0.9), 0.3),
    "linear planar": functools.partial(linear, "planar"),
    "linear axisymmetric": functools.partial(linear, "axisymmetric"),
    "linear volume": functools.partial(linear, "volume"),
    "exponential planar": exponential,
    "spherical p=-1 planar": functools.partial(spherical, "planar", -1.0),
    "spherical p=-1 axisymmetric": functools.partial(spherical, "axisymmetric", -1.0),
    "spherical p=-1/2 axisymmetric": functools.partial(spherical, "axisymmetric", -0.5),
    "spherical p=2 planar": functools.partial(spherical, "planar", 2.0),
    "spherical p=2 volume": functools.partial(spherical, "volume", 2.0),
}
