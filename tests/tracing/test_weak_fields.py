"""Fields far weaker than the tolerance keep their optical path differences: a contrast of 2^-30 survives the chain."""

import numpy as np
import pytest

from aerokernels.focus.estimate import estimate_strehl
from aerokernels.medium import IndexField
from aerokernels.rays import Disc, RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.error_limit import SHARE, error_limit, greatest_path

from .backends import ENGINES, WAVE, on

WIDTH, CELL = 1e-3, 1.25e-4
DIRECTION = np.array([0.03, 0.01, 1.0]) / np.linalg.norm([0.03, 0.01, 1.0])
# Across the rays: at a slant the ray's deflection would count in first order, too.
FAR = Plane((0.0, 0.0, 20e-3), DIRECTION)


def blob(contrast: float, geometry: str = "volume") -> IndexField:
    """A Gaussian ball about (0, 0, 5 mm) in a box of 6 x 6 x 10 mm, a rod along x in a planar field."""
    z, y = np.arange(81) * CELL, np.arange(-24, 25) * CELL
    if geometry == "axisymmetric":
        y = np.arange(25) * CELL
    axes = [y, y, z] if geometry == "volume" else [y, z]
    square = sum(part**2 for part in np.meshgrid(*axes[:-1], z - 5e-3, indexing="ij"))
    origin = [axis[0] for axis in axes]
    samples = contrast * np.exp(-square / WIDTH**2)
    return IndexField.from_samples(samples, origin=origin, spacing=[CELL] * len(axes), geometry=geometry)


def rays_through(count: int) -> tuple[RayBundle, np.ndarray]:
    """Rays that pass the blob's middle at up to 1.1 mm, and how far they do [m] across the rod and from the middle."""
    rng = np.random.default_rng(4)
    middle = np.c_[rng.uniform(-0.8e-3, 0.8e-3, (count, 2)), np.full(count, 5e-3)]
    return RayBundle(middle - 6e-3 * DIRECTION, DIRECTION), middle


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("count", [300, 4200])
@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_a_contrast_of_2_to_the_minus_30_survives(engine, precision, count, geometry):
    """OPD = contrast WIDTH sqrt(pi) exp(-b^2 / WIDTH^2), b the distance from the middle; 1e-3 of the greatest is held.

    Along a straight line, which is exact to the second order of the contrast; the spline, at 8 cells a WIDTH, is right
    to 1e-5 of it. In a planar field b and the way are those in the plane of y and z.
    """
    contrast = 2.0**-30
    rays, middle = rays_through(count)
    result = trace(blob(contrast, geometry), rays, until=FAR, precision=precision, **on(engine))
    d, c = rays.direction[0], middle - [0.0, 0.0, 5e-3]
    if geometry == "planar":
        d, c = d[1:], c[:, 1:]
    speed = np.linalg.norm(d)
    square = (c**2).sum(axis=1) - (c @ d / speed) ** 2
    expected = contrast * WIDTH * np.sqrt(np.pi) / speed * np.exp(-square / WIDTH**2)
    assert result.ok.all()
    assert np.abs(result.opd - expected).max() < 1e-3 * expected.max()


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("geometry", ["volume", "axisymmetric"])
def test_a_pupil_sees_it_too(engine, geometry):
    """OPD over a pupil is linear in so small a contrast: 2^-30 and 2^-22 differ by 2^8, to 1e-3."""
    pupil = Disc(1e-3, center=(0.0, 0.0, -1e-3))
    weak, strong = (
        estimate_strehl(blob(contrast, geometry), pupil, ray_count=6000, seed=3, symmetry=False, **on(engine)).opd_rms
        for contrast in (2.0**-30, 2.0**-22)
    )
    assert strong / weak == pytest.approx(2.0**8, rel=1e-3)
    assert weak > 1e-13


def test_only_weak_fields_are_held_to_less_than_the_tolerance():
    """Greatest path of the blob: contrast WIDTH sqrt(pi); a field of more than SHARE of it keeps the tolerance."""
    tolerance = 1e-3 * WAVE
    strong, weak = blob(1e-3), blob(1e-6)
    assert greatest_path(strong) == pytest.approx(1e-3 * WIDTH * np.sqrt(np.pi), rel=1e-3)
    assert error_limit(strong, tolerance) == tolerance
    assert error_limit(weak, tolerance) == pytest.approx(SHARE * greatest_path(weak))
    assert error_limit(blob(0.0), tolerance) == tolerance
