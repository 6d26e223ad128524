"""Optical paths from a scene to a camera's pupil, against rays that are aimed until they meet the scene's point."""

import functools
import math
import warnings

import numpy as np
import pytest

from aerokernels import Camera, Disc, IndexField, Plane, RayBundle, image_through, trace
from aerokernels.imaging.spreads import defocus_paths, node_paths
from tests.slow import first_of

OPTIONS = {"precision": "float64", "tolerance": 1e-5, "backend": "reference"}
TANGENT, Q = np.array([[0.1, 0.3], [-0.2, 0.05]]), np.array([[4e-3, -3e-3], [-2e-3, 5e-3]])


def prism() -> IndexField:
    """Air that turns light upward by 2e-4 rad or so, unevenly, in a slab before the camera."""
    y, z = np.linspace(-0.1, 0.1, 41), np.linspace(0.0, 0.1, 21)
    samples = (2e-3 * y[:, None] + 1e-2 * y[:, None] ** 2) * np.sin(np.pi * z / 0.1) ** 2
    return IndexField.from_samples(
        samples, origin=(y[0], 0.0), spacing=(y[1] - y[0], z[1]), geometry="planar", ambient_index=1.2
    )


def traced(field: IndexField, start: np.ndarray, way: np.ndarray, plane: Plane):
    """End, final direction and optical path of a ray from a point to a plane."""
    found = trace(
        field, RayBundle(start[None], way[None]), until=plane, outputs=("opd", "position", "direction"), **OPTIONS
    )
    length = float((plane.point - start) @ plane.normal) / float(way @ plane.normal)
    return found.position[0], found.direction[0], float(found.opd[0]) + 1.2 * length


@functools.cache
def from_near_points() -> np.ndarray:
    """Optical path [m] from points 0.6 m ahead of the pupil to places of it, less that without air, by single rays.

    A ray that begins in a place of the pupil is aimed until it ends in the point: it misses that by more than 30 um if
    it starts straight toward it. Shape (points, places).
    """
    field, plane = prism(), Plane(np.array([0.0, 0.0, 0.59]), np.array([0.0, 0.0, 1.0]))
    found = np.empty((len(TANGENT), len(Q)))
    for i, tangent in enumerate(TANGENT):
        point = np.array([0.0, 0.0, -0.01]) + 0.6 * np.array([*tangent, 1.0])
        for j, q in enumerate(Q):
            start = np.array([*q, -0.01])
            aim = point.copy()
            for _ in range(3):
                way = (aim - start) / np.linalg.norm(aim - start)
                end, _, path = traced(field, start, way, plane)
                aim = aim + point - end
            found[i, j] = path - 1.2 * np.linalg.norm(point - start)
            moved = traced(field, start, (point - start) / np.linalg.norm(point - start), plane)[0] - point
            assert np.linalg.norm(moved) > 3e-5
    return found


@pytest.mark.parametrize("focus", first_of([2.0, None]))
def test_paths_from_a_near_point(focus: float | None):
    """What light from the point takes to a place of the pupil, less what it takes without air, to third order."""
    camera = Camera(Disc(6e-3, (0.0, 0.0, -0.01)), 0.1, 1e-5, 8, distance=0.6, focus=focus)
    found, arrived = node_paths(prism(), camera, TANGENT, Q, OPTIONS)
    assert (arrived == 1.0).all()
    assert found - 1.2 * defocus_paths(camera, TANGENT, Q) == pytest.approx(from_near_points(), abs=2e-9)


def test_paths_from_a_far_point():
    """A plane wave of the node's direction: to a place of the pupil, less what it takes without air."""
    field, camera = prism(), Camera(Disc(6e-3, (0.0, 0.0, -0.01)), 0.1, 1e-5, 8)
    found, arrived = node_paths(field, camera, TANGENT, Q, OPTIONS)
    assert (arrived == 1.0).all()
    plane = Plane(np.array([0.0, 0.0, 0.11]), np.array([0.0, 0.0, 1.0]))
    for i, tangent in enumerate(TANGENT):
        way = np.array([*tangent, 1.0]) / math.sqrt(1.0 + tangent @ tangent)
        for j, q in enumerate(Q):
            start, aim = np.array([*q, -0.01]), way.copy()
            for _ in range(6):
                end, last, path = traced(field, start, aim, plane)
                aim = aim + way - last
                aim /= np.linalg.norm(aim)
            # The wave reaches the ray's end later than the pupil's place by the way between them along its direction.
            expected = path - 1.2 * float((end - start) @ way)
            assert found[i, j] == pytest.approx(expected, abs=5e-9)


def test_a_picture_in_water_is_the_one_in_air_with_the_wavelength_in_water():
    """Indices and the wavelength times 1.33: all paths are as many waves, and rays and diffraction have equal angles.

    The flow turns light by 2e-4 rad, 2 pixels, and a point of the scene spreads over some pixels.
    """
    x, z = np.linspace(-5e-3, 5e-3, 31), np.linspace(0.0, 1e-2, 31)
    parts = np.meshgrid((x - 1e-3) / 2e-3, x / 2e-3, (z - 5e-3) / 1e-3, indexing="ij")
    contrast = 2e-4 * np.exp(-0.5 * sum(part**2 for part in parts))
    scene = np.zeros((24, 24))
    scene[12, 12] = scene[5, 18] = 1.0
    camera = Camera(Disc(2e-3, center=(0.0, 0.0, -0.5)), 0.1, 10e-6, distance=1.0)
    seen = []
    for ambient in (1.0, 1.33):
        field = IndexField.from_samples(
            ambient * contrast,
            origin=(x[0], x[0], 0.0),
            spacing=(x[1] - x[0], x[1] - x[0], z[1]),
            geometry="volume",
            ambient_index=ambient,
        )
        options = {"psf_nodes": 3, "psf_pixels": 12, "pupil_pixels": 24, "aperture_rays": 1}
        seen.append(image_through(field, scene, camera, wavelength=ambient * 532e-9, **options))
    assert np.abs(seen[0].displacement).max() > 0.5
    assert seen[1].image == pytest.approx(seen[0].image, abs=1e-5 * seen[0].image.max())
    assert seen[1].reference == pytest.approx(seen[0].reference, abs=1e-12)


def test_pictures_along_the_span_of_a_planar_field_are_those_of_the_same_air_in_a_wide_volume():
    """Set-up: a blob in y and z near the far face, seen at 45 degrees to the span by a camera focused at infinity.

    Expected: the same point spread function; the rays of a planar field stopped inside the air, 0.06 of the light off.
    Tolerance: the volume repeats the planar samples, so that both have one interpolant: traces are within 1e-3 wave.
    """
    spacing, counts = 5e-4, (49, 65)
    y, z = ((np.arange(count) - count // 2) * spacing for count in counts)
    across, along = np.meshgrid(y, z, indexing="ij")
    rest = np.clip((12e-3 - abs(across)) / 2e-3, 0.0, 1.0) * np.clip((16e-3 - abs(along)) / 1e-3, 0.0, 1.0)
    blob = 3e-5 * np.exp(-((across / 4e-3) ** 2 + ((along - 12e-3) / 3e-3) ** 2)) * rest**2 * (3.0 - 2.0 * rest)
    flat = IndexField.from_samples(blob, origin=[y[0], z[0]], spacing=[spacing] * 2, geometry="planar")
    wide = {"origin": [-0.06, y[0], z[0]], "spacing": [1.5e-3, spacing, spacing], "geometry": "volume"}
    volume = IndexField.from_samples(np.repeat(blob[None], 81, axis=0), **wide)
    look = np.array([1.0, 0.2, 1.0]) / np.sqrt(2.04)
    camera = Camera(Disc(6e-3, -0.03 * look, look), focal_length=1.0, pixel=905e-9 / 24e-3, pixel_count=9)
    scene = np.zeros((9, 9))
    scene[4, 4] = 1.0
    options = {"psf_nodes": 1, "psf_pixels": 9, "backend": "opencl", "allow_truncation": True}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found, true = (image_through(field, scene, camera, **options).image for field in (flat, volume))
    np.testing.assert_allclose(found, true, atol=2.0 * np.pi * 2e-3 * true.max())
