"""Frames to test with."""

import numpy as np
import pytest

from aerokernels.hardware.frames import EchoFrame


@pytest.fixture
def frames() -> list[EchoFrame]:
    """Twelve frames of different lengths (none, short, longer than a COBS block), with zero bytes and 0xFF in them."""
    random = np.random.default_rng(7)
    found = []
    for sequence in range(12):
        samples = random.integers(-3, 4, size=(0, 1, 5, 126, 127, 300)[sequence % 6]).astype(np.int16)
        found.append(EchoFrame(sequence, 20_000 * sequence, 1000, 2.0**-12, 0.125, samples, flags=sequence))
    return found
