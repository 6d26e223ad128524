"""Rays with a closed form: the quick ones; tests/physics has the full suite."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace

WAVE = 905e-9


def radial_gradient(cell: float, height: float, length: float, n0: float = 1.5, g: float = 100.0) -> IndexField:
    """n^2 = n0^2 (1 - g^2 y^2), whose rays are exactly sinusoidal."""
    y = np.arange(-round(height / cell), round(height / cell) + 1) * cell
    z = np.arange(round(length / cell) + 1) * cell
    contrast = n0 * np.sqrt(1.0 - (g * y) ** 2) - n0
    return IndexField.from_samples(
        np.repeat(contrast[:, None], len(z), axis=1),
        origin=(y[0], 0.0),
        spacing=(cell, cell),
        geometry="planar",
        ambient_index=n0,
    )


@pytest.mark.parametrize(("precision", "allowed"), [("float32", 3e-6), ("float64", 1e-8)])
@pytest.mark.parametrize("method", ["adaptive", "fixed"])
def test_radial_gradient_of_figure_1(precision, allowed, method):
    """Set-up: the paper's Figure 1 medium, n0 = 1.5, g = 0.1 / mm, 0.25 mm cells, a ray at 1.6 mm along z.

    Formula: y = x0 cos(n0 g z / beta), beta = n0 sqrt(1 - g^2 x0^2). Errors: the spline reproduces the potential, a
    parabola, so what is left is steps and rounding. Tolerance: the issue's, on |y - y_exact| / x0.
    """
    field, x0 = radial_gradient(0.25e-3, 4e-3, 65e-3), 1.6e-3
    beta = 1.5 * np.sqrt(1.0 - (100.0 * x0) ** 2)
    rays = RayBundle([[0.0, x0, 0.0]], [[0.0, 0.0, 1.0]])
    settings = {"step": 0.1e-3} if method == "fixed" else {"tolerance": 1e-5 if precision == "float64" else 1e-3}
    for z in (11e-3, 16.1e-3, 33.3e-3, 62e-3):
        result = trace(field, rays, until=Plane((0, 0, z), (0, 0, 1)), method=method, precision=precision, **settings)
        assert result.position[0, 2] == pytest.approx(z, abs=1e-15)
        exact = x0 * np.cos(150.0 * z / beta)
        assert abs(result.position[0, 1] - exact) / x0 < allowed


@pytest.mark.parametrize("geometry", ["planar", "volume"])
def test_order_in_a_weak_smooth_field_is_at_least_four(geometry):
    """Fixed steps from 24 to 10 cells through a Gaussian blob of 12 cells, contrast 1e-4, aslant: OPD and direction.

    Fitted order at least 3.8 in both. (The path's own rule is exact to degree four: its order may come out higher.)
    """
    h, size = 1e-4, 12e-4
    low = -0.5 * 160 * h
    y, z = np.meshgrid(low + h * np.arange(161), h * np.arange(241), indexing="ij")
    contrast = 1e-4 * np.exp(-(y**2 + (z - 12e-3) ** 2) / (2 * size**2))
    origin, spacing = [low, 0.0], [h, h]
    if geometry == "volume":
        contrast, origin, spacing = np.repeat(contrast[None], 4, axis=0), [-1.5 * h, *origin], [h, *spacing]
    field = IndexField.from_samples(contrast, origin=origin, spacing=spacing, geometry=geometry)
    # Starts at many phases of the steps, so that their mean error shows and not one cancellation.
    start = np.random.default_rng(2).uniform(0.0, 2.4e-3, 64)
    rays = RayBundle(np.c_[0 * start, np.full(64, 0.7e-3), start], [[0.0, 0.03, 1.0]])
    settings = {"until": Plane((0, 0, 23e-3), (0, 0, 1)), "precision": "float64"}
    exact = trace(field, rays, method="fixed", step=0.5 * h, **settings)
    steps = h * np.array([24.0, 20.0, 16.0, 13.0, 10.0])
    off = np.array(
        [
            [np.sqrt(np.mean((getattr(found, name) - getattr(exact, name)) ** 2)) for name in ("opd", "direction")]
            for found in (trace(field, rays, method="fixed", step=float(step), **settings) for step in steps)
        ]
    )
    orders = [np.polyfit(np.log(steps), np.log(column), 1)[0] for column in off.T]
    assert min(orders) > 3.8


def test_order_of_fixed_steps_is_four():
    """Fitted order 4 +- 0.2 in position on the same medium, float64, steps where rounding does not show."""
    field, x0, z = radial_gradient(0.25e-3, 4e-3, 65e-3), 1.6e-3, 50e-3
    exact = x0 * np.cos(150.0 * z / (1.5 * np.sqrt(1.0 - (100.0 * x0) ** 2)))
    rays = RayBundle([[0.0, x0, 0.0]], [[0.0, 0.0, 1.0]])
    steps = np.array([2e-3, 1e-3, 0.5e-3, 0.25e-3])
    off = []
    for step in steps:
        result = trace(
            field, rays, until=Plane((0, 0, z), (0, 0, 1)), method="fixed", step=float(step), precision="float64"
        )
        off.append(abs(result.position[0, 1] - exact))
    order = np.polyfit(np.log(steps), np.log(off), 1)[0]
    assert abs(order - 4.0) < 0.2


def test_the_precision_trap():
    """A contrast of 2^-30 over 1 m, float32: an index of 1 + 2^-30 does not exist in float32, its OPD must."""
    contrast = np.full((5, 5, 1001), 2.0**-30)
    field = IndexField.from_samples(
        contrast, origin=(-2e-3, -2e-3, 0.0), spacing=(1e-3, 1e-3, 1e-3), geometry="volume", ambient_index=1 + 2.0**-30
    )
    rays = RayBundle([[0.3e-3, -0.2e-3, -0.25]], [[0.0, 0.0, 1.0]])
    for method in ("adaptive", "straight"):
        result = trace(field, rays, until=Plane((0, 0, 1.25), (0, 0, 1)), method=method, precision="float32")
        assert result.opd[0] == pytest.approx(2.0**-30, rel=1e-6)
        assert result.optical_path[0] - 1.5 == pytest.approx(1.5 * 2.0**-30 + 2.0**-30, rel=1e-6)


def test_float32_over_a_metre_and_a_half():
    """20 000 cells of a smooth random field over 1.5 m: float32 within 1e-3 wave of float64 (decision 1)."""
    rng = np.random.default_rng(11)
    z = np.linspace(0.0, 1.0, 20_001)
    wave = sum(rng.normal() * np.sin(2 * np.pi * k * z + rng.uniform(0, 6)) for k in range(1, 40))
    y = np.linspace(-1.0, 1.0, 9)
    contrast = 3e-4 * (1.0 + 0.1 * wave[None, :] / np.abs(wave).max() * np.cos(y)[:, None])
    field = IndexField.from_samples(
        contrast, origin=(-4e-3, 0.0), spacing=(1e-3, 1.5 / 20_000), geometry="planar", ambient_index=1.0
    )
    rays = RayBundle(np.c_[np.zeros(5), np.linspace(-3e-3, 3e-3, 5), np.full(5, -0.01)], [[0.0, 1e-4, 1.0]])
    settings = {"until": Plane((0, 0, 1.6), (0, 0, 1)), "method": "fixed", "step": 1.5e-4}
    single = trace(field, rays, precision="float32", **settings)
    double = trace(field, rays, precision="float64", **settings)
    assert single.step_count.max() > 9_000
    assert np.abs(single.opd - double.opd).max() < 1e-3 * WAVE
