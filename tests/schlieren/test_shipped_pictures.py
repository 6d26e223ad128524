"""Pictures of the shipped flows at Mach 2, 3 and 4: three shocks, whose angles fall with Mach; the stand-off distance.

The flows are resampled to 0.25 mm and pictured with pixels of 0.5 mm, the nose to 0.05 mm and with pixels of 0.1 mm.
"""

import math

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.benches import line_of_sight, measure_shock_angle, measure_stand_off, schlieren

pytestmark = pytest.mark.slow

MACH = {"mach2": 2.0, "mach3": 3.0, "mach4": 4.0}
# Lines drawn by hand: heights [m] of the second shock at z = -50 and -70 mm, of the third at -96 and -108 mm.
SECOND = {"mach2": (0.030, 0.049), "mach3": (0.025, 0.039), "mach4": (0.023, 0.035)}
THIRD = {"mach2": (0.044, 0.062), "mach3": (0.037, 0.0495), "mach4": (0.0348, 0.0447)}


@pytest.fixture(scope="module")
def fields():
    return {name: flow.shipped(name).index_field().resample(2.5e-4) for name in MACH}


def test_three_shocks_and_their_angles_fall_with_mach(fields):
    """The second and third shock cross the flow behind the first: each is steeper than the Mach angle of the stream.

    The body's cones have half angles of 10 and 22 degrees; a shock lies above both its wall and the Mach angle.
    """
    angles = []
    for name, field in fields.items():
        light = line_of_sight(field, extent=(-0.115, 0.005, 0.0, 0.1), pixel_count=(240, 200))
        largest = float(np.nanquantile(np.abs(light.deflection[..., 1]), 0.999))
        picture = schlieren(light, knife_edge="horizontal", sensitivity=0.5 / largest)
        shocks = [measure_shock_angle(picture, (-0.06, -0.03), degree=2)]
        for heights, window in ((SECOND[name], (-0.07, -0.05)), (THIRD[name], (-0.108, -0.096))):
            near = ((window[0], heights[1]), (window[1], heights[0]))
            shocks.append(measure_shock_angle(picture, window, near=near, reach=0.003, degree=2))
        assert all(shock.standard_error < math.radians(0.7) for shock in shocks)
        angles.append([shock.angle for shock in shocks])
        assert min(angles[-1]) > math.asin(1.0 / MACH[name])
    bow, second, third = np.degrees(np.transpose(angles))
    for falling in (bow, second, third):
        assert falling[0] > falling[1] + 1.0 > falling[2] + 2.0
    assert (second > bow).all() and (third > second).all()


def test_stand_off_is_where_the_density_jumps():
    """The distance from nose to bow shock on the axis, against the flow's own density on the axis.

    Truth: half way up the captured jump. The picture's front is its outer edge: the solver captures the shock over two
    cells of 0.05 mm. Tolerance 0.1 mm of 1.4 to 2.8 mm; the distance falls with Mach.
    """
    found = []
    for name in MACH:
        field = flow.shipped(name).index_field().resample(5e-5, region=((0.0, -0.003), (0.01, 0.0043)))
        light = line_of_sight(field, extent=(-0.002, 0.0042, -0.003, 0.003), pixel_count=(62, 60), rays_per_pixel=2)
        picture = schlieren(light, knife_edge=math.pi)
        stand_off = measure_stand_off(picture, 0.002)
        z = np.linspace(0.0, 0.0043, 431)
        contrast = field.contrast_at(np.stack([0.0 * z, 0.0 * z, z], axis=1))
        truth = float(np.interp(0.4 * contrast.max(), contrast[::-1], z[::-1]))
        assert abs(stand_off.distance - truth) < 1e-4
        assert abs(stand_off.nose) < 5e-5 and stand_off.standard_error < 2e-5
        found.append(stand_off.distance)
    assert found == sorted(found, reverse=True)
