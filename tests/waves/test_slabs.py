"""Slabs of a field that waves and bent rays pass: their integrals, their precision, and what rays gain by bending."""

from itertools import pairwise

import numpy as np
import pytest

from aerokernels import IndexField, Rectangle, Wave, wavefront
from aerokernels.waves.bending import bending
from aerokernels.waves.layers import sample_layers
from aerokernels.waves.slabs import FINEST, LookingAlong, slabs_of
from aerokernels.waves.split_step import plane_wave
from tests.phase_plates import WAVELENGTH, phase_plate
from tests.random_fields import uniform_field


def test_bent_rays_through_layers_are_traced_ones():
    """A lens all along half of a box, then air at rest: OPD to second order in the turn, against the traced wavefront.

    Third order is some 4 % of the second, by the displacement over the lens, which is 0.02 waves here.
    """
    length, half = 0.2, 2e-3
    y, z = np.linspace(-2.0 * half, 2.0 * half, 81), np.linspace(0.0, length, 81)
    along = np.where(z < 0.5 * length, np.sin(2.0 * np.pi * z / length) ** 2, 0.0)
    field = IndexField.from_samples(
        1.2e-5 * np.cos(0.5 * np.pi * y / half)[:, None] * along,
        origin=(y[0], 0.0),
        spacing=(y[1] - y[0], z[1]),
        geometry="planar",
    )
    pupil = Rectangle(2.0 * half, 2.0 * half, (0.0, 0.0, -1e-4))
    light = plane_wave(pupil, WAVELENGTH, 96, 1.5, 1.0)
    layers = sample_layers(field, light, 1e-4, length + 1e-4, 64)
    straight = layers.sum(axis=0, dtype=np.float64)
    more = bending(layers.astype(np.float64), light.pixel, length / 64, 0.0)
    traced = wavefront(field, pupil, wavelength=WAVELENGTH, pixel_count=64, tolerance=1e-4)
    x = light.coordinates[1]
    second = np.interp(traced.coordinate, x, more[:, 48])
    expected = traced.opd[:, 32] - np.interp(traced.coordinate, x, straight[:, 48])
    assert np.ptp(expected) > 0.015 * WAVELENGTH
    assert np.abs(second - expected).max() < 0.06 * np.ptp(expected)


@pytest.mark.parametrize("half", [0.5e-3, 2e-3])
def test_slabs_are_single_precision_beside_the_box_too(half: float):
    """Phases in double precision take the wave ten times as long: windows within the box and wider than it."""
    field = phase_plate(lambda x, y: 2e-7 * (x * x + y * y) / 1e-6, 1e-3)
    look = LookingAlong(
        np.zeros(3), np.array([0.0, 0.0, 1.0]), (np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])), half
    )
    place = np.linspace(-half, half, 32)
    slabs = slabs_of(field, look, 0.0, 2e-3, WAVELENGTH)
    assert [slabs.paths(place, place, count).dtype for count in (1, 2, 4)] == 3 * [np.float32]


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
@pytest.mark.parametrize("interpolation", ["cubic", "linear", "monotone"])
@pytest.mark.parametrize("look", [1.0, -1.0])
def test_slabs_are_integrals_of_the_fields_own_interpolant(geometry: str, interpolation: str, look: float):
    """Along z: two Gauss points to each piece between nodes and slabs, by `contrast_at`, 1e-6 of the greatest path.

    The index is no linear function of the interpolated potential, by the square of the contrast, which is 3e-6 here.
    Less each slab's mean over the window: what all the light has in common is not held.
    """
    field = uniform_field(geometry, interpolation, amplitude=3e-6)
    low, high = field.box
    size = float(np.min(np.where(np.isfinite(high - low), high - low, np.inf)[:2]))
    center = np.array([1e-4, 2e-4, low[2] if look > 0.0 else high[2]])
    wave = Wave(np.ones((2, 2)), 1e-3, WAVELENGTH, center, (0.0, 0.0, look))
    window = LookingAlong(wave.center, wave.normal, wave.axes, 0.3 * size)
    x, y = 0.3 * size * np.linspace(-1.0, 1.0, 4), 0.3 * size * np.linspace(-0.9, 1.0, 5)
    slabs = slabs_of(field, window, 0.0, float(high[2] - low[2]), WAVELENGTH)
    found = slabs.paths(x, y, 4)
    edges = np.linspace(slabs.first, slabs.last, 5)
    depth = np.abs(field.samples.origin[-1] + field.spacing[-1] * np.arange(field.samples.shape[-1]) - center[2])
    across, up = np.meshgrid(x, y)
    points = wave.center + across[..., None] * wave.axes[0] + up[..., None] * wave.axes[1]
    for number, (begin, end) in enumerate(pairwise(edges)):
        knots = np.sort([begin, *depth[(depth > begin) & (depth < end)], end])
        expected = np.zeros(across.shape)
        for middle, half in zip(0.5 * (knots[1:] + knots[:-1]), 0.5 * np.diff(knots), strict=True):
            for place in (-1.0, 1.0):
                at = points + (middle + half * place / np.sqrt(3.0)) * wave.normal
                expected += half * field.contrast_at(at.reshape(-1, 3)).reshape(across.shape)
        apart = (found[number] - found[number].mean()) - (expected - expected.mean())
        assert np.abs(apart).max() < 1e-6 * np.abs(expected).max()
    whole, few = (slabs.paths(x, y, count).sum(axis=0) for count in (FINEST, 4))
    assert np.abs((whole - whole[0, 0]) - (few - few[0, 0])).max() < 1e-6 * np.ptp(whole)
