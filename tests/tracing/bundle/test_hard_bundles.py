"""The check of fields that hide something between traced lines: it passes for what is traced, and it can fail."""

from dataclasses import replace

import numpy as np
import pytest

from tests.draws import hard_bundles

pytest.importorskip("pyopencl")


def test_a_needle_is_not_missed():
    found = hard_bundles.check(0, backend="opencl")
    assert found.kind == "needle, slanted" and found.wrong == found.statuses == 0
    assert found.delivered > 0 and found.worst <= 1.0


def test_a_ray_that_is_off_is_found(monkeypatch: pytest.MonkeyPatch):
    """Three interpolated rays a hundred tolerances off, two of them with a status that says so: one is wrong."""
    real = hard_bundles.trace

    def spoilt(field, rays, **options):
        result = real(field, rays, **options)
        if options["tolerance"] < hard_bundles.TOLERANCE:
            return result
        opd, status = result.opd.copy(), np.array(result.traced_status)
        opd[[100, 200, 300]] += 100.0 * hard_bundles.TOLERANCE * hard_bundles.WAVE
        status[[200, 300]] = hard_bundles.RayStatus.TOLERANCE_NOT_MET
        return replace(result, opd=opd, traced_status=status, lost=None)

    monkeypatch.setattr(hard_bundles, "trace", spoilt)
    assert hard_bundles.check(0, backend="opencl").wrong == 1
