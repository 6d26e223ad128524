"""Contrasts, lengths and ambient indices over many decades: relative accuracy must not depend on the size of things."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.plan import RAY_OUTPUTS

from .checks import PRECISIONS, UNIT, UP, WAVE, keeps_promises, linear_square_field

# Outputs that are lengths, and so grow with the scene.
LENGTHS = ("position", "optical_path", "opd", "arc_length", "step_error")


def bump(contrast: float, scale: float = 1.0, ambient: float = 1.0, geometry: str = "planar") -> IndexField:
    """A Gaussian of `contrast`, 4 cells wide, off the middle of a box of 24 by 32 cells of 1/16 scale."""
    cell = scale / 16.0
    low = 0.0 if geometry == "axisymmetric" else -12.0
    across, along = np.meshgrid(np.arange(25) + low, np.arange(33) - 14.0, indexing="ij")
    samples = contrast * np.exp(-((across - 1.0) ** 2 + along**2) / 32.0)
    return IndexField.from_samples(
        samples, origin=(low * cell, 0.0), spacing=(cell, cell), geometry=geometry, ambient_index=ambient
    )


def fan(scale: float = 1.0) -> RayBundle:
    """Five rays along z and two aslant, from ahead of the box of `bump`."""
    height = scale * np.array([-0.4, -0.1, 0.0, 0.15, 0.5, 0.1, -0.2])
    direction = np.array([UP] * 5 + [(0.1, 0.2, 1.0), (-0.05, -0.1, 1.0)])
    return RayBundle(np.c_[0.0 * height, height, np.full(7, -0.25 * scale)], direction)


def error_asked(power: int) -> tuple[dict[str, float], dict[str, float]]:
    """Wavelength and tolerance whose product, the error asked for in metres, is 2^power times greater in the second.

    All factors are powers of two, so the products are exact. The wavelength takes what its range of 0.1 to 24 um lets
    it, the tolerance the rest, below a quarter of a wave: from a third on a tolerance counts as a third.
    """
    by_wavelength = min(max(power, -3), 4)
    rest = power - by_wavelength
    tolerance = min(1e-2, 0.25 * 2.0**-rest)
    return (
        {"wavelength": WAVE, "tolerance": tolerance},
        {"wavelength": WAVE * 2.0**by_wavelength, "tolerance": tolerance * 2.0**rest},
    )


@pytest.mark.parametrize("precision", PRECISIONS)
@given(decade=st.floats(-12.0, 0.0))
@example(decade=-12.0)
@example(decade=0.0)
@settings(max_examples=25, deadline=None)
def test_relative_accuracy_is_the_same_at_every_contrast(precision, decade):
    """Set-up: n^2 = 1 + g y with g = 3 x 10^decade, contrast up to 10^decade, a ray along z at y = 1/2 over 1/2 m.

    Formula: y = y0 + g sigma^2 / 4 with sigma = z / n0, direction y : z = g sigma / 2 : n0, optical path
    n0^2 sigma + g^2 sigma^3 / 12 (int n^2), undisturbed path z. Without cancellation:
    OPD = z (n0 - 1) + g^2 sigma^3 / 12. Errors: the scheme is exact on a parabola, so what is left is rounding: of the
    samples (8 cells from y = 0, a slope of samples that are each off by a few units is off by some 8 times that) and
    of 16 steps. Tolerance: 128 units, relative, of OPD, of the sideways direction and of the sideways shift; the
    shift comes as a difference of float64 positions, and keeps one rounding of these.
    """
    gradient = 3.0 * 10.0**decade
    rays = RayBundle([[0.0, 0.5, 0.0]], [UP])
    length = 0.5
    settings_ = {"until": Plane((0, 0, length), UP), "method": "fixed", "step": 1.0 / 32.0}
    result = keeps_promises(trace(linear_square_field(gradient), rays, precision=precision, **settings_), 1)
    square = 1.0 + 0.5 * gradient
    index = np.sqrt(square)
    sigma = length / index
    excess = 0.5 * gradient / (index + 1.0)
    opd = length * excess + gradient**2 * sigma**3 / 12.0
    slope = 0.5 * gradient * sigma
    turn = slope / np.hypot(slope, index)
    shift = 0.25 * gradient * sigma**2
    allowed = 128.0 * UNIT[precision]
    assert result.ok[0]
    assert abs(result.opd[0] / opd - 1.0) < allowed
    assert abs(result.direction[0, 1] / turn - 1.0) < allowed
    assert abs(result.position[0, 1] - 0.5 - shift) < allowed * shift + 2.0**-53


@pytest.mark.parametrize("geometry", ["planar", "axisymmetric"])
@pytest.mark.parametrize("precision", PRECISIONS)
@given(power=st.integers(-20, 20))
@example(power=-20)
@example(power=20)
@settings(max_examples=12, deadline=None)
def test_a_scene_scaled_by_a_power_of_two_is_the_same_to_the_last_bit(precision, geometry, power):
    """Lengths and the error asked for times 2^k, k in +-20 (1e-6 to 1e6 m): every product scales without rounding.

    So lengths scale exactly and directions, steps and statuses stay. Holds only if the kernel has no length built in.
    """
    scale = 2.0**power
    asked, asked_scaled = error_asked(power)
    for contrast in (3e-4, 1e-9):
        settings_ = {"method": "adaptive", "precision": precision}
        unit = trace(bump(contrast, geometry=geometry), fan(), until=Plane((0, 0, 3.0), UP), **settings_, **asked)
        scaled = trace(
            bump(contrast, scale, geometry=geometry),
            fan(scale),
            until=Plane((0, 0, 3.0 * scale), UP),
            **settings_,
            **asked_scaled,
        )
        keeps_promises(scaled, 7)
        for name in RAY_OUTPUTS:
            factor = scale if name in LENGTHS else 1.0
            assert np.array_equal(getattr(scaled, name), getattr(unit, name) * factor), name
        assert np.array_equal(scaled.status, unit.status)
