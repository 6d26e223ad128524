"""The shipped volume: the dome at an angle of attack, against exact gas dynamics and its own symmetry."""

import numpy as np
import pytest

from aerokernels import flow

RADIUS = 8e-3  # of the dome [m]


@pytest.fixture(scope="module")
def field():
    return flow.shipped("dome-alpha10")


def test_the_wind_stagnates_behind_a_normal_shock(field):
    """Formula: Rayleigh's pitot pressure over R T0 is the greatest density. The solver's error is below 1 %."""
    stream, gamma = field.conditions, field.conditions.gamma
    mach2 = stream.mach**2
    ratio = ((gamma + 1) * mach2 / ((gamma - 1) * mach2 + 2)) ** (gamma / (gamma - 1)) * (
        (gamma + 1) / (2 * gamma * mach2 - gamma + 1)
    ) ** (1 / (gamma - 1))
    exact = stream.stagnation_pressure * ratio / (stream.gas_constant * stream.stagnation_temperature)
    assert abs(field.density.max() / exact - 1.0) < 0.01
    assert field.density[..., -1] == pytest.approx(field.ambient_density, rel=1e-4)


def test_the_bow_shock_stands_where_it_does_at_zero_incidence(field):
    """A sphere does not know where the wind comes from: along the wind the stand-off is 0.215 radii, within 5 %."""
    wind = np.array([0.0, -np.sin(np.radians(10.0)), np.cos(np.radians(10.0))])
    way = np.linspace(1.01 * RADIUS, 1.5 * RADIUS, 2000)
    density = field.density_at([0.0, 0.0, -RADIUS] + way[:, None] * wind)
    behind = way[np.flatnonzero(density > 2.4 * field.ambient_density)[-1]]
    assert abs((behind / RADIUS - 1.0) / 0.215 - 1.0) < 0.05


def test_it_is_symmetric_and_has_the_dome_for_a_body(field):
    assert np.array_equal(field.density, field.density[::-1])
    assert field.origin[0] + field.spacing[0] * (field.density.shape[0] - 1) == pytest.approx(-field.origin[0])
    # The wind comes from below: there the gas is denser.
    low, high = (field.density_at([[0.0, y, -2e-3]])[0] for y in (-7.6e-3, 7.6e-3))
    assert low > 1.3 * high
    assert field.body.contains(np.array([[0.0, 0.0, -1e-4], [0.0, 7.8e-3, -7e-3]])).all()
    assert not field.body.contains(np.array([[0.0, 0.0, 1e-4], [0.0, 8.2e-3, -7e-3]])).any()
