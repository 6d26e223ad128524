"""Synthetic schlieren against the exact line-of-sight integrals of a Gaussian blob.

Set-up: contrast m = M exp(-(x^2 + y^2 + z^2) / s^2), M = 1e-6, s = 10 mm, in a box of +-6 s; light along x.
Formula: OPD = M s sqrt(pi) exp(-(y^2 + z^2) / s^2), deflection = grad(OPD) / n_0 (first order in M).
Expected: OPD up to 17.7 nm, deflection up to 1.52 urad.
Error sources: the box cuts the blob off at exp(-36) = 2e-16 of its peak; second order in M, relative 2 M = 2e-6; the
cubic B-spline at spacing h = s / 8, whose interpolation error is at most 0.0032 h^4 max|d4m| = 0.0032 * 12 / 4096 M
= 9.4e-6 M in the value and 0.04 h^3 max|d4m| = 9.4e-4 M / s in the slope, relative to its greatest, 0.86 M / s, 1.1e-3;
the integrator, asked for 1e-5 wave = 9e-12 m or 5e-4 of the greatest OPD; float32, relative 1e-5.
Tolerance: 0.2 % of the greatest value for both. On the volume, h = s / 4, the slope error is 8 times as large: 1 %.
"""

import numpy as np
import pytest

from aerokernels.benches import line_of_sight, schlieren
from aerokernels.benches.knife_edge import KnifeEdge
from aerokernels.medium import IndexField

PEAK, SIZE, SPACING, REACH = 1e-6, 0.01, 0.00125, 0.06
GREATEST_OPD = PEAK * SIZE * np.sqrt(np.pi)
GREATEST_DEFLECTION = GREATEST_OPD / SIZE * np.sqrt(2.0) * np.exp(-0.5)


def gaussian(geometry: str, reach: float = REACH, spacing: float = SPACING, ambient_index: float = 1.0) -> IndexField:
    line = np.arange(-reach, reach + 0.5 * spacing, spacing)
    axes = {"volume": [line] * 3, "planar": [line] * 2, "axisymmetric": [line[line > -0.5 * spacing], line]}[geometry]
    axes[0] = np.where(np.abs(axes[0]) < 1e-9, 0.0, axes[0])
    squares = sum(np.square(axis) for axis in np.meshgrid(*axes, indexing="ij"))
    return IndexField.from_samples(
        PEAK * np.exp(-squares / SIZE**2),
        origin=[axis[0] for axis in axes],
        spacing=[spacing] * len(axes),
        geometry=geometry,
        ambient_index=ambient_index,
    )


def exact(image, path: float) -> tuple[np.ndarray, np.ndarray]:
    """OPD and deflection (right, up) of a blob whose light path is worth `path` [m] at its centre."""
    right, up = np.meshgrid(image.horizontal, image.vertical)
    opd = PEAK * path * np.exp(-(right**2 + up**2) / SIZE**2)
    return opd, np.stack([-2.0 * right / SIZE**2 * opd, -2.0 * up / SIZE**2 * opd], axis=-1)


@pytest.mark.parametrize(
    ("geometry", "view", "path", "options"),
    [
        ("axisymmetric", "x", SIZE * np.sqrt(np.pi), {}),
        ("axisymmetric", (1.0, 0.0, 1.0), SIZE * np.sqrt(np.pi), {}),
        ("planar", "x", 0.02, {"width": 0.02}),
        ("volume", "x", SIZE * np.sqrt(np.pi), {}),
        ("volume", "z", SIZE * np.sqrt(np.pi), {}),
        ("volume", "y", SIZE * np.sqrt(np.pi), {}),
    ],
)
def test_a_gaussian_blob_against_its_line_of_sight_integral(geometry, view, path, options):
    # A volume of spacing s / 4 keeps the test small.
    coarse = 2.0 if geometry == "volume" else 1.0
    image = schlieren(
        gaussian(geometry, spacing=coarse * SPACING),
        view=view,
        extent=(-0.03, 0.03, -0.02, 0.02),
        pixel_count=(31, 20),
        tolerance=1e-5,
        **options,
    )
    opd, deflection = exact(image, path)
    tolerance = 0.002 if coarse == 1.0 else 0.01
    assert image.opd.shape == (20, 31) and image.deflection.shape == (20, 31, 2)
    assert np.abs(image.opd - opd).max() < tolerance * PEAK * path
    assert np.abs(image.deflection - deflection).max() < tolerance * PEAK * path / SIZE * np.sqrt(2.0) * np.exp(-0.5)
    assert not image.blocked.any()


@pytest.mark.parametrize("rows", [10, 11])
def test_the_mirrored_half_is_what_rays_would_find(rows: int):
    """A picture with the axis in its middle is traced by halves; one with another row on top is not: the rest agrees.

    The field is no blob at the middle: it is shifted along the axis. Tolerance: float32, 1e-5 of the greatest value.
    """
    field = gaussian("axisymmetric")
    field = IndexField.from_samples(
        field.samples.samples, origin=[0.0, -REACH + 0.01], spacing=[SPACING] * 2, geometry="axisymmetric"
    )
    reach, pitch = 0.02, 0.04 / rows
    half = line_of_sight(field, extent=(-0.02, 0.03, -reach, reach), pixel_count=(12, rows))
    full = line_of_sight(field, extent=(-0.02, 0.03, -reach, reach + pitch), pixel_count=(12, rows + 1))
    for name, greatest in (("opd", GREATEST_OPD), ("deflection", GREATEST_DEFLECTION), ("displacement", 1e-9)):
        np.testing.assert_allclose(getattr(half, name), getattr(full, name)[:rows], atol=1e-5 * greatest)
    assert half.through.shape == half.blocked.shape == (rows, 12)
    np.testing.assert_array_equal(half.opd, half.opd[::-1])


def test_a_denser_ambient_medium_refracts_less():
    """The exit angle is grad(OPD) / n_0 with the same contrast: in n_0 = 1.5 two thirds of that in vacuum."""
    pictures = [
        schlieren(gaussian("axisymmetric", ambient_index=n), extent=(-0.02, 0.02, -0.02, 0.02), pixel_count=12)
        for n in (1.0, 1.5)
    ]
    np.testing.assert_allclose(
        pictures[1].deflection * 1.5, pictures[0].deflection, rtol=0.0, atol=0.005 * GREATEST_DEFLECTION
    )


def test_picture_axes_follow_the_frame():
    """Light along x with y up: z points to the right, so that a body that flies toward +z points right."""
    image = schlieren(gaussian("axisymmetric"), pixel_count=8)
    np.testing.assert_allclose(image.right, [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(image.up, [0.0, 1.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(image.horizontal, (np.arange(8) + 0.5) * 0.015 - 0.06, atol=1e-12)
    np.testing.assert_allclose(image.vertical, image.horizontal, atol=1e-12)
    wide = schlieren(gaussian("axisymmetric"), pixel_count=10, extent=(0.0, 0.05, 0.0, 0.01))
    assert wide.intensity.shape == (2, 10)


@pytest.mark.parametrize(("knife_edge", "component"), [("vertical", 0), ("horizontal", 1)])
def test_the_knife_edge_law(knife_edge: str, component: int):
    """I = 1 - cut_off + sensitivity * deflection across the edge, cut to 0 .. 1, for each edge."""
    options = {"extent": (-0.02, 0.02, -0.02, 0.02), "pixel_count": 16, "knife_edge": knife_edge}
    field = gaussian("axisymmetric")
    weak = schlieren(field, cut_off=0.7, sensitivity=0.2 / GREATEST_DEFLECTION, **options)
    expected = 0.3 + weak.sensitivity * weak.deflection[..., component]
    assert 0.05 < expected.min() and expected.max() < 0.55
    np.testing.assert_allclose(weak.intensity, expected, rtol=1e-12)
    strong = schlieren(field, cut_off=0.7, sensitivity=5.0 / GREATEST_DEFLECTION, **options)
    assert strong.intensity.min() == 0.0 and strong.intensity.max() == 1.0
    automatic = schlieren(field, **options)
    largest = np.quantile(np.abs(automatic.deflection[..., component]), 0.995)
    assert abs(automatic.sensitivity * largest - 0.5) < 1e-9
    # A blob of high index is a convex lens: what passes on the right bends left, below zero; the picture is odd.
    axis = -1 if component == 0 else 0
    flipped = np.flip(automatic.intensity, axis)
    np.testing.assert_allclose(automatic.intensity + flipped, 1.0, atol=0.02)
    half = automatic.intensity[:, 8:] if component == 0 else automatic.intensity[8:]
    assert half.max() < 0.51


def test_a_field_without_gradient_gives_an_even_picture():
    field = IndexField.from_samples(
        np.zeros((9, 17)), origin=[0.0, -0.04], spacing=[0.005, 0.005], geometry="axisymmetric"
    )
    image = schlieren(field, pixel_count=9, cut_off=0.25)
    assert np.all(image.intensity == 0.75) and np.all(image.deflection == 0.0) and np.all(image.opd == 0.0)


def test_the_body_is_a_silhouette():
    """A sphere of 20 mm radius: the pixels whose line of sight passes its centre nearer than that are dark.

    The pixels within 1 mm of the edge are left out: the profile has 200 chords (sagitta 0.6 um), and the wall is known
    to a small part of the field's spacing of 1.25 mm.
    """
    from aerokernels.medium import Body

    angle = np.linspace(0.0, np.pi, 201)
    profile = 0.02 * np.stack([np.sin(angle), np.cos(angle)], axis=1)
    profile[[0, -1], 0] = 0.0
    plain = gaussian("axisymmetric")
    field = IndexField.from_samples(
        plain.samples.samples,
        origin=[0.0, -REACH],
        spacing=[SPACING] * 2,
        geometry="axisymmetric",
        body=Body(profile, "axisymmetric"),
    )
    image = schlieren(field, extent=(-0.03, 0.03, -0.03, 0.03), pixel_count=40)
    distance = np.hypot(*np.meshgrid(image.horizontal, image.vertical))
    inside, outside = distance < 0.019, distance > 0.021
    assert inside.sum() > 300 and outside.sum() > 300
    assert image.blocked[inside].all() and not image.blocked[outside].any()
    assert np.all(image.intensity[image.blocked] == 0.0) and np.isnan(image.opd[image.blocked]).all()
    assert np.isfinite(image.opd[outside]).all() and np.isfinite(image.deflection[outside]).all()


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"knife_edge": "round"}, "knife_edge 'round'"),
        ({"knife_edge": 30.0}, r"knife_edge = 30.0: .* is it in degrees\?"),
        ({"cut_off": 1.5}, "cut_off = 1.5"),
        ({"sensitivity": float("nan")}, "sensitivity"),
        ({"view": "w"}, "view 'w'"),
        ({"view": (0.0, 0.0, 0.0)}, "zero"),
        ({"width": 0.1}, "leave it out"),
        ({"extent": (0.0, 0.0, 0.0, 1.0)}, "increasing"),
        ({"pixel_count": 0}, "pixel_count 0"),
        ({"pixel_count": 2.5}, "pixel_count .*, got 2.5"),
    ],
)
def test_arguments_that_make_no_sense(options: dict, match: str):
    with pytest.raises(ValueError, match=match):
        schlieren(gaussian("axisymmetric"), **options)


def test_a_planar_field_needs_a_width_and_light_along_x():
    with pytest.raises(ValueError, match="infinite in x"):
        schlieren(gaussian("planar"))
    with pytest.raises(ValueError, match="along x"):
        schlieren(gaussian("planar"), width=0.1, view="y")


def test_the_full_range_is_that_of_the_nearer_end():
    """Deflections of 0.1 of the edge's range: at a share of 0.8 held back 0.2 is left, at a whole one all of it."""
    cut = np.full(1000, -0.1)
    for cut_off, room in ((0.3, 0.3), (0.8, 0.2), (1.0, 1.0)):
        found = KnifeEdge(cut_off=cut_off).with_full_range(np.stack([cut, 0.0 * cut], axis=1))
        assert found.sensitivity == pytest.approx(10.0 * room, rel=1e-12)
    assert KnifeEdge().with_full_range(np.zeros((0, 2))).sensitivity == 0.0
