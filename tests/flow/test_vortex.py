"""The isentropic vortex."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from aerokernels import flow


@pytest.mark.parametrize(("mach", "gamma"), [(0.05, 1.4), (0.5, 1.4), (1.3, 1.4), (0.8, 1.2), (0.9, 5.0 / 3.0)])
def test_against_the_radial_balance(mach, gamma):
    """Set-up: dp / dr = rho v^2 / r with rho = p^(1/g) (rho, p and the radius 1 far away), from six radii inwards.

    v = sqrt(g) M r exp((1 - r^2) / 2). Expected: density and pressure in closed form. Error: the integration's; 1e-9.
    """
    swirl = flow.Vortex(mach, 2.0, gamma)

    def slope(r, p):
        speed = math.sqrt(gamma) * mach * r * math.exp(0.5 * (1.0 - r * r))
        return p ** (1.0 / gamma) * speed**2 / r

    stops = np.linspace(7.0, 0.02, 40)
    found = solve_ivp(slope, (7.0, 0.02), [1.0], t_eval=stops, rtol=1e-12, atol=1e-13, method="DOP853").y[0]
    assert np.abs(swirl.density_ratio_at(2.0 * stops, 0.0) - found ** (1.0 / gamma)).max() < 1e-9


def test_field_is_the_formulas_average():
    """Averages against Gauss's rule with 20 points each way: 1e-11 for cells of 1/2 and 1/20 of the radius."""
    node, weight = np.polynomial.legendre.leggauss(20)
    for spacing in (5e-3, 5e-4):
        field = flow.vortex(1.2, radius=0.01, spacing=spacing, density=0.6)
        cell = np.argmin(field.density) + np.arange(0, 30, 3)
        low, high = field.mesh.corners[cell].min(axis=1), field.mesh.corners[cell].max(axis=1)
        y, z = (low[:, k, None] + 0.5 * (high - low)[:, k, None] * (node + 1.0) for k in range(2))
        values = field.solution.density_ratio_at(y[:, :, None], z[:, None, :])
        expected = 0.6 * 0.25 * np.einsum("nij,i,j->n", values, weight, weight)
        assert np.abs(field.density[cell] / expected - 1.0).max() < 1e-11


def test_bad_vortices_are_refused():
    with pytest.raises(ValueError, match=r"must be below 1\.35"):
        flow.vortex(1.4)
    with pytest.raises(ValueError, match="mach must be positive"):
        flow.vortex(-0.5)
    with pytest.raises(ValueError, match="at most half the radius"):
        flow.vortex(0.5, radius=0.01, spacing=0.006)
    with pytest.raises(ValueError, match="take a wider one"):
        flow.vortex(0.5, radius=0.01, spacing=1e-6)
    with pytest.raises(ValueError, match="gamma must be above 1"):
        flow.Vortex(0.5, 0.01, 1.0)
