"""The reference engine: the same rays in air that is moved, mirrored or turned, and what it counts.

Moving by whole cells rounds nothing, mirroring and turning round sums in another order: OPD to 1e-9 of the greatest.
"""

import numpy as np
import pytest

from aerokernels import RayBundle, trace
from aerokernels.tracing import ArcLength, Plane
from tests.moved_air import CHANGES, PITCH, PLAIN, Moved, beams

WAVE = 905e-9
OUTPUTS = ("opd", "position", "direction", "arc_length", "step_count", "evaluation_count", "step_error")


def traced(by: Moved, backend: str, stop: str, interpolation: str = "cubic", **options):
    position, direction = beams(24)
    up = np.array([0.1, -0.2, 1.0]) / np.sqrt(1.05)
    until = {
        "none": None, "arc": ArcLength(30.0 * PITCH), "before": Plane(by.place([0.0, 0.0, 2.0 * PITCH]), by.way(up)),
        "beyond": Plane(by.place([0.0, 0.0, 20.0 * PITCH]), by.way(up)),
    }[stop]  # fmt: skip
    rays = RayBundle(by.place(position), by.way(direction))
    return trace(
        by.field(interpolation), rays, until=until, backend=backend, precision="float64", wavelength=WAVE,
        outputs=OUTPUTS, **options,
    )  # fmt: skip


@pytest.mark.parametrize("change", ["moved", "turned", "turned about x"])
@pytest.mark.parametrize("stop", ["none", "arc", "before", "beyond"])
def test_rays_turn_with_the_air(change: str, stop: str):
    by = CHANGES[change]
    options = {"tolerance": 1e-5}
    before, after = traced(PLAIN, "reference", stop, **options), traced(by, "reference", stop, **options)
    assert before.ok.all() and after.ok.all()
    scale = np.abs(before.opd).max()
    assert scale > 1e-9
    np.testing.assert_allclose(after.opd, before.opd, atol=1e-9 * scale)
    np.testing.assert_allclose(after.position, by.place(before.position), atol=1e-15 + 1e-9 * scale)
    np.testing.assert_allclose(after.direction, by.way(before.direction), atol=1e-12)
    np.testing.assert_allclose(after.arc_length, before.arc_length, rtol=1e-13)
    if change == "moved":
        np.testing.assert_array_equal(after.step_count, before.step_count)
        np.testing.assert_array_equal(after.evaluation_count, before.evaluation_count)
