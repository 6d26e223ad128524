"""The Riemann problem, and a shock tube as a density field."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from aerokernels import flow
from aerokernels.flow import GasState

STATE = st.builds(
    lambda density, pressure, velocity: GasState(10.0**density, 10.0**pressure, velocity),
    st.floats(-2.0, 2.0),
    st.floats(-2.0, 2.0),
    st.floats(-3.0, 3.0),
)
GAMMA = st.floats(1.1, 1.67)
SOD = (GasState(1.0, 1.0), GasState(0.125, 0.1))


def solved(left, right, gamma):
    limit = 2.0 / (gamma - 1.0) * (left.sound_speed(gamma) + right.sound_speed(gamma))
    assume(right.velocity - left.velocity < 0.9 * limit)
    return flow.riemann(left, right, gamma=gamma)


@pytest.mark.parametrize(
    ("left", "right", "pressure", "velocity", "densities"),
    [
        ((1.0, 1.0, 0.0), (0.125, 0.1, 0.0), 0.30313, 0.92745, (0.42632, 0.26557)),
        ((1.0, 0.4, -2.0), (1.0, 0.4, 2.0), 0.00189, 0.0, (0.02185, 0.02185)),
        ((1.0, 1000.0, 0.0), (1.0, 0.01, 0.0), 460.894, 19.5975, (0.57506, 5.99924)),
        ((1.0, 0.01, 0.0), (1.0, 100.0, 0.0), 46.0950, -6.19633, (5.99242, 0.57511)),
        ((5.99924, 460.894, 19.5975), (5.99242, 46.0950, -6.19633), 1691.64, 8.68975, (14.2823, 31.0426)),
    ],
)
def test_toros_tests(left, right, pressure, velocity, densities):
    """Toro, Table 4.3: star values of five problems, to the table's digits."""
    found = flow.riemann(GasState(*left), GasState(*right))
    assert abs(found.pressure / pressure - 1.0) < (3e-3 if pressure < 0.01 else 1e-5)
    assert abs(found.velocity - velocity) < 1e-5 * max(1.0, abs(velocity))
    np.testing.assert_allclose((found.left_density, found.right_density), densities, rtol=2e-4)


@given(STATE, STATE, GAMMA)
def test_waves_conserve(left, right, gamma):
    """Each wave keeps what it must; rounding, against the greatest term: 1e-10.

    Across a shock: mass, momentum and energy fluxes in the wave's own frame. Across a rarefaction: entropy and
    u +- 2 a / (g - 1).
    """
    found = solved(left, right, gamma)
    for state, density, wave, sign in (
        (left, found.left_density, found.left_wave, 1.0),
        (right, found.right_density, found.right_wave, -1.0),
    ):
        if wave[0] == wave[1]:
            sides = []
            for rho, p, u in (
                (state.density, state.pressure, state.velocity),
                (density, found.pressure, found.velocity),
            ):
                w = u - wave[0]
                sides.append((rho * w, p + rho * w * w, w * (gamma / (gamma - 1.0) * p + 0.5 * rho * w * w)))
            for before, after in zip(*sides, strict=True):
                assert abs(after - before) < 1e-10 * max(abs(before), abs(after))
            assert found.pressure >= state.pressure * (1.0 - 1e-13)
        else:
            entropy = math.log(found.pressure / state.pressure) - gamma * math.log(density / state.density)
            assert abs(entropy) < 1e-11 * (1.0 + abs(math.log(found.pressure / state.pressure)))
            sound = math.sqrt(gamma * found.pressure / density)
            before = state.velocity + sign * 2.0 / (gamma - 1.0) * state.sound_speed(gamma)
            after = found.velocity + sign * 2.0 / (gamma - 1.0) * sound
            assert abs(after - before) < 1e-10 * (1.0 + abs(before) + state.sound_speed(gamma))
    assert list(found.breaks) == sorted(found.breaks)


@settings(max_examples=40, deadline=None)
@given(STATE, STATE, GAMMA)
def test_nothing_is_lost_in_the_tube(left, right, gamma):
    """Set-up: a stretch that holds all waves at t = 1; its content by Gauss's rule, 40 points in each region.

    Formula: mass, momentum and energy change by what flows in and out at its ends, where the states are the initial
    ones. Tolerance 1e-9 of what is there and flows.
    """
    found = solved(left, right, gamma)
    reach = 1.1 * max(abs(speed) for speed in found.breaks) + 0.1
    node, weight = np.polynomial.legendre.leggauss(40)
    total = np.zeros(3)
    edges = [-reach, *found.breaks, reach]
    for low, high in pairwise(edges):
        if high <= low:
            continue
        xi = low + 0.5 * (high - low) * (node + 1.0)
        rho, u, p = found.density_at(xi), found.velocity_at(xi), found.pressure_at(xi)
        content = np.stack([rho, rho * u, p / (gamma - 1.0) + 0.5 * rho * u * u])
        total += 0.5 * (high - low) * content @ weight
    expected = np.zeros(3)
    size = np.zeros(3)
    for state, sign in ((left, 1.0), (right, -1.0)):
        rho, u, p = state.density, state.velocity, state.pressure
        energy = p / (gamma - 1.0) + 0.5 * rho * u * u
        flux = np.array([rho * u, rho * u * u + p, u * (energy + p)])
        expected += reach * np.array([rho, rho * u, energy]) + sign * flux
        size += reach * np.array([rho, rho * abs(u), energy]) + abs(flux)
    assert (np.abs(total - expected) < 1e-9 * size).all()


@pytest.mark.parametrize("gamma", [1.2, 1.4, 5.0 / 3.0])
def test_rarefaction_against_integration(gamma):
    """Sod's left wave by du / d rho = -a / rho at one entropy, and x / t = u - a on the way (characteristics)."""
    found = flow.riemann(*SOD, gamma=gamma)
    stops = np.linspace(1.0, found.left_density, 15)
    path = solve_ivp(
        lambda rho, u: -math.sqrt(gamma * rho ** (gamma - 1.0)) / rho,
        (1.0, found.left_density),
        [0.0],
        t_eval=stops,
        rtol=1e-12,
        atol=1e-13,
        method="DOP853",
    ).y[0]
    assert abs(path[-1] - found.velocity) < 1e-9
    xi = path - np.sqrt(gamma * stops ** (gamma - 1.0))
    inside = slice(1, -1)  # on its ends the wave's kinks
    assert np.abs(found.density_at(xi[inside]) - stops[inside]).max() < 1e-9
    assert np.abs(found.velocity_at(xi[inside]) - path[inside]).max() < 1e-9
    assert np.abs(found.pressure_at(xi[inside]) - stops[inside] ** gamma).max() < 1e-9


@given(STATE, STATE, GAMMA)
def test_mirror_image(left, right, gamma):
    """Left and right exchanged and velocities turned round: the same waves, mirrored."""
    found = solved(left, right, gamma)
    turned = [GasState(state.density, state.pressure, -state.velocity) for state in (right, left)]
    mirror = flow.riemann(*turned, gamma=gamma)
    assert abs(mirror.pressure / found.pressure - 1.0) < 1e-12
    scale = 1.0 + abs(found.velocity) + left.sound_speed(gamma) + right.sound_speed(gamma)
    assert abs(mirror.velocity + found.velocity) < 1e-11 * scale
    assert np.abs(np.array(mirror.breaks) + np.array(found.breaks)[::-1]).max() < 1e-10 * scale


def test_a_moving_normal_shock_is_the_steady_one():
    """Gas driven so that nothing but a shock of Mach 3 runs into the right: the ratios of `normal_shock`."""
    shock = flow.normal_shock(3.0)
    sound = math.sqrt(1.4)
    behind = GasState(shock.density_ratio, shock.pressure_ratio, 3.0 * sound * (1.0 - 1.0 / shock.density_ratio))
    found = flow.riemann(behind, GasState(1.0, 1.0))
    assert abs(found.right_wave[0] / (3.0 * sound) - 1.0) < 1e-12
    assert abs(found.right_density / shock.density_ratio - 1.0) < 1e-12
    assert abs(found.left_density / shock.density_ratio - 1.0) < 1e-12


def test_tube_in_both_directions():
    """Cell averages are the density's integral by Gauss's rule in each region; along z the tube runs downstream."""
    driver, driven = GasState(1.2, 1e5), GasState(0.15, 1e4)
    across = flow.shock_tube(driver, driven, 3e-4, length=0.5, spacing=7e-3)
    along = flow.shock_tube(driver, driven, 3e-4, length=0.5, axis="z", spacing=7e-3)
    cells = across.density.reshape(-1, 8)
    np.testing.assert_array_equal(cells[:, 0], cells[:, 7])
    np.testing.assert_array_equal(along.density.reshape(8, -1)[3], cells[::-1, 0])
    found = across.solution.riemann
    edges = np.unique(across.mesh.vertices[:, 0])
    width = edges[1] - edges[0]
    # Mass: what there was, since nothing has reached the ends.
    assert abs(cells[:, 0].sum() * width - 0.25 * (1.2 + 0.15)) < 1e-13
    node, weight = np.polynomial.legendre.leggauss(30)
    places = np.concatenate([edges, np.clip(3e-4 * np.array(found.breaks), edges[0], edges[-1])])
    pieces = np.unique(places)
    x = pieces[:-1, None] + 0.5 * np.diff(pieces)[:, None] * (node + 1.0)
    integral = 0.5 * np.diff(pieces) * (found.density_at(x / 3e-4) @ weight)
    owner = np.searchsorted(edges, pieces[:-1], side="right") - 1
    expected = np.bincount(owner, integral, minlength=len(edges) - 1) / width
    np.testing.assert_allclose(cells[:, 0], expected, rtol=1e-11)
    assert across.ambient_density == 0.15 and across.density_at([[0.0, 0.24, 0.0]])[0] == 0.15
    assert across.density_at([[0.0, -0.24, 0.0]])[0] == 1.2 == along.density_at([[0.0, 0.0, 0.24]])[0]
    assert driver.temperature() == 1e5 / (1.2 * flow.GAS_CONSTANT_AIR)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"time": 1e-3}, r"too short: at 0\.001 s"),
        ({"time": 0.0}, "time must be positive"),
        ({"axis": "x"}, "choose one of y, z"),
        ({"spacing": -1.0}, "spacing must be positive"),
        ({"spacing": 1e-9}, "take a wider one"),
        ({"spacing": 0.1}, "at least 8 along either axis"),
        ({"width": 0.0}, "width must be positive"),
        ({"gamma": 1.0}, "gamma must be above 1"),
        ({"left": GasState(1.2, 1e5, -5e3)}, "vacuum opens"),
    ],
)
def test_bad_tubes_are_refused(change, fault):
    arguments = {"left": GasState(1.2, 1e5), "right": GasState(0.15, 1e4), "time": 3e-4, "length": 0.5} | change
    with pytest.raises(ValueError, match=fault):
        flow.shock_tube(**arguments)


def test_bad_states_are_refused():
    with pytest.raises(TypeError, match="left must be a GasState"):
        flow.riemann((1.0, 1.0, 0.0), SOD[1])
    with pytest.raises(ValueError, match="pressure must be positive"):
        GasState(1.0, -1.0)
    with pytest.raises(ValueError, match="velocity must be finite"):
        GasState(1.0, 1.0, math.nan)
