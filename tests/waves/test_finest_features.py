"""The finest phase of a map, and the disturbed length of slabs, on waves whose answer is known by hand."""

import dataclasses

import numpy as np
import pytest

from aerokernels import Disc, IndexField, Rectangle
from aerokernels.waves.coarse_wave import _mean_squares, finest_and_squares, fresnel_number
from aerokernels.waves.screens import disturbance
from aerokernels.waves.slabs import FINEST, LEFT_OUT, LookingAlong, slabs_of
from aerokernels.waves.validity import Validity, _same_light

PIXEL, WAVE = 1e-4, 1e-6


@pytest.mark.parametrize("along", ["x", "y"])
@pytest.mark.parametrize(
    ("amplitude", "pixels"), [(0.05, np.inf), (0.07, 8), (0.1, 8), (0.14, 4), (0.36, 4), (0.47, 2), (1.3, 2), (1.9, 1)]
)
def test_the_finest_phase_is_where_second_differences_hold_it(amplitude, pixels, along):
    """A wave of 16 pixels, amplitude a: at distance s its second difference has 4 a sin^2(pi s / 16), rms over root 2.

    With sqrt(rms^2 / 8) above 0.06 at s = 8, 4, 2, 1 for a above 0.06, 0.12, 0.41, 1.57. No tilt and no gap changes it.
    """
    place = np.arange(64)
    phase = np.broadcast_to(amplitude * np.cos(2.0 * np.pi * place / 16.0 + 0.3), (64, 64)) + 5.0 * place
    path = (phase if along == "x" else phase.T) * WAVE / (2.0 * np.pi)
    assert finest_and_squares(path, PIXEL, WAVE)[0] == pixels * PIXEL
    path[:, 40:] = np.nan
    path[50:] = np.nan
    assert finest_and_squares(path, PIXEL, WAVE)[0] == pixels * PIXEL


def test_a_column_is_looked_at_along_itself():
    """A map of one column, as of a planar field: its own lines only."""
    phase = 0.13 * np.cos(2.0 * np.pi * np.arange(64) / 16.0)[:, None]
    assert finest_and_squares(phase * WAVE / (2.0 * np.pi), PIXEL, WAVE)[0] == 4 * PIXEL
    assert _mean_squares(np.array([[[0.0, 1.0, 4.0, 9.0, 16.0]], [[0.0, np.nan, 2.0, 0.0, 1.0]]]), 1) == 4.0 + 9.0


def test_fresnel_numbers():
    """Feature squared over wavelength times distance; nothing disturbed, no diffraction."""
    assert fresnel_number(2e-3, 1e-6, 0.5) == pytest.approx(8.0)
    assert fresnel_number(2e-3, 1e-6, 0.0) == np.inf
    told = Validity(-0.011, 1e-3, 0.5, 2.0, 0.0, 0.1)
    assert not told.good and dataclasses.replace(told, limit=0.011).good and not bool(told)


def test_pupils_of_the_same_light():
    """The same disc made twice, and not one elsewhere, of another shape, or of half the light."""
    disc = Disc(5e-3)
    assert _same_light(disc, disc) and _same_light(disc, Disc(5e-3))
    elsewhere = Disc(5e-3, center=(0.0, 1e-6, 0.0)), Disc(5e-3, normal=(0.0, 1.0, 9.0))
    for other in (Disc(5.001e-3), Rectangle(1e-2, 1e-2), *elsewhere):
        assert not _same_light(disc, other)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_slabs_begin_and_end_where_the_air_left_out_holds_a_hundredth_radian(sign):
    """Layers of known phase across a window: at either end as many cells are left out as hold LEFT_OUT together.

    Linear between nodes 1 cm apart: a node's phase is 2 pi d n / wavelength, d the differences across the window.
    The first node that brings the sum to LEFT_OUT is looked at with its cell; the window looks up or down.
    """
    wavelength, spacing = 1e-6, 0.01
    phase = np.zeros(41)
    phase[[5, 9, 12]] = 0.6 * LEFT_OUT, 0.6 * LEFT_OUT, 40.0
    phase[[30, 33]] = 5.0, 0.6 * LEFT_OUT
    contrast = np.zeros((5, 5, 41))
    contrast[2:] = phase * wavelength / (2.0 * np.pi * spacing)
    field = IndexField.from_samples(
        contrast, origin=(-0.02, -0.02, 0.0), spacing=(0.01, 0.01, spacing), geometry="volume", interpolation="linear"
    )
    center = np.array([0.0, 0.0, -0.1 if sign > 0.0 else 0.5])
    axes = (np.array([sign, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
    look = LookingAlong(center, np.array([0.0, 0.0, sign]), axes, 0.015)
    slabs = slabs_of(field, look, 0.0, 0.6, wavelength)
    ends = np.sort(center[2] + sign * np.array([slabs.first, slabs.last]))
    assert ends == pytest.approx([0.08, 0.31], abs=1e-12)
    # What a finer count of slabs holds is what one holds, and that is the integral of all layers but those left out.
    x, y = np.array([0.005 * sign]), np.array([0.005])
    whole = slabs.paths(x, y, 1)[0, 0, 0]
    assert slabs.paths(x, y, FINEST).sum() == pytest.approx(whole, rel=1e-3)
    held = (phase[9] + phase[12] + phase[30]) * wavelength / (2.0 * np.pi)
    assert whole == pytest.approx(held, rel=2e-3)


@pytest.mark.parametrize("middle", [100, 101, 103, 250])
def test_the_disturbed_length_of_thin_sheets(middle: int):
    """Two sheets of a node's thickness, which a part of the lines meets, 200 nodes apart, whichever nodes they are at.

    Equal disturbances at both: the even distribution of their standard deviation, half the distance, is root 3 as long.
    """
    contrast = np.zeros((9, 501))
    contrast[4:, [middle, middle + 200]] = 1e-5
    field = IndexField.from_samples(
        contrast, origin=(-4e-3, 0.0), spacing=(1e-3, 1e-3), geometry="planar", interpolation="linear"
    )
    pupil = Rectangle(6e-3, 6e-3, (0.0, 0.0, -0.01))
    found = disturbance(field, pupil, pupil.normal)
    assert found.length == pytest.approx(np.sqrt(3.0) * 0.2, rel=1e-2)
    assert found.until == pytest.approx(0.01 + (middle + 100) * 1e-3 + 0.5 * found.length, rel=1e-2)
