"""Bodies in volumes: where straight rays begin and end, on every engine, against the crossings of their triangles."""

import numpy as np
import pytest

from aerokernels.medium import IndexField, SolidBody
from aerokernels.rays import RayBundle
from aerokernels.tracing import RayStatus, trace
from tests.bodies import star

from .backends import ENGINES, on

# So weak that refraction where rays leave the body does not move them.
SIZE, CONTRAST = 20e-3, 2e-9


def scene() -> tuple[SolidBody, IndexField, RayBundle]:
    """A turned body of sharp rings in constant contrast, and rays from in- and outside, some bound for corners."""
    random = np.random.default_rng(9)
    solid = SolidBody.of_revolution(star(random, "axisymmetric", 0.6 * SIZE), 16)
    rotation = np.linalg.qr(random.normal(size=(3, 3)))[0]
    body = SolidBody(solid.vertices @ rotation, solid.triangles)
    field = IndexField.from_samples(
        np.full((9, 9, 9), CONTRAST), origin=[-SIZE] * 3, spacing=[SIZE / 4] * 3, geometry="volume", body=body
    )
    position, direction = random.uniform(-0.9 * SIZE, 0.9 * SIZE, (400, 3)), random.normal(size=(400, 3))
    direction[:60] = body.vertices[random.integers(0, len(body.vertices), 60)] - position[:60]
    return body, field, RayBundle(position, direction)


def expected(body: SolidBody, rays: RayBundle):
    """Status, begin and end of straight rays in the box [m along them]."""
    with np.errstate(divide="ignore"):
        leave = ((np.copysign(SIZE, rays.direction) - rays.position) / rays.direction).min(axis=1)
    met = body.crossings(rays.position, rays.direction)
    inside = np.count_nonzero(met <= 0.0, axis=1) % 2 == 1
    begin = np.where(inside, np.where(met > 0.0, met, np.inf).min(axis=1), 0.0)
    hit = np.where(met > begin[:, None], met, np.inf).min(axis=1)
    status = np.where(hit < leave, RayStatus.HIT_BODY, RayStatus.OK)
    return np.where(begin > leave, RayStatus.INSIDE_BODY, status), begin, np.minimum(hit, leave)


def check(result, body, rays) -> None:
    """Statuses, hits to 1e-6 of the box (float32), and the optical path of the rest to 0.5 um of way.

    Rays moved by 2e-11 m say which of them graze, and are left out.
    """
    status, begin, end = expected(body, rays)
    sure = np.ones(rays.ray_count, bool)
    for shift in 1e-9 * SIZE * np.concatenate([np.eye(3), -np.eye(3)]):
        other, first, last = expected(body, RayBundle(rays.position + shift, rays.direction))
        sure &= (other == status) & (np.abs(first - begin) < 1e-6 * SIZE) & (np.abs(last - end) < 1e-6 * SIZE)
    assert sure.mean() > 0.8 and sure[60:].mean() > 0.98
    assert np.array_equal(result.traced_status[sure], status[sure])
    hit, through = (sure & (status == code) for code in (RayStatus.HIT_BODY, RayStatus.OK))
    assert hit.sum() > 40 and through.sum() > 40
    at = rays.position + end[:, None] * rays.direction
    assert np.abs(result.position - at)[hit].max() < 1e-6 * SIZE
    way = np.linalg.norm(result.position - rays.position - begin[:, None] * rays.direction, axis=1)
    assert np.abs(way - (end - begin))[through].max() < 1e-8
    assert np.abs((result.optical_path - begin - way) / CONTRAST - way)[through].max() < 5e-7


@pytest.mark.parametrize("engine", ENGINES)
def test_rays_meet_the_triangles_of_a_body(engine):
    """Set-up: a star of 16 x 20 rings, cells of 5 mm. Expected: begin, end and status of `SolidBody.crossings`."""
    body, field, rays = scene()
    check(trace(field, rays, **on(engine)), body, rays)


def test_the_oracle_meets_them_by_formulas_of_its_own():
    """As above, without the rays bound for corners: it counts a triangle a hair beyond its edges."""
    body, field, rays = scene()
    rays = RayBundle(rays.position[60:], rays.direction[60:])
    check(trace(field, rays, backend="reference"), body, rays)
