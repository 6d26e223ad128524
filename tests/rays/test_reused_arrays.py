"""Objects keep the places that they were given, whatever becomes of the caller's array afterwards."""

import numpy as np
import pytest

from aerokernels import (
    FLDI,
    Annulus,
    Disc,
    IndexField,
    Mask,
    Plane,
    Polygon,
    RayBundle,
    Rectangle,
    Wave,
    estimate_strehl,
)
from aerokernels.benches import Picture

PLACE = np.array([1e-3, -2e-3, 0.3])
MADE = {
    "Disc": (lambda place: Disc(1e-3, place), "center"),
    "Annulus": (lambda place: Annulus(1e-3, 5e-4, center=place), "center"),
    "Rectangle": (lambda place: Rectangle(1e-3, 1e-3, place), "center"),
    "Polygon": (lambda place: Polygon([[0.0, 0.0], [1e-3, 0.0], [0.0, 1e-3]], place), "center"),
    "Mask": (lambda place: Mask(np.ones((2, 2)), 1e-3, place), "center"),
    "normal": (lambda place: Disc(1e-3, normal=place), "normal"),
    "Plane": (lambda place: Plane(place, (0, 0, 1)), "point"),
    "Wave": (lambda place: Wave(np.ones((4, 4)), 1e-3, 1e-6, center=place), "center"),
    "FLDI": (lambda place: FLDI(1e-4, 1e-5, focus=place), "focus"),
    "RayBundle": (lambda place: RayBundle(place[None], place[None]), "position"),
}


@pytest.mark.parametrize(("make", "name"), MADE.values(), ids=MADE)
def test_places_are_copies(make, name):
    """A loop that moves one array from pupil to pupil left all of them at the last place."""
    place = PLACE.copy()
    made = make(place)
    before = getattr(made, name).copy()
    place[:] = 7.0
    np.testing.assert_array_equal(getattr(made, name), before)


@pytest.mark.parametrize(("make", "name"), [MADE[kind] for kind in ("Disc", "Plane", "Wave", "FLDI", "normal")])
def test_places_are_read_only(make, name):
    """Axes and plans follow from them, and are computed once."""
    with pytest.raises(ValueError, match="read-only"):
        getattr(make(PLACE), name)[0] = 1.0


def test_a_picture_is_a_copy():
    brightness, heights = np.eye(3), np.arange(3.0)
    made = Picture(brightness, np.arange(3.0), heights)
    brightness[:], heights[:] = 0.5, 9.0
    np.testing.assert_array_equal(made.intensity, np.eye(3))
    np.testing.assert_array_equal(made.vertical, np.arange(3.0))


def test_a_loop_over_places_has_its_answers():
    """Set-up: a lump beside the axis, three pupils made from one array that moves on.

    Expected: the Strehl ratios of pupils made one by one.
    """
    axis = np.linspace(-0.01, 0.01, 21)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    contrast = 2e-5 * np.exp(-((x - 2e-3) ** 2 + y**2 + z**2) / 9e-6)
    field = IndexField.from_samples(contrast, origin=(-0.01,) * 3, spacing=(1e-3,) * 3, geometry="volume")
    place, pupils, places = np.array([0.0, 0.0, -0.05]), [], (-1e-3, 1e-3, 2e-3)
    for across in places:
        place[0] = across
        pupils.append(Disc(2e-3, place))
    found = [estimate_strehl(field, pupil, ray_count=1024).value for pupil in pupils]
    alone = [estimate_strehl(field, Disc(2e-3, (across, 0.0, -0.05)), ray_count=1024).value for across in places]
    assert found == alone and len(set(found)) == 3
