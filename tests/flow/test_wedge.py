"""Plane shocks as density fields."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import flow


def areas_behind(field, low, high) -> np.ndarray:
    """Share of rectangles (y, z) low to high that lies below the line z = -y / tan(b), y > 0: by clipping polygons."""
    tangent = math.tan(field.solution.shock.shock_angle)
    shares = []
    for (y0, z0), (y1, z1) in zip(low, high, strict=True):
        corners = [(y0, z0), (y1, z0), (y1, z1), (y0, z1)]
        value = [y + tangent * z for y, z in corners]  # negative behind
        kept = []
        for k in range(4):
            (ya, za), (yb, zb), a, b = corners[k - 1], corners[k], value[k - 1], value[k]
            if (a < 0.0) != (b < 0.0):
                kept.append((ya + (yb - ya) * a / (a - b), za + (zb - za) * a / (a - b)))
            if b < 0.0:
                kept.append(corners[k])
        twice = sum(kept[k - 1][0] * kept[k][1] - kept[k - 1][1] * kept[k][0] for k in range(len(kept)))
        shares.append(abs(0.5 * twice) / ((y1 - y0) * (z1 - z0)))
    return np.array(shares)


@settings(max_examples=15, deadline=None)
@given(st.floats(1.05, 20.0), st.floats(0.05, 0.95), st.floats(1.1, 1.67))
def test_cells_hold_exact_shares(mach, share, gamma):
    """Set-up: any wedge on a coarse mesh. Expected: shares of areas found by clipping polygons.

    Each cell's average is the free stream's density and that behind the shock by the areas into which the shock cuts
    it. Error: rounding, of the jump times the cells from the origin, 1e-11.
    """
    half_angle = share * flow.maximum_deflection(mach, gamma=gamma)
    field = flow.wedge(mach, half_angle, length=1.0, spacing=0.05, gamma=gamma, density=0.7)
    upper = field.mesh.corners.mean(axis=1)[:, 0] > 0.0
    low, high = field.mesh.corners.min(axis=1), field.mesh.corners.max(axis=1)
    ratio = field.solution.shock.density_ratio
    expected = 0.7 * (1.0 + (ratio - 1.0) * areas_behind(field, low[upper], high[upper]))
    assert np.abs(field.density[upper] / expected - 1.0).max() < 1e-11
    cells = field.density.reshape(field.mesh.shape[0] - 1, -1)
    np.testing.assert_allclose(cells, cells[::-1], rtol=1e-11)


def test_wedge_in_the_optical_frame():
    field = flow.wedge(3.0, 0.3, length=0.05, spacing=1e-3, temperature=200.0)
    shock = field.solution.shock
    tangent = math.tan(shock.shock_angle)
    points = [[0.01, 0.02 * tangent * s, -0.02] for s in (1.001, -1.001, 0.999, -0.999)]
    ratio = shock.density_ratio
    np.testing.assert_allclose(field.density_at(points) / 1.225, [1.0, 1.0, ratio, ratio], rtol=1e-14)
    assert np.isnan(field.density_at([[0.0, 1e-3, -0.02]])).all()
    assert np.array_equal(field.density_at([[0.0, 0.0, 1e-3], [0.0, 0.0, -0.06], [0.0, 1.0, -0.04]]), np.full(3, 1.225))
    low, high = field.mesh.box
    assert low[1] == -0.05 and high[1] > 0.0 and high[0] > 0.05 * tangent and low[0] == -high[0]
    assert field.conditions.temperature == 200.0 and field.conditions.mach == 3.0
    assert field.body.contains(np.array([[0.0, -0.04]])).all() and field.geometry == "planar"
    thin = field.scaled(0.3)
    assert abs(thin.density_at(points)[2] - 0.3 * ratio) < 1e-14 and thin.conditions.density == 0.3


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        ({"mach": 2.0, "half_angle": 0.5}, r"detaches.*22\.97 deg"),
        ({"mach": 0.9, "half_angle": 0.1}, "mach must be 1 or more"),
        ({"mach": 3.0, "half_angle": -0.1}, "half_angle must be positive"),
        ({"mach": 3.0, "half_angle": 0.2, "height": 0.01}, r"height 0\.01 m cuts the flow"),
        ({"mach": 3.0, "half_angle": 0.2, "spacing": 0.0}, "spacing must be positive"),
        ({"mach": 3.0, "half_angle": 0.2, "spacing": 1e-7}, "take a wider one"),
        ({"mach": 3.0, "half_angle": 0.2, "length": 0.0}, "length must be positive"),
        ({"mach": 3.0, "half_angle": 0.2, "density": -1.0}, "density must be positive"),
        ({"mach": 3.0, "half_angle": 0.2, "temperature": 0.0}, "temperature must be positive"),
    ],
)
def test_bad_wedges_are_refused(arguments, fault):
    with pytest.raises(ValueError, match=fault):
        flow.wedge(**arguments)


def test_bad_points_and_meshes_are_refused():
    field = flow.wedge(2.0, 0.1, length=0.1, spacing=5e-3)
    with pytest.raises(ValueError, match=r"points must have shape \(n, 3\)"):
        field.density_at([[0.0, 0.0]])
