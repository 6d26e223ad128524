"""Planes beyond a field: every straight line of a pupil has left the field's box before it meets the plane."""

import numpy as np
import pytest

from aerokernels import Camera, Disc, IndexField, estimate_strehl, image_through, wavefront
from aerokernels.tracing.lines import box_span
from aerokernels.tracing.stop import plane_beyond


def blob(geometry: str, contrast: float = 3e-5) -> IndexField:
    """A small grid of some contrast."""
    counts = (9, 9, 9) if geometry == "volume" else (9, 9)
    origin = {"volume": [-0.01, -0.02, 0.0], "planar": [-0.02, 0.0], "axisymmetric": [0.0, 0.0]}[geometry]
    samples = np.zeros(counts)
    samples[(4,) * len(counts)] = contrast
    return IndexField.from_samples(samples, origin=origin, spacing=[3e-3] * len(counts), geometry=geometry)


@pytest.mark.parametrize("geometry", ["volume", "planar", "axisymmetric"])
def test_all_lines_of_a_pupil_have_left_the_box_at_the_plane(geometry: str):
    """Also where a planar field is seen along its span, in which its box never ends: corners in y and z count."""
    field, draw = blob(geometry), np.random.default_rng(4)
    checked = 0
    for _ in range(300):
        look, normal = draw.normal(size=(2, 3)) * (1.0, draw.choice([0.1, 1.0]), draw.choice([0.1, 1.0]))
        look, normal = look / np.linalg.norm(look), normal / np.linalg.norm(normal)
        if geometry == "planar" and np.hypot(*look[1:]) < 0.04:
            continue
        pupil = Disc(draw.choice([1e-3, 2e-2]), draw.normal(scale=0.03, size=3), normal)
        start = pupil.sample(64)[0]
        plane = plane_beyond(field, pupil, look)
        way = (plane.point - start) @ look
        span = box_span(field, start, np.broadcast_to(look, start.shape))
        assert (way > 0.0).all() and (way > np.where(span.meets, span.leave, 0.0)).all()
        checked += int(span.meets.sum())
    assert checked > 1000


def test_light_that_may_never_leave_a_planar_field_is_refused():
    """Within arcsin sqrt(32 m) of the span, 1.8 degrees for m = 3e-5; a greater contrast needs a greater angle."""
    for angle, contrast, refused in ((1.7, 3e-5, True), (1.9, 3e-5, False), (1.9, 1e-4, True), (0.0, 3e-5, True)):
        look = np.array([np.cos(np.radians(angle)), 0.0, np.sin(np.radians(angle))])
        field, pupil = blob("planar", contrast), Disc(1e-3, np.array([0.0, -0.01, 0.01]) - 0.5 * look, look)
        if not refused:
            assert plane_beyond(field, pupil, look).point @ look > pupil.center @ look
            continue
        camera = Camera(pupil=pupil, focal_length=1.0, pixel=1e-5, pixel_count=4)
        doors = [
            lambda f=field, p=pupil: estimate_strehl(f, p, backend="reference", ray_count=64),
            lambda f=field, p=pupil: wavefront(f, p, backend="reference", pixel_count=8),
            lambda f=field, c=camera: image_through(f, np.ones((4, 4)), c, backend="reference"),
        ]
        for door in doors:
            with pytest.raises(ValueError, match="a planar field never ends along x"):
                door()
