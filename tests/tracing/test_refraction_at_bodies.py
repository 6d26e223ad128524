"""A ray that starts in a body is refracted where it leaves it: Snell's law, directions against slopes of the OPD."""

import numpy as np
import pytest

from aerokernels.medium import Body, IndexField, SolidBody
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, RayStatus, trace
from tests.slow import first_of

from .backends import ENGINES, on

SIZE, RADIUS, UP = 20e-3, 8e-3, (0.0, 0.0, 1.0)
ALL = [*ENGINES, "reference-cpu"]
FACES = -np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])


def arc(count: int, geometry: str) -> np.ndarray:
    """Corners on a circle, or on half of it from the axis to the axis, at uneven angles."""
    share = np.arange(count) / (count if geometry == "planar" else count - 1)
    angle = share * (2.0 * np.pi if geometry == "planar" else np.pi) + 0.3 * np.sin(2.0 * np.pi * share) / count
    points = RADIUS * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    if geometry == "axisymmetric":
        points[[0, -1], 0] = 0.0
    return points


BODIES = {
    "circle": lambda: Body(arc(240, "planar"), "planar"),
    "sphere": lambda: Body(arc(180, "axisymmetric")),
    "wedge": lambda: Body([[0.0, 12e-3], [6e-3, -6e-3], [-6e-3, -6e-3]], "planar"),
    "cone": lambda: Body([[0.0, 12e-3], [6e-3, -6e-3], [0.0, -6e-3]]),
    "tetrahedron": lambda: SolidBody(-9e-3 * FACES, np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])),
    "turned sphere": lambda: SolidBody.of_revolution(Body(arc(91, "axisymmetric")), 180),
}


def exact_normals(name: str, at: np.ndarray) -> np.ndarray:
    """Outward normals at points of the bodies' surfaces, by hand."""
    if name == "tetrahedron":
        return FACES[np.argmax(at @ FACES.T, axis=1)] / np.sqrt(3.0)
    if name in ("circle", "sphere", "turned sphere"):
        normal = at * [float(name != "circle"), 1.0, 1.0]
        return normal / np.linalg.norm(normal, axis=1)[:, None]
    beside = at * [float(name == "cone"), 1.0, 0.0]
    mantle = 3.0 * beside / np.linalg.norm(beside, axis=1)[:, None] + np.array(UP)
    return np.where(at[:, 2:] > -6e-3 * (1.0 - 1e-9), mantle / np.sqrt(10.0), -np.array(UP))


def in_air(body: Body | SolidBody, of) -> IndexField:
    """A box of 40 mm around a body, with the contrast `of`(first axis, z), or (x, y, z) in a volume."""
    axis = np.linspace(-SIZE, SIZE, 21 if body.geometry == "volume" else 81)
    axes = {"volume": [axis] * 3, "planar": [axis] * 2, "axisymmetric": [axis[len(axis) // 2 :], axis]}[body.geometry]
    return IndexField.from_samples(
        np.broadcast_to(of(*np.meshgrid(*axes, indexing="ij")), [len(each) for each in axes]).copy(),
        origin=[each[0] for each in axes],
        spacing=[axis[1] - axis[0]] * len(axes),
        geometry=body.geometry,
        body=body,
    )


@pytest.mark.parametrize("contrast", [2e-4, -2e-4])
@pytest.mark.parametrize("name", first_of(["sphere", "tetrahedron", "circle", "wedge", "cone", "turned sphere"], 2))
@pytest.mark.parametrize("engine", ALL)
def test_snells_law_where_rays_leave_a_body(engine, name, contrast):
    """Set-up: rays of all directions from within bodies in uniform air. Expected: Snell's law with exact normals.

    The normal of a curve through the corners is exact on a circle; between the triangles of a sphere it is off by a
    share of their angle of 2 degrees, squared. float32 holds a deflection, which is c tan(incidence), to 5e-6.
    """
    if (engine, name) == ("reference-cpu", "turned sphere"):
        pytest.skip("the oracle tests every triangle: it has the normals of the tetrahedron by the same lines")
    body, rng = BODIES[name](), np.random.default_rng(3)
    position, direction = rng.uniform(-1e-3, 1e-3, (120, 3)), rng.normal(size=(120, 3))
    direction[:, 0] *= name not in ("circle", "wedge")
    rays = RayBundle(position, direction)
    met = body.crossings(rays.position, rays.direction)
    place = rays.position + np.where(met > 0.0, met, np.inf).min(axis=1)[:, None] * rays.direction
    normal = exact_normals(name, place)
    cosine = np.sum(normal * rays.direction, axis=1)
    ratio = 1.0 / (1.0 + contrast)
    behind = np.sqrt(1.0 - ratio**2 * (1.0 - cosine**2))
    expected = ratio * rays.direction + (behind - ratio * cosine)[:, None] * normal
    found = trace(in_air(body, lambda *_: np.array(contrast)), rays, **on(engine))
    kept = (cosine > 0.15) & (np.abs(rays.direction).max(axis=1) > 0.0)
    assert kept.sum() > 80 and found.ok[kept].all()
    off = np.linalg.norm(found.direction - expected, axis=1)[kept] * cosine[kept]
    assert off.max() < 2e-4 * (1e-3 if name == "turned sphere" else 5e-6)


def graded(first, z, third=None):
    """Air that thins out from the middle of the box, as smooth as a bell; its slopes are felt as well as its value."""
    square = first**2 + z**2 if third is None else first**2 + z**2 + third**2
    return 2e-4 * np.exp(-square / (2.0 * 9e-3**2)) * (1.0 + 20.0 * (z if third is None else third))


@pytest.mark.parametrize("ray_count", [400, 6000])
@pytest.mark.parametrize("name", first_of(["sphere", "cone", "circle", "wedge"], 2))
@pytest.mark.parametrize("engine", ALL)
def test_directions_are_slopes_of_the_optical_path(engine, name, ray_count):
    """Set-up: a plane wave leaves bodies into graded air; rays along z on a line in y.

    Expected by Fermat's principle: between two points of a plane behind, the optical path differs by the integral of
    n dr/ds along the plane. The trapezoidal rule on 5 mm is off by (5 mm)^3 / (12 N^2) times the curvature of the
    slope, 2e-4 / (4 mm)^2, at most 2e-12 m; chords of 0.2 mm add h^2 / (8 R) of air, 1.3e-10 m, at ends of the
    interval. A direction without refraction is off by 1e-4 rad, 6e-7 m.
    """
    body = BODIES[name]()
    y = np.linspace(0.5e-3, 5.5e-3, ray_count)  # beside the tip, at which the slope jumps
    rays = RayBundle(np.c_[0.0 * y, y, np.full(ray_count, -2e-3)], [UP])
    if engine == "reference-cpu" and ray_count > 400:
        pytest.skip("the oracle has one way to trace, however many rays")
    found = trace(in_air(body, graded), rays, until=Plane((0.0, 0.0, 30e-3), UP), tolerance=1e-4, **on(engine))
    assert found.ok.all()
    assert bool(found.plan.sample_count) == (ray_count > 400 and engine != "reference-cpu")
    across, slope = found.position[:, 1], found.direction[:, 1]
    along = np.concatenate([[0.0], np.cumsum(0.5 * (slope[1:] + slope[:-1]) * np.diff(across))])
    assert np.abs(found.opd - found.opd[0] - along).max() < 4e-10


@pytest.mark.parametrize("engine", ALL)
def test_rays_that_would_be_reflected_run_along_the_wall(engine):
    """Set-up: a flat wall met at 10 mrad, thinner air by 2e-4 behind it: total reflection below 20 mrad."""
    body = Body([[-15e-3, 0.0], [15e-3, 0.0], [15e-3, -5e-3], [-15e-3, -5e-3]], "planar")
    rays = RayBundle([[0.0, -10e-3, -1e-4]], [[0.0, 1.0, 10e-3]])
    found = trace(in_air(body, lambda *_: np.array(-2e-4)), rays, **on(engine))
    assert np.isfinite(found.direction).all()
    assert abs(found.direction[0, 2]) < 1e-6 or found.status[0] == RayStatus.HIT_BODY
