"""The memory that an estimate takes, in sizes of a volume's float32 samples."""

import os
import subprocess
import sys

import pytest

# Prints the growth of the process's greatest memory over that of a small field, in sizes of the samples.
ESTIMATE = """
import resource, sys
import numpy as np
from aerokernels import Disc, IndexField, estimate_strehl

def estimate(count):
    axis = np.linspace(-1.0, 1.0, count, dtype=np.float32)
    samples = np.empty((count, count, count), np.float32)
    for x, layer in zip(axis, samples):
        wave = np.sin(5 * x + 3 * axis[:, None]) * np.cos(7 * axis)
        layer[...] = 1e-6 * wave * np.exp(-28 * (x**2 + axis[:, None] ** 2 + axis**2))
    spacing = [0.1 / (count - 1)] * 3
    field = IndexField.from_samples(samples, origin=[-0.05] * 3, spacing=spacing, geometry="volume")
    direction = None if sys.argv[2] == "straight" else (0.1, 0.05, 1.0)
    pupil = Disc(radius=0.02, center=(0.001, 0.002, -0.1))
    assert estimate_strehl(field, pupil, direction=direction, backend=sys.argv[1]).value > 0.99
    return samples.nbytes

def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)

estimate(24)
before = peak()
size = estimate(208)
print((peak() - before) / size)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no getrusage")
@pytest.mark.parametrize(("backend", "direction"), [("opencl", "tilted"), ("warp", "straight")])
def test_an_estimate_takes_at_most_five_times_the_samples(backend: str, direction: str):
    """Set-up: 208^3 float32 samples (36 MB), in a fresh process for a CPU.

    Expected: at most 5 arrays, of which the caller's, the field's and its spline are one each, and what rays along one
    axis do not resolve, or its transform, is one more; the rest are slabs and what the engine loads.
    """
    environment = {**os.environ, "CUDA_VISIBLE_DEVICES": ""}
    done = subprocess.run(
        [sys.executable, "-c", ESTIMATE, backend, direction], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout.split()[-1]) < 5.0
