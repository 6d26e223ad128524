"""Numbers at and below the least normal ones of float32 and float64, in contrasts, positions, directions and stops."""

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import ArcLength, Plane, trace

from .checks import PRECISIONS, UNIT, UP, keeps_promises, random_field, slab

FAR = Plane((0.0, 0.0, 10e-3), UP)
GEOMETRIES = ("volume", "planar", "axisymmetric")
# 1e-162 and below: the square is no float64 number any more.
TINY = (1e-30, 1e-46, 1e-150, 1e-160, 3e-162, 1.6e-162, 1e-162, 1e-200, 1e-300, 1e-308, 1e-310, 5e-324)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("size", [1e-30, 1e-38, 1e-44, 1e-46, 1e-300, 1e-307, 1e-310, 5e-324])
def test_a_contrast_that_is_hardly_a_number(size, precision):
    """A random field times 1e-30 to 5e-324: the OPD is at most that times the length; float32 may take it for nothing.

    Tolerance: 4 roundings of the 11 mm path in float64, far above the contrast: what matters is that nothing divides
    by it.
    """
    field = random_field("planar", amplitude=size)
    height = np.linspace(-1e-3, 1e-3, 5)
    rays = RayBundle(np.c_[0 * height, height, np.full(5, -1e-3)], [[0.0, 0.1, 1.0]])
    result = trace(field, rays, until=FAR, method="adaptive", precision=precision)
    assert keeps_promises(result, 5).ok.all()
    assert np.abs(result.opd).max() <= 4.0 * 2.0**-53 * 11e-3
    assert np.abs(result.direction - rays.direction).max() <= 2.0**-53


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_directions_with_tiny_components(geometry, precision):
    """(e, -e, 1) with e down to 5e-324 is (0, 0, 1): entry, exit and OPD are the same, whatever e^2 underflows to."""
    field = random_field(geometry)
    for x in (0.0, 0.3e-3, 1.25e-3):
        tiny = np.array([*TINY, 0.0])
        for first, second in ((1.0, -1.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
            rays = RayBundle(np.tile([x, 0.0, -1e-3], (13, 1)), np.c_[first * tiny, second * tiny, np.ones(13)])
            for until in (None, FAR):
                result = keeps_promises(trace(field, rays, until=until, method="adaptive", precision=precision), 13)
                assert result.ok.all()
                assert (np.abs(result.opd - result.opd[-1]) <= 4.0 * 2.0**-53 * 11e-3).all()


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_starts_at_tiny_coordinates(geometry, precision):
    """A start at (e, -e, e), inside the box's entry face by e: as from 0 exactly, within the roundings of the path.

    Partial sums of the OPD may be rounded the other way: by four units of the greatest one that there may be.
    """
    field = random_field(geometry)
    tiny = np.array([*TINY, 0.0])
    partial = 8.0 * UNIT[precision] * float(np.abs(field.samples.samples).max()) * 11e-3
    for sign in (1.0, -1.0):
        rays = RayBundle(np.c_[tiny, -tiny, sign * tiny], [[0.05, 0.02, 1.0]])
        result = keeps_promises(trace(field, rays, until=FAR, method="adaptive", precision=precision), 13)
        assert result.ok.all()
        assert (np.abs(result.opd - result.opd[-1]) <= 4.0 * 2.0**-53 * 11e-3 + partial).all()


@pytest.mark.parametrize("precision", PRECISIONS)
def test_stops_at_tiny_distances(precision):
    """A plane, or a length of arc, e ahead of the start in a slab: hardly a thing to trace, an OPD of contrast x e."""
    field = slab(1e-3, "planar")
    rays = RayBundle([[0.0, 1e-4, 0.0]], [UP])
    for distance in TINY:
        for until in (Plane((0.0, 0.0, distance), UP), ArcLength(distance)):
            result = keeps_promises(trace(field, rays, until=until, method="adaptive", precision=precision), 1)
            assert result.ok[0]
            assert abs(result.opd[0]) <= 2e-3 * distance
            assert 0.0 <= result.arc_length[0] <= 2.0 * distance
