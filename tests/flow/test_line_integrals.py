"""Line integrals of density through exact flows: what the cells hold against the formula by quadrature."""

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad

from aerokernels import flow
from aerokernels.flow.conical_field import cell_averages

NODE, WEIGHT = np.polynomial.legendre.leggauss(12)


def fields():
    """Coarse meshes: about 40 cells a side. With each, the angles of its jumps and kinks from -z towards +y."""
    wedge = flow.wedge(3.0, 0.3, length=1.0, spacing=0.04)
    fan = flow.expansion(2.0, 0.4, length=1.0, spacing=0.04)
    swirl = flow.vortex(0.9, radius=1.0, spacing=0.25)
    angles = fan.solution.head_angle, fan.solution.tail_angle, fan.solution.inner_angle
    return {
        "wedge": (wedge, wedge.solution.breaks),
        "fan": (fan, angles),
        "vortex": (swirl, ()),
    }


FIELDS = fields()


def crossings(angles, y, low, high) -> list[float]:
    """Where a line of constant y meets the rays of some angles, z = -y / tan(angle), between two ends."""
    found = [-y / math.tan(angle) for angle in angles if y * math.sin(angle) > 0.0]
    return sorted(z for z in found if low < z < high)


def along_z(field, angles, y) -> float:
    """The formula's integral over the whole box along z at one y, by quadrature between jumps."""
    low, high = field.mesh.box
    stops = [low[1], *crossings(angles, y, low[1], high[1]), high[1]]
    ratio = field.solution.density_ratio_at
    parts = [quad(lambda z: float(ratio(y, z)), a, b, epsabs=1e-12, epsrel=1e-12, limit=200)[0]
             for a, b in pairwise(stops)]  # fmt: skip
    return field.ambient_density * sum(parts)


@pytest.mark.parametrize("name", FIELDS)
def test_rows_of_cells_hold_the_lines_through_them(name):
    """Set-up: rows of cells along z, each fifth. Expected: the formula's line integrals through them, within 1e-9.

    Formula: the sum of averages times widths is the mean over the row's height of the line integrals through it. They
    are smooth in y but where a jump leaves through an end of the box; the mean is taken by Gauss's rule in between.
    """
    field, angles = FIELDS[name]
    y, z = np.unique(field.mesh.vertices[:, 0]), np.unique(field.mesh.vertices[:, 1])
    held = field.density.reshape(len(y) - 1, len(z) - 1) @ np.diff(z)
    leaves = [-math.tan(angle) * end for angle in angles for end in (z[0], z[-1])]
    for row in range(2, len(y) - 1, 5):
        stops = [y[row], *sorted(v for v in leaves if y[row] < v < y[row + 1]), y[row + 1]]
        exact = 0.0
        for a, b in pairwise(stops):
            lines = [along_z(field, angles, place) for place in a + 0.5 * (b - a) * (NODE + 1.0)]
            exact += 0.5 * (b - a) * float(np.dot(WEIGHT, lines))
        assert abs(held[row] / (exact / (y[row + 1] - y[row])) - 1.0) < 1e-9


def test_a_cones_cells_hold_the_lines_through_them():
    """As above for the cone's averages: rows of cells along z at Mach 3, 20 degrees, ahead of and beside the body.

    The contrast to the free stream over its density; lines by quadrature between the shock and the base. 1e-6.
    """
    cone = flow.cone(3.0, math.radians(20.0), length=1.0)
    shock = cone.shock
    step = np.array([0.02, 0.02])
    averages = cell_averages(lambda a: shock.density_ratio_at(a) - 1.0, shock.shock_angle, (30, 50), -1.0, step)
    wall, tangent = math.tan(shock.half_angle), math.tan(shock.shock_angle)
    for row in (19, 22, 25):
        low, high = (row - 0.5) * 0.02, (row + 0.5) * 0.02
        total = 0.0
        for r, share in zip(low + 0.5 * (high - low) * (NODE + 1.0), 0.5 * WEIGHT, strict=True):
            assert r > 1.01 * wall  # beside the body all the way to its base
            total += (
                share
                * quad(
                    lambda z, r=r: float(shock.density_ratio_at(math.atan2(r, -z))) - 1.0,
                    -1.01,
                    -r / tangent,
                    epsabs=1e-11,
                )[0]
            )
        assert abs(averages[row].sum() * 0.02 / total - 1.0) < 1e-6
