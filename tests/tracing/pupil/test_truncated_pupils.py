"""Pupils that look through a cut: refused, or allowed with what is lost in the budget."""

import warnings

import numpy as np
import pytest

from aerokernels import Disc, IndexField, estimate_strehl, flow, trace
from aerokernels.rays import RayBundle
from aerokernels.tracing import RayStatus
from aerokernels.tracing.pupil.air import PupilAir, TruncationWarning

from ..disturbed_boxes import CONTRAST, HALF, WAVE, box


def cut_box() -> IndexField:
    """A box of a wave along y, 16 mm long in z, resampled within 4 mm of z = 0 and of the axis."""
    whole = box(value=lambda x, y, z: CONTRAST * np.cos(np.pi * y / (2.0 * HALF)), scale=2.0)
    return whole.resample(1e-3, region=((-HALF,) * 3, (HALF,) * 3))


@pytest.mark.parametrize(
    ("pupil", "place"),
    [
        (Disc(2e-3, (0, 0, -2e-3)), "at the face z = 4 mm"),
        (Disc(2e-3, (0, 0, 0), (1, 0, 0)), "at the face x = 4 mm"),
        (Disc(8e-3, (0, 0, 5e-3), (0, 0, -1)), "beside the field's box|at the face z = -4 mm"),
    ],
    ids=["ahead", "turned", "twice as wide"],
)
def test_truncated_pupils_are_refused_unless_allowed(pupil, place):
    """A region full of disturbed air that goes on: refused with share, place and remedy; allowed, it warns."""
    field = cut_box()
    with pytest.raises(ValueError, match=rf"% of the pupil looks through disturbed air that is cut off ({place}).*all"):
        estimate_strehl(field, pupil, ray_count=1024)
    with pytest.warns(TruncationWarning, match="of the pupil looks through disturbed air"):
        seen = estimate_strehl(field, pupil, ray_count=1024, allow_truncation=True)
    assert seen.error["total"] >= seen.error["truncation"] > 0.0
    assert any("cut off" in reason for reason in seen.plan.reasons)


def test_the_error_of_a_truncated_pupil_is_that_of_the_truth():
    """The source traced whole: what truncation is told to change is within a factor of 3 of what it changes."""
    pupil = Disc(3e-3, (0.0, 0.0, -2e-3))
    field = cut_box()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        seen = estimate_strehl(field, pupil, ray_count=4096, allow_truncation=True)
    truth = estimate_strehl(field.source, pupil, ray_count=4096)
    assert abs(seen.value - truth.value) > 0.001
    assert 1.0 / 3.0 < seen.error["truncation"] / abs(seen.value - truth.value) < 3.0


def test_a_thousandth_of_a_pupil_may_lose_something():
    """No refusal up to there."""
    PupilAir(1e-3, 1e-9, "at the face z = 4 mm").check(allowed=False)
    with pytest.raises(ValueError, match=r"0\.11 % of the pupil .* cut off at the face z = 4 mm"):
        PupilAir(1.1e-3, 1e-9, "at the face z = 4 mm").check(allowed=False)


@pytest.fixture(scope="module")
def mach3():
    """The shipped Mach 3 flow as the README uses it, on a coarser grid."""
    air = flow.shipped("mach3").scaled(1.225)
    return air.index_field(wavelength=WAVE).resample(2e-4, region=((0, -9e-3), (9e-3, 6e-3)))


def test_the_shipped_flow_straight_ahead_is_not_truncated(mach3):
    """It ends in the free stream there: no word, nothing in the budget; rays across it are another matter."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        seen = estimate_strehl(mach3, Disc(6e-3, (0, 0, -8e-3)), ray_count=1024)
    assert seen.error["truncation"] == 0.0
    across = trace(mach3, RayBundle([[-20e-3, 8.5e-3, -5e-3], [-20e-3, 2e-3, 5e-3]], [1.0, 0.0, 0.0]))
    assert list(across.status)[1] == RayStatus.OK and across.status[0] == RayStatus.LEFT_DISTURBED_AIR


@pytest.mark.parametrize("pupil", [Disc(6e-3, (0, 0, -8e-3), (0, 1, 1)), Disc(10e-3, (0, 0, -8e-3))])
def test_the_shipped_flow_cut_short_is_refused(mach3, pupil):
    """Turned by 45 degrees, 38 % of the pupil leaves through the side of the region; a wider one looks past it."""
    with pytest.raises(ValueError, match=r"(3[5-9]|4\d|19|18|2\d)(\.\d+)? % of the pupil looks through disturbed air"):
        estimate_strehl(mach3, pupil, ray_count=1024)
