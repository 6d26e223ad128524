"""Whether a Strehl estimate's rays saw what the field holds."""

from aerokernels.strehl.ratio import UNSEEN, met_nothing
from tests.random_fields import uniform_field


def test_rays_that_met_nothing_where_there_is_something():
    """A contrast of 3e-4 in a box of 6 mm, 1.7 waves of 1 um: rays of no OPD missed it, above a tolerance."""
    field = uniform_field("volume", amplitude=3e-4)
    assert met_nothing(field, 0.0, 1e-6, 1e-3)
    assert met_nothing(field, 0.9 * UNSEEN * 1e-3 * 1e-6, 1e-6, 1e-3)
    assert not met_nothing(field, 1.1 * UNSEEN * 1e-3 * 1e-6, 1e-6, 1e-3)
    assert met_nothing(field, 0.0, 1e-6, 1.0) and not met_nothing(field, 0.0, 1e-6, 3.0)
