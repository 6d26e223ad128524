"""What the moments of a pupil's rays define, beside least squares on the points themselves."""

import dataclasses

import numpy as np
import pytest

from aerokernels.pupils import Disc
from aerokernels.tracing import Plane
from aerokernels.tracing.tasks import sums as pupil_fit
from aerokernels.tracing.tasks.sums import MOMENT_COUNT, PupilTask
from tests.random_fields import uniform_field


def moments(x, y, w) -> np.ndarray:
    """Sums in the order of tasks/sums.py."""
    q = x * x + y * y
    return np.array([np.sum(one) for one in (1 + 0 * x, x, y, w, x * x, x * y, y * y, x * w, y * w, w * w, 0 * x, 0 * x,
                                             x * q, y * q, q * q, q * w)])  # fmt: skip


def drawn(count: int = 40):
    """Points off the middle, of a pupil of some 3 mm, and a wavefront."""
    random = np.random.default_rng(8)
    x, y = 3e-3 * random.normal(size=(2, count)) + np.array([[1e-3], [-2e-3]])
    return x, y, 2.0 + 150.0 * x - 70.0 * y + 4e4 * (x * x + y * y) + random.normal(size=count)


@pytest.mark.parametrize("terms", [(), ("piston",), ("tilt",), ("focus",), ("piston", "tilt", "focus")])
def test_slopes_and_rms_are_those_of_least_squares(terms):
    """Expected: NumPy's least squares on the points, with a mean; moments in metres lose some ten digits of sixteen."""
    x, y, w = drawn()
    columns = [np.ones_like(x)] + ([x, y] if "tilt" in terms else []) + ([x * x + y * y] if "focus" in terms else [])
    found, *_ = np.linalg.lstsq(np.stack(columns, axis=1), w, rcond=None)
    rms = np.sqrt(np.mean((w - np.stack(columns, axis=1) @ found) ** 2))
    expected = np.zeros(3)
    expected[:2] = found[1:3] if "tilt" in terms else 0.0
    expected[2] = found[-1] if "focus" in terms else 0.0
    slopes, about = pupil_fit.fit_terms(moments(x, y, w), terms)
    np.testing.assert_allclose(slopes, expected, rtol=1e-8)
    assert about == pytest.approx(rms, rel=1e-9)
    surface = pupil_fit.fit_surface(np.stack([0.25 * moments(x, y, w), 0.75 * moments(x, y, w)]), terms)
    np.testing.assert_allclose(surface, [w.mean(), *expected], rtol=1e-8)


def test_moments_of_a_plane_and_of_points_on_a_line():
    """A plane comes out with no rms; on a line the tilt along it, and none across: the shortest that fits."""
    x, y, _ = drawn()
    piston, tilt, about_piston, about_plane = pupil_fit.fit_moments(moments(x, y, 1.0 + 2.0 * x - 3.0 * y))
    assert piston == pytest.approx(np.mean(1.0 + 2.0 * x - 3.0 * y), rel=1e-13)
    np.testing.assert_allclose(tilt, [2.0, -3.0], rtol=1e-6)
    assert about_piston == pytest.approx(np.std(2.0 * x - 3.0 * y), rel=1e-6)
    assert about_plane == pytest.approx(0.0, abs=1e-7)
    _, tilt, _, about_plane = pupil_fit.fit_moments(moments(x, 2.0 * x, 5.0 * x))
    np.testing.assert_allclose(tilt, [1.0, 2.0], rtol=1e-6)
    assert about_plane == pytest.approx(0.0, abs=1e-8)


def test_no_rays_no_surface():
    """Where no ray gets through all is zero, and nothing is divided by it."""
    none = np.zeros(MOMENT_COUNT)
    assert pupil_fit.fit_moments(none)[0] == 0.0 and not pupil_fit.fit_moments(none)[1].any()
    assert not pupil_fit.fit_surface(none[None], ("piston", "tilt", "focus")).any()
    assert pupil_fit.fit_terms(none, ("focus",))[1] == 0.0


def test_moments_come_in_metres():
    """Moments in units of a reach of 4 mm; radial ones, of points along x, are those of the disc they stand for."""
    x, y, w = drawn()
    reach = 4e-3
    field = uniform_field("volume")
    look = np.array([0.0, 0.0, 1.0])
    task = PupilTask(field, Disc(reach), look, Plane(look, look), None, 1e-6, 40, 1)
    units = moments(x / reach, y / reach, w)[None]
    np.testing.assert_allclose(pupil_fit.moments_in_metres(units, task)[0], moments(x, y, w), rtol=1e-12)
    # A circle of 720 points has the moments of its radius; odd ones vanish, and those of x^2 and y^2 are halves of r^2.
    angle = np.arange(720) * np.pi / 360.0
    x, y, w = reach * np.cos(angle), reach * np.sin(angle), 7.0 + 0.0 * angle
    task = dataclasses.replace(task, is_radial=True)
    on_x = moments(np.ones(720), np.zeros(720), w)[None]
    np.testing.assert_allclose(pupil_fit.moments_in_metres(on_x, task)[0], moments(x, y, w), rtol=1e-12, atol=1e-13)
