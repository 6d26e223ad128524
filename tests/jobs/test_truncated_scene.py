"""A scene whose pupil looks through the end of the known air is refused, unless its [trace] table allows it."""

import pytest

from aerokernels.jobs.run import scene_strehl
from aerokernels.prepare import prepare_field
from aerokernels.scene import Scene


def test_a_truncated_scene_is_refused_unless_it_is_allowed():
    """The flow cut 7 mm ahead of the pupil, behind the bow shock: rays leave through the disturbed front of the box."""
    scene = Scene.load("wind-tunnel-mach3", {"strehl.ray_count": 1024, "grid.spacing": "0.2 mm"})
    assert scene.trace.allow_truncation is False
    whole = prepare_field(scene)
    cut = whole.mesh_field.resample(2e-4, region=((0.0, -9e-3), (9e-3, -1e-3)))
    assert scene_strehl(whole.field, scene).error["truncation"] < 1e-4
    with pytest.raises(ValueError, match=r"of the pupil looks through disturbed air .*trace\.allow_truncation = true"):
        scene_strehl(cut, scene)
    allowed = Scene.load("wind-tunnel-mach3", {"strehl.ray_count": 1024, "trace.allow_truncation": True})
    with pytest.warns(UserWarning, match="that of the known air only"):
        estimate = scene_strehl(cut, allowed)
    assert estimate.error["total"] >= estimate.error["truncation"] > 0.0
