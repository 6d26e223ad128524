"""Rays that end where no examined ray does."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.leapfrog.sample_count import SPREAD_RAYS
from tests.random_fields import CELL

from ..backends import ENGINES, WAVE, on

COUNT, APART = 36, 6  # samples, and cells between them
END = COUNT * APART  # node at which rays stop


def spot_field() -> IndexField:
    """Two smooth blobs at y = -22 and 42 cells, and between them, at y = 25, a spot at the rays' end."""
    y, z = np.meshgrid(np.arange(-48.0, 49.0), np.arange(END + 9.0), indexing="ij")
    depth = np.exp(-0.5 * ((z - 80.0) / 18.0) ** 2)
    blobs = depth * (np.exp(-0.5 * ((y + 22.0) / 8.0) ** 2) + np.exp(-0.5 * ((y - 42.0) / 8.0) ** 2)) / 50.0
    behind = (z - END + 0.45 * APART) / (0.7 * APART)
    spot = 0.03 / APART * np.exp(-0.5 * (behind**2 + ((y - 25.0) / 3.0) ** 2))
    return IndexField.from_samples(
        WAVE / CELL * (blobs + spot), origin=(y[0, 0] * CELL, 0.0), spacing=(CELL, CELL), geometry="planar"
    )


@pytest.mark.parametrize("engine", ENGINES)
def test_a_few_rays_that_alone_end_in_a_spot_are_right(engine):
    """None of them is among the rays whose lines are examined, nor are they outermost: they were off by two tolerances.

    The others end in calm air.
    """
    count, few, rng = 12_000, 12, np.random.default_rng(3)
    height, slope = rng.uniform(-40.0, -5.0, count), rng.normal(0.0, 1e-3, count)
    examined = np.linspace(0, count - 1, SPREAD_RAYS).round().astype(int)
    height[examined[:40]] = 42.0
    height[examined[-1]] = 45.0
    pilot = np.linspace(0, count - 1, 512).round().astype(int)
    others = np.setdiff1d(np.arange(count), [*examined, *pilot, *slope.argsort()[[0, -1]]])
    rows = rng.choice(others, few, replace=False)
    height[rows] = 25.0 + rng.uniform(-2.0, 2.0, few)
    start = np.c_[0.0 * height, height * CELL, np.full(count, -1e-3)]
    field, rays = spot_field(), RayBundle(start, np.c_[0.0 * slope, slope, np.ones(count)])
    until = Plane((0.0, 0.0, END * CELL), (0.0, 0.0, 1.0))
    result = trace(field, rays, until=until, wavelength=WAVE, **on(engine))
    assert result.plan.sample_count
    tight = {"method": "adaptive", "precision": "float64", "tolerance": 1e-6}
    exact = trace(field, rays.rows(rows), until=until, wavelength=WAVE, **tight)
    assert np.abs(result.opd[rows] - exact.opd).max() < 1e-3 * WAVE
