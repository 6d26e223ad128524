"""Exact flows by other means: plain roots and integrations, cells by fine lattices, constants of gases."""

import math

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from aerokernels import flow
from aerokernels.flow import ciddor
from aerokernels.flow.billig import bow_shock
from aerokernels.flow.blunt_body import blunt_body
from aerokernels.flow.conical_profile import ConicalProfile
from aerokernels.flow.exact_averages import direction_averages, piecewise_means, smooth_averages
from aerokernels.flow.exact_field import edges, rectangles, square_step
from aerokernels.flow.fan_field import expansion_fan, mach_after_turn, maximum_expansion
from aerokernels.flow.gas import free_stream, isentropic, no_gas, stagnation_ratio, tunnel_conditions
from aerokernels.flow.riemann import GasState, riemann
from aerokernels.flow.shocks import normal_shock, oblique_shock, prandtl_meyer
from aerokernels.flow.species import SPECIES, Composition, species_constant
from aerokernels.flow.taylor_maccoll import cone_shock, maximum_cone_angle

STATES = [
    (GasState(1.0, 1e5), GasState(0.125, 1e4)),
    (GasState(1.0, 1e5, 200.0), GasState(1.3, 0.8e5, -250.0)),
    (GasState(1.0, 1e5, -300.0), GasState(0.9, 1.2e5, 350.0)),
    (GasState(0.3, 2e4, 100.0), GasState(2.0, 4e5, 20.0)),
]


@pytest.mark.parametrize("gamma", [1.4, 1.667])
@pytest.mark.parametrize(("left", "right"), STATES)
def test_a_riemann_problem_by_a_plain_root(left: GasState, right: GasState, gamma: float):
    """Toro's functions of the pressure; each region by the relations of a shock or of a fan."""

    def change(p: float, state: GasState) -> float:
        sound = math.sqrt(gamma * state.pressure / state.density)
        if p > state.pressure:
            return (p - state.pressure) * math.sqrt(
                2.0 / ((gamma + 1.0) * state.density) / (p + (gamma - 1.0) / (gamma + 1.0) * state.pressure)
            )
        return 2.0 * sound / (gamma - 1.0) * ((p / state.pressure) ** ((gamma - 1.0) / (2.0 * gamma)) - 1.0)

    apart = right.velocity - left.velocity
    pressure = brentq(lambda p: change(p, left) + change(p, right) + apart, 1.0, 1e8, xtol=1e-6, rtol=1e-14)
    velocity = left.velocity - change(pressure, left)
    found = riemann(left, right, gamma=gamma)
    assert found.pressure == pytest.approx(pressure, rel=1e-9, abs=0.0) and found.velocity == pytest.approx(
        velocity, abs=1e-6
    )
    assert left.sound_speed(gamma) == pytest.approx(math.sqrt(gamma * left.pressure / left.density))
    assert left.temperature(300.0) == pytest.approx(left.pressure / (300.0 * left.density))
    for xi in np.linspace(-900.0, 900.0, 61):
        side, sign = (left, 1.0) if xi < velocity else (right, -1.0)
        sound = side.sound_speed(gamma)
        ratio = pressure / side.pressure
        own, place = sign * side.velocity, sign * xi
        if ratio > 1.0:
            front = own - sound * math.sqrt((gamma + 1.0) / (2.0 * gamma) * ratio + (gamma - 1.0) / (2.0 * gamma))
            share = (gamma - 1.0) / (gamma + 1.0)
            behind = side.density * (ratio + share) / (share * ratio + 1.0)
            state = (side.density, own, side.pressure) if place < front else (behind, sign * velocity, pressure)
            breaks = (front,)
        else:
            tail = sign * velocity - sound * ratio ** ((gamma - 1.0) / (2.0 * gamma))
            breaks = (own - sound, tail)
            if place < own - sound:
                state = (side.density, own, side.pressure)
            elif place < tail:
                here = 2.0 / (gamma + 1.0) + (gamma - 1.0) / (gamma + 1.0) / sound * (own - place)
                speed = 2.0 / (gamma + 1.0) * (sound + 0.5 * (gamma - 1.0) * own + place)
                power = 2.0 / (gamma - 1.0)
                state = (side.density * here**power, speed, side.pressure * here ** (gamma * power))
            else:
                state = (side.density * ratio ** (1.0 / gamma), sign * velocity, pressure)
        if min(abs(place - one) for one in breaks) < 1e-3:
            continue
        assert float(found.density_at(xi)) == pytest.approx(state[0], rel=1e-8, abs=0.0)
        assert float(found.velocity_at(xi)) == pytest.approx(sign * state[1], abs=1e-5)
        assert float(found.pressure_at(xi)) == pytest.approx(state[2], rel=1e-8, abs=0.0)
    assert (np.diff(found.breaks) >= 0.0).all() and found.breaks[2] == found.velocity


def test_gases_that_part_too_fast_leave_a_vacuum():
    """From 2 (a1 + a2) / (g - 1) on."""
    still = GasState(1.0, 1e5)
    limit = 2.0 / 0.4 * 2.0 * still.sound_speed()
    with pytest.raises(ValueError, match="vacuum opens"):
        riemann(still, GasState(1.0, 1e5, 1.000001 * limit))
    assert riemann(still, GasState(1.0, 1e5, 0.99 * limit)).pressure > 0.0


@pytest.mark.parametrize(("mach", "half"), [(2.0, 0.2), (3.0, 0.35), (6.0, 0.1), (1.5, 0.25)])
@pytest.mark.parametrize("gamma", [1.4, 1.3])
def test_the_flow_over_a_cone_by_plain_integration(mach: float, half: float, gamma: float):
    """V_r and v_t from the shock inward until v_t is zero; the shock's angle by a root."""

    def integrate(shock: float, dense: bool = False):
        normal = mach * math.sin(shock)
        density = (gamma + 1.0) * normal**2 / ((gamma - 1.0) * normal**2 + 2.0)
        start = (math.cos(shock), -math.sin(shock) / density)

        def slope(t, v):
            sound = 1.0 / mach**2 + 0.5 * (gamma - 1.0) * (1.0 - v[0] ** 2 - v[1] ** 2)
            return v[1], -v[0] - sound * (v[0] + v[1] / math.tan(t)) / (sound - v[1] ** 2)

        wall = lambda t, v: v[1]  # noqa: E731
        wall.terminal = True
        return solve_ivp(slope, (shock, 1e-3), start, rtol=1e-10, atol=1e-12, events=wall, dense_output=dense), density

    found = cone_shock(mach, half, gamma=gamma)
    shock = brentq(
        lambda b: float(integrate(b)[0].t[-1]) - half, found.shock_angle - 0.02, found.shock_angle + 0.02, xtol=1e-11
    )
    assert found.shock_angle == pytest.approx(shock, abs=1e-7)
    solution, density = integrate(shock, True)
    assert found.density_ratio == pytest.approx(density, rel=1e-6, abs=0.0)
    normal = mach * math.sin(shock)
    pressure = 1.0 + 2.0 * gamma / (gamma + 1.0) * (normal**2 - 1.0)
    assert found.pressure_ratio == pytest.approx(pressure, rel=1e-6, abs=0.0)
    assert found.temperature_ratio == pytest.approx(pressure / density, rel=1e-6, abs=0.0)
    total = density ** (gamma / (gamma - 1.0)) * pressure ** (-1.0 / (gamma - 1.0))
    assert found.stagnation_pressure_ratio == pytest.approx(total, rel=1e-6, abs=0.0)
    angles = np.linspace(half + 1e-4, shock - 1e-4, 9)
    radial, polar = solution.sol(angles)
    speeds = found.velocity_at(angles)
    np.testing.assert_allclose(speeds[0], radial, atol=1e-6)
    np.testing.assert_allclose(speeds[1], polar, atol=1e-6)
    temperature = 1.0 + 0.5 * (gamma - 1.0) * mach**2 * (1.0 - radial**2 - polar**2)
    local = found.density_ratio_at(angles)
    np.testing.assert_allclose(local, total * temperature ** (1.0 / (gamma - 1.0)), rtol=1e-5)
    for name, angle in (("downstream_mach", shock), ("surface_mach", half)):
        v = solution.sol(angle)
        t = 1.0 + 0.5 * (gamma - 1.0) * mach**2 * (1.0 - v @ v)
        assert getattr(found, name) == pytest.approx(mach * math.sqrt(v @ v) / math.sqrt(t), rel=1e-6, abs=0.0)
    wall = 1.0 + 0.5 * (gamma - 1.0) * mach**2 * (1.0 - float(solution.sol(half)[0]) ** 2)
    assert found.surface_temperature_ratio == pytest.approx(wall, rel=1e-6, abs=0.0)
    assert found.surface_density_ratio == pytest.approx(total * wall ** (1.0 / (gamma - 1.0)), rel=1e-5, abs=0.0)
    assert found.surface_pressure_ratio == pytest.approx(total * wall ** (gamma / (gamma - 1.0)), rel=1e-5, abs=0.0)
    radial, polar = found.velocity_at(found.shock_angle * (1.0 - 1e-12))
    sine, cosine = math.sin(shock), math.cos(shock)
    turned = math.atan2(radial * sine + polar * cosine, radial * cosine - polar * sine)
    assert found.deflection == pytest.approx(turned, rel=1e-5, abs=0.0)
    # Ahead of the shock the free stream, inside the body what there is at the wall.
    ahead = found.velocity_at(shock + 0.1)
    assert ahead[0] == pytest.approx(math.cos(shock + 0.1)) and ahead[1] == pytest.approx(-math.sin(shock + 0.1))
    assert float(found.density_ratio_at(shock + 0.1)) == 1.0
    inside, at_wall = found.velocity_at(0.5 * half), found.velocity_at(half)
    assert inside[0] == pytest.approx(at_wall[0], abs=1e-9) and inside[1] == pytest.approx(at_wall[1], abs=1e-9)
    assert float(found.density_ratio_at(0.5 * half)) == pytest.approx(float(found.density_ratio_at(half)))


def test_the_greatest_cone_that_keeps_its_shock():
    """By a search over shock angles; beyond it the shock detaches, just below it there is one."""
    for mach in (1.3, 2.5):
        greatest = maximum_cone_angle(mach)
        assert cone_shock(mach, greatest * (1.0 - 1e-6)).shock_angle < 0.5 * math.pi
        with pytest.raises(ValueError, match="detaches"):
            cone_shock(mach, greatest * 1.0001)
    with pytest.raises(ValueError, match="half_angle"):
        cone_shock(2.0, 0.99e-6)
    slender = cone_shock(2.0, 1e-6)
    assert slender.shock_angle == pytest.approx(math.asin(0.5), abs=1e-12)


def test_cubics_between_entries_of_a_profile():
    """Values and slopes of cubics u' = -w and of w are kept exactly."""
    depth = np.array([0.0, 0.3, 0.5, 1.1])
    polar, slope = 0.3 + 0.2 * depth - 0.5 * depth**2, 0.2 - depth
    radial = 1.0 - 0.3 * depth - 0.1 * depth**2 + 0.5 / 3.0 * depth**3
    at = np.array([0.0, 0.1, 0.3, 0.44, 0.9, 1.1])
    found = ConicalProfile(depth, radial, polar, slope).deviation(at)
    np.testing.assert_allclose(found[0], 1.0 - 0.3 * at - 0.1 * at**2 + 0.5 / 3.0 * at**3, atol=1e-14)
    np.testing.assert_allclose(found[1], 0.3 + 0.2 * at - 0.5 * at**2, atol=1e-14)


@pytest.mark.parametrize("gamma", [1.4, 1.25])
@pytest.mark.parametrize(("mach", "turn"), [(1.0, 0.3), (2.0, 0.2), (3.5, 0.5), (2.2, 0.0)])
def test_an_expansion_by_its_differential_equation(mach: float, turn: float, gamma: float):
    """Turn = integral of sqrt(M^2 - 1) / (1 + (g - 1) / 2 M^2) dM / M; isentropic ratios; densities in the fan."""
    angle = lambda m: quad(lambda x: math.sqrt(x * x - 1.0) / (1.0 + 0.5 * (gamma - 1.0) * x * x) / x, 1.0, m)[0]  # noqa: E731
    assert prandtl_meyer(mach, gamma=gamma).angle == pytest.approx(angle(mach), abs=1e-8)
    after = brentq(lambda m: angle(m) - angle(mach) - turn, 1.0, 60.0, xtol=1e-9) if turn else mach
    found = expansion_fan(mach, turn, gamma=gamma)
    assert found.downstream_mach == pytest.approx(after, rel=1e-6, abs=0.0)
    cold = (1.0 + 0.5 * (gamma - 1.0) * mach**2) / (1.0 + 0.5 * (gamma - 1.0) * after**2)
    assert found.temperature_ratio == pytest.approx(cold, rel=1e-6, abs=0.0)
    assert found.density_ratio == pytest.approx(cold ** (1.0 / (gamma - 1.0)), rel=1e-6, abs=0.0)
    assert found.pressure_ratio == pytest.approx(cold ** (gamma / (gamma - 1.0)), rel=1e-6, abs=0.0)
    assert found.head_angle == pytest.approx(math.asin(1.0 / mach))
    assert found.tail_angle == pytest.approx(math.asin(1.0 / after) - turn, abs=1e-6)
    assert mach_after_turn(angle(mach) + turn, gamma=gamma) == pytest.approx(after, rel=1e-6, abs=0.0)
    for share in (0.25, 0.7):
        local = brentq(lambda m, s=share: angle(m) - angle(mach) - s * turn, 1.0, 60.0, xtol=1e-10) if turn else mach
        line = math.asin(1.0 / local) - share * turn
        ratio = ((1.0 + 0.5 * (gamma - 1.0) * mach**2) / (1.0 + 0.5 * (gamma - 1.0) * local**2)) ** (
            1.0 / (gamma - 1.0)
        )
        if turn:
            assert float(found.ratio_of_angle(line)) == pytest.approx(ratio, rel=1e-6, abs=0.0)
    middle = -0.5 * (turn + math.pi)
    assert found.inner_angle == pytest.approx(middle)
    for place, ratio in ((found.head_angle + 0.01, 1.0), (middle - 0.01, 1.0), (middle + 0.01, found.density_ratio)):
        assert float(found.ratio_of_angle(place)) == ratio
    root = math.sqrt((gamma + 1.0) / (gamma - 1.0))
    assert maximum_expansion(mach, gamma=gamma) == pytest.approx(0.5 * math.pi * (root - 1.0) - angle(mach), abs=1e-7)


@pytest.mark.parametrize("gamma", [1.4, 1.01])
def test_shocks_by_conservation(gamma: float):
    """Mass, momentum and energy across a normal and an oblique shock; the entropy's pressure at rest."""
    for mach in (1.2, 3.0):
        found = normal_shock(mach, gamma=gamma)
        density, pressure = found.density_ratio, found.pressure_ratio
        # In units of the stream's density, speed and of rho u^2: p1 = 1 / (g M^2).
        p1 = 1.0 / (gamma * mach**2)
        assert p1 + 1.0 == pytest.approx(pressure * p1 + 1.0 / density)
        heat = gamma / (gamma - 1.0)
        assert heat * p1 + 0.5 == pytest.approx(heat * pressure * p1 / density + 0.5 / density**2)
        assert found.downstream_mach == pytest.approx(1.0 / density / math.sqrt(gamma * pressure * p1 / density))
        logarithm = (gamma * math.log(density) - math.log(pressure)) / (gamma - 1.0)
        assert stagnation_ratio(density, pressure, gamma) == pytest.approx(math.exp(logarithm), rel=1e-9, abs=0.0)
        slanted = oblique_shock(mach, 0.03, gamma=gamma)
        across = math.sin(slanted.shock_angle)
        behind = math.tan(slanted.shock_angle - 0.03) / math.tan(slanted.shock_angle)
        assert slanted.density_ratio == pytest.approx(1.0 / behind)
        normal = normal_shock(mach * across, gamma=gamma)
        assert slanted.pressure_ratio == pytest.approx(normal.pressure_ratio)
        assert slanted.downstream_mach == pytest.approx(normal.downstream_mach / math.sin(slanted.shock_angle - 0.03))


def test_streams_of_a_perfect_gas():
    """Static and stagnation values by T0 / T = 1 + (g - 1) / 2 M^2."""
    ratio = 1.0 + 0.15 * 4.0
    found = isentropic(2.0, gamma=1.3)
    assert found.temperature_ratio == pytest.approx(1.0 / ratio)
    assert found.pressure_ratio == pytest.approx(ratio ** (-1.3 / 0.3)) and found.density_ratio == pytest.approx(
        ratio ** (-1.0 / 0.3)
    )
    tunnel = tunnel_conditions(2.0, 5e5, 300.0, gamma=1.3, gas_constant=280.0)
    assert tunnel.temperature == pytest.approx(300.0 / ratio) and tunnel.stagnation_pressure == 5e5
    assert tunnel.density == pytest.approx(tunnel.pressure / (280.0 * tunnel.temperature))
    assert tunnel.sound_speed == pytest.approx(math.sqrt(1.3 * 280.0 * tunnel.temperature))
    assert tunnel.velocity == pytest.approx(2.0 * tunnel.sound_speed)
    other = tunnel_conditions(2.0, 5e5, 300.0, gamma=1.3, gas_constant=280.0, density=2.0 * tunnel.density)
    assert other.pressure == pytest.approx(2.0 * tunnel.pressure) and other.stagnation_pressure == pytest.approx(1e6)
    assert other.velocity == tunnel.velocity
    stream = free_stream(2.0, 0.5, 250.0, gamma=1.3, gas_constant=280.0)
    assert stream.pressure == pytest.approx(0.5 * 280.0 * 250.0) and stream.stagnation_temperature == pytest.approx(
        250.0 * ratio
    )
    assert stream.stagnation_pressure == pytest.approx(stream.pressure * ratio ** (1.3 / 0.3))
    for wrong in ((9.99, 300.0), (5e5, 44.9)):
        with pytest.raises(ValueError, match="too low"):
            tunnel_conditions(2.0, *wrong)
    tunnel_conditions(2.0, 10.0, 45.0)
    values = np.array([[1.0, 1000.0], [0.5, 2.0]])
    assert no_gas(values) is None and no_gas(np.zeros(0)) is None
    for wrong, place, words in ((np.nan, 3, "not finite"), (0.0, 1, "not positive"), (1000.1, 2, "too great")):
        bad = values.copy()
        bad.flat[place] = wrong
        fault, count, first = no_gas(bad)
        assert fault.startswith(words) and (count, first) == (1, place)
        passed = np.zeros((2, 2), dtype=bool)
        passed.flat[place] = True
        assert no_gas(bad, passed) is None


def test_averages_of_directions_over_cells():
    """Jumps at angles of all quarters: by 400 x 400 points to a cell."""
    breaks = (-2.5, -0.4, 0.3, 1.9)
    function = lambda a: np.searchsorted(breaks, a) + 0.3 * np.sin(a) * (a > 0.3)  # noqa: E731
    y, z = np.array([-0.5, -0.1, 0.0, 0.35]), np.array([-0.6, -0.2, 0.05, 0.4])
    found = direction_averages(function, breaks, y, z)
    share = (np.arange(400) + 0.5) / 400
    for i, j in np.ndindex(3, 3):
        a, b = (edge[k] + (edge[k + 1] - edge[k]) * share for edge, k in ((y, i), (z, j)))
        assert found[i, j] == pytest.approx(function(np.arctan2(a[:, None], -b)).mean(), abs=8e-3)
    means = piecewise_means(lambda x: np.where(x < 0.37, x**3, 5.0), np.array([0.0, 0.2, 0.9]), [0.37, -1.0, 3.0])
    np.testing.assert_allclose(means, [0.2**3 / 4.0, ((0.37**4 - 0.2**4) / 4.0 + 5.0 * 0.53) / 0.7])
    smooth = smooth_averages(lambda a, b: a**3 * b**2 + b, np.array([0.0, 1.0, 3.0]), np.array([-1.0, 2.0]))
    np.testing.assert_allclose(smooth, [[0.25 * 1.0 + 0.5], [10.0 * 1.0 + 0.5]])


def test_edges_of_cells():
    """A divisor of the length that is not above the spacing; cells that cover a range with one edge at zero."""
    assert square_step(1.0, 0.3) == pytest.approx(0.25) and square_step(1.0, 0.25) == pytest.approx(0.25)
    assert square_step(1.0, None) == pytest.approx(1.0 / 200.0) and square_step(1.0, 0.2499) == pytest.approx(0.2)
    np.testing.assert_allclose(edges(-0.5, 1.2, 0.5), [-0.5, 0.0, 0.5, 1.0, 1.5])
    np.testing.assert_allclose(edges(-0.6, 1.0, 0.5), [-1.0, -0.5, 0.0, 0.5, 1.0])
    assert rectangles(np.arange(9.0), np.arange(9.0)).geometry == "planar"
    with pytest.raises(ValueError, match="at least 8"):
        rectangles(np.arange(8.0), np.arange(9.0))
    with pytest.raises(ValueError, match="take a wider one"):
        edges(0.0, 1.0, 2e-7)


@pytest.mark.parametrize("geometry", ["axisymmetric", "planar"])
def test_a_bow_shock_and_the_flow_behind_it(geometry: str):
    """Billig's hyperbola; on the axis the shock's relations and the stagnation point; between them linear."""
    mach, radius = 3.0, 0.02
    bow = bow_shock(mach, radius, geometry=geometry)
    a, b, c, d, e = {"axisymmetric": (0.143, 3.24, 1.143, 0.54, 1.2), "planar": (0.386, 4.67, 1.386, 1.8, 0.75)}[
        geometry
    ]
    stand_off, bend = radius * a * math.exp(b / 9.0), radius * c * math.exp(d / 2.0**e)
    assert bow.stand_off == pytest.approx(stand_off) and bow.curvature_radius == pytest.approx(bend)
    far = math.asin(1.0 / mach)
    r = np.array([0.0, 0.01, 0.05])
    z = stand_off - bend / math.tan(far) ** 2 * (np.sqrt(1.0 + (r * math.tan(far) / bend) ** 2) - 1.0)
    np.testing.assert_allclose(bow.z_at(r), z, atol=1e-15)
    np.testing.assert_allclose(bow.radius_at(z), r, atol=1e-9)
    assert float(bow.radius_at(stand_off + 0.01)) == 0.0
    for angle in (0.0, 0.4, 1.2):
        distance = float(bow.distance_along(angle))
        assert float(bow.z_at(distance * math.sin(angle))) == pytest.approx(distance * math.cos(angle) - radius)
    slope = (float(bow.z_at(0.0301)) - float(bow.z_at(0.0299))) / 0.0002
    normal = mach**2 / (1.0 + slope**2)
    assert float(bow.normal_mach_square_at(0.03)) == pytest.approx(normal, rel=1e-4, abs=0.0)
    field = blunt_body(mach, radius, geometry=geometry, spacing=radius / 8)
    solution = field.solution
    shock = normal_shock(mach)
    stagnation = shock.density_ratio * (1.0 + 0.2 * shock.downstream_mach**2) ** 2.5
    share = 1.0 / (1.0 + 0.2 * mach**2) ** 3.5 / shock.stagnation_pressure_ratio
    for place in (0.0, 0.3, 1.0):
        ratio = float(solution.behind_at(0.0, place * stand_off))
        assert ratio == pytest.approx((1.0 - place) * stagnation + place * shock.density_ratio, rel=1e-6, abs=0.0)
    angle = 0.7
    wall = stagnation * (share + (1.0 - share) * math.cos(angle) ** 2) ** (1.0 / 1.4)
    on_wall = float(solution.density_ratio_at(radius * math.sin(angle), radius * (math.cos(angle) - 1.0)))
    assert on_wall == pytest.approx(wall, rel=1e-6, abs=0.0)
    assert float(solution.density_ratio_at(0.0, 1.01 * stand_off)) == 1.0
    beside = float(solution.density_ratio_at(-1.3 * radius, -1.5 * radius))
    reach = float(bow.radius_at(-1.5 * radius))
    part = 0.3 * radius / (reach - radius)
    behind = float(bow.normal_mach_square_at(reach))
    jump = 6.0 * behind / (behind + 5.0)
    last = stagnation * share ** (1.0 / 1.4)
    assert beside == pytest.approx((1.0 - part) * last + part * jump, rel=1e-6, abs=0.0)


def test_constants_of_gases_by_their_formulas():
    """Both dispersion forms, the real gas's density, mixtures by mass, and Lorentz and Lorenz's form."""
    for gas in SPECIES.values():
        length = 0.6
        if gas.form == "sum":
            c = gas.coefficients
            excess = c[0] + sum(c[k] / (c[k + 1] - length**-2) for k in range(1, len(c), 2))
        else:
            c = gas.coefficients
            square = 1.0 + sum(c[k] * length**2 / (length**2 - c[k + 1]) for k in range(0, len(c), 2))
            excess = math.sqrt(square) - 1.0
        assert gas.refractivity(0.6e-6) == pytest.approx(excess, rel=1e-9, abs=0.0)
        moles = gas.pressure / (8.314462618 * gas.temperature)
        density = gas.molar_mass * moles / (1.0 + gas.virial * moles)
        assert gas.reference_density == pytest.approx(density)
        assert species_constant(gas.name, 0.6e-6) == pytest.approx(excess / density)
        n = 1.0 + excess
        assert species_constant(gas.name, 0.6e-6, "lorentz-lorenz") == pytest.approx(
            1.5 * (n * n - 1.0) / (n * n + 2.0) / density
        )
    mixed = Composition({"N2": 0.7, "CO2": 0.3})
    masses = 0.7 * SPECIES["N2"].molar_mass, 0.3 * SPECIES["CO2"].molar_mass
    expected = sum(m * species_constant(name, 0.6e-6) for m, name in zip(masses, ("N2", "CO2"), strict=True)) / sum(
        masses
    )
    assert mixed.constant(0.6e-6) == pytest.approx(expected)
    by_mass = Composition({"N2": 0.7, "CO2": 0.3}, "mass")
    assert by_mass.constant(0.6e-6) == pytest.approx(
        0.7 * species_constant("N2", 0.6e-6) + 0.3 * species_constant("CO2", 0.6e-6)
    )
    assert mixed.range == (0.480126e-6, 1.817228e-6) and mixed.uncertainty == 3e-4
    assert Composition({"N2": 0.9, "H2O": 0.1}).uncertainty == 1e-2
    assert Composition({"N2": 0.9, "H2O": 0.1}).range == (0.4679e-6, 1.69e-6)


def test_published_refractivities():
    """Ciddor's own table: dry air of 450 ppm at 633 nm, 20 degC and 100 kPa, 1e8 (n - 1) = 26824.4, 60 kPa 16100 about.

    Moist air at 50 degC, 100 kPa and a vapour pressure of 1526.5 Pa at 510 ppm: 24222.3 or so (Ciddor, table 3): 1e-5.
    """
    dry = ciddor.ciddor_refractivity(0.633e-6, 293.15, 100e3)
    assert dry * 1e8 == pytest.approx(26824.4, rel=2e-5, abs=0.0)
    half = ciddor.ciddor_refractivity(0.633e-6, 293.15, 60e3)
    assert half / dry == pytest.approx(0.6, rel=2e-4, abs=0.0)
    assert ciddor.water_fraction(293.15, 1e5, 0.5) == pytest.approx(0.5 * 2338.8 / 1e5 * 1.004, rel=1e-3, abs=0.0)
    assert ciddor.water_fraction(253.15, 1e5, 1.0) == pytest.approx(103.3 / 1e5 * 1.004, rel=4e-3, abs=0.0)
    vapour = ciddor.ciddor_constant(0.633e-6, water=1.0) * 0.018015 / 0.0289647
    assert flow.refractivity_model("ciddor").constant(0.633e-6) == pytest.approx(ciddor.ciddor_constant(0.633e-6))
    assert 0.8 < vapour / ciddor.ciddor_constant(0.633e-6) < 0.9
