"""Rays are moved in packets that share cells, in whatever order they come; each keeps its own result."""

import numpy as np
import pytest

from aerokernels import IndexField, Plane, RayBundle, trace

from .backends import WAVE, on

H = 1e-3 / 16
X = (np.arange(33) - 16) * H


def field(geometry: str = "volume") -> IndexField:
    axes = {"volume": (X, X, X), "planar": (X, X), "axisymmetric": (X[16:] - X[16], X)}[geometry]
    made = 1e-4 * np.exp(-sum((axis / 5e-4) ** 2 for axis in np.meshgrid(*axes, indexing="ij")))
    origin = [axis[0] for axis in axes]
    return IndexField.from_samples(made, origin=origin, spacing=(H,) * len(axes), geometry=geometry, wavelength=WAVE)


def incoherent(count: int) -> RayBundle:
    rng = np.random.default_rng(3)
    way = np.c_[rng.normal(0.0, 0.05, (count, 2)), np.ones(count)]
    return RayBundle(np.c_[rng.uniform(-5e-4, 5e-4, (count, 2)), np.full(count, -1.2e-3)], way)


def test_each_ray_keeps_its_result():
    """The same rays in two orders: the same optical paths, to the rounding of a packet's sums."""
    pytest.importorskip("pyopencl")
    rays = incoherent(6000)
    shuffled = np.random.default_rng(5).permutation(rays.ray_count)
    options = {**on("opencl"), "until": Plane((0.0, 0.0, 1.2e-3), (0.0, 0.0, 1.0)), "outputs": ("opd", "direction")}
    one = trace(field(), rays, **options)
    other = trace(field(), RayBundle(rays.position[shuffled], rays.direction[shuffled]), **options)
    assert one.plan.sample_count > 0
    assert np.abs(one.opd[shuffled] - other.opd).max() < 1e-7 * WAVE
    assert np.abs(one.direction[shuffled] - other.direction).max() < 1e-9
