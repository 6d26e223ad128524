"""The pieces of a picture through a flow: nodes, defocus, kernels of point spread functions."""

import numpy as np
import pytest

from aerokernels import Camera, Disc
from aerokernels.imaging.spreads import SpreadGrid, defocus_paths, mixed, nodes_along, pixel_spreads


def test_nodes_reach_from_edge_to_edge():
    """Evenly over the pixels, rounded, none twice; the middle one where there is one."""
    assert nodes_along(10, 4).tolist() == [0, 3, 6, 9]
    assert nodes_along(3, 9).tolist() == [0, 1, 2]
    assert nodes_along(8, 1).tolist() == [3] and nodes_along(1, 5).tolist() == [0]


@pytest.mark.parametrize(("distance", "focus"), [(1.5, 2.5), (np.inf, 2.0), (3.0, np.inf), (2.0, 2.0), (np.inf, None)])
def test_defocus_is_the_difference_of_two_paths(distance, focus):
    """From a point of the scene to a point q of the pupil, less from the point in focus, both less those to its middle.

    Points at tangents t stand at (t, 1) times the distance; a far one sends a plane wave along -(t, 1). Differences
    of paths of metres: 1e-15 m.
    """
    camera = Camera(Disc(0.01), 0.1, 5e-6, 32, distance=distance, focus=focus)
    tangent = np.array([[0.0, 0.0], [0.05, -0.02], [-0.2, 0.1]])
    q = np.array([[0.0, 0.0], [3e-3, -4e-3], [-9e-3, 1e-3]])
    places = np.insert(q, 2, 0.0, axis=1)

    def path(far: float) -> np.ndarray:
        toward = np.insert(tangent, 2, 1.0, axis=1)
        if np.isfinite(far):
            points = far * toward
            return np.linalg.norm(points[:, None] - places, axis=2) - np.linalg.norm(points, axis=1)[:, None]
        return -(toward / np.linalg.norm(toward, axis=1)[:, None]) @ places.T

    expected = path(distance) - path(distance if focus is None else focus)
    np.testing.assert_allclose(defocus_paths(camera, tangent, q), expected, atol=2e-15)


def test_light_of_two_wavelengths_is_mixed_by_its_weights():
    """Kernels and the shares they hold, weighted; of one wavelength nothing is changed."""
    place = np.array([0, 4])
    first, second = (
        SpreadGrid(place, place, np.full((2, 2, 3, 3), value), np.zeros((2, 2, 2), int), np.full((2, 2), kept))
        for value, kept in ((0.1, 0.9), (0.3, 0.5))
    )
    found = mixed((first, second), np.array([0.25, 0.75]))
    assert found.kernel == pytest.approx(0.25) and found.kept == pytest.approx(0.6)
    assert mixed((second,), np.array([1.0])) is second


def test_a_dark_pupil_keeps_light_in_its_pixel():
    """Where no ray arrives the kernel is the pixel alone, and holds all."""
    camera = Camera(Disc(2e-3), 0.1, 1.2e-5, 32)
    wave = np.zeros((2, 7, 7), dtype=complex)
    wave[1, 3, 3] = 1.0
    kernel, kept = pixel_spreads(wave, 4e-3 / 7, np.zeros((2, 2)), np.zeros((2, 2)), camera, 532e-9, 5)
    assert kernel[0, 2, 2] == 1.0 and kernel[0].sum() == 1.0 and kept[0] == 1.0
    # One pixel of the pupil is seen as wide: even over the pixels held, and those are a part of its light.
    assert kernel[1] == pytest.approx(1.0 / 25.0, rel=1e-12)
    scale = camera.pixel_tangent * 4e-3 / 7 / 532e-9
    assert kept[1] == pytest.approx(25.0 * scale**2, rel=1e-12)


def test_a_kernel_is_no_wider_than_the_transform_repeats_itself():
    """Of pupil pixels of 0.4 of the wavelength over the camera's angle a kernel holds two pixels, and no more."""
    camera = Camera(Disc(2e-3), 0.1, 1.2e-5, 32)
    step = 532e-9 / camera.pixel_tangent / 2.5
    kernel, _ = pixel_spreads(np.ones((1, 3, 3), complex), step, np.zeros((1, 2)), np.zeros((1, 2)), camera, 532e-9, 6)
    rows, columns = np.nonzero(kernel[0])
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (2, 3, 2, 3)
    assert kernel.sum() == pytest.approx(1.0, rel=1e-12)
