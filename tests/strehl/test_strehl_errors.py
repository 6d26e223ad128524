"""The errors of an estimate's numbers: formulas against NumPy, and numbers against exact ones."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField, RayBundle, estimate_strehl, trace
from aerokernels.tracing import Plane

PUPIL = Disc(4e-3, (0.0, 1e-3, -12e-3))
# The media fade out toward both ends of their boxes as exp(-(z / 3 mm)^2): so much of them is on a ray.
DEPTH = 0.003 * np.sqrt(np.pi)  # [m]


def ramp(slope: float, spacing: float = 5e-4) -> IndexField:
    """A planar field whose contrast rises along y by `slope` [1/m]: a prism."""
    y, z = np.arange(-0.01, 0.01 + 1e-9, spacing), np.arange(-0.012, 0.012 + 1e-9, spacing)
    contrast = slope * (y[:, None] + 0.01) * np.exp(-((z / 0.003) ** 2))
    return IndexField.from_samples(contrast, origin=(y[0], z[0]), spacing=(spacing, spacing), geometry="planar")


def blob(spacing: float) -> IndexField:
    """A lump of gas of 4 mm, sampled."""
    y, z = np.arange(-0.012, 0.012 + 1e-9, spacing), np.arange(-0.012, 0.012 + 1e-9, spacing)
    contrast = 2e-5 * np.exp(-((y[:, None] - 0.002) ** 2 + z**2) / 0.004**2)
    return IndexField.from_samples(contrast, origin=(y[0], z[0]), spacing=(spacing, spacing), geometry="planar")


@pytest.mark.parametrize("slope", [1e-4, -4e-5])
def test_a_prism_deflects_within_the_error_told(slope):
    """Set-up: n = 1 + g y over L. Formula: OPD = g y L, so that the boresight is g L and the OPD rms |g| L a / 2.

    Error: bending, g^2 L^2, 1e-12 of the path; the sum over rays. Tolerance: what the estimate says, which is
    above 0 and small against the numbers.
    """
    found = estimate_strehl(ramp(slope), PUPIL, ray_count=16384)
    quantities = found.quantities
    expected = {"boresight_x": 0.0, "boresight_y": DEPTH * slope, "opd_rms": 0.5 * DEPTH * abs(slope) * PUPIL.radius}
    for name, value in expected.items():
        quantity = quantities[name]
        assert quantity.error > 0.0 and abs(quantity.value - value) <= quantity.error, name
        assert quantity.error < 0.1 * DEPTH * abs(slope) * (1.0 if "rad" in quantity.unit else PUPIL.radius), name
    assert quantities["value"].error == found.error["total"]
    assert " +- " in repr(found).splitlines()[0] and "boresight" in repr(found) and "rays" in repr(found)


@pytest.mark.parametrize("spacing", [2e-3, 1e-3])
def test_numbers_of_a_coarse_grid_are_within_their_errors(spacing):
    """Against the same lump sampled ten times finer: the Strehl ratio, Marechal's, the OPD rms and the boresight."""
    fine, coarse = (estimate_strehl(blob(step), PUPIL, ray_count=4096).quantities for step in (1e-4, spacing))
    for name, quantity in coarse.items():
        assert abs(quantity.value - fine[name].value) <= quantity.error + fine[name].error, name


def test_what_a_field_of_noise_says_is_worth_nothing():
    """Set-up: samples that are noise of 2e-4, so that every other node left out changes all. Expected: said so."""
    z = np.arange(-0.012, 0.0121, 5e-4)
    contrast = np.random.default_rng(5).normal(scale=4e-4, size=(41, len(z))) * np.exp(-((z / 0.003) ** 2))
    field = IndexField.from_samples(contrast, origin=(-0.01, z[0]), spacing=(5e-4, 5e-4), geometry="planar")
    found = estimate_strehl(field, PUPIL, ray_count=4096)
    assert found.error["total"] > found.value and found.verdict.worthless
    assert "finer cells" in found.verdict.reason and found.verdict.reason in repr(found)


def test_a_symmetric_estimate_has_no_boresight_and_says_so():
    r, z = np.arange(0.0, 0.0101, 5e-4), np.arange(-0.01, 0.0101, 5e-4)
    contrast = 1e-5 * np.exp(-(r[:, None] ** 2 + z**2) / 0.004**2)
    field = IndexField.from_samples(contrast, origin=(0.0, z[0]), spacing=(5e-4, 5e-4), geometry="axisymmetric")
    found = estimate_strehl(field, Disc(4e-3, (0.0, 0.0, -8e-3)), ray_count=4096)
    assert found.quantities["boresight_x"].error == 0.0 and "0, 0 urad, error below rounding" in repr(found)
    assert found.verdict.level == "fine"


def test_a_trace_says_its_rays_and_its_error():
    """Set-up: the prism. Expected: the rms of OPD = g y L over the rays, +- the budget's total, and how rays ended."""
    rays = RayBundle.collimated(PUPIL, 500)
    found = trace(ramp(1e-4), rays, until=Plane((0.0, 0.0, 0.015), (0.0, 0.0, 1.0)))
    expected = np.std(1e-4 * DEPTH * rays.position[:, 1])
    rms = found.quantities["opd_rms"]
    assert abs(rms.value - expected) <= rms.error == found.error["total"]
    assert "500 OK" in repr(found) and " +- " in repr(found) and str(found.plan).splitlines()[0] in repr(found)
    behind = trace(ramp(1e-4), rays, until=Plane((0.0, 0.0, -0.02), (0.0, 0.0, 1.0)))
    assert "500 STOP_NOT_REACHED" in repr(behind) and "OPD rms none" in repr(behind)
    few = trace(ramp(1e-4), rays, outputs=("position",))
    assert "OPD" not in repr(few) and "500 rays" in repr(few)
