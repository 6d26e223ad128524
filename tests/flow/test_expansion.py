"""The Prandtl-Meyer fan: relations against integration of the flow's own equations, and the density field."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from aerokernels import flow

MACHS = (1.05, 1.3, 2.0, 3.0, 5.0, 10.0, 20.0)


@pytest.mark.parametrize("gamma", [1.2, 1.4, 5.0 / 3.0])
@pytest.mark.parametrize("mach", MACHS)
def test_fan_against_the_equations_of_motion(mach, gamma):
    """Set-up: a stream turned bit by bit, by the equations of motion (Anderson eq 4.35 and momentum).

    dM / dt = M (1 + (g - 1) / 2 M^2) / sqrt(M^2 - 1), d ln rho / dt and d ln p / dt = -M^2 and -g M^2 over that root.
    Expected: Mach number, density and pressure behind, and the density on the Mach lines between, at asin(1 / M) - t.
    Turns up to 60 % of the way to vacuum. Errors: the integration's, below 1e-11. Tolerance 1e-9.
    """
    turn = 0.6 * flow.maximum_expansion(mach, gamma=gamma)

    def slope(_, state):
        m = state[0]
        root = math.sqrt(m * m - 1.0)
        return m * (1.0 + 0.5 * (gamma - 1.0) * m * m) / root, -m * m / root, -gamma * m * m / root

    stops = np.linspace(0.0, turn, 12)
    found = solve_ivp(slope, (0.0, turn), (mach, 0.0, 0.0), t_eval=stops, rtol=1e-13, atol=1e-14, method="DOP853")
    fan = flow.expansion_fan(mach, turn, gamma=gamma)
    assert abs(fan.downstream_mach / found.y[0, -1] - 1.0) < 1e-9
    assert abs(fan.density_ratio / math.exp(found.y[1, -1]) - 1.0) < 1e-9
    assert abs(fan.pressure_ratio / math.exp(found.y[2, -1]) - 1.0) < 1e-9
    assert abs(fan.temperature_ratio * fan.density_ratio / fan.pressure_ratio - 1.0) < 1e-13
    lines = np.arcsin(1.0 / found.y[0]) - stops
    assert np.abs(fan.ratio_of_angle(lines) / np.exp(found.y[1]) - 1.0).max() < 1e-9
    assert abs(lines[0] - fan.head_angle) < 1e-12 and abs(lines[-1] - fan.tail_angle) < 1e-9


def test_table_of_the_prandtl_meyer_angle():
    """NACA 1135, Table II, backwards: 26.3798, 49.7573, 65.7848 degrees are Mach 2, 3, 4."""
    for degrees, mach in ((0.0, 1.0), (26.3798, 2.0), (49.7573, 3.0), (65.7848, 4.0)):
        assert abs(flow.mach_after_turn(math.radians(degrees)) - mach) < 1e-5


def test_turns_to_vacuum_are_refused():
    """Air from Mach 1: 130.454 degrees (NACA 1135)."""
    assert abs(math.degrees(flow.maximum_expansion(1.0)) - 130.454) < 1e-3
    with pytest.raises(ValueError, match=r"leaves the wall.*80\.7 deg.*vacuum"):
        flow.expansion_fan(3.0, math.radians(85.0))
    with pytest.raises(ValueError, match="negative turn makes a shock"):
        flow.expansion_fan(3.0, -0.1)
    with pytest.raises(ValueError, match=r"130\.5 deg.*vacuum"):
        flow.mach_after_turn(2.3)
    with pytest.raises(ValueError, match="mach must be 1 or more"):
        flow.expansion_fan(0.9, 0.1)
    with pytest.raises(ValueError, match="back against the stream"):
        flow.expansion(1.05, 1.6)
    with pytest.raises(ValueError, match="length must be positive"):
        flow.expansion(3.0, 0.1, length=-1.0)


def test_field_around_the_corner():
    """Uniform ahead of the first Mach line and behind the last, the fan between; nothing inside the body."""
    turn = 0.25
    field = flow.expansion(2.5, turn, length=0.04, spacing=0.5e-3)
    fan = field.solution
    angle = np.array([0.5 * (fan.head_angle + math.pi), fan.head_angle - 1e-3, fan.tail_angle + 1e-3, -turn + 1e-3])
    points = 0.02 * np.stack([0.0 * angle, np.sin(angle), -np.cos(angle)], axis=1)
    expected = [1.0, fan.ratio_of_angle(angle[1]), fan.ratio_of_angle(angle[2]), fan.density_ratio]
    np.testing.assert_allclose(field.density_at(points) / 1.225, expected, rtol=1e-12)
    assert abs(fan.ratio_of_angle(fan.tail_angle) / fan.density_ratio - 1.0) < 1e-12
    inside = [[0.0, -1e-3, 0.01], [0.0, -0.008, -0.02]]
    assert np.isnan(field.density_at(inside)).all()
    # In the mesh the body's cells carry on their wall's density, so that nothing is polluted there.
    cells = field.density.reshape(field.mesh.shape[0] - 1, -1)
    assert cells[0, -1] == 1.225 and abs(cells[0, 0] / (1.225 * fan.density_ratio) - 1.0) < 1e-12
    assert field.conditions.mach == 2.5
    assert "Prandtl-Meyer" in field.provenance and field.geometry == "planar"
