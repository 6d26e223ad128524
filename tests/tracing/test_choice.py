"""What "auto" takes: a fixed step where the field is smooth and weak all over, error control elsewhere."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from aerokernels.medium import Body, IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace

WAVE = 905e-9
CELL = 1e-4


def turbulence(amplitude: float = 1e-5, size: float = 6.0, interpolation: str = "cubic", strip: int = 0) -> IndexField:
    """Smooth random air, structures of a few `size` cells, in a planar box; `strip` columns of it are sharpened."""
    noise = gaussian_filter(np.random.default_rng(8).standard_normal((96, 192)), size, mode="wrap")
    noise *= amplitude / np.abs(noise).max()
    if strip:
        noise[:, 90 : 90 + strip] += amplitude * 3.0
    return IndexField.from_samples(
        noise, origin=(-48 * CELL, 0.0), spacing=(CELL, CELL), geometry="planar", interpolation=interpolation
    )


RAYS = RayBundle(
    np.c_[np.zeros(200), np.linspace(-30, 30, 200) * CELL, np.zeros(200)],
    np.c_[np.zeros(200), np.tile(np.linspace(-0.01, 0.01, 20), 10), np.ones(200)],
)
END = Plane((0.0, 0.0, 191 * CELL), (0.0, 0.0, 1.0))


@pytest.mark.parametrize("tolerance", [1e-1, 1e-2, 1e-3])
def test_smooth_weak_fields_take_a_fixed_step(tolerance):
    """It keeps the tolerance, and costs at most 1.4 times the evaluations of error control, each of them cheaper."""
    field = turbulence()
    exact = trace(field, RAYS, until=END, method="adaptive", tolerance=1e-7, precision="float64")
    chosen = trace(field, RAYS, until=END, tolerance=tolerance, precision="float64")
    assert chosen.plan.method == "fixed" and "smooth and weak" in chosen.plan.reasons[0]
    assert np.abs(chosen.opd - exact.opd).max() < tolerance * WAVE
    forced = trace(field, RAYS, until=END, tolerance=tolerance, precision="float64", method="adaptive")
    assert chosen.evaluation_count.mean() <= 1.4 * forced.evaluation_count.mean()


@pytest.mark.parametrize(
    ("field", "word"),
    [
        (turbulence(strip=2), "rough in places"),
        (turbulence(interpolation="linear"), "kinks"),
        (turbulence(amplitude=0.3, size=12.0), "turn"),
    ],
    ids=["shock", "kinks", "strong"],
)
def test_the_others_take_error_control(field, word):
    plan = trace(field, RAYS[np.arange(2)], until=END).plan
    assert plan.method == "adaptive" and word in plan.reasons[0]


def test_a_body_takes_error_control():
    body = Body(np.array([[0.0, -1e-3], [1e-3, -1e-3], [1e-3, 1e-3], [0.0, 2e-3]]) + np.array([0.0, 5e-3]), "planar")
    field = IndexField.from_samples(
        np.full((64, 64), 1e-5), origin=(-32 * CELL, 0.0), spacing=(CELL, CELL), geometry="planar", body=body
    )
    rays = RayBundle([[0.0, -2e-3, 0.0]], [[0.0, 0.0, 1.0]])
    assert trace(field, rays).plan.method == "adaptive"


def test_a_step_too_short_to_end_is_refused():
    with pytest.raises(ValueError, match="1e8 steps"):
        trace(turbulence(), RAYS, until=END, method="fixed", step=1e-15)
