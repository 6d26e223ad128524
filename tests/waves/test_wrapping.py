"""Light that leaves a periodic window and comes back on its other side is told of."""

import warnings

import numpy as np
import pytest
from scipy.special import ndtri

from aerokernels import Disc, IndexField, Wave, split_step
from aerokernels.waves import WrappedWaveWarning
from aerokernels.waves.wave import wrapped_share

WAVELENGTH, PIXEL, COUNT, WAIST = 1e-6, 1e-4, 256, 2e-3
PLACE = PIXEL * (np.arange(COUNT) - COUNT // 2)
X, Y = np.meshgrid(PLACE, PLACE)
RAYLEIGH = np.pi * WAIST**2 / WAVELENGTH


def beam(slope: float = 0.0, curvature: float = 0.0) -> Wave:
    """A Gaussian beam at its waist, turned by a slope, and focused at 1 / curvature."""
    phase = 2.0 * np.pi / WAVELENGTH * (slope * X - 0.5 * curvature * (X**2 + Y**2))
    return Wave(np.exp(-(X**2 + Y**2) / WAIST**2 + 1j * phase), PIXEL, WAVELENGTH)


@pytest.mark.parametrize("distance", [8.0 * RAYLEIGH, 20.0 * RAYLEIGH])
def test_the_share_that_leaves_is_that_of_the_components_that_go_far_enough(distance):
    """Set-up: the components k / (window) of a Gaussian beam have the light exp(-2 (pi w k / window)^2).

    Expected: those that move by more than half the window and the lit part on one side, 3.7 w / 2, leave. None of them
    moves by that to a pixel, so that only rounding is between.
    """
    wave = beam()
    found = wrapped_share(wave, distance)
    far = 0.5 * COUNT * PIXEL - 0.5 * WAIST * ndtri(1e-4)
    component = np.arange(-50, 51) / (COUNT * PIXEL)
    light = np.exp(-2.0 * (np.pi * WAIST * component) ** 2)
    moved = np.abs(component) * WAVELENGTH * distance
    assert np.abs(moved - far).min() > 2.0 * PIXEL
    assert found == pytest.approx(light[moved > far].sum() / light.sum(), rel=1e-9)
    with pytest.warns(WrappedWaveWarning, match="of the light leaves the window of 0.0256 m x 0.0256 m"):
        wave.propagate(distance)
    with pytest.warns(WrappedWaveWarning):
        wave.propagate(-distance)


def test_light_that_stays_is_not_told_of():
    """A beam up to two Rayleigh lengths, one turned toward a side, and one that goes through its focus."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        beam().propagate(2.0 * RAYLEIGH)
        beam(slope=1e-3).propagate(5.0)
        beam(curvature=1.0 / 2.0).propagate(4.0)
        Wave(np.ones((1, 64)), PIXEL, WAVELENGTH).propagate(100.0)


def test_a_beam_that_is_a_window_further_looks_as_if_it_had_not_moved():
    """A period aside, its intensity is where it began, and only its slope tells."""
    wave = beam(slope=4e-3)
    with pytest.warns(WrappedWaveWarning, match="at least 1e\\+02 % of the light"):
        moved = wave.propagate(COUNT * PIXEL / 4e-3)
    assert abs(float((moved.intensity * X).sum() / moved.intensity.sum())) < 2e-4


@pytest.mark.parametrize(("window", "is_told"), [(2.0, True), (40.0, False)])
def test_a_wave_through_a_field_needs_a_window_that_holds_it(window, is_told):
    """A pupil of 1 mm, 0.5 m ahead of a box: diffraction of half a milliradian."""
    axis = np.linspace(-0.02, 0.02, 9)
    field = IndexField.from_samples(
        np.zeros((9, 9, 9)), origin=(-0.02, -0.02, 0.5), spacing=(axis[1] - axis[0],) * 3, geometry="volume"
    )
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        split_step(field, Disc(0.5e-3), window=window, pixel_count=256, step_count=2)
    assert [one.category for one in told] == [WrappedWaveWarning] * is_told
