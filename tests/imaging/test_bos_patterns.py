"""What a BOS camera sees of a pattern: the mean over its pixels and over its aperture, each with its error."""

import numpy as np
import pytest

from aerokernels import Camera, Disc, IndexField, Polygon, Rectangle, background_displacement


@pytest.mark.parametrize("shape", [Disc, Rectangle, Polygon], ids=lambda shape: shape.__name__)
def test_the_error_told_holds_the_points_of_the_aperture(shape):
    """A blob of 4 mm close to an aperture of as much, out of focus: against a mean over 40 of its points."""
    axis = np.linspace(-0.015, 0.015, 31)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    window = np.prod([np.cos(np.pi * one / 0.03) ** 2 for one in (x, y, z)], axis=0)
    blob = 5e-5 * window * np.exp(-((x - 1e-3) ** 2 + (y + 5e-4) ** 2 + z**2) / (2.0 * (4e-3) ** 2))
    field = IndexField.from_samples(blob, origin=[-0.015] * 3, spacing=[1e-3] * 3, geometry="volume")
    numbers = {
        Disc: (5e-3,),
        Rectangle: (9e-3, 6e-3),
        Polygon: (np.array([[-5e-3, -4e-3], [4e-3, -2e-3], [0.0, 5e-3]]),),
    }[shape]
    pupil = shape(*numbers, center=(0.0, 0.0, -0.2))
    camera = Camera(pupil, focal_length=0.03, pixel=2e-5, pixel_count=(7, 9), distance=0.7, focus=0.5)
    found = background_displacement(field, camera, tolerance=1e-4)
    fine = background_displacement(field, camera, tolerance=1e-4, aperture_rays=40)
    off = np.linalg.norm(found.displacement - fine.displacement, axis=-1)
    assert off.max() > 1e-5 and (off <= found.error).all() and found.error.max() < 10.0 * off.max() + 1e-3
    middle = background_displacement(field, camera, tolerance=1e-4, aperture_rays=1)
    assert middle.error.max() < found.error.max()


def lump(contrast: float, width: float) -> IndexField:
    """A Gaussian lump of air of this width [m] on the axis, on cells of 0.125 mm."""
    r, z = np.linspace(0.0, 0.03, 241), np.linspace(-0.03, 0.03, 481)
    made = contrast * np.exp(-(r[:, None] ** 2 + z**2) / width**2)
    return IndexField.from_samples(made, origin=(0.0, -0.03), spacing=(r[1], z[1] - z[0]), geometry="axisymmetric")


def test_the_error_told_holds_the_rounding_of_rays():
    """A lump on 64 cells over its width, whose grid is exact to 1e-9: tight steps in double precision differ.

    Single precision is off by 2e-6 of the displacement: only the grid was in the told error, a sixth of that.
    """
    field = lump(1e-4, 0.008)
    pupil = Disc(1e-3, center=(-1.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0))
    camera = Camera(pupil, focal_length=0.1, pixel=3e-4, pixel_count=(8, 8), distance=2.0)
    seen = background_displacement(field, camera, aperture_rays=1)
    exact = background_displacement(field, camera, aperture_rays=1, tolerance=1e-5, precision="float64")
    off = np.linalg.norm(seen.displacement - exact.displacement, axis=-1)
    assert off.max() > 1e-8 and (off <= seen.error).all()
    assert seen.error.max() < 1e-4 * np.abs(exact.displacement).max()


@pytest.mark.slow
def test_the_error_of_a_blur_holds_the_rounding_of_rays_in_every_pixel():
    """A weaker lump seen by 16 points: rounding changes some rays' distances from their mean and hardly the blur.

    The errors are then of 1e-9 pixels, and covered in four of five pixels; twice what is told covers 19 of 20.
    Truth: 36 points, double precision, tolerance 1e-5.
    """
    field = lump(2e-6, 0.0045)
    pupil = Disc(1.5e-3, center=(-1.0, 0.0, 0.0), normal=(1.0, 0.0, 0.0))
    camera = Camera(pupil, focal_length=0.1, pixel=1e-4, pixel_count=(16, 16), focus=2.0)
    seen = background_displacement(field, camera, aperture_rays=16, tolerance=2e-4)
    exact = background_displacement(field, camera, aperture_rays=36, tolerance=1e-5, precision="float64")
    off = np.abs(seen.blur - exact.blur)
    assert off.max() > 1e-10 and np.quantile(off / seen.blur_error, 0.95) < 2.5 and (off <= 6.0 * seen.blur_error).all()
    assert seen.blur_error.max() < 1e-4 * exact.blur.max()


@pytest.mark.parametrize("finer", [4.0, 3.3, 1.6])
def test_a_pixel_sees_the_mean_of_a_fine_pattern(finer: float):
    """Squares of a random pattern, `finer` to a pixel: a pixel's brightness is their mean over its area, exactly.

    The mean by areas of overlap along either axis; beyond its border the pattern goes on as there.
    """
    from aerokernels.imaging.bos import Background

    squares = np.random.default_rng(5).integers(0, 2, (60, 70)).astype(float)
    camera = Camera(Disc(1e-3), focal_length=0.05, pixel=1e-5, pixel_count=(10, 12), distance=1.0)
    background = Background.of_scene(squares, camera.scene_pixel / finer, camera)
    row, column = np.random.default_rng(6).uniform(-15.0, 15.0, (2, 40))
    found = background.seen(background.prepared(), row, column)
    wide = np.pad(squares, 60, mode="edge")
    for index in range(40):
        shares = []
        for place, count in ((row[index], 60), (column[index], 70)):
            middle, edges = place * finer + 0.5 * count + 60.0, np.arange(count + 121)
            low, high = middle - 0.5 * finer, middle + 0.5 * finer
            shares.append(np.clip(np.minimum(edges[1:], high) - np.maximum(edges[:-1], low), 0.0, None) / finer)
        assert found[index] == pytest.approx(shares[0] @ wide @ shares[1], abs=1e-9)


def test_hard_edges_do_not_overshoot():
    """A checkerboard of the camera's own pixels, displaced by parts of them, stays within black and white."""
    from aerokernels.imaging.bos import Background

    board = np.indices((20, 20)).sum(axis=0) % 2.0
    camera = Camera(Disc(1e-3), focal_length=0.05, pixel=1e-5, pixel_count=20, distance=1.0)
    background = Background.of_scene(board, camera.scene_pixel, camera)
    place = np.linspace(-12.0, 12.0, 301)
    found = background.seen(background.prepared(), place, place + 0.3)
    assert found.min() >= 0.0 and found.max() <= 1.0 and np.ptp(found) > 0.5
