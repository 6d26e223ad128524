"""Leapfrog takes samples only where the air is not uniform; what is left out is less than a share of the tolerance."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.error_limit import SUPPORT_SHARE, support_box
from aerokernels.tracing.leapfrog.pilot import LEAST_RAYS
from tests.slow import first_of

from ..backends import ENGINES, WAVE, on

CELL = 1e-4
AMBIENT = 1.0003


def blob(geometry: str, margin: float = 1e-13) -> IndexField:
    """A Gaussian cloud 1 mm wide in a box of 3 x 3 x 16 mm, at z = 4 mm, in air uniform but for `margin`."""
    across, z = CELL * (np.arange(31) - 15.0), CELL * np.arange(161)
    first = np.abs(across[15:]) if geometry == "axisymmetric" else across
    shape = np.exp(-((first[:, None] / 6e-4) ** 2) - ((z - 4e-3) / 6e-4) ** 2)
    origin: tuple = (first[0], 0.0)
    if geometry == "volume":
        shape = shape[:, None, :] * np.exp(-((across / 6e-4) ** 2))[None, :, None]
        origin = (across[0], across[0], 0.0)
    noise = margin * np.random.default_rng(4).uniform(-1.0, 1.0, shape.shape)
    return IndexField.from_samples(
        3e-4 * shape + noise, origin=origin, spacing=(CELL,) * shape.ndim, geometry=geometry, ambient_index=AMBIENT
    )


STOPS = {
    "box": None,
    "within": Plane((0.0, 0.0, 4.1e-3), (0.0, 0.3, 1.0)),
    "behind": Plane((0.0, 0.0, 30e-3), (0.2, 0.0, 1.0)),
}
EVERY = 29  # of so many rays one is compared
cloud = functools.cache(blob)


def cloud_rays(parallel: bool) -> RayBundle:
    """Rays along z, or within some 0.05 rad of it."""
    rng = np.random.default_rng(3)
    position = np.c_[rng.uniform(-1.4e-3, 1.4e-3, (LEAST_RAYS, 2)), rng.uniform(-1e-3, 1e-3, LEAST_RAYS)]
    if parallel:
        return RayBundle(position, (0.0, 0.0, 1.0))
    return RayBundle(position, np.c_[rng.normal(0.0, 0.02, (LEAST_RAYS, 2)), np.ones(LEAST_RAYS)])


@functools.cache
def single_rays(geometry: str, parallel: bool, stop: str):
    """Some of the rays, one by one in float64 to a thousandth of the tolerance: every engine is compared with them."""
    settings = {"method": "adaptive", "precision": "float64", "tolerance": 1e-6}
    return trace(cloud(geometry), cloud_rays(parallel)[::EVERY], until=STOPS[stop], **settings)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", first_of(["axisymmetric", "volume", "planar"]))
def test_rays_through_a_cloud_in_a_long_box(engine, geometry):
    """Within the tolerance for stops before, in and behind the cloud, on far fewer samples than the box has cells."""
    for parallel in (True, False):
        rays = cloud_rays(parallel)
        for stop, until in STOPS.items():
            result = trace(cloud(geometry), rays, until=until, **on(engine))
            if until is None and parallel:
                assert 0 < result.plan.sample_count <= 60
            expected, part = single_rays(geometry, parallel, stop), slice(None, None, EVERY)
            assert (result.traced_status[part] == expected.traced_status).all()
            assert np.abs(result.opd[part] - expected.opd)[expected.ok].max() < 1e-3 * WAVE
            assert np.abs(result.direction[part] - expected.direction)[expected.ok].max() < 1e-7


@pytest.mark.parametrize("engine", ENGINES)
def test_uniform_air_leaves_rays_alone(engine):
    """Not one sample's worth of anything: straight lines, to the last digits."""
    field = IndexField.from_samples(
        np.zeros((8, 9)), origin=(0.0, 0.0), spacing=(CELL, CELL), geometry="axisymmetric", ambient_index=AMBIENT
    )
    rng = np.random.default_rng(6)
    position = np.c_[rng.uniform(-4e-4, 4e-4, (LEAST_RAYS, 2)), np.full(LEAST_RAYS, -1e-3)]
    rays = RayBundle(position, np.c_[rng.normal(0.0, 0.02, (LEAST_RAYS, 2)), np.ones(LEAST_RAYS)])
    result = trace(field, rays, until=Plane((0.0, 0.0, 5e-3), (0.0, 0.0, 1.0)), **on(engine))
    assert result.ok.all() and not result.opd.any()
    assert np.abs(result.direction - rays.direction).max() < 1e-15
    there = rays.position + rays.direction * (6e-3 / rays.direction[:, 2])[:, None]
    assert np.abs(result.position - there).max() < 1e-17


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["volume", "planar", "axisymmetric"]), st.floats(-13.0, -7.0))
def test_what_lies_outside_is_less_than_its_share(seed, geometry, exponent):
    """At random places outside, the contrast times the size of the box is below the share of the tolerance."""
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(9, 20, 3 if geometry == "volume" else 2))
    samples = 10.0 ** rng.uniform(-14.0, -5.0) * rng.standard_normal(shape)
    edge = tuple(slice(int(rng.integers(0, 6)), int(rng.integers(6, 12))) for _ in shape)
    samples[edge] += 1e-4 * rng.standard_normal(samples[edge].shape)
    origin = (0.0,) * len(shape)
    field = IndexField.from_samples(samples, origin=origin, spacing=(CELL,) * len(shape), geometry=geometry)
    tolerance = 10.0**exponent
    low, high = support_box(field, tolerance)
    box_low, box_high = np.array(field.samples.low), np.array(field.samples.high)
    assert (low >= box_low).all() and (high <= box_high).all() and (low <= high).all()
    points = rng.uniform(box_low, box_high, (400, len(shape)))
    outside = ((points < low) | (points > high)).any(axis=1)
    position = np.zeros((400, 3))
    position[:, -len(shape) :] = points
    if geometry == "axisymmetric":
        position = np.c_[points[:, 0], np.zeros(400), points[:, 1]]
    contrast = np.abs(field.contrast_at(position[outside]))
    size = np.linalg.norm(box_high - box_low)
    assert contrast.max(initial=0.0) * size <= 1.001 * SUPPORT_SHARE * tolerance
