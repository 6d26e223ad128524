"""A scene whose pupil looks through a cut in the flow is refused, unless its [trace] table allows it."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField
from aerokernels.jobs.run import scene_strehl
from aerokernels.prepare import prepare_field
from aerokernels.scene import Scene
from aerokernels.tracing.pupil.air import pupil_air


def test_a_truncated_scene_is_refused_unless_it_is_allowed():
    """The flow cut 7 mm ahead of the pupil, behind the bow shock: rays leave through the disturbed front of the box."""
    scene = Scene.load("wind-tunnel-mach3", {"strehl.ray_count": 1024, "grid.spacing": "0.2 mm"})
    assert scene.trace.allow_truncation is False
    whole = prepare_field(scene)
    cut = whole.mesh_field.resample(2e-4, region=((0.0, -9e-3), (9e-3, -1e-3)))
    assert scene_strehl(scene, whole.field).error["truncation"] < 1e-4
    with pytest.raises(ValueError, match=r"of the pupil looks through disturbed air .*trace\.allow_truncation = true"):
        scene_strehl(scene, cut)
    allowed = Scene.load("wind-tunnel-mach3", {"strehl.ray_count": 1024, "trace.allow_truncation": True})
    with pytest.warns(UserWarning, match="that of the air in the field's box"):
        estimate = scene_strehl(allowed, cut)
    assert estimate.error["total"] >= estimate.error["truncation"] > 0.0


def test_a_pupil_that_stands_outside_the_field_is_told_so():
    """Set-up: density rising along z, cut to a box from z = 0 to 8 mm; the pupil 5 mm behind it, or within it.

    Expected: only the one behind, where a scene's default may put it, is asked to be moved.
    """
    contrast = np.broadcast_to(1e-5 * np.arange(49.0), (9, 49))
    whole = IndexField.from_samples(contrast, origin=(-4e-3, -8e-3), spacing=(1e-3, 5e-4), geometry="planar",
                                    ambient_index=1.0)  # fmt: skip
    field = whole.resample(5e-4, region=((-4e-3, 0.0), (4e-3, 8e-3)))
    for z, words in (-5e-3, r"is outside the field: move it .*receiver\.aperture_z"), (1e-3, "beyond. Give the"):
        found = pupil_air(field, Disc(1e-3, (0.0, 0.0, z)), np.array([0.0, 0.0, 1.0]), 1e-9)
        with pytest.raises(ValueError, match=words):
            found.check(allowed=False)
