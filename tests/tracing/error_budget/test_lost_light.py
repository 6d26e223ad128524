"""What light may lose where the air ends, by air that falls off as an exponential and so is known beyond its end."""

import numpy as np
import pytest

from aerokernels import IndexField, RayBundle
from aerokernels.medium import Body
from aerokernels.tracing import ArcLength, Plane
from aerokernels.tracing.error_budget.known_air import may_be_lost
from aerokernels.tracing.lever_arms import LeverArms
from aerokernels.tracing.pupil.air import meets_wall
from aerokernels.tracing.support import support_box

CELL, HALF, LENGTH, SCALE, GREATEST = 2.5e-4, 2e-3, 8e-3, 1.5e-3, 1e-5


def falling() -> IndexField:
    """Contrast GREATEST exp(-(y + HALF) / SCALE), alike along z, planar."""
    y, z = np.arange(-HALF, HALF + 1e-9, CELL), np.arange(0.0, LENGTH + 1e-9, CELL)
    samples = GREATEST * np.exp(-(y[:, None] + HALF) / SCALE) * np.ones(len(z))
    return IndexField.from_samples(samples, origin=(-HALF, 0.0), spacing=(CELL, CELL), geometry="planar")


FACE = GREATEST * np.exp(-2.0 * HALF / SCALE)  # at the upper face


WITHIN = np.exp(2.0 * CELL / SCALE)  # the greatest of the two cells behind a face is what counts


@pytest.mark.parametrize("beside", [1e-4, 3e-4, 6e-4])
@pytest.mark.parametrize("ahead", [1e-3, 5e-3])
def test_a_ray_beside_the_box_passes_what_the_air_has_fallen_to(beside: float, ahead: float):
    """Contrast at the face times exp(-d / s) times the box's length; up to a cell farther away, up to two deeper.

    A plane across the ray loses the same, and so does a longer way behind the box.
    """
    field, up = falling(), (0.0, 0.0, 1.0)

    def lost(distance: float, until) -> float:
        return float(may_be_lost(field, RayBundle([[0.0, HALF + distance, -ahead]], up), until, 1e-14)[0][0])

    far = ArcLength(ahead + 3.0 * LENGTH)
    found = lost(beside, far)
    assert np.exp(-(beside + CELL) / SCALE) < found / (FACE * LENGTH) < WITHIN * np.exp(-beside / SCALE)
    assert lost(3.0 * beside, far) < found
    assert lost(beside, Plane((0.0, 0.0, 3.0 * LENGTH), up)) == pytest.approx(found, rel=1e-6)
    assert lost(beside, ArcLength(ahead + 3.5 * LENGTH)) == pytest.approx(found, rel=0.2)


def test_a_slanted_plane_adds_the_drift_of_what_turns_the_ray():
    """The slope, contrast over s, times the lost length, the way on to the stop and the tangent of the slant.

    So the part that a slant adds is as long as the way on, and as steep as the slant.
    """
    field, beside = falling(), 3e-4
    ray = RayBundle([[0.0, HALF + beside, -1e-3]], (0.0, 0.0, 1.0))

    def lost(slant: float, depth: float) -> float:
        until = Plane((0.0, HALF + beside, depth), (0.0, np.sin(slant), np.cos(slant)))
        return float(may_be_lost(field, ray, until, 1e-14)[0][0])

    across = lost(0.0, 0.5)
    one, steeper, farther = lost(0.3, 0.5) - across, lost(0.6, 0.5) - across, lost(0.3, 1.0) - across
    assert steeper / one == pytest.approx(np.tan(0.6) / np.tan(0.3), rel=1e-6)
    assert farther / one == pytest.approx(2.0, rel=0.02)  # from the middle of the box on
    assert one == pytest.approx(across / SCALE * 0.5 * np.tan(0.3), rel=0.05)


def test_light_that_leaves_by_the_upper_face_loses_what_lies_beyond_it():
    """Aslant through the face: contrast there times s, over the sine of the angle with it; deeper faces hold more."""
    field = falling()
    for sine in (0.3, 0.6):
        way = np.array([0.0, sine, np.sqrt(1.0 - sine**2)])
        start = np.array([0.0, 0.0, 0.3e-3])
        lost = may_be_lost(field, RayBundle([start], way), ArcLength(1.0), 1e-14)[0]
        assert 1.0 < lost[0] / (FACE * SCALE / sine) < WITHIN
        down = may_be_lost(field, RayBundle([start], way * [1.0, -1.0, 1.0]), ArcLength(1.0), 1e-14)[0]
        assert down[0] > 3.0 * lost[0]


def test_lever_arms_leave_out_less():
    """Rays whose stop is slanted see what turns them: the support is no smaller, and grows with the lever arm."""
    field = falling()
    plain = np.array(support_box(field, 1e-9))
    for arm in (1e-3, 1.0, 100.0):
        low, high = support_box(field, 1e-9, LeverArms(LENGTH, arm, arm))
        assert (low <= plain[0] + 1e-15).all() and (high >= plain[1] - 1e-15).all()
    assert support_box(field, 1e-9, LeverArms(LENGTH, 1e3, 1e3))[1][0] == pytest.approx(HALF)


def test_a_line_along_x_ends_on_a_body_that_is_round_alone():
    """Planar air has no end along x: such a line crosses no wall and never leaves. About an axis, x and y are alike."""
    profile = np.array([(0.0, -2e-3), (1.5e-3, -1e-3), (1.5e-3, 1e-3), (0.0, 2e-3)])
    start = 1e-3 * np.array([[0.1, 0.4, 0.2], [-3.0, 0.5, 0.3], [-3.0, 2.5, 0.3], [0.2, -0.3, 3.0]])
    along_x = np.tile([1.0, 0.0, 0.0], (4, 1))
    answers = {}
    for geometry in ("planar", "axisymmetric"):
        outline = profile if geometry == "axisymmetric" else np.r_[profile, profile[2:0:-1] * [-1.0, 1.0]]
        low = (0.0, -4e-3) if geometry == "axisymmetric" else (-4e-3, -4e-3)
        count = 5 if geometry == "axisymmetric" else 9
        field = IndexField.from_samples(
            np.zeros((count, 9)), origin=low, spacing=(1e-3, 1e-3), geometry=geometry, body=Body(outline, geometry)
        )
        answers[geometry] = meets_wall(field, start, along_x)
        if geometry == "axisymmetric":  # turned by a quarter about the axis
            turned = start[:, [1, 0, 2]] * [-1.0, 1.0, 1.0], np.tile([0.0, 1.0, 0.0], (4, 1))
            np.testing.assert_array_equal(meets_wall(field, *turned), answers[geometry])
    assert not answers["planar"].any()
    np.testing.assert_array_equal(answers["axisymmetric"][1:], [True, False, False])
