"""Every medium with exact rays at the default tolerance."""

import pytest

from .checks import assert_float64, case
from .media import CASES


@pytest.mark.usefixtures("both_backends")
@pytest.mark.parametrize("name", list(CASES))
def test_default_tolerance(name):
    """At 1e-3 wave, in float64: within 1e-8 of the path in all outputs.

    Paths are 0.6 to 8 m, so that 9e-10 m of optical path is 1.5e-9 of them at most; position and direction are
    controlled as far as they matter for the optical path, and the grid adds its few 1e-9 (see cases.py).
    """
    assert_float64(case(name), 1e-8)
