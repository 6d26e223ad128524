"""Shocks and the Prandtl-Meyer function."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from aerokernels import flow

MACH = st.floats(1.01, 20.0)
GAMMA = st.floats(1.1, 1.67)


def fluxes(mach, angle_to_shock, density, pressure, gamma):
    """Mass, normal momentum, tangential velocity and total enthalpy of a stream that meets a shock at an angle."""
    sound = math.sqrt(gamma * pressure / density)
    normal, along = mach * sound * math.sin(angle_to_shock), mach * sound * math.cos(angle_to_shock)
    enthalpy = gamma / (gamma - 1.0) * pressure / density
    return density * normal, pressure + density * normal**2, along, enthalpy + 0.5 * (normal**2 + along**2)


@given(MACH, GAMMA, st.floats(0.0, 1.0), st.booleans())
def test_oblique_shock_conserves(mach, gamma, share, strong):
    """Set-up: any attached shock. Formula: Rankine-Hugoniot, that is, conservation across the wave.

    Mass, momentum and energy fluxes are worked out on both sides from the returned state alone; rho1 = p1 = 1. The turn
    must fit the shock angle for the tangential velocity to stay. Error: rounding, of numbers up to Mach^2 = 400.
    """
    deflection = share * flow.maximum_deflection(mach, gamma=gamma)
    shock = flow.oblique_shock(mach, deflection, strong=strong, gamma=gamma)
    ahead = fluxes(mach, shock.shock_angle, 1.0, 1.0, gamma)
    behind = fluxes(
        shock.downstream_mach,
        shock.shock_angle - deflection,
        shock.density_ratio,
        shock.pressure_ratio,
        gamma,
    )
    scale = (ahead[0], ahead[1], math.sqrt(2.0 * ahead[3]), ahead[3])
    for before, after, size in zip(ahead, behind, scale, strict=True):
        assert abs(after - before) < 1e-11 * size
    assert abs(shock.temperature_ratio - shock.pressure_ratio / shock.density_ratio) < 1e-14 * shock.temperature_ratio


@pytest.mark.parametrize(
    ("mach", "density", "pressure", "downstream", "stagnation"),
    [
        (2.0, 8 / 3, 4.5, 0.57735, 0.72087),
        (3.0, 27 / 7, 31 / 3, 0.47519, 0.32834),
        (4.0, 32 / 7, 18.5, 0.43496, 0.13876),
    ],
)
def test_normal_shock_tables(mach, density, pressure, downstream, stagnation):
    """NACA 1135, Table II: ratios are rational for air; the rest to the table's digits."""
    shock = flow.normal_shock(mach)
    assert abs(shock.density_ratio / density - 1.0) < 1e-14
    assert abs(shock.pressure_ratio / pressure - 1.0) < 1e-14
    assert abs(shock.downstream_mach - downstream) < 1e-5
    assert abs(shock.stagnation_pressure_ratio - stagnation) < 1e-5


@pytest.mark.parametrize(
    ("mach", "degrees", "weak", "strong"),
    [(2.0, 10.0, 39.31, 83.70), (3.0, 20.0, 37.76, 82.15), (5.0, 30.0, 42.34, 80.64)],
)
def test_oblique_shock_angles(mach, degrees, weak, strong):
    """Set-up: wedges in air. Expected: published angles to 0.01 degree, and the explicit solution to rounding."""
    for angle, is_strong in ((weak, False), (strong, True)):
        shock = flow.oblique_shock(mach, math.radians(degrees), strong=is_strong)
        assert abs(math.degrees(shock.shock_angle) - explicit_angle(mach, degrees, is_strong)) < 1e-9
        assert abs(math.degrees(shock.shock_angle) - angle) < 0.01


def explicit_angle(mach, degrees, strong):
    """The shock angle [deg] as the root of a cubic (Anderson eq 4.19-4.21, air): an independent route to it."""
    tangent, square, delta = math.tan(math.radians(degrees)), mach**2, 0.0 if strong else 1.0
    a, b = 1.0 + 0.2 * square, 1.0 + 1.2 * square
    root = math.sqrt((square - 1.0) ** 2 - 3.0 * a * b * tangent**2)
    chi = ((square - 1.0) ** 3 - 9.0 * a * (a + 0.6 * square**2) * tangent**2) / root**3
    top = square - 1.0 + 2.0 * root * math.cos((4.0 * math.pi * delta + math.acos(chi)) / 3.0)
    return math.degrees(math.atan(top / (3.0 * a * tangent)))


def test_no_turn_gives_a_mach_wave_or_a_normal_shock():
    wave, normal = flow.oblique_shock(3.0, 0.0), flow.oblique_shock(3.0, 0.0, strong=True)
    assert abs(math.sin(wave.shock_angle) - 1.0 / 3.0) < 1e-15
    assert abs(wave.density_ratio - 1.0) < 1e-14 and abs(wave.downstream_mach - 3.0) < 1e-13
    assert normal.shock_angle == 0.5 * math.pi
    assert abs(normal.density_ratio - flow.normal_shock(3.0).density_ratio) < 1e-14


def test_detached_shock_names_the_greatest_deflection():
    """Mach 2: 22.97 degrees (NACA 1135, chart 2)."""
    assert abs(math.degrees(flow.maximum_deflection(2.0)) - 22.97) < 0.005
    with pytest.raises(ValueError, match=r"detaches.*30 deg.*22\.97 deg"):
        flow.oblique_shock(2.0, math.radians(30.0))


@pytest.mark.parametrize("call", [flow.normal_shock, flow.prandtl_meyer, lambda mach: flow.oblique_shock(mach, 0.1)])
@pytest.mark.parametrize("mach", [0.99, -2.0, math.nan, math.inf])
def test_subsonic_streams_are_refused(call, mach):
    with pytest.raises(ValueError, match="mach must be 1 or more"):
        call(mach)


@pytest.mark.parametrize("deflection", [-0.1, math.nan])
def test_bad_deflections_are_refused(deflection):
    with pytest.raises(ValueError, match="deflection must be zero or positive"):
        flow.oblique_shock(2.0, deflection)


@pytest.mark.parametrize(("mach", "degrees"), [(1.0, 0.0), (2.0, 26.3798), (3.0, 49.7573), (4.0, 65.7848)])
def test_prandtl_meyer_table(mach, degrees):
    """NACA 1135, Table II: nu to 1e-4 degree."""
    result = flow.prandtl_meyer(mach)
    assert abs(math.degrees(result.angle) - degrees) < 1e-4
    assert abs(math.sin(result.mach_angle) * mach - 1.0) < 1e-15


@pytest.mark.parametrize("mach", [1.01, 2.0, 20.0])
def test_stagnation_pressure_near_gamma_one(mach):
    """Set-up: gamma 1.0001, where density ratio and pressure ratio are raised to 1e4. Expected: by logarithms."""
    found = flow.normal_shock(mach, gamma=1.0001)
    log = (1.0001 * math.log(found.density_ratio) - math.log(found.pressure_ratio)) / 1e-4
    assert math.log(found.stagnation_pressure_ratio) == pytest.approx(log, rel=1e-9, abs=1e-12)
