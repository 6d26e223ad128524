"""Parts of optical instruments by exact answers: halves of a picture, parts of a source, limits of closed forms."""

import math

import numpy as np
import pytest

from aerokernels import FLDI
from aerokernels.schlieren import Bench, measure_shock_angle
from aerokernels.schlieren.knife_edge import _across

from .test_fronts import WINDOW, drawn


def test_points_of_the_lower_half_lie_on_the_lower_front():
    """Front y = +-(2 mm - 0.3 z): points of each half lie on it to a tenth of a pixel, angles are alike."""
    picture = drawn(0.3)
    found = {half: measure_shock_angle(picture, WINDOW, half=half, smoothing=0.0) for half in ("upper", "lower")}
    for half, sign in (("upper", 1.0), ("lower", -1.0)):
        along, up = found[half].points.T
        np.testing.assert_allclose(
            up, sign * (0.002 - 0.3 * along), atol=0.2 * (picture.vertical[1] - picture.vertical[0])
        )
        assert found[half].place == pytest.approx(0.5 * sum(WINDOW), abs=1e-4)
        assert found[half].curve[1] == pytest.approx(-0.3, abs=1e-3)
    both = measure_shock_angle(picture, WINDOW, half="both", smoothing=0.0)
    assert both.angle == pytest.approx(0.5 * (found["upper"].angle + found["lower"].angle), abs=1e-12)
    assert len(both.points) == len(found["upper"].points) + len(found["lower"].points)
    assert both.roll == pytest.approx(0.0, abs=1e-9)
    errors = [found[half].standard_error for half in ("upper", "lower")]
    # Scatter is independent in the halves; the part from the edge's width is that of the mean angle, 1e-3 of it here.
    assert both.standard_error == pytest.approx(0.5 * math.hypot(*errors), rel=0.01)
    scatter = [found[half].residual_rms for half in ("upper", "lower")]
    assert both.residual_rms == pytest.approx(math.hypot(*scatter) / math.sqrt(2.0))
    np.testing.assert_allclose(both.curve, 0.5 * (found["upper"].curve + found["lower"].curve))


@pytest.mark.parametrize("source", ["slit", "disc"])
@pytest.mark.parametrize("count", [1, 3, 4, 7])
def test_parts_of_a_source_together_are_the_source(source: str, count: int):
    """At any edge and deflection the parts let through, by their shares, what is not held back of the whole."""
    whole, parts = Bench(2e-3, 0.8, source=source), Bench(2e-3, 0.8, source=source, source_points=count)
    points, shares = parts.points()
    assert shares.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(shares @ points, 0.0, atol=1e-15)
    deflection = whole.angle * np.linspace(-0.7, 0.7, 15)
    for cut_off in (0.1, 0.5, 0.8):
        expected = 1.0 - whole.held_back(whole.edge(cut_off) - deflection)
        found = sum(
            share * parts.passed(point, deflection, cut_off) for point, share in zip(points, shares, strict=True)
        )
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_long_waves_are_passed_as_they_are():
    """The transfer function of an FLDI at wave number 0 is 1, and the closed form goes there evenly.

    For small K it falls by (K tan(theta) L)^2 / 24 more than in the focus: second order of erf.
    """
    instrument = FLDI(120e-6, 6e-6)
    assert float(instrument.transfer_through(np.zeros(1), 0.03)[0]) == 1.0
    wave = np.array([1e-6, 1.0, 50.0])
    in_focus = instrument.transfer(wave, 0.0)
    grown = wave * math.tan(instrument.divergence) * 0.03
    expected = in_focus * (1.0 - grown**2 / 24.0)
    np.testing.assert_allclose(instrument.transfer_through(wave, 0.03), expected, rtol=1e-6)


def test_an_edge_turned_by_any_number_of_quarters_sees_one_component():
    """The component toward the bright side is cos a e_x + sin a e_y; at quarter turns one of the two, exactly."""
    deflection = np.array([[3e-6, -7e-6], [1e-6, 2e-6]])
    for quarter in range(-9, 10):
        found = _across(deflection, 0.5 * math.pi * quarter)
        turned = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][quarter % 4]
        np.testing.assert_array_equal(found, deflection @ turned)
    np.testing.assert_allclose(_across(deflection, 0.3), deflection @ [math.cos(0.3), math.sin(0.3)], rtol=1e-14)
