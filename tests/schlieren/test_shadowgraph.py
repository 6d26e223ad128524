"""Shadowgraphs against exact maps: light is conserved, lenses focus, and a blob's irradiance is its Jacobian."""

import numpy as np
import pytest

from aerokernels.benches import line_of_sight, shadowgraph
from aerokernels.medium import Body, IndexField

WIDTH = 0.02


def planar(contrast, reach: float = 0.02, spacing: float = 2.5e-4) -> IndexField:
    line = np.arange(-reach, reach + 0.5 * spacing, spacing)
    y, z = np.meshgrid(line, line, indexing="ij")
    return IndexField.from_samples(contrast(y, z), origin=[-reach] * 2, spacing=[spacing] * 2, geometry="planar")


def test_a_lens_squeezes_light_evenly():
    """Contrast -a z^2 / 2 over 20 mm bends by -a W z: on a screen at L the light is denser by 1 / (1 - a W L).

    Set-up: a W L = 0.2 and -0.2, a L W small against 1 in the flow itself (W / L = 0.02).
    Error sources: bending within the lens, relative a W^2 / 24 = 1e-6 of the place; focal plane in the middle of it.
    Tolerance 1e-3; the picture's border is left out: light from beside it is taken to be shifted as at the border.
    """
    for sign in (1.0, -1.0):
        a, distance = sign * 0.2 / WIDTH, 1.0
        image = shadowgraph(
            planar(lambda y, z, a=a: -0.5 * a * z**2, spacing=1e-3), distance=distance, width=WIDTH, pixel_count=40,
            tolerance=1e-4,
        )  # fmt: skip
        expected = 1.0 / (1.0 - a * WIDTH * distance)
        np.testing.assert_allclose(image.irradiance[8:-8, 8:-8], expected, rtol=1e-3)
        assert image.intensity[20, 20] == pytest.approx(0.5 * expected, rel=1e-3)


def test_a_blob_is_the_jacobian_of_its_map():
    """Contrast M exp(-(y^2 + z^2) / s^2) over 20 mm; landing p = q + L W grad m: irradiance at p is 1 / det(dp / dq).

    The exact irradiance comes from the map solved for q at each pixel by fixed-point iteration.
    Error sources: averages over the light's lattice and pixel against point values, (pitch / s)^2 / 10 = 1e-3 of the
    modulation; the spline's slope 1e-3; the bending in the flow, W / (2 L) of second order: 1 % of modulation^2.
    Tolerance: 1 % of the undisturbed light; the modulation is 40 %.
    """
    peak, size, distance = 1e-6, 4e-3, 0.2 * 1e3 * (4e-3) ** 2
    strength = peak * WIDTH / size**2  # second derivative of the OPD / 2
    distance = 0.1 / strength
    image = shadowgraph(
        planar(lambda y, z: peak * np.exp(-(y**2 + z**2) / size**2)), distance=distance, width=WIDTH,
        extent=(-0.012, 0.012, -0.012, 0.012), pixel_count=96, tolerance=1e-4,
    )  # fmt: skip
    place = np.stack(np.meshgrid(image.horizontal, image.vertical), axis=-1)

    def shift(q):
        opd = peak * WIDTH * np.exp(-np.sum(q**2, axis=-1) / size**2)
        return -2.0 * distance / size**2 * opd[..., None] * q

    source = place.copy()
    for _ in range(60):
        source = place - shift(source)
    square = np.sum(source**2, axis=-1) / size**2
    bend = -0.2 * np.exp(-square)  # shift = bend q
    exact = 1.0 / ((1.0 + bend) * (1.0 + bend * (1.0 - 2.0 * square)))
    assert np.ptp(exact) > 0.4
    assert np.abs(image.irradiance - exact).max() < 0.01


def test_light_is_conserved_across_a_caustic():
    """The blob far beyond its focus: rays have crossed, and the light that fell on the middle is all still there.

    Expected: total irradiance over the picture equals the pixels' number within 1e-9: nothing is bent at the border,
    every square between rays lands within the picture, however it is folded.
    """
    field = planar(lambda y, z: 1e-6 * np.exp(-(y**2 + z**2) / 0.004**2))
    light = line_of_sight(field, width=WIDTH, pixel_count=80, extent=(-0.018, 0.018, -0.018, 0.018))
    for distance in (0.0, 200.0, 400.0, 1500.0):
        image = shadowgraph(light, distance=distance)
        assert image.irradiance.sum() == pytest.approx(image.irradiance.size, rel=1e-6)
    assert shadowgraph(light, distance=400.0).irradiance.max() > 3.0


def test_a_screen_in_the_focal_plane_shows_nothing():
    """Drawn back to the middle of a flow that is even about it, every ray stands where it would have been."""
    light = line_of_sight(planar(lambda y, z: 1e-5 * np.exp(-(y**2 + z**2) / 0.004**2)), width=WIDTH, pixel_count=40)
    np.testing.assert_allclose(shadowgraph(light, distance=0.0).irradiance, 1.0, atol=1e-4)
    assert np.nanmax(np.abs(light.displacement)) < 1e-9


def test_the_body_casts_a_shadow_and_a_wide_source_blurs_it():
    """A cylinder of 5 mm radius (along x, planar); a source of 2 mrad at 1 m blurs its edge over 2 mm.

    Without a source angle the edge is a pixel of 0.5 mm wide.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    field = planar(lambda y, z: np.zeros_like(y), spacing=1e-3)
    body = Body(0.005 * np.stack([np.sin(angle), np.cos(angle)], axis=1), "planar")
    field = IndexField.from_samples(
        field.samples.samples, origin=[-0.02] * 2, spacing=[1e-3] * 2, geometry="planar", body=body
    )
    light = line_of_sight(field, width=WIDTH, pixel_count=80)
    distance = np.hypot(*np.meshgrid(light.window.horizontal, light.window.vertical))
    sharp, soft = (shadowgraph(light, distance=1.0, source_angle=a).irradiance for a in (0.0, 2e-3))
    assert sharp[distance < 0.0042].max() == 0.0 and sharp[distance > 0.0062].min() > 0.99
    assert 0.05 < soft[np.abs(distance - 0.0046) < 1e-4].mean() < 0.5
    assert soft[distance > 0.0075].min() > 0.99
    assert soft.sum() == pytest.approx(sharp.sum(), rel=1e-9)


def test_the_bench_says_which_shape_blurs():
    """A lens of air, round, through benches of one angle: a slit blurs its peak least and a square most."""
    from aerokernels.benches import Bench

    field = planar(lambda y, z: 5e-6 * np.exp(-(y**2 + z**2) / 0.002**2), spacing=5e-4)
    options = {"distance": 0.5, "width": WIDTH, "pixel_count": 40}
    shapes = ("slit", "disc", "square")
    found = {shape: shadowgraph(field, bench=Bench(4e-3, 1.0, source=shape), **options) for shape in shapes}
    plain = shadowgraph(field, source_angle=4e-3, **options)
    np.testing.assert_array_equal(found["disc"].irradiance, plain.irradiance)
    assert all(found[shape].source == shape for shape in shapes)
    peaks = [float(found[shape].irradiance.max()) - 1.0 for shape in shapes]
    assert peaks[0] > 1.05 * peaks[1] > 1.1 * peaks[2] > 0.0


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"distance": float("inf")}, "distance"),
        ({"distance": 1.0, "source_angle": -1.0}, "source_angle"),
        ({"distance": 1.0, "exposure": 0.0}, "exposure"),
        ({"distance": 1.0, "pixel_count": 1}, "at least 2 x 2 rays"),
    ],
)
def test_arguments_that_make_no_sense(options: dict, match: str):
    with pytest.raises(ValueError, match=match):
        shadowgraph(planar(lambda y, z: 0.0 * y, spacing=2e-3), width=WIDTH, **options)
