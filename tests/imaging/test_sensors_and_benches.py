"""A sensor's grey levels, seeds of a bench's two pictures, and what their datasets say."""

import numpy as np
import pytest

from aerokernels import Camera, Disc, DotPattern, IndexField, Sensor, background_displacement, bos, look_map


def test_grey_levels_of_electrons():
    """Brightness times exposure of the full well, dark current on top, rounded to levels; white is 1 at most."""
    sensor = Sensor(1000.0, 0.5, 0.0, 20.0, 4, shot_noise=False)
    assert sensor.levels == 15
    brightness = np.array([0.0, 0.4, 1.0, 1.9, 2.5, -1.0, np.nan])
    electrons = 500.0 * np.maximum(np.nan_to_num(brightness), 0.0) + 20.0
    expected = np.rint(np.minimum(electrons / 1000.0, 1.0) * 15) / 15
    np.testing.assert_allclose(sensor.expose(brightness), expected)
    assert sensor.expose(9.0) == Sensor(read_noise=0.0).expose(9.0) == 1.0
    assert Sensor().expose(0.5).shape == ()
    many = np.full(40_000, 0.6)
    noisy = Sensor(1000.0, 0.5, 7.0, 20.0, 16).expose(many, seed=3) * 1000.0
    assert noisy.mean() == pytest.approx(320.0, abs=0.5) and noisy.var() == pytest.approx(
        320.0 + 49.0, rel=0.03, abs=0.0
    )
    quiet = Sensor(1000.0, 0.5, 7.0, 20.0, 16, shot_noise=False).expose(many, seed=3) * 1000.0
    assert quiet.var() == pytest.approx(49.0, rel=0.03, abs=0.0)
    np.testing.assert_array_equal(Sensor().expose(many, seed=0), Sensor().expose(many))
    assert (Sensor().expose(many, seed=1) != Sensor().expose(many)).any()
    assert Sensor(bits=1).levels == 1 and Sensor(bits=16).levels == 65535
    for bits in (0, 17):
        with pytest.raises(ValueError, match="bits"):
            Sensor(bits=bits)


def lump() -> IndexField:
    y, z = np.linspace(-0.02, 0.02, 21), np.linspace(0.0, 0.04, 21)
    samples = 1e-6 * np.exp(-(y[:, None] ** 2 + (z - 0.02) ** 2) / 0.006**2)
    return IndexField.from_samples(samples, origin=(y[0], 0.0), spacing=(y[1] - y[0], z[1]), geometry="planar")


def test_both_pictures_of_a_bench_have_noise_of_their_own():
    """Seeds 2 s and 2 s + 1."""
    camera = Camera(Disc(1e-3, (0.0, 0.0, -0.1)), 0.05, 2e-5, (6, 7), distance=0.5)
    options = {"aperture_rays": 1, "allow_truncation": True}
    sensor = Sensor()
    plain = bos(lump(), camera, DotPattern(), **options)
    noisy = bos(lump(), camera, DotPattern(), sensor=sensor, seed=3, **options)
    np.testing.assert_array_equal(noisy.reference, sensor.expose(plain.reference, seed=6))
    np.testing.assert_array_equal(noisy.picture, sensor.expose(plain.picture, seed=7))
    data = plain.traced.to_xarray()
    np.testing.assert_allclose(data.x, np.arange(7) - 3.0)
    np.testing.assert_allclose(data.y, np.arange(6) - 2.5)
    assert data.attrs["pixel_tangent"] == camera.pixel_tangent and data.attrs["scene_pixel_m"] == camera.scene_pixel
    alone = background_displacement(lump(), camera, **options)
    np.testing.assert_array_equal(alone.shift, -alone.displacement)


def test_a_direction_that_does_not_look_through_the_flow_sees_nothing():
    """Its Strehl ratio is 1; a single snapshot of a ball ahead."""
    x = np.linspace(-0.02, 0.02, 9)
    ball = 1e-6 * np.exp(-(x[:, None, None] ** 2 + x[:, None] ** 2 + x**2) / 0.008**2)
    field = IndexField.from_samples(ball, origin=(-0.02, -0.02, 0.08), spacing=(5e-3,) * 3, geometry="volume")
    found = look_map(field, np.radians([0.0, 80.0]), np.radians([0.0, 60.0]), Disc(5e-3), ray_count=64)
    assert float(found.strehl[0, 0]) < 1.0 and float(found.opd_rms[0, 0]) > 0.0
    np.testing.assert_array_equal(found.strehl.values.ravel()[1:], 1.0)
    np.testing.assert_array_equal(found.opd_rms.values.ravel()[1:], 0.0)
    np.testing.assert_array_equal(found.boresight.values.ravel()[1:], 0.0)
    assert (found.known.values.ravel()[1:] == 1.0).all() and (found.blocked == 0.0).all()
