"""Rays are moved in packets that share cells, in whatever order they come; each keeps its own result."""

import numpy as np
import pytest

from aerokernels import IndexField, Plane, RayBundle, trace
from aerokernels.tracing.launch import PACKET, coherent_order

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


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_neighbours_share_cells_at_both_ends(geometry: str):
    """Of 40,000 rays packets of 16 lie in less than a fifth of the cells of before; each ray once."""
    rays = incoherent(40_000)
    order = coherent_order(field(geometry), rays.position, rays.direction)
    assert order is not None and (np.sort(order) == np.arange(rays.ray_count)).all()
    ends = [rays.position + (z - rays.position[:, 2:]) / rays.direction[:, 2:] * rays.direction for z in (X[0], X[-1])]

    def spread(rows: np.ndarray) -> float:
        sizes = []
        for end in ends:
            local = {"volume": end[:, :2], "planar": end[:, 1:2], "axisymmetric": np.hypot(*end[:, :2].T)[:, None]}
            packets = (local[geometry][rows] / H).reshape(-1, PACKET, local[geometry].shape[1])
            sizes.append(np.prod(np.ptp(packets, axis=1), axis=1))
        return float(np.mean(sizes))

    assert spread(order) < 0.2 * spread(np.arange(rays.ray_count))


def test_what_is_in_order_stays_so():
    across = np.linspace(-5e-4, 5e-4, 256)
    u, v = (axis.ravel() for axis in np.meshgrid(across, across, indexing="ij"))
    rays = RayBundle(np.c_[u, v, np.full(u.size, -1.2e-3)], [[0.05, 0.02, 1.0]])
    assert coherent_order(field(), rays.position, rays.direction) is None
    assert coherent_order(field(), rays.position[:1000], rays.direction[:1000]) is None
    sideways = RayBundle(rays.position, np.random.default_rng(1).normal(size=(u.size, 3)))
    assert coherent_order(field(), sideways.position, sideways.direction) is None


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
