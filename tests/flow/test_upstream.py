"""What a field owes to how it was made reaches the budgets of what is traced through it."""

import numpy as np
import pytest

from aerokernels import Disc, RayBundle, estimate_strehl, flow, trace
from aerokernels.flow.reading.volumes.resampling import VolumeResampling

WAVE = 905e-9


def volume(column: float) -> flow.GridDensity:
    """A lens of air on 12^3 nodes, 1 mm apart, said to be resampled with an error of its columns [kg/m2]."""
    axis = np.arange(12.0) - 5.5
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    density = 1.0 + 0.5 * np.exp(-(x**2 + y**2 + z**2) / 6.0)
    told = VolumeResampling((1e-3,) * 3, 0.0, 0.0, column, 2.0 * column, 0.0, 0.0, 0.0)
    return flow.GridDensity(density, [-5.5e-3] * 3, [1e-3] * 3, "volume", 1.0, resampling=told)


def test_a_volumes_resampling_is_an_error_of_resampling():
    """Set-up: columns off by 1e-4 kg/m2 rms. Expected: "resampling" is K times that, times 2, and in the total."""
    relation = {"relation": "gladstone-dale", "constant": 2.25e-4}
    rays = RayBundle(np.array([[1e-3, 0.5e-3, -6e-3], [-1e-3, 2e-3, -6e-3]]), [(0.0, 0.0, 1.0)])
    found = trace(volume(1e-4).index_field(WAVE, **relation), rays, backend="reference").error
    assert found["resampling"] == pytest.approx(2.0 * 2.25e-4 * 1e-4, rel=0.02)
    assert found["total"] > found["resampling"] and found["refractivity"] == 0.0
    assert trace(volume(0.0).index_field(WAVE, **relation), rays, backend="reference").error["resampling"] == 0.0


def test_the_models_uncertainty_is_part_of_the_total():
    """Set-up: eq 2, 1.2 % uncertain. Expected: twice that of a trace's OPD about its mean, and of a Strehl ratio."""
    field = volume(0.0).index_field(WAVE, "paper")
    assert field.upstream.refractivity == 1.2e-2 and field.upstream.model.startswith("paper")
    assert volume(0.0).index_field(WAVE, "ciddor").upstream.refractivity < 1e-3
    rays = RayBundle(np.array([[1e-3, 0.5e-3, -6e-3], [-1e-3, 2e-3, -6e-3]]), [(0.0, 0.0, 1.0)])
    traced = trace(field, rays, backend="reference")
    assert traced.error["refractivity"] == pytest.approx(2.0 * 1.2e-2 * np.std(traced.opd), rel=1e-3)
    others = [value for cause, value in traced.error.items() if cause != "total"]
    assert traced.error["total"] == pytest.approx(float(np.linalg.norm(others)), rel=1e-12)
    pupil = Disc(2e-3, center=(0.0, 0.0, -6e-3))
    seen = estimate_strehl(field, pupil, wavelength=WAVE, ray_count=1024, allow_truncation=True)
    change = abs(seen.value - np.exp(np.log(seen.value) * 1.012**2))  # ln S goes with the square of the phase
    assert seen.error["refractivity"] == pytest.approx(2.0 * change, rel=0.1)
