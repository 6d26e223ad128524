"""Maps that are traced: through plates whose wavefront is known, on any pupil, in any direction."""

import numpy as np
import pytest

from aerokernels import Annulus, Disc, Mask, Rectangle, estimate_strehl, strehl, wavefront
from tests.phase_plates import RADIUS, WAVELENGTH, modes, phase_plate

BEHIND = (0.0, 0.0, -1e-3)


@pytest.mark.parametrize(
    "pupil",
    [Disc(RADIUS, BEHIND), Annulus(RADIUS, 1e-3, BEHIND), Rectangle(3e-3, 2e-3, BEHIND),
     Mask(np.outer(np.hanning(18)[1:-1], np.hanning(18)[1:-1]), 2e-4, BEHIND)],
    ids=lambda pupil: type(pupil).__name__,
)  # fmt: skip
def test_a_traced_wavefront_is_the_plates_and_the_estimates(pupil):
    """The map is the plate's OPD but for the path that bending adds, angle^2 / 2 times 5 mm.

    Its Strehl ratio is that of 16 x 1024 Sobol points to 2e-3.
    """
    opd = modes({3: 4e-8, 4: 5e-8, 5: -4e-8, 8: 3e-8})
    field = phase_plate(opd, 4e-3)
    found = wavefront(field, pupil, wavelength=WAVELENGTH, pixel_count=64)
    x, y = np.meshgrid(found.coordinate, found.coordinate)
    assert np.nanmax(np.abs(found.opd - opd(x, y))) < 1e-9
    assert found.blocked == 0.0 and found.plan is not None and found.seconds["total"] > 0.0
    estimate = estimate_strehl(field, pupil, wavelength=WAVELENGTH, ray_count=1 << 14)
    assert found.strehl() == pytest.approx(estimate.value, abs=2e-3)
    assert found.rms == pytest.approx(estimate.opd_rms, rel=1e-2)
    assert found.tilt == pytest.approx(estimate.boresight, abs=3e-7)
    assert found.strehl() == pytest.approx(
        strehl(found.opd, WAVELENGTH, found.weight), abs=1e-14
    )  # one formula, whatever the way
    assert "Strehl ratio 0." in repr(found) and 0.0 < found.opd_error < 1e-8


def test_a_mask_is_traced_on_its_own_pixels():
    weights = np.random.default_rng(5).uniform(0.1, 1.0, (9, 9))
    found = wavefront(phase_plate(modes({4: 5e-8}), 4e-3), Mask(weights, 2e-4, BEHIND), wavelength=WAVELENGTH)
    assert found.weight == pytest.approx(weights, abs=1e-12) and found.pixel == pytest.approx(2e-4)


def test_a_slanted_look_sees_the_plate_from_aside():
    """Thin plate, rays along (a, 0, 1): what they gather at x is the plate at x + a (its depth's middle - start).

    The map's coordinates are across the look direction: x is longer by sqrt(1 + a^2) in the pupil's plane.
    """
    field = phase_plate(lambda x, y: 1e-7 * np.sin(1500.0 * x) + 0.0 * y, 4e-3, count=81)
    slope = 0.2
    found = wavefront(field, Disc(1e-3, BEHIND), direction=(slope, 0.0, 1.0), wavelength=WAVELENGTH, pixel_count=24)
    depth = 1e-3 + 1e-3  # from the pupil to the middle of the plate
    longer = np.sqrt(1.0 + slope**2)
    expected = 1e-7 * np.sin(1500.0 * (longer * found.coordinate + slope * depth)) * longer
    row = found.opd[12]
    good = np.isfinite(row)
    assert np.abs(row[good] - expected[good]).max() < 5e-9  # the plate is 2 mm thick: 0.2 mm of x
