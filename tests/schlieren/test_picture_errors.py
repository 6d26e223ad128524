"""What pictures tell of the error of their brightness, and of what is not known, against closed forms.

Set-up: round lumps of gas, m0 exp(-|x|^2 / w^2), whose optical path along any line at the distance (u, v) is
sqrt(pi) w m0 exp(-(u^2 + v^2) / w^2): deflection and its divergence are derivatives of that, and their means over a
pixel are differences of it and of error functions. Formulas of first order leave out the square of the relative change
of a shadowgraph's light, 3.5e-5, and 1e-5 of other signals.
"""

import math
import pickle
import warnings

import numpy as np
import pytest
from scipy.special import erf

from aerokernels import IndexField, Rectangle
from aerokernels.benches import Bench, interferogram, line_of_sight, schlieren, shadowgraph
from aerokernels.medium import Body

WIDTH, STRENGTH, HALF = 0.008, 3e-6, 0.024
PATH = math.sqrt(math.pi) * WIDTH * STRENGTH
VIEW = {"extent": (-0.02, 0.018, -0.019, 0.019), "pixel_count": (12, 11)}


def lump(cell: float, geometry: str = "volume", at: float = 0.0) -> IndexField:
    """The lump on cells of a size [m], at `at` along x."""
    count = 2 * round(HALF / cell)
    axis = np.linspace(-HALF, HALF, count + 1)
    if geometry == "axisymmetric":
        squared = axis[count // 2 :, None] ** 2 + axis**2
        origin: tuple = (0.0, -HALF)
    else:
        squared = (axis[:, None, None] - at) ** 2 + axis[:, None] ** 2 + axis**2
        origin = (-HALF,) * 3
    contrast = STRENGTH * np.exp(-squared / WIDTH**2)
    spacing = (axis[1] - axis[0],) * len(origin)
    return IndexField.from_samples(contrast, origin=origin, spacing=spacing, geometry=geometry)


def edges(centres: np.ndarray) -> np.ndarray:
    half = 0.5 * (centres[1] - centres[0])
    return np.append(centres - half, centres[-1] + half)


def mean_slopes(picture) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means over pixels of the exact deflections toward right and up [rad], and of their divergence [1 / m]."""
    across, up = edges(picture.horizontal) / WIDTH, edges(picture.vertical) / WIDTH
    bell = [np.diff(np.exp(-(side**2))) for side in (across, up)]
    whole = [np.diff(0.5 * math.sqrt(math.pi) * erf(side)) for side in (across, up)]
    bent = [np.diff(-2.0 * side * np.exp(-(side**2))) for side in (across, up)]
    area = np.diff(up)[:, None] * np.diff(across)
    right, upward = whole[1][:, None] * bell[0] / area, bell[1][:, None] * whole[0] / area
    divergence = (whole[1][:, None] * bent[0] + bent[1][:, None] * whole[0]) / area
    return PATH / WIDTH * right, PATH / WIDTH * upward, PATH / WIDTH**2 * divergence


GREATEST = PATH / WIDTH * math.sqrt(2.0) * math.exp(-0.5)
PICTURES = {
    "edge": lambda field, **more: schlieren(field, knife_edge=0.6, cut_off=0.3, sensitivity=0.25 / GREATEST, **more),
    "other side": lambda field, **more: schlieren(
        field, knife_edge=math.pi, cut_off=0.6, exposure=0.8, bench=Bench(4.0 * GREATEST, 1.0), **more
    ),
    "shadow": lambda field, **more: shadowgraph(field, distance=3.0, **more),
    "fringes": lambda field, **more: interferogram(field, phase=0.15, exposure=0.9, **more),
}


def exact(name: str, picture) -> np.ndarray:
    right, up, divergence = mean_slopes(picture)
    if name == "edge":
        return 0.7 + 0.25 / GREATEST * (math.cos(0.6) * right + math.sin(0.6) * up)
    if name == "other side":
        return 0.8 * (0.4 - 0.25 / GREATEST * right)
    if name == "shadow":
        return 0.5 * (1.0 - 3.0 * divergence)
    fine = (np.arange(40) + 0.5) / 40
    across, along = (
        (side[:-1, None] + np.diff(side)[:, None] * fine).ravel()
        for side in (edges(picture.horizontal), edges(picture.vertical))
    )
    waves = PATH / 905e-9 * np.exp(-(along[:, None] ** 2 + across**2) / WIDTH**2) + 0.15
    light = 0.45 * (1.0 + np.cos(2.0 * np.pi * waves))
    return light.reshape(len(picture.vertical), 40, len(picture.horizontal), 40).mean(axis=(1, 3))


@pytest.mark.parametrize("name", PICTURES)
@pytest.mark.parametrize(("geometry", "cell", "k"), [("volume", 4e-3, 1), ("axisymmetric", 2e-3, 3)])
def test_the_error_of_a_brightness_holds_its_cells_and_its_pixels(name, geometry, cell, k):
    """Two and four cells over w, one ray and nine a pixel. The error is not told many times too great either."""
    picture = PICTURES[name](lump(cell, geometry), rays_per_pixel=k, **VIEW)
    off = np.abs(picture.intensity - exact(name, picture))
    assert picture.error.shape == off.shape and off.max() > 5e-5
    assert np.mean(off <= picture.error + (3.5e-5 if name == "shadow" else 1e-5)) >= 0.95
    assert np.linalg.norm(picture.error) < 15.0 * np.linalg.norm(off)


def test_what_a_picture_needs_for_its_error_travels_with_it():
    told = schlieren(line_of_sight(lump(4e-3), **VIEW), sensitivity=1e4)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(told)).error, told.error)
    assert (told.error > 0.0).all()


def test_light_that_leaves_through_a_cut_is_marked():
    """Half of the lump is cut off at x = 0: pixels through it are not known, those beside it are.

    In a shadowgraph so are the pixels onto which that light falls; a lump inside the box leaves all known, and so does
    half a lump with which the flow ends.
    """
    cut = lump(2e-3).resample(2e-3, region=((-HALF,) * 3, (0.0, HALF, HALF)))
    with pytest.warns(RuntimeWarning, match="not known"):
        picture = schlieren(cut, **VIEW)
    distance = np.hypot(*np.meshgrid(picture.horizontal, picture.vertical))
    assert not picture.known[distance < WIDTH].any()
    # Its optical path is below the tolerance of 0.9 nm beyond: STRENGTH WIDTH exp(-9) is 3e-12 m.
    assert picture.known[distance > 3.0 * WIDTH].all() and (distance > 3.0 * WIDTH).any()
    assert picture.to_xarray()["known"].sum() == picture.known.sum()
    with pytest.warns(RuntimeWarning, match="not known"):
        shadow = shadowgraph(cut, distance=0.5, source_angle=0.02, **VIEW)
    assert shadow.known.sum() < picture.known.sum()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert schlieren(lump(2e-3), **VIEW).known.all()
        assert schlieren(lump(2e-3, at=HALF), **VIEW).known.all()


@pytest.mark.parametrize("k", [1, 2])
def test_the_outline_of_a_body_within_pixels_is_in_the_error(k):
    """A cylinder along the axis in still air, seen from the side: a pixel is dark by its exact share of a rectangle.

    Its ends and sides are moved over a pixel in steps of a ninth: samples of few rays count a pixel wholly or not.
    """
    r, z = np.arange(0.0, 0.0101, 1e-3), np.arange(-0.01, 0.0101, 1e-3)
    errors, offs = [], []
    for part in range(9):
        radius, half = 0.004 + part * 1e-3 / 9.0, 0.003 + (8 - part) * 1e-3 / 9.0
        rod = Body(np.array([[0.0, -half], [radius, -half], [radius, half], [0.0, half]]))
        still = IndexField.from_samples(
            np.zeros((len(r), len(z))), origin=(0.0, -0.01), spacing=(1e-3, 1e-3), geometry="axisymmetric", body=rod
        )
        seen = schlieren(
            still, extent=(-0.008, 0.008, -0.008, 0.008), pixel_count=16, rays_per_pixel=k, sensitivity=1.0
        )
        dark = Rectangle(2.0 * half, 2.0 * radius).coverage(edges(seen.horizontal), edges(seen.vertical))
        errors.append(seen.error)
        offs.append(np.abs(seen.intensity - 0.5 * (1.0 - dark)))
    error, off = np.array(errors), np.array(offs)
    assert np.mean(off <= error + 1e-9) >= 0.95 and np.isfinite(error).all()
    assert np.linalg.norm(error) < 6.0 * np.linalg.norm(off)
