"""Bodies are met exactly, whatever the grid: thin plates, steps, slits, deep pupils, straight and bent rays.

Constant contrast c0 fills the box, so weak that refraction where rays leave the body does not change what they meet
(WEAK): they are straight from there on, and the optical path is longer than the arc by c0 times the way outside the
body. Statuses, places and ways follow from `Body.crossings`, which tests/medium/test_crossings.py holds against the
profile itself.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from aerokernels.focus.estimate import estimate_strehl
from aerokernels.medium import Body, IndexField
from aerokernels.rays import Disc, RayBundle
from aerokernels.tracing import Plane, RayStatus, trace
from tests.slow import first_of

from .backends import ENGINES, OPENCL, on

WAVE = 905e-9
UP = (0.0, 0.0, 1.0)
SIZE = 20e-3
# Refraction by c0 tan(incidence) displaces a ray of 40 mm by 1e-10 m.
WEAK = 2e-9


def constant(body: Body, cells: int, contrast: float = WEAK, size: float = SIZE) -> IndexField:
    """A box from -size to size along each axis (r from 0), `cells` to a `size`."""
    planar = body.geometry == "planar"
    return IndexField.from_samples(
        np.full(((2 if planar else 1) * cells + 1, 2 * cells + 1), contrast),
        origin=(-size if planar else 0.0, -size),
        spacing=(size / cells,) * 2,
        geometry=body.geometry,
        body=body,
    )


@dataclass
class Expected:
    """What geometry says: status, where a ray begins and ends [m along it], which rays keep clear of edges."""

    status: np.ndarray
    begin: np.ndarray
    end: np.ndarray
    sure: np.ndarray


def expected(body: Body, rays: RayBundle) -> Expected:
    """Of rays in the box of `constant`, moved by 2e-9 of its size each way to find those that graze."""
    status, begin, end = by_geometry(body, rays.position, rays.direction)
    sure = np.ones(rays.ray_count, dtype=bool)
    for shift in 2e-9 * SIZE * np.concatenate([np.eye(3), -np.eye(3)]):
        other, first, _ = by_geometry(body, rays.position + shift, rays.direction)
        sure &= (other == status) & (np.abs(first - begin) < 1e-5 * SIZE)
    return Expected(status, begin, end, sure)


def by_geometry(body: Body, position, direction) -> tuple[np.ndarray, ...]:
    """Status, begin and end of straight rays that start in the box and leave it by a face."""
    with np.errstate(divide="ignore", invalid="ignore"):
        leave = np.where(direction == 0.0, np.inf, (np.copysign(SIZE, direction) - position) / direction)
        if body.geometry == "planar":
            leave = leave[:, 1:].min(axis=1)
        else:
            a, b = np.sum(direction[:, :2] ** 2, axis=1), np.sum(position[:, :2] * direction[:, :2], axis=1)
            c = SIZE**2 - np.sum(position[:, :2] ** 2, axis=1)
            leave = np.minimum(np.where(a > 0.0, (np.sqrt(b**2 + a * c) - b) / a, np.inf), leave[:, 2])
    found = body.crossings(position, direction)
    inside = (found <= 0.0).sum(axis=1) % 2 == 1
    begin = np.where(inside, np.where(found > 0.0, found, np.inf).min(axis=1, initial=np.inf), 0.0)
    hit = np.where(found > begin[:, None], found, np.inf).min(axis=1, initial=np.inf)
    status = np.where(hit < leave, RayStatus.HIT_BODY, RayStatus.OK)
    status = np.where(begin > leave, RayStatus.INSIDE_BODY, status)
    return status, begin, np.minimum(hit, leave)


def spread(rng: np.random.Generator, count: int, geometry: str, along_z: bool) -> RayBundle:
    """Rays from everywhere in the box, inside and outside the body; none nearly along a face of the box."""
    position = 0.7 * SIZE * rng.uniform(-1.0, 1.0, (count, 3))
    direction = np.tile(UP, (count, 1)) if along_z else rng.normal(size=(count, 3))
    if geometry == "planar":
        direction[:, 0] = 0.0
    if not along_z:
        steep = np.copysign(0.2 + np.abs(direction), direction)
        direction = np.where(direction == 0.0, 0.0, steep)
    return RayBundle(position, direction)


@pytest.mark.parametrize("ray_count", first_of([5000, 300]))
@pytest.mark.parametrize("engine", ENGINES)
def test_plates_thinner_than_anything_else(engine, ray_count):
    """Set-up: |y| < 3 mm, 20 nm to 1 cell of 0.5 mm thick, in a box of 40 mm. Every ray that meets one ends on it."""
    rng = np.random.default_rng(5)
    rays = RayBundle(np.c_[np.zeros(ray_count), rng.uniform(-8e-3, 8e-3, ray_count), np.full(ray_count, -19e-3)], [UP])
    for thickness in (20e-9, 5e-6, 100e-6, 500e-6):
        low, high = 3.07e-3 - thickness / 2, 3.07e-3 + thickness / 2
        body = Body(np.array([[-3e-3, low], [3e-3, low], [3e-3, high], [-3e-3, high]]), "planar")
        result = trace(constant(body, 40), rays, **on(engine))
        hit = np.abs(rays.position[:, 1]) < 3e-3
        assert np.array_equal(result.status == RayStatus.HIT_BODY, hit)
        assert np.abs(result.position[hit, 2] - low).max() < 1e-8


@pytest.mark.parametrize("engine", ENGINES)
def test_double_precision(engine):
    """A comb of slits 30 um wide on cells of 1 mm; float64 is exact to 1e-9 wave and 1e-13 m for rays from outside."""
    teeth = [[x, z] for k in range(8) for x, z in ((k, 0.0), (k, 10.0), (k + 0.97, 10.0), (k + 0.97, 0.0))]
    body = Body(np.array([*teeth, [8.0, 0.0], [8.0, -1.0], [0.0, -1.0]]) * 1e-3 - [4e-3, 2e-3], "planar")
    rays = spread(np.random.default_rng(7), 400, "planar", along_z=False)
    result = trace(constant(body, 20, 2e-4), rays, precision="float64", **on(engine))
    truth = expected(body, rays)
    truth.sure &= truth.begin == 0.0
    assert np.array_equal(result.traced_status[truth.sure], truth.status[truth.sure])
    through = truth.sure & result.ok
    assert np.abs(result.opd - 2e-4 * (truth.end - truth.begin))[through].max() < 1e-9 * WAVE
    hit = truth.sure & (result.status == RayStatus.HIT_BODY)
    assert hit.any() and np.abs(result.arc_length - truth.end)[hit].max() < 1e-13


@pytest.mark.parametrize("engine", ENGINES)
def test_a_pupil_deep_in_a_body(engine):
    """Set-up: a cylinder of 10 mm radius, a pupil of 9.99 mm 290 mm behind its flat face. No light is blocked."""
    body = Body(np.array([[0.0, 0.0], [10e-3, 0.0], [10e-3, -300e-3], [0.0, -300e-3]]))
    field = IndexField.from_samples(
        np.full((21, 341), 1e-4), origin=(0.0, -300e-3), spacing=(1e-3, 1e-3), geometry="axisymmetric", body=body
    )
    pupil = Disc(9.99e-3, (0.0, 0.0, -290e-3))
    rays = RayBundle.collimated(pupil, 300)
    assert trace(field, rays, until=Plane((0.0, 0.0, 60e-3), UP), **on(engine)).ok.all()
    for symmetry in ("auto", False):
        seen = estimate_strehl(
            field, pupil, wavelength=WAVE, ray_count=8192, symmetry=symmetry, allow_truncation=True, **on(engine)
        )
        assert seen.blocked == 0.0
        assert abs(seen.value - 1.0) < 1e-6


def parabolas(rays: RayBundle, gradient: float, corners: np.ndarray) -> np.ndarray:
    """Where rays first meet the edges of a polygon, as (y, z) [m], NaN where none: n^2 = 1 + 2 gradient y.

    With d sigma = ds / n a ray is r + n d sigma + gradient sigma^2 / 2 along y: quadratic in sigma for each edge.
    """
    start = rays.position[:, 1:]
    speed = np.sqrt(1.0 + 2.0 * gradient * start[:, :1]) * rays.direction[:, 1:]
    first = np.full(len(start), np.inf)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        normal = np.array([a[1] - b[1], b[0] - a[0]])
        for k in range(len(start)):
            for sigma in np.roots([0.5 * gradient * normal[0], speed[k] @ normal, (start[k] - a) @ normal]):
                if abs(sigma.imag) < 1e-15 and 0.0 < sigma.real < first[k]:
                    place = start[k] + speed[k] * sigma.real + [0.5 * gradient * sigma.real**2, 0.0]
                    if 0.0 <= (place - a) @ (b - a) <= (b - a) @ (b - a):
                        first[k] = sigma.real
    met = np.where(np.isfinite(first), first, np.nan)[:, None]
    return start + speed * met + np.array([0.5 * gradient, 0.0]) * met**2


def sloping(gradient: float, corners: np.ndarray) -> IndexField:
    """n^2 = 1 + 2 gradient y in a box of 40 mm, with a body; ambient 1."""
    y = np.linspace(-SIZE, SIZE, 81)
    contrast = np.repeat((np.sqrt(1.0 + 2.0 * gradient * y) - 1.0)[:, None], 21, axis=1)
    return IndexField.from_samples(
        contrast, origin=(-SIZE, -SIZE), spacing=(SIZE / 40, SIZE / 10), geometry="planar", body=Body(corners, "planar")
    )


@pytest.mark.parametrize(
    ("engine", "settings"),
    [
        pytest.param(*engine.values, settings, marks=engine.marks)
        for settings, engines in (({"tolerance": 1e-4}, ENGINES), ({"method": "fixed", "step": 9e-3}, OPENCL))
        for engine in engines
    ],
)
def test_bent_rays_meet_a_thin_plate_where_their_parabola_does(engine, settings):
    """Set-up: n^2 = 1 + 4 y / m bends rays by up to 1.6 mm before a plate 1 um thick, tilted by 40 degrees.

    A step looks for the wall along chords within 1e-4 cells of it (5e-8 m), at angles above 20 degrees; fixed steps
    bow by 20 um. Warp finds the same walls (test_generated_kernels.py), and needs no kernel of fixed steps for it.
    """
    turn = np.deg2rad(40.0)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    corners = np.array([s * 6e-3 * along + t * 0.5e-6 * across for s, t in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    rng = np.random.default_rng(9)
    # From everywhere, and closely past both edges: the way there bends by 0.12 mm and 0.36 mm.
    near = [rng.uniform(-0.1e-3, 0.1e-3, 40) + y for y in (corners[0, 0] - 0.124e-3, corners[1, 0] - 0.356e-3)]
    y = np.concatenate([rng.uniform(-9e-3, 6e-3, 60), *near])
    rays = RayBundle(np.c_[0 * y, y, 0 * y - 15e-3], [UP])
    place = parabolas(rays, 2.0, corners)
    result = trace(sloping(2.0, corners), rays, precision="float64", **settings, **on(engine))
    hit = np.isfinite(place[:, 0])
    assert 40 < hit.sum() < 100
    assert np.array_equal(result.status == RayStatus.HIT_BODY, hit)
    assert np.linalg.norm(result.position[hit, 1:] - place[hit], axis=1).max() < 2e-7


@pytest.mark.parametrize("engine", ENGINES)
def test_even_samples_see_an_edge_beside_the_undisturbed_ray(engine):
    """Set-up: n^2 = 1 + 0.04 y / m bends rays by 9 um before a plate 1 um thick, 300 of 5000 within 30 um of its edge.

    Expected: those are blocked whose parabola, not whose straight line, ends on the plate.
    """
    gradient, edge, z = 0.02, 1e-3, 15e-3
    corners = np.array([[edge, z], [5e-3, z], [5e-3, z + 1e-6], [edge, z + 1e-6]])
    y = np.concatenate([np.linspace(-9e-3, 0.0, 4700), edge + 30e-6 * np.linspace(-1.0, 1.0, 300)])
    rays = RayBundle(np.c_[0 * y, y, 0 * y - 15e-3], [UP])
    result = trace(sloping(gradient, corners), rays, **on(engine))
    assert result.plan.sample_count
    there = y + 0.5 * gradient * (30e-3 / np.sqrt(1.0 + 2.0 * gradient * y)) ** 2
    assert (there - y).min() > 8.9e-6
    sure = np.abs(there - edge) > 2e-8
    expected_status = np.where(there > edge, RayStatus.HIT_BODY, RayStatus.OK)
    assert np.array_equal(result.traced_status[sure], expected_status[sure])
