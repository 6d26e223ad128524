"""Taylor-Maccoll: the flow over a cone against other formulations, conservation, limits and published angles."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from aerokernels import flow

CASES = [(1.05, 3.0), (1.5, 10.0), (2.0, 30.0), (3.0, 20.0), (5.0, 40.0), (10.0, 5.0), (20.0, 10.0), (20.0, 50.0)]
ANYWHERE = (st.floats(1.2, 12.0), st.floats(0.05, 0.99), st.floats(1.15, 1.66))


def gauss(low, high, count=200):
    """Nodes and weights for integrands that go as a root at the upper end."""
    node, weight = np.polynomial.legendre.leggauss(count)
    share = 0.5 * (node + 1.0)
    return high - (high - low) * share**2, (high - low) * share * weight


def state(shock, angle):
    """Density and pressure (free stream: 1 and 1 / (gamma M^2)), radial and polar velocity at polar angles."""
    density = shock.density_ratio_at(angle)
    # Entropy is the same everywhere behind the shock: pressure goes with density^gamma.
    pressure = shock.pressure_ratio * (density / shock.density_ratio) ** shock.gamma / (shock.gamma * shock.mach**2)
    return density, pressure, *shock.velocity_at(angle)


@pytest.mark.parametrize(("mach", "degrees"), CASES)
def test_the_textbook_equation_gives_the_same_flow(mach, degrees):
    """Set-up: Anderson's equation (10.15), velocities over the maximum one, from the shock angle found to the wall.

    Expected: radial flow at the half angle, the same Mach number there and the same density on the way. Neither the
    deviation form nor the strength as unknown is used. Errors: both integrations, below 1e-11 each.
    """
    shock = flow.cone_shock(mach, math.radians(degrees))
    angle, half = shock.shock_angle, 0.2
    excess = (mach * math.sin(angle)) ** 2 - 1.0
    turn = math.atan(2.0 / math.tan(angle) * excess / (mach**2 * (1.4 + math.cos(2.0 * angle)) + 2.0))
    behind = flow.oblique_shock(mach, turn)
    if abs(behind.shock_angle - angle) > 1e-9:  # past the wedge's greatest turn it is the strong one of the two
        behind = flow.oblique_shock(mach, turn, strong=True)
    assert abs(behind.shock_angle - angle) < 1e-9 and abs(shock.deflection - turn) < 1e-11
    speed = 1.0 / math.sqrt(1.0 + 5.0 / behind.downstream_mach**2)
    start = (speed * math.cos(angle - turn), -speed * math.sin(angle - turn))

    def slope(theta, v):
        radial, polar = v
        rest = half * (1.0 - radial**2 - polar**2)
        return polar, (radial * polar**2 - rest * (2.0 * radial + polar / math.tan(theta))) / (rest - polar**2)

    stops = np.linspace(angle, shock.half_angle, 30)
    found = solve_ivp(slope, (angle, shock.half_angle), start, rtol=1e-12, atol=1e-14, method="DOP853", t_eval=stops)
    radial, polar = found.y
    assert abs(polar[-1]) < 1e-10
    assert abs(radial[-1] / math.sqrt(half * (1.0 - radial[-1] ** 2)) - shock.surface_mach) < 1e-9
    density = behind.density_ratio * ((1.0 - radial**2 - polar**2) / (1.0 - speed**2)) ** 2.5
    # The first angle may lie on either side of the shock.
    assert np.abs(shock.density_ratio_at(stops[1:]) - density[1:]).max() < 1e-9
    unit = 1.0 / math.sqrt(1.0 + 5.0 / mach**2)
    assert np.abs(np.array(shock.velocity_at(stops[1:])) - found.y[:, 1:] / unit).max() < 1e-9


@settings(max_examples=6, deadline=None)
@given(*ANYWHERE)
def test_mass_and_momentum_balance(mach, share, gamma):
    """Set-up: the gas between wall, shock and a sphere about the tip; free stream of density and speed 1.

    Mass: 2 int rho v_r sin t dt = sin^2 b. Momentum along the axis: 2 int [(p - p1) cos t + rho v_r v_x] sin t dt
    + (p_wall - p1) sin^2 d = sin^2 b. Errors: Gauss quadrature of a profile good to 1e-11, sums of order 1.
    """
    half_angle = share * flow.maximum_cone_angle(mach, gamma=gamma)
    shock = flow.cone_shock(mach, half_angle, gamma=gamma)
    angle, weight = gauss(half_angle, shock.shock_angle)
    density, pressure, radial, polar = state(shock, angle)
    ambient = 1.0 / (gamma * mach**2)
    along = radial * np.cos(angle) - polar * np.sin(angle)
    captured = math.sin(shock.shock_angle) ** 2
    assert abs(2.0 * np.sum(weight * density * radial * np.sin(angle)) - captured) < 1e-9
    thrust = 2.0 * np.sum(weight * ((pressure - ambient) * np.cos(angle) + density * radial * along) * np.sin(angle))
    wall = (shock.surface_pressure_ratio - 1.0) * ambient * math.sin(half_angle) ** 2
    assert abs(thrust + wall - captured) < 1e-9


@pytest.mark.parametrize(("mach", "degrees", "angle"), [(2.0, 10.0, 31.2), (3.0, 20.0, 29.6)])
def test_shock_angles_of_the_charts(mach, degrees, angle):
    """NACA 1135, charts of cones in air, as far as they can be read: 0.1 degree."""
    assert abs(math.degrees(flow.cone_shock(mach, math.radians(degrees)).shock_angle) - angle) < 0.1


@pytest.mark.parametrize(("mach", "half_angle"), [(2.0, 1e-3), (1.3, 3e-4), (4.0, 1e-3)])
def test_slender_cones(mach, half_angle):
    """Slender limit d -> 0: pressure coefficient d^2 (2 ln(2 / (B d)) - 1) with B = sqrt(M^2 - 1) (linear theory).

    The shock's strength M^2 sin^2 b - 1 goes to 2 B dB with b - mu = 3/8 (g+1)^2 M^6 d^4 / B^3 (Lighthill 1948,
    Whitham 1952). The next terms are of order (M d)^2 ln: below 1 % for these.
    """
    shock = flow.cone_shock(mach, half_angle)
    root = math.sqrt(mach**2 - 1.0)
    coefficient = 2.0 * (shock.surface_pressure_ratio - 1.0) / (1.4 * mach**2)
    assert abs(coefficient / (half_angle**2 * (2.0 * math.log(2.0 / (root * half_angle)) - 1.0)) - 1.0) < 0.01
    excess = 0.375 * 2.4**2 * mach**6 * half_angle**4 / root**3
    # The velocity jump across the shock is w = 2 e / ((g + 1) (1 + e)) sin b, free of cancellation.
    strength = 1.2 * shock.profile(0.0)[1] * mach
    assert abs(strength / (2.0 * root * excess) - 1.0) < 0.01
    assert abs(shock.shock_angle - math.asin(1.0 / mach)) < 1.01 * excess + 1e-15


@pytest.mark.parametrize("mach", [1.2, 2.0, 20.0])
def test_greatest_half_angle(mach):
    """Attached just below it, detached just above; well above the wedge's. Mach 2: 40.7 degrees (NACA 1135, charts)."""
    greatest = flow.maximum_cone_angle(mach)
    assert mach != 2.0 or abs(math.degrees(greatest) - 40.7) < 0.1
    assert greatest > 1.2 * flow.maximum_deflection(mach)
    assert flow.cone_shock(mach, greatest * (1.0 - 1e-9)).half_angle < greatest
    with pytest.raises(ValueError, match=rf"detaches.*{math.degrees(greatest):.4g} deg"):
        flow.cone_shock(mach, greatest * (1.0 + 1e-6))


@pytest.mark.parametrize("mach", [0.99, -2.0, math.nan, math.inf])
def test_subsonic_streams_are_refused(mach):
    with pytest.raises(ValueError, match="mach must be 1 or more"):
        flow.cone_shock(mach, 0.1)


@pytest.mark.parametrize("half_angle", [0.0, -0.1, 1e-9, math.nan, math.inf])
def test_bad_half_angles_are_refused(half_angle):
    with pytest.raises(ValueError, match="half_angle must be at least"):
        flow.cone_shock(2.0, half_angle)
    with pytest.raises(ValueError, match="detaches"):
        flow.cone_shock(1.0, 0.01)
