"""Rays that never leave: they end with a status after the steps allowed, and no other ray feels it."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, RayStatus, launch, trace
from tests.slow import first_of

from .checks import PRECISIONS, UNIT, UP, assert_same_bits, keeps_promises


def fish_eye(geometry: str) -> IndexField:
    """Maxwell's n = 2 / (1 + r^2), over r up to 1.5 in cells of 1/16: every ray is a circle, that of r = 1 too."""
    axis = np.arange(-24, 25) / 16.0
    mesh = np.meshgrid(*[axis] * (3 if geometry == "volume" else 2), indexing="ij")
    return IndexField.from_samples(
        2.0 / (1.0 + sum(a**2 for a in mesh)) - 0.6,
        origin=[-1.5] * len(mesh),
        spacing=[1.0 / 16.0] * len(mesh),
        geometry=geometry,
        ambient_index=0.6,
    )


@pytest.mark.parametrize("precision", first_of(PRECISIONS))
def test_twenty_turns_of_a_circle(precision):
    """After the arc 40 pi a ray on the circle r = 1, and one a quarter turn on, are back where they started.

    Formula: optical path n s = 40 pi. Errors: the cubic spline of a fish-eye in 16 cells: its force is off by
    h^3 f'''' / 24 ~ 1e-4 here, 1e-3 over the turns as a change of radius and 40 pi times that along the circle. What is
    tested is that it ends at the length: position within 0.1, and |r| = 1 within 1e-2; the length itself to rounding.
    """
    length = 40.0 * np.pi
    rays = RayBundle([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    result = trace(fish_eye("planar"), rays, until=ArcLength(length), method="adaptive", precision=precision)
    assert keeps_promises(result, 2).ok.all()
    assert np.abs(result.arc_length - length).max() < 8.0 * UNIT[precision] * length + 1e-9
    assert np.abs(np.linalg.norm(result.position, axis=1) - 1.0).max() < 1e-2
    assert np.abs(result.position - rays.position).max() < 0.1
    assert np.abs(result.optical_path / length - 1.0).max() < 1e-2


@pytest.mark.parametrize("precision", PRECISIONS)
def test_failing_rays_leave_their_neighbours_alone(precision, monkeypatch):
    """Rays that are trapped, that miss, that never meet the plane, among 300 that arrive (three chunks of a launch).

    Every ray has the very bits it has without the failing ones, and each failure its own name at its own place. (Some
    more of this bundle are bent back by the lens itself.)
    """
    field = fish_eye("planar")
    rng = np.random.default_rng(2)
    count = 300
    monkeypatch.setattr(launch, "CHUNK", 128)
    start = np.c_[np.zeros(count), rng.uniform(-1.4, 1.4, count), np.full(count, -2.0)]
    heading = np.c_[np.zeros(count), rng.normal(0.0, 0.1, count), np.ones(count)]
    bad = np.array([0, 1, 2, 17, 127, 128, 255, 256, 299])
    start[bad], heading[bad] = [0.0, 1.0, 0.0], UP
    backward = np.array([5, 270])
    heading[backward] = [0.0, 0.0, -1.0]
    until = Plane((0, 0, 2.5), UP)
    settings_ = {"until": until, "method": "adaptive", "max_steps": 400, "tolerance": 10.0, "precision": precision}
    every = keeps_promises(trace(field, RayBundle(start, heading), **settings_), count)
    assert (every.status[bad] == RayStatus.MAX_STEPS).all()
    assert (every.status[backward] == RayStatus.STOP_NOT_REACHED).all()
    good = np.setdiff1d(np.arange(count), np.r_[bad, backward])
    alone = keeps_promises(trace(field, RayBundle(start[good], heading[good]), **settings_), len(good))
    assert alone.ok.mean() > 0.5
    assert_same_bits(every, alone, good)
