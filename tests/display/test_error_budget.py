"""Errors by cause: their order, their total, and how they print, wherever they come from."""

import json
import pickle

import numpy as np
import pytest

import aerokernels as ak

ORDER = "step precision interpolation jumps resampling truncation refractivity bundle sampling total".split()
Y = np.linspace(-6e-3, 6e-3, 49)
DENSITY = 1.2 + 0.1 * np.exp(-(Y[:, None] ** 2 + Y**2) / 2e-3**2)
PUPIL = ak.Disc(3e-3, (0.0, 0.0, -7e-3))


@pytest.fixture(scope="module")
def budgets() -> dict[str, dict[str, float]]:
    """Budgets of a trace, a Strehl estimate and a wavefront, through a density whose relation is uncertain."""
    density = ak.flow.GridDensity(DENSITY, [Y[0]] * 2, [Y[1] - Y[0]] * 2, "planar", 1.2)
    field = density.index_field(wavelength=905e-9, relation="paper")
    return {
        "trace": ak.trace(field, ak.RayBundle.collimated(PUPIL, 500)).error,
        "strehl": ak.estimate_strehl(field, PUPIL, ray_count=1024).error,
        "wavefront": ak.wavefront(field, PUPIL, pixel_count=16).error,
    }


@pytest.mark.parametrize("door", ["trace", "strehl", "wavefront"])
def test_every_door_has_the_same_entries_and_the_same_total(budgets, door):
    error = budgets[door]
    assert list(error) == ORDER and error["refractivity"] > 0.0
    assert error["total"] == pytest.approx(np.linalg.norm([error[cause] for cause in ORDER[:-1]]), rel=1e-12)
    assert isinstance(error, dict) and json.loads(json.dumps(error)) == error
    again = pickle.loads(pickle.dumps(error))
    assert again == error and repr(again) == repr(error)
    text = str(error)
    assert "\n" not in text and f"total {(1.0 if door == 'strehl' else 1e9) * error['total']:.2g}" in text
    assert ("[nm]" in text) == (door != "strehl") and len(text) < 250
