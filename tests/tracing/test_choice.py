"""What "auto" takes for few rays: error control, whatever the field is like, and never a fixed step."""

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
def test_smooth_weak_fields_take_error_control(tolerance):
    """It keeps the tolerance; a fixed step chosen for the roughest place missed it 2 to 4 times on such fields."""
    field = turbulence()
    exact = trace(field, RAYS, until=END, method="adaptive", tolerance=1e-7, precision="float64")
    chosen = trace(field, RAYS, until=END, tolerance=tolerance, precision="float64")
    assert chosen.plan.method == "adaptive" and "error control" in chosen.plan.reasons[0]
    assert chosen.plan.step is None and (chosen.step_error <= tolerance * WAVE).all()
    assert np.abs(chosen.opd - exact.opd).max() < tolerance * WAVE


@pytest.mark.parametrize(
    "field",
    [turbulence(strip=2), turbulence(interpolation="linear"), turbulence(amplitude=0.3, size=12.0)],
    ids=["shock", "kinks", "strong"],
)
def test_the_others_take_it_too(field):
    assert trace(field, RAYS[np.arange(2)], until=END).plan.method == "adaptive"


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
