"""Parts of pupils' quadratures by exact answers."""

import numpy as np
import pytest

from aerokernels import Disc, IndexField, estimate_strehl
from aerokernels.tracing.pupil.sums import _reverse_bits


def test_bits_are_reversed():
    """Of 32 bits, as their binary digits say; twice gives the number back."""
    numbers = np.array([0, 1, 2, 3, 0x12345678, 0x80000001, 0xFFFFFFFF, 65537, 40503 * 65536 + 977], dtype=np.uint32)
    expected = [int(f"{int(one):032b}"[::-1], 2) for one in numbers]
    assert _reverse_bits(numbers).tolist() == expected
    np.testing.assert_array_equal(_reverse_bits(_reverse_bits(numbers)), numbers)


@pytest.mark.parametrize("across", [0, 1])
@pytest.mark.parametrize("bundle", ["auto", "off"])
def test_a_prism_tilts_what_the_reference_engine_sees(across: int, bundle: str):
    """Contrast g x over the length L turns light by g L; along the other axis by nothing, and the OPD is flat."""
    slope, length, half = 1e-3, 0.02, 0.01
    place = np.linspace(-half, half, 9)
    shape = [1, 1, 1]
    shape[across] = 9
    samples = np.broadcast_to(slope * place.reshape(shape), (9, 9, 9))
    field = IndexField.from_samples(
        np.ascontiguousarray(samples), origin=(-half, -half, 0.0), spacing=(half / 4, half / 4, length / 8),
        geometry="volume",
    )  # fmt: skip
    pupil = Disc(0.004, (1e-3, -2e-3, -1e-3))
    options = {"ray_count": 64, "backend": "reference", "precision": "float64", "bundle": bundle}
    options |= {"remove": ("piston", "tilt"), "allow_truncation": True}
    found = estimate_strehl(field, pupil, wavelength=1e-6, **options)
    expected = np.zeros(2)
    expected[across] = slope * length
    np.testing.assert_allclose(np.abs(found.boresight), expected, atol=0.02 * slope * length)
    assert found.opd_rms < 1e-9
