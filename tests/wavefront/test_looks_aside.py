"""Angles of a pupil that is seen askew: slopes per metre across the look direction, in each function."""

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.focus.estimate import estimate_strehl
from aerokernels.pupils import Disc, Mask, Polygon, Rectangle, seen_along, transverse_axes
from aerokernels.rays import RayBundle
from aerokernels.series.optical import optical_series
from aerokernels.tracing import trace
from aerokernels.wavefronts import wavefront
from tests.slow import first_of

WAVE = 905e-9
LOOKS = {"in a plane": (np.sin(0.75), 0.0, np.cos(0.75)), "askew": (0.5, -0.4, 0.77)}
CENTER = np.array([-0.02, 0.01, -5e-3])


def layer():
    """A series of two equal snapshots: a layer whose density rises along x and falls along y, smooth at its faces."""
    x, y, z = (np.linspace(-0.1, 0.1, 25), np.linspace(-0.1, 0.1, 25), np.linspace(0.0, 0.04, 41))
    shape = np.clip(np.minimum(z, 0.04 - z) / 0.015, 0.0, 1.0)
    shape = shape**3 * (10.0 - 15.0 * shape + 6.0 * shape**2)
    density = 1.2 + (x[:, None, None] - 0.5 * y[:, None]) * shape
    spacing = [axis[1] - axis[0] for axis in (x, y, z)]
    options = {"geometry": "volume", "origin": [x[0], y[0], z[0]], "spacing": spacing, "ambient_density": 1.2}
    return flow.open_series([density, density], time=[0.0, 1e-4], **options)


@pytest.mark.parametrize(
    "pupil",
    first_of([Disc(3e-3, CENTER), Rectangle(5e-3, 4e-3, CENTER), Disc(3e-3, CENTER, LOOKS["askew"])]),
    ids=["disc", "rectangle", "facing"],
)
def test_tilts_are_the_turn_of_a_ray(pupil):
    """Set-up: a plane layer of linear index, which turns all rays alike. Expected: the turn of a traced ray.

    Across the look direction, along the axes of a pupil that faces along it. 1 % covers the pixels (32 across the disc)
    and the layer's slopes of second order; slopes in the pupil's plane were off by 27 %.
    """
    series, direction = layer(), np.array(LOOKS["askew"]) / np.linalg.norm(LOOKS["askew"])
    field, axes = series[0].index_field(WAVE), transverse_axes(direction)
    start = CENTER - 0.02 * direction
    turned = trace(field, RayBundle(start[None], direction[None]), precision="float64").direction[0]
    expected = np.array([turned @ axis for axis in axes])
    near = 0.01 * np.linalg.norm(expected)
    options = {"direction": direction, "wavelength": WAVE}
    seen = wavefront(field, pupil, pixel_count=32, **options)
    assert np.abs(seen.tilt - expected).max() < near and np.abs(seen.centroid - expected).max() < 2.0 * near
    angle = np.linspace(-3.0, 3.0, 121) * np.linalg.norm(expected)
    peak = np.unravel_index(seen.psf(angle).intensity.argmax(), (121, 121))
    assert np.abs(angle[list(peak)][::-1] - expected).max() < angle[1] - angle[0]
    for backend, count in (("auto", 8192), ("reference", 64)):
        found = estimate_strehl(field, pupil, ray_count=count, backend=backend, **options)
        assert np.abs(found.boresight - expected).max() < near
    history = optical_series(series, pupil, pixel_count=24, remove=("piston",), **options)
    boresight = np.array([history.boresight_x[0], history.boresight_y[0]])
    assert np.abs(boresight - expected).max() < near


@pytest.mark.parametrize("look", LOOKS)
def test_the_projection_of_a_pupil(look: str):
    """Its cells cover cos(angle) of its area, one by one the same share as a fine grid of points; points are on it."""
    direction = np.array(LOOKS[look]) / np.linalg.norm(LOOKS[look])
    polygon, mask = Polygon([[0, 0], [4e-3, 1e-3], [1e-3, 3e-3]]), Mask([[1, 0.5]], 2e-3)
    for pupil in (Disc(3e-3), Rectangle(5e-3, 4e-3), polygon, mask):
        seen = seen_along(pupil, direction)
        edges = [np.linspace(-extent, extent, 31) for extent in seen.half_extent]
        share = seen.coverage(*edges)
        area = share.sum() * (edges[0][1] - edges[0][0]) * (edges[1][1] - edges[1][0])
        assert area == pytest.approx(pupil.area * direction[2], rel=2e-3)
        x, y = (0.5 * (edge[1:] + edge[:-1]) for edge in edges)
        points = x[:, None, None] * seen.axes[0] + y[:, None] * seen.axes[1]
        inside = pupil.transmission(points[..., 0], points[..., 1]).T
        assert (
            np.abs(points[..., 2]).max() < 1e-15
            and np.abs(share - inside)[(share < 0.01) | (share > 0.99)].max() < 0.02
        )
        across = np.stack([points @ axis for axis in transverse_axes(direction)])
        assert np.abs(across - np.stack(np.broadcast_arrays(x[:, None], y))).max() < 1e-15
