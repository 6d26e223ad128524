"""Rays that end at an arc length in strong air, where the index changes along the last step.

Set-up: 200 rays through a planar field of contrasts up to 0.05, smooth over two cells, in fixed steps of 1.5 cells.
The parabola at the start of the last step may miss the arc length by more than a share of the step: such a ray came to
a halt behind it and had the status MAX_STEPS (a quarter of these rays).

Expected: every ray ends with the status OK where error control ends it, as exactly as the steps are: the greatest
distance falls by 8 when the step is halved, the third order of a cubic field. Found: 2.5e-7 and 3.2e-8 m.
"""

import functools

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, trace

from .backends import OPENCL, WARP, on

CELL, LENGTH = 1e-3, 9.3e-3


def strong_field() -> IndexField:
    samples = gaussian_filter(np.random.default_rng(0).normal(size=(21, 21)), 1.2)
    samples *= 0.05 / np.abs(samples).max()
    return IndexField.from_samples(samples, origin=(-10 * CELL, 0.0), spacing=(CELL, CELL), geometry="planar")


def rays() -> RayBundle:
    rng = np.random.default_rng(1)
    position = np.c_[np.zeros(200), rng.uniform(-8 * CELL, 8 * CELL, 200), np.full(200, 1e-4)]
    return RayBundle(position, np.c_[rng.uniform(-0.1, 0.1, (200, 2)), np.ones(200)])


@functools.cache
def ends() -> np.ndarray:
    """Where the rays end by error control, on the engine that "auto" takes [m]: one answer for all engines."""
    exact = trace(strong_field(), rays(), until=ArcLength(LENGTH), precision="float64", tolerance=1e-6)
    assert exact.ok.all()
    return exact.position


@pytest.mark.parametrize(
    ("engine", "precision"),
    [
        pytest.param(*engine.values, precision, marks=engine.marks)
        for precision, engines in (("float32", WARP + OPENCL), ("float64", OPENCL))
        for engine in engines
    ],
)
def test_all_rays_end_at_the_arc_length(engine, precision):
    """Warp in float32 only, by a kernel of test_cross_backend.py: both land alike (test_generated_kernels.py)."""
    field, bundle, until = strong_field(), rays(), ArcLength(LENGTH)
    off = []
    for step in (1.5 * CELL, 0.75 * CELL):
        found = trace(field, bundle, until=until, method="fixed", step=step, precision=precision, **on(engine))
        assert found.ok.all(), found.status_summary()
        off.append(np.linalg.norm(found.position - ends(), axis=1).max())
    assert off[1] < off[0] / 6.0


def test_so_does_the_reference_engine():
    found = trace(strong_field(), rays()[::20], until=ArcLength(LENGTH), backend="reference", method="adaptive")
    assert found.ok.all()
    assert np.linalg.norm(found.position - ends()[::20], axis=1).max() < 3e-7
