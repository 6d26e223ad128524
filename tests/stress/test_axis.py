"""The axis r = 0 of an axisymmetric field: rays on it, beside it by any distance, and across it."""

import numpy as np
import pytest

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from tests.slow import first_of

from .checks import PRECISIONS, UNIT, UP, WAVE, keeps_promises

CELL = 1e-4
CONTRAST = 3e-3
FAR = Plane((0.0, 0.0, 0.2), UP)


def lens(interpolation: str = "cubic") -> IndexField:
    """A Gaussian in r, wavy along z: a lens of about 0.16 m focal length, 1.6 mm in radius, 4 mm long."""
    r, z = np.arange(17)[:, None] * CELL, np.arange(41) * CELL
    samples = CONTRAST * np.exp(-((r / 8e-4) ** 2)) * (1.0 + 0.3 * np.sin(z / 5e-4))
    return IndexField.from_samples(
        samples, origin=(0.0, 0.0), spacing=(CELL, CELL), geometry="axisymmetric", interpolation=interpolation
    )


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("interpolation", first_of(["cubic", "linear", "monotone"]))
@pytest.mark.parametrize("sign", first_of([1.0, -1.0]))
def test_a_ray_on_the_axis_stays_on_it(interpolation, precision, sign):
    """By symmetry no force across: exactly x = y = 0 and a direction exactly along z, either way; the OPD is a line's.

    Formula: OPD = int m dz along the axis, here by Gauss points on each cell of the interpolant. Tolerance: 1e-3 wave.
    """
    field = lens(interpolation)
    start = -1e-3 if sign > 0.0 else 5e-3
    ray = RayBundle([[0.0, 0.0, start]], [[0.0, 0.0, sign]])
    until = Plane((0.0, 0.0, start + 0.2 * sign), UP)
    result = keeps_promises(trace(field, ray, until=until, method="adaptive", precision=precision), 1)
    assert result.ok[0]
    assert (result.position[0, :2] == 0.0).all() and np.array_equal(result.direction[0], [0.0, 0.0, sign])
    node, weight = np.polynomial.legendre.leggauss(5)
    z = (np.arange(40)[:, None] + 0.5 * (node + 1.0)).ravel() * CELL
    line = field.contrast_at(np.c_[0.0 * z, 0.0 * z, z])
    expected = line @ np.tile(0.5 * CELL * weight, 40)
    assert abs(result.opd[0] - expected) < 1e-3 * WAVE


@pytest.mark.parametrize("precision", PRECISIONS)
def test_beside_the_axis_by_any_distance(precision):
    """A ray at r0 = 1e-6 to 1e-310 m beside the axis: the lens is linear there, r(0.2 m) = M r0, with one M for all.

    M from r0 = 1e-8 m in float64. Errors: the even cubic spline has a term of |r|^3, of the size cell x r0 / (0.8 mm)^2
    = 1.6e-4 of the force at 1e-6 m: 1e-3 of r0 allowed in all, x 2 for the steps; the slope near r = 0 is a difference
    of coefficients, so it carries a few roundings of contrast / cell over 4 mm of lens and then 0.2 m of flight: below
    that the ray is as good as on the axis. OPD: that of the axis, but for (M - 1)^2 r0^2 / 0.4 m = 143 r0^2 / m at the
    slope with which it leaves.
    """
    offset = 10.0 ** -np.array([6.0, 7, 8, 9, 10, 12, 15, 18, 20, 25, 30, 38, 45, 100, 154, 162, 200, 300, 310])
    settings_ = {"until": FAR, "method": "adaptive", "tolerance": 1e-5}
    probe = trace(lens(), RayBundle([[1e-8, 0.0, -1e-3], [0.0, 0.0, -1e-3]], [UP]), precision="float64", **settings_)
    gain, on_axis = probe.position[0, 0] / 1e-8, probe.opd[1]
    assert -10.0 < gain < -1.0
    noise = 4.0 * UNIT[precision] * CONTRAST / CELL * 4e-3 * 0.2
    for angle in (0.0, 0.7, np.pi / 2, 4.0):
        outward = np.array([np.cos(angle), np.sin(angle)])
        start = np.c_[offset[:, None] * outward, np.full(len(offset), -1e-3)]
        result = keeps_promises(trace(lens(), RayBundle(start, [UP]), precision=precision, **settings_), len(offset))
        assert result.ok.all()
        miss = np.hypot(*(result.position[:, :2] - gain * start[:, :2]).T)
        assert (miss < 2e-3 * offset + noise).all()
        rounding = UNIT[precision] * 8.0 * on_axis + 2.0**-50 * 0.2
        assert (np.abs(result.opd - on_axis) < 2e-5 * WAVE + 200.0 * offset**2 + rounding).all()
