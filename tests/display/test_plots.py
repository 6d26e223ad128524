"""Results draw themselves on axes: what is drawn are their own numbers, in the units of the labels."""

from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from aerokernels import EchoResult, TraceResult, Wave


def test_spot_diagram_is_the_directions_about_their_mean():
    angle = 1e-6 * np.array([[0.0, 0.0], [30.0, 0.0], [0.0, -60.0]])
    direction = np.column_stack([angle, np.sqrt(1.0 - (angle**2).sum(axis=1))])
    traced = TraceResult(np.zeros(3, dtype=int), None, {}, 1e-6, np.ones(3) / 3, direction=direction)
    axes = traced.plot(Figure().subplots())
    x, y = axes.lines[0].get_data()
    assert x == pytest.approx([-10.0, 20.0, -10.0], abs=1e-6) and y == pytest.approx([20.0, 20.0, -40.0], abs=1e-6)
    with pytest.raises(ValueError, match="direction"):
        TraceResult(np.zeros(3, dtype=int), None, {}, 1e-6, np.ones(3) / 3).plot()


def test_intensity_of_a_wave_and_voltage_of_an_echo():
    wave = Wave(np.full((4, 6), 2.0 + 0.0j), 1e-3, 1e-6)
    drawn = wave.plot(Figure().subplots()).images[0]
    assert (drawn.get_array() == 4.0).all() and drawn.get_extent() == pytest.approx((-3.5, 2.5, -2.5, 1.5))
    echo = SimpleNamespace(
        time=np.arange(3) * 1e-9, voltage=np.array([0.0, 1.0, 0.5]), clean_voltage=np.zeros(3), noise_rms=0.1
    )
    lines = EchoResult.plot(echo, Figure().subplots()).lines
    assert len(lines) == 2 and lines[0].get_xdata() == pytest.approx([0.0, 1.0, 2.0])
