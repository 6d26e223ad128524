"""The cone's flow as a density field, and the averages that its index field is made of."""

import math

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.flow.conical_field import cell_averages

K = flow.gladstone_dale_constant(905e-9)
MACH, HALF_ANGLE, LENGTH = 3.0, math.radians(20.0), 0.05


@pytest.fixture(scope="module")
def field() -> flow.ConicalFlow:
    return flow.cone(MACH, HALF_ANGLE, length=LENGTH)


def on_ray(angle, distance, azimuth=0.7):
    """Points at a polar angle and distance from the tip."""
    angle, distance = np.broadcast_arrays(angle, distance)
    radius = distance * np.sin(angle)
    return np.stack([radius * math.cos(azimuth), radius * math.sin(azimuth), -distance * np.cos(angle)], axis=-1)


def test_density_is_that_of_the_polar_angle(field):
    shock = field.shock
    angle = np.linspace(HALF_ANGLE + 1e-9, shock.shock_angle - 1e-9, 50)
    expected = 1.225 * shock.density_ratio_at(angle)
    np.testing.assert_allclose(field.density_at(on_ray(angle, 0.03)), expected, rtol=1e-11)
    just = shock.shock_angle + np.array([-1e-9, 1e-9])
    np.testing.assert_allclose(field.density_at(on_ray(just, 0.03)) / 1.225, [shock.density_ratio, 1.0], rtol=1e-7)
    assert abs(expected[0] / 1.225 / shock.surface_density_ratio - 1.0) < 1e-12


def test_ahead_beside_and_behind_it_is_ambient_and_inside_the_body_nothing(field):
    points = [[0.0, 0.0, 1e-6], [0.0, 0.02, -0.01], [0.0, 0.02, -0.0501], [0.0, 0.5, -0.049]]
    assert np.array_equal(field.density_at(points), np.full(4, 1.225))
    assert np.isnan(field.density_at([[0.0, 1e-3, -0.02]])).all()
    assert field.body.contains(np.array([[1e-3, -0.02], [0.0075, -0.02]])).tolist() == [True, False]


@pytest.mark.parametrize("relation", flow.RELATIONS)
@pytest.mark.parametrize("interpolation", ["cubic", "linear", "monotone"])
def test_index_away_from_the_shock(field, relation, interpolation):
    """Set-up: 0.25 mm cells, points at 2 to 4.5 cm from the tip, up to the wall and 4 cells or more from the shock.

    Expected: the contrast of the exact density. Errors: the spline's ringing at 4 cells, 0.07 of the jump times 0.4^4;
    the field bends by 2e-4 per cell, so the others' h^2 is no more. Tolerance: 3e-3 of the contrast, ahead as well.
    """
    index = field.index_field(relation=relation, spacing=0.25e-3, interpolation=interpolation)
    distance = np.repeat([0.02, 0.035, 0.045], 20)
    share = np.tile(np.linspace(1e-3, 1.0, 20), 3)
    low, high = field.half_angle, field.shock.shock_angle - 1e-3 / distance
    points = on_ray(low + share * (high - low), distance)
    expected = flow.index_contrast(field.density_at(points), 1.225, K, relation)
    assert np.abs(index.contrast_at(points) / expected - 1.0).max() < 3e-3
    ahead = on_ray(field.shock.shock_angle + 1.5e-3 / distance, distance)
    assert np.abs(index.contrast_at(ahead)).max() < 3e-3 * expected.max()
    assert abs(index.ambient_index - 1.0 - float(flow.index_contrast(1.225, 0.0, K, relation))) < 2.3e-16
    low_corner, high_corner = index.box
    assert low_corner[2] == -LENGTH and high_corner[2] > 0.0 and high_corner[0] > field.radius
    assert index.body is field.body


@pytest.mark.parametrize(
    ("contrast", "moment", "allowed"),
    [
        (np.ones_like, lambda angle: math.tan(angle), 1e-12),
        (lambda angle: np.cos(angle) ** 2, lambda angle: angle, 1e-7),
        # rises with the root of the distance from the shock, as behind a weak one
        (lambda angle: np.cos(angle) ** 2 * np.sqrt(0.5 - angle), lambda angle: 0.5**1.5 / 1.5, 1e-5),
    ],
)
@pytest.mark.parametrize("step", [(0.01, 0.01), (0.007, 0.02)])
def test_averages_add_up(contrast, moment, allowed, step):
    """Set-up: a conical field g(t) ahead of z = -L, L = 1 + h/2; averages times areas = L^2 / 2 int g / cos^2 dt.

    Closed forms for three g and a shock at 0.5 rad. Errors: none for a constant; the quadrature's for the others.
    """
    step = np.array(step)
    z_count = round(1.0 / step[1]) + 5
    shape = (math.ceil(math.tan(0.5) * (1.0 + step[1]) / step[0]) + 3, z_count)
    averages = cell_averages(contrast, 0.5, shape, -1.0, step)
    averages[0] *= 0.5  # the first cells reach to both sides of the axis
    total = averages.sum() * step.prod()
    exact = 0.5 * (1.0 + 0.5 * step[1]) ** 2 * moment(0.5)
    assert abs(total / exact - 1.0) < allowed
    assert averages.max() <= 1.0 + 1e-12 and averages.min() >= 0.0


@pytest.mark.parametrize("spacing", [0.0, -1e-3, math.nan, 0.02, (1e-3, 0.02)])
def test_bad_spacings_are_refused(field, spacing):
    with pytest.raises(ValueError, match="spacing must be positive and at most a quarter"):
        field.index_field(spacing=spacing)


def test_bad_cones_are_refused(field):
    with pytest.raises(ValueError, match=r"radius 0\.02 m cuts the flow: the shock reaches"):
        flow.cone(MACH, HALF_ANGLE, length=LENGTH, radius=0.02)
    with pytest.raises(ValueError, match="length must be positive"):
        flow.cone(MACH, HALF_ANGLE, length=0.0)
    with pytest.raises(ValueError, match="density must be positive"):
        flow.cone(MACH, HALF_ANGLE, density=-1.0)
    with pytest.raises(ValueError, match="detaches"):
        flow.cone(MACH, 1.0)
    with pytest.raises(ValueError, match=r"points must have shape \(n, 3\)"):
        field.density_at([[0.0, 0.0]])
