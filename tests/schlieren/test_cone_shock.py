"""The shock angle read off synthetic pictures of the exact flow over a cone, against Taylor-Maccoll.

Set-up: `flow.cone` on a grid of 200 cells along the cone; light along x, traced; a picture of 120 pixels over 54 mm;
the shock read off between 30 and 90 % of the cone's length. The pictures know nothing of the shock but its rays.
Formula: the shock is a cone, its outline in the picture the line y = -z tan b.
Error sources: the edge of a band between pixels, measured at 0.03 pixel rms over 67 columns, 0.01 degree; a constant
offset of the edge does not turn the line; the grid's bell at the shock, two cells or 0.5 mm, whose half height shifts
as the band flattens along the cone: a tenth of a pixel over 67, 0.08 degree.
Tolerance: 0.1 degree; asked for are 0.3. The standard error holds the last one by the change with half the smoothing:
before, 14 of these 28 pictures were off by more than three of it, up to nine.
"""

import math

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.benches import Picture, line_of_sight, measure_shock_angle, schlieren, shadowgraph
from aerokernels.medium import IndexField
from tests.slow import first_of

LENGTH, PIXELS = 0.05, 120
WINDOW = (-0.045, -0.015)
FLOWS = [(2.0, 10.0), (3.0, 20.0), (5.0, 30.0), (1.5, 5.0), (2.0, 20.0), (3.0, 10.0), (4.0, 15.0)]


def sight(mach: float, degrees: float, both_halves: bool = False):
    gas = flow.cone(mach, math.radians(degrees), length=LENGTH, density=0.33)
    reach = 1.15 * LENGTH * math.tan(gas.shock.shock_angle)
    pitch = 0.054 / PIXELS
    field: IndexField = gas.index_field(spacing=LENGTH / 200)
    rows = round(reach / pitch) * (2 if both_halves else 1)
    low = -reach if both_halves else 0.0
    return gas, line_of_sight(field, extent=(-LENGTH, 0.004, low, reach), pixel_count=(PIXELS, rows))


@pytest.mark.parametrize(("mach", "degrees"), first_of(FLOWS, 2))
def test_shock_angle_is_taylor_maccoll(mach: float, degrees: float):
    gas, light = sight(mach, degrees)
    exact = flow.cone_shock(mach, math.radians(degrees)).shock_angle
    assert exact == gas.shock.shock_angle
    for knife_edge in ("horizontal", "vertical", math.radians(115.0), math.pi):
        found = measure_shock_angle(schlieren(light, knife_edge=knife_edge), WINDOW)
        assert abs(found.angle - exact) < min(math.radians(0.1), 3.0 * found.standard_error), knife_edge
        assert 0.0 < found.standard_error < math.radians(0.15)
        assert len(found.points) >= 60 and found.place == pytest.approx(-0.03, abs=1e-3)


def test_a_shadowgraph_shows_the_same_angle():
    gas, light = sight(3.0, 20.0)
    found = measure_shock_angle(shadowgraph(light, distance=0.3), WINDOW)
    assert abs(found.angle - gas.shock.shock_angle) < math.radians(0.15)


def test_both_halves_take_out_how_much_the_picture_is_turned():
    """A picture turned by 1 degree about the tip: the halves differ by 2, their mean stays."""
    from scipy.ndimage import rotate

    _, light = sight(3.0, 20.0, both_halves=True)
    plain = schlieren(light, knife_edge="horizontal")
    tip = int(np.argmin(np.abs(plain.horizontal)))
    part = plain.intensity[:, tip - 110 : tip]  # so that the tip lies at the middle of the turned part's right border
    wide = np.pad(part, ((0, 0), (0, 110)), mode="edge")
    turned = rotate(wide, -1.0, reshape=False, order=1, mode="nearest")[:, :110]
    straight, crooked = (
        measure_shock_angle(Picture(i, plain.horizontal[tip - 110 : tip], plain.vertical), WINDOW, half="both")
        for i in (part, turned)
    )
    assert abs(crooked.angle - straight.angle) < math.radians(0.1)
    assert abs(straight.roll) < math.radians(0.01)
    assert abs(abs(crooked.roll) - math.radians(1.0)) < math.radians(0.1)


def test_standard_error_tells_the_scatter():
    """With noise of 5 % of full light on 40 pictures the angles scatter as the standard errors say, or less.

    Error source: a standard deviation of 40 numbers is good to 11 %; smoothing and the pixels' pattern tie neighbours
    together, which the correlation of the residuals takes in on the safe side; the change with half the smoothing has
    scatter of its own: told is 0.7 to 3.5 times the scatter.
    """
    _, light = sight(3.0, 20.0)
    clean = schlieren(light, knife_edge="horizontal")
    random = np.random.default_rng(5)
    found = []
    for _ in range(40):
        noisy = np.clip(clean.intensity + 0.05 * random.standard_normal(clean.intensity.shape), 0.0, 1.0)
        found.append(measure_shock_angle(Picture(noisy, clean.horizontal, clean.vertical), WINDOW))
    scatter = np.std([one.angle for one in found], ddof=1)
    reported = np.sqrt(np.mean([one.standard_error**2 for one in found]))
    assert 0.7 * scatter < reported < 3.5 * scatter
    assert scatter < math.radians(0.3)


def test_the_outline_of_the_body_is_no_shock():
    """Mach 4.8, half angle 22.3 degrees: a knife edge that hardly shows the upper shock, beside the dark body.

    The body's edge was measured, 5 degrees less than the shock. The shock is 2 to 5 pixels from it in this window.
    """
    gas = flow.cone(4.81, math.radians(22.3), length=LENGTH, density=0.33)
    reach = 1.15 * LENGTH * math.tan(gas.shock.shock_angle)
    extent = (-LENGTH, 0.004, -reach, reach)
    light = line_of_sight(gas.index_field(spacing=LENGTH / 74), extent=extent, pixel_count=(80, 88))
    picture = schlieren(light, knife_edge=math.radians(147.0), cut_off=0.2)
    found = measure_shock_angle(picture, (-0.042, -0.019), degree=2)
    assert abs(found.angle - gas.shock.shock_angle) < min(math.radians(1.0), 3.0 * found.standard_error)
