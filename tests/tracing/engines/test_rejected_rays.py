"""Chunks of rays without a rejected one: their step_error is not left to chance."""

from dataclasses import replace

import numpy as np
import pytest

from aerokernels import IndexField, Plane
from aerokernels.device_arrays import rows_where
from aerokernels.tracing import launch
from aerokernels.tracing.engines import engine_of
from aerokernels.tracing.planning import make_plan

from ..backends import ENGINES, WAVE, on

H = 1e-4
SHAPE = (14, 15, 18)
STOP = Plane((0.0, 0.0, (SHAPE[2] - 1) * H), (0.0, 0.0, 1.0))
COUNT, CHUNK, TOLERANCE = 3000, 700, 1e-3


def field() -> IndexField:
    """A wide blob, with a needle of some cells' width that polynomials of cubes do not hold."""
    x, y, z = np.meshgrid(*(np.arange(count) - 0.5 * (count - 1) for count in SHAPE), indexing="ij")
    made = 6e-4 * np.exp(-(x**2 + y**2 + (0.5 * z) ** 2) / 400.0)
    made += 1e-4 * np.exp(-((x - 2.0) ** 2 + (y - 1.0) ** 2) / 3.0)
    return IndexField.from_samples(made, origin=(0.0, 0.0, 0.0), spacing=(H,) * 3, geometry="volume", wavelength=WAVE)


@pytest.mark.parametrize("name", ENGINES)
def test_chunks_without_a_rejected_ray_have_no_error_left_to_chance(name: str, monkeypatch):
    """Set-up: step_error is not asked for, and new memory holds NaN; one ray, of the last chunk, is rejected.

    Expected: that ray alone is traced again.
    """
    engine, air = engine_of(**on(name)), field()
    monkeypatch.setattr(launch, "CHUNK", CHUNK)
    monkeypatch.setattr(engine, "keeps", lambda size: False)
    monkeypatch.setattr(engine, "room", lambda shape, kind: np.full(shape, np.nan if kind is np.float64 else -1, kind))
    start, ahead = np.full((COUNT, 3), [2.0 * H, 2.0 * H, 0.0]), np.tile([0.0, 0.0, 1.0], (COUNT, 1))
    start[-1] = 8.5 * H, 8.0 * H, 0.0  # along the needle
    choices = {"step": None, "max_steps": None, "path_length": None, "wavelength": WAVE, "precision": "float32"}
    plan = make_plan(air, method="straight", tolerance=TOLERANCE, directions=ahead, **choices, **on(name))
    scales = {"quadrature_error_scale": 0.5, "trajectory_error_scale": 0.05}
    plan = replace(plan, method="leapfrog", sample_count=36, cubes=True, **scales)
    ready = engine.prepare(air, plan, STOP, WAVE, frozenset(("opd",)), ahead)
    arrays = launch.in_chunks(ready, (start, ahead), frozenset(("opd",)))
    assert rows_where(arrays["status"], -1, arrays["step_error"], TOLERANCE * WAVE).tolist() == [COUNT - 1]
