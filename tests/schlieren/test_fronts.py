"""Shocks and stand-off distances read off drawn pictures, whose answers are exact."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels.benches import Picture, measure_shock_angle, measure_stand_off

COLUMNS, ROWS, PITCH = 170, 201, 1e-4
HORIZONTAL = (np.arange(COLUMNS) - 130) * PITCH
VERTICAL = (np.arange(ROWS) - 100) * PITCH
WINDOW = (-0.0125, -0.0035)


def area_below(height: np.ndarray) -> np.ndarray:
    """Share of each pixel of a column that lies below a height [m], shape (ROWS, COLUMNS): what a camera sees."""
    return np.clip((height - VERTICAL[:, None]) / PITCH + 0.5, 0.0, 1.0)


def drawn(slope: float, offset: float = 0.002, bend: float = 0.0, brightness: float = 0.8) -> Picture:
    """Air of 0.5 and a band of `brightness` from a front at offset - slope z down to half of its height, twice."""
    front = np.maximum(offset - slope * HORIZONTAL + bend * HORIZONTAL**2, 0.0)
    band = area_below(front) - area_below(0.5 * front)
    mirrored = band[::-1]
    return Picture(0.5 + (brightness - 0.5) * (band + mirrored), HORIZONTAL, VERTICAL)


@settings(max_examples=40, deadline=None)
@given(st.floats(5.0, 28.0), st.sampled_from([0.0, 0.2, 0.8, 1.0]), st.sampled_from([0.0, 1.0]))
def test_a_straight_front(degrees: float, brightness: float, smoothing: float):
    """The half height of a step seen by pixels, drawn straight, is the step: 90 columns leave 0.02 degree.

    Error source: within a pixel that the front crosses, the share below it is not linear in its height where the front
    leaves by a side: 0.1 pixel at 28 degrees, of changing sign.
    """
    picture = drawn(math.tan(math.radians(degrees)), brightness=brightness)
    for half in ("upper", "lower"):
        found = measure_shock_angle(picture, WINDOW, half=half, smoothing=smoothing)
        assert abs(math.degrees(found.angle) - degrees) < 0.02
        assert math.degrees(found.standard_error) < 0.1


def test_a_curved_front():
    """Front y = 2 mm - 0.4 z + 8 z^2: the tangent in the middle of the window, z = -8.5 mm, is 0.4 + 0.136."""
    found = measure_shock_angle(drawn(0.4, bend=8.0), WINDOW, degree=2)
    assert abs(found.angle - math.atan(0.4 - 2.0 * 8.0 * found.place)) < math.radians(0.05)
    assert abs(found.curve[2] - 8.0) < 0.2
    straight = measure_shock_angle(drawn(0.4, bend=8.0), WINDOW, degree=1)
    assert straight.standard_error > 3.0 * found.standard_error


def test_specks_do_not_count():
    """Ten columns of 90 have a bright speck outside the front: their points are left out."""
    picture = drawn(0.4)
    spoiled = picture.intensity.copy()
    spoiled[185:190, 30:110:8] = 1.0
    found = measure_shock_angle(Picture(spoiled, HORIZONTAL, VERTICAL), WINDOW, smoothing=0.0)
    assert abs(found.angle - math.atan(0.4)) < math.radians(0.02)
    assert 70 <= len(found.points) <= 82


def test_a_shock_inside_the_flow():
    """A thin dark line at y = 1 mm - 0.2 z under the outer band, found near a line drawn by hand."""
    outer = drawn(0.4)
    ridge = np.exp(-0.5 * ((VERTICAL[:, None] - (0.001 - 0.2 * HORIZONTAL)) / (1.5 * PITCH)) ** 2)
    picture = Picture(np.clip(outer.intensity - 0.4 * ridge, 0.0, 1.0), HORIZONTAL, VERTICAL)
    found = measure_shock_angle(picture, WINDOW, near=((-0.013, 0.0037), (-0.004, 0.0017)), reach=0.0008, smoothing=0.0)
    assert abs(found.angle - math.atan(0.2)) < math.radians(0.1)
    assert abs(measure_shock_angle(picture, WINDOW).angle - math.atan(0.4)) < math.radians(0.05)


def bow(shock: float, nose: float, brightness: float, is_hard: bool = False) -> Picture:
    """A nose of radius 4 mm and a bow shock of radius 6 mm at places on the axis [m], cut along rows by pixels.

    Hard pixels are wholly on one side, as those of one ray.
    """

    def left_of(place: np.ndarray) -> np.ndarray:
        share = np.clip((place[:, None] - HORIZONTAL) / PITCH + 0.5, 0.0, 1.0)
        return np.rint(share) if is_hard else share

    behind, body = (
        left_of(tip - r + np.sqrt(r**2 - VERTICAL[70:131] ** 2)) for tip, r in ((shock, 0.006), (nose, 0.004))
    )
    return Picture((0.5 + (brightness - 0.5) * behind) * (1.0 - body), HORIZONTAL, VERTICAL[70:131])


@settings(max_examples=30, deadline=None)
@given(st.floats(0.6e-3, 2e-3), st.floats(-1e-3, -0.1e-3), st.sampled_from([0.7, 1.0]))
def test_stand_off_distance(distance: float, nose: float, brightness: float):
    """Exact places, drawn by shares of pixels; tolerance 0.15 pixel.

    Error sources: circles are parabolas to (y / r)^4 r / 8, 10 um at y = 1.5 mm, of which the fit's value on the axis
    sees a fifth; and what half heights lose where an edge slants through a pixel, 0.1 pixel.
    """
    picture = bow(nose + distance, nose, brightness)
    found = measure_stand_off(picture, 0.0015, smoothing=0.0)
    assert abs(found.distance - distance) < 15e-6
    assert found.standard_error < 15e-6
    assert abs(found.nose - nose) < 12e-6
    given_nose = measure_stand_off(picture, 0.0015, smoothing=0.0, nose=nose)
    assert abs(given_nose.distance - distance) < 12e-6 and given_nose.nose_points.shape == (0, 2)
    mirrored = Picture(picture.intensity[:, ::-1], -HORIZONTAL[::-1], picture.vertical)
    assert measure_stand_off(mirrored, 0.0015, smoothing=0.0, upstream="left").distance == pytest.approx(found.distance)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"half": "left"}, "half 'left'"),
        ({"degree": 3}, "degree = 3"),
        ({"window": (0.0, -0.01)}, "increasing"),
        ({"window": (0.1, 0.2)}, "the picture goes from"),
        ({"level": 1.0}, "level = 1.0"),
        ({"smoothing": -1.0}, "smoothing"),
        ({"axis": 0.01}, "axis"),
        ({"near": ((0.0, 0.0), (1.0, 0.0))}, "belong together"),
        ({"near": ((0.0, 0.0), (0.0, 1.0)), "reach": 1e-3}, "two points"),
        ({"near": ((0.0, 0.0), (1.0, 0.0)), "reach": -1.0}, "reach"),
        ({"window": (0.0005, 0.0035)}, "scan lines show one front"),
    ],
)
def test_what_makes_no_sense_is_refused(options: dict, match: str):
    picture = drawn(0.4, offset=-0.0002)  # no front from z = -0.5 mm on
    with pytest.raises(ValueError, match=match):
        measure_shock_angle(picture, **{"window": WINDOW, **options})


def test_stand_off_distances_of_hard_pixels_are_within_their_errors():
    """Set-up: 60 noses and shocks at random places, drawn by pixels of one ray.

    Expected: errors of rms 0.3 to 1 standard errors, none above 2. Rows near the axis show the same pixel, so that the
    scatter alone tells less.
    """
    draw, ratios = np.random.default_rng(5), []
    for _ in range(60):
        nose, distance = draw.uniform(-1e-3, -0.1e-3), draw.uniform(0.6e-3, 2e-3)
        found = measure_stand_off(bow(nose + distance, nose, 0.9, is_hard=True), 0.001, smoothing=0.0)
        ratios.append((found.distance - distance) / found.standard_error)
    assert 0.3 < np.sqrt(np.mean(np.square(ratios))) < 1.0
    assert np.abs(ratios).max() < 2.0


@pytest.mark.parametrize("brightness", [0.0, 0.05])
def test_a_shock_as_dark_as_the_body_is_refused(brightness: float):
    """As by a knife edge from the wrong side. A distance of 0.01 mm was found, where 1 mm is right."""
    picture = bow(1e-3, 0.0, brightness)
    with pytest.raises(ValueError, match="the shock is as dark as the body; take the knife edge from the other side"):
        measure_stand_off(picture, 0.0015, smoothing=0.0)
    assert abs(measure_stand_off(picture, 0.0015, smoothing=0.0, nose=0.0).distance - 1e-3) < 15e-6


def test_stand_off_needs_a_shock_and_a_body():
    picture = bow(1e-3, -1e-3, 0.9)
    flat = Picture(np.full_like(picture.intensity, 0.5), picture.horizontal, picture.vertical)
    with pytest.raises(ValueError, match="shock: 0 of"):
        measure_stand_off(flat, 0.0015)
    no_body = bow(1e-3, -1.0, 0.9)
    with pytest.raises(ValueError, match="body: 0 of"):
        measure_stand_off(no_body, 0.0015)
    with pytest.raises(ValueError, match="rows of pixels"):
        measure_stand_off(picture, 1e-4)
    with pytest.raises(ValueError, match="upstream 'up'"):
        measure_stand_off(picture, 0.0015, upstream="up")


@pytest.mark.parametrize("share", [0.2, 0.4])
def test_columns_at_one_end_that_show_another_edge_do_not_turn_the_front(share: float):
    """Near a nose the band between shock and body is thinner than its blur, and the body's edge is found instead.

    Set-up: a front at 22 degrees; in the window's last columns it is 2 to 4 pixels lower and steeper. Expected: its
    own angle within 0.05 degree. A fit of least absolute deviations to all of them is 3 degrees off.
    """
    slope = math.tan(math.radians(22.0))
    front = 0.002 - slope * HORIZONTAL
    place = (HORIZONTAL - WINDOW[0]) / (WINDOW[1] - WINDOW[0])
    front = np.where(place > 1.0 - share, front - (2.0 + 2.0 * (1.0 - place) / share) * PITCH, front)
    picture = Picture(0.5 - 0.4 * area_below(np.maximum(front, 0.0)), HORIZONTAL, VERTICAL)
    found = measure_shock_angle(picture, WINDOW, smoothing=0.0)
    assert abs(found.angle - math.radians(22.0)) < math.radians(0.05)
    assert len(found.points) <= 91 * (1.0 - share) + 1
