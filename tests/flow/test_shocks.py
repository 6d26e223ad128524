"""Shocks and the Prandtl-Meyer function."""

import math

import pytest
from hypothesis import assume, given
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


@pytest.mark.parametrize("gamma", [1.2, 1.4, 5.0 / 3.0])
@pytest.mark.parametrize("mach", [1.05, 1.5, 3.0, 8.0, 20.0])
def test_shocks_against_the_conservation_laws_solved(mach, gamma):
    """Set-up: rho1 = p1 = 1. Density behind by root finding on energy, with mass and momentum put in; then the angle.

    Normal shock: g / (g - 1) p2 / rho2 + u2^2 / 2 = const, p2 = 1 + rho1 u1 (u1 - u2), by Brent's method away from the
    root that is no shock. Oblique: the velocity along the shock stays, tan(b - d) = tan(b) / (rho2 / rho1), where the
    normal Mach number gives the density by the same route. Errors: the root finding's, 1e-12. Tolerance 1e-9.
    """
    from scipy.optimize import brentq

    def density(normal_mach):
        speed = normal_mach * math.sqrt(gamma)

        def energy(ratio):
            pressure = 1.0 + speed**2 * (1.0 - 1.0 / ratio)
            rise = gamma / (gamma - 1.0) * (pressure / ratio - 1.0) + 0.5 * speed**2 * (1.0 / ratio**2 - 1.0)
            return rise / (1.0 - 1.0 / ratio)  # without the root at 1

        return brentq(energy, 1.0 + 1e-9, 2.0 * (gamma + 1.0) / (gamma - 1.0), xtol=1e-13, rtol=1e-14)

    assert abs(flow.normal_shock(mach, gamma=gamma).density_ratio / density(mach) - 1.0) < 1e-9
    for share in (0.2, 0.9):
        turn = share * flow.maximum_deflection(mach, gamma=gamma)
        for strong in (False, True):
            shock = flow.oblique_shock(mach, turn, strong=strong, gamma=gamma)
            angle = shock.shock_angle
            ratio = density(mach * math.sin(angle))
            assert abs(shock.density_ratio / ratio - 1.0) < 1e-9
            assert abs(angle - math.atan(math.tan(angle) / ratio) - turn) < 1e-9


@given(MACH, GAMMA)
def test_normal_shock_conserves_and_entropy_rises(mach, gamma):
    shock = flow.normal_shock(mach, gamma=gamma)
    ahead = fluxes(mach, 0.5 * math.pi, 1.0, 1.0, gamma)
    behind = fluxes(shock.downstream_mach, 0.5 * math.pi, shock.density_ratio, shock.pressure_ratio, gamma)
    for index in (0, 1, 3):
        assert abs(behind[index] / ahead[index] - 1.0) < 1e-13
    assert shock.shock_angle == 0.5 * math.pi
    assert shock.downstream_mach < 1.0 + 1e-12 and shock.density_ratio < (gamma + 1.0) / (gamma - 1.0)
    assert shock.stagnation_pressure_ratio <= 1.0 + 1e-12
    # The stagnation pressures on both sides, from each side's own isentropic relation.
    own = shock.pressure_ratio / flow.isentropic(shock.downstream_mach, gamma=gamma).pressure_ratio
    own *= flow.isentropic(mach, gamma=gamma).pressure_ratio
    assert abs(own / shock.stagnation_pressure_ratio - 1.0) < 1e-10


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


def test_density_difference_behind_the_tunnels_shocks():
    """The paper says that the density difference rises with Mach; behind a normal shock only the ratio does.

    Expected, by hand from the paper's densities: rho2 - rho1 = 0.850, 0.943, 0.714 kg/m3 at Mach 2, 3, 4.
    """
    published = (0.51, 0.33, 0.20)
    rise = [
        density * (flow.normal_shock(mach).density_ratio - 1.0)
        for mach, density in zip((2.0, 3.0, 4.0), published, strict=True)
    ]
    assert [round(value, 3) for value in rise] == [0.85, 0.943, 0.714]


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


@given(MACH, st.floats(0.05, 0.95))
def test_weak_shock_lies_below_the_strong_one(mach, share):
    assume(mach > 1.1)
    deflection = share * flow.maximum_deflection(mach)
    weak, strong = (flow.oblique_shock(mach, deflection, strong=flag) for flag in (False, True))
    assert math.asin(1.0 / mach) < weak.shock_angle < strong.shock_angle < 0.5 * math.pi
    assert weak.pressure_ratio < strong.pressure_ratio


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


@given(st.floats(1.05, 10.0), GAMMA)
def test_prandtl_meyer_slope(mach, gamma):
    """D nu / dM = sqrt(M^2 - 1) / (M (1 + (g - 1) / 2 M^2)): the differential relation across a Mach wave.

    Central difference of step h = 1e-4 M: its error is h^2/6 nu''' and stays below 1e-5 of the slope down to Mach 1.05,
    where nu goes as (M - 1)^1.5.
    """
    step = 1e-4 * (mach - 1.0)
    slope = flow.prandtl_meyer(mach + step, gamma=gamma).angle - flow.prandtl_meyer(mach - step, gamma=gamma).angle
    expected = math.sqrt(mach**2 - 1.0) / (mach * (1.0 + 0.5 * (gamma - 1.0) * mach**2))
    assert abs(slope / (2.0 * step) / expected - 1.0) < 1e-6


@given(st.floats(1.2, 5.0))
def test_a_weak_turn_compresses_as_much_as_it_would_expand(mach):
    """For a small turn d a shock and an isentropic wave agree to third order: nu falls by d - O(d^3).

    With d = 1e-3 the difference is below C d^3 with C < 200 for Mach 1.2 to 5.
    """
    turn = 1e-3
    shock = flow.oblique_shock(mach, turn)
    fall = flow.prandtl_meyer(mach).angle - flow.prandtl_meyer(shock.downstream_mach).angle
    assert abs(fall - turn) < 200.0 * turn**3


@pytest.mark.parametrize("mach", [1.01, 2.0, 20.0])
def test_stagnation_pressure_near_gamma_one(mach):
    """Set-up: gamma 1.0001, where density ratio and pressure ratio are raised to 1e4. Expected: by logarithms."""
    found = flow.normal_shock(mach, gamma=1.0001)
    log = (1.0001 * math.log(found.density_ratio) - math.log(found.pressure_ratio)) / 1e-4
    assert math.log(found.stagnation_pressure_ratio) == pytest.approx(log, rel=1e-9, abs=1e-12)
