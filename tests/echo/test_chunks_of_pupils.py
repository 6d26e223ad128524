"""Ways back in chunks that begin and end anywhere within a pupil."""

import pytest

from aerokernels.echo import pupil_reduction
from aerokernels.echo.pupil_reduction import receiver_pupil, reduce_pupils

from .test_return_paths import blob_field, scene, target_intersections


@pytest.mark.parametrize("chunk", [3, 5])
def test_a_chunk_may_begin_with_the_last_ray_of_a_pupil(monkeypatch: pytest.MonkeyPatch, chunk: int):
    """Three pupils of 4 rays: sums, counts and statuses are those of one chunk."""
    setting = scene(trace__backend="reference", receiver__ray_count=16)
    field, target, pupil = blob_field(5e-5), target_intersections(3), receiver_pupil(setting)
    start, weight = pupil[0][:4], pupil[1][:4]
    whole = reduce_pupils(setting, field, target, start, weight)
    monkeypatch.setattr(pupil_reduction, "CHUNK_RAYS", chunk)
    parts = reduce_pupils(setting, field, target, start, weight)
    assert parts.phasor == pytest.approx(whole.phasor, abs=1e-9)
    assert parts.open_share == pytest.approx(whole.open_share, abs=1e-12)
    assert parts.statuses == whole.statuses == {"OK": len(start) * 3}
    assert parts.ray_count == whole.ray_count == 3 * len(start)
