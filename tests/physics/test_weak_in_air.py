"""The rod and the guide made of air: an index 3e-4 above that of the surroundings on the axis, as in real flows."""

import numpy as np
import pytest

from aerokernels.tracing import trace

from .media import parabolic, sech

WAVE = 905e-9


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize(
    ("medium", "geometry"),
    [
        (parabolic, "planar"),
        (parabolic, "axisymmetric"),
        (parabolic, "volume"),
        (sech, "planar"),
        (sech, "axisymmetric"),
    ],
)
def test_the_default_tolerance_holds(medium, geometry, precision):
    """5 mm from the axis to the edge, 1.5 m long, 1.2 pitches: the OPD is up to 4.5e-4 m or 500 waves.

    Formula: that of the medium (test_parabolic.py, test_sech.py). Expected: the OPD within 1e-3 wave at 905 nm in
    float32 as in float64, at the default tolerance. Errors: steps, 1e-3 wave asked for; the grid, none where the
    potential is a parabola, 480 cells across else; rounding in float32, at most 16 * 2^-24 * 3e-4 of the path, 5e-4
    wave (see assert_float32). Position and direction within 2^-24 of the path.
    """
    g, length = 4.9, 1.5
    air = medium(geometry, length * g / (2.0 * np.pi), g=g, n0=1.0003, ambient=1.0, reach=np.sqrt(6e-4))
    result = trace(air.field, air.rays, until=air.until, precision=precision)
    line = length / air.rays.direction[:, 2]
    assert np.abs(result.opd - (air.ends.optical_path - line)).max() < 1e-3 * WAVE
    assert np.linalg.norm(result.position - air.ends.position, axis=1).max() < 2.0**-24 * length
    assert np.linalg.norm(result.direction - air.ends.direction, axis=1).max() < 2.0**-24 * length * g
