"""No ray, one ray, three million rays."""

import numpy as np
import pytest

from aerokernels.rays import RayBundle
from aerokernels.tracing import trace

from .checks import PRECISIONS, assert_same_bits, keeps_promises, random_field

RAY_COUNT = 3_000_000
# Traces the bundle whole, then every 9973rd ray alone; says what became of them and how much memory it took.
MILLIONS = """
import json, re, sys
from pathlib import Path
import numpy as np
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import trace

def memory(what):
    return 1024 * int(re.search(what + r":\\s*(\\d+) kB", Path("/proc/self/status").read_text())[1])

count = int(sys.argv[1])
y, z = np.meshgrid(np.linspace(-1.0, 1.0, 4), np.linspace(0.0, 1.0, 4), indexing="ij")
field = IndexField.from_samples(
    1e-7 * (1.0 + 0.2 * np.sin(2.0 * y) * np.cos(z)), origin=(-1.0, 0.0), spacing=(2 / 3, 1 / 3), geometry="planar"
)
place = np.arange(count) / count
position, direction = np.zeros((count, 3)), np.zeros((count, 3))
position[:, 1], position[:, 2] = 1.8 * place - 0.9, -0.1
direction[:, 1], direction[:, 2] = 0.1 * (1e3 * place % 1.0) - 0.05, 1.0
rays = RayBundle(position, direction)
del position, direction, place
trace(field, rays[:10], outputs=("opd",))  # compiled and loaded before memory is counted
Path("/proc/self/clear_refs").write_text("5")  # the peak so far, of building the bundle, is forgotten
before = memory("VmRSS")
result = trace(field, rays, outputs=("opd",))
used = memory("VmHWM") - before
rows = np.arange(0, count, 9973)
alone = trace(field, rays[rows], outputs=("opd",))
print(json.dumps({
    "used": used,
    "length": len(result.opd),
    "others": [name for name in ("position", "direction", "arc_length", "step_count")
               if getattr(result, name) is not None],
    "summary": result.status_summary(),
    "finite": bool(np.isfinite(result.opd).all()),
    "least": float(result.opd.min()),
    "greatest": float(result.opd.max()),
    "apart": float(np.abs(result.opd[rows] - alone.opd).max()),
    "same": bool(np.array_equal(result.status[rows], alone.status)),
}))
"""


def scattered(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Starts 1 mm ahead of the box of `random_field`, directions within a few tenths of a radian of the axis."""
    rng = np.random.default_rng(6)
    start = np.c_[rng.uniform(-1e-3, 1e-3, (count, 2)), np.full(count, -1e-3)]
    return start, np.c_[rng.normal(0.0, 0.1, (count, 2)), np.ones(count)]


@pytest.mark.parametrize("precision", PRECISIONS)
def test_one_ray_is_as_among_many(precision):
    """Each of some rays of a bundle, traced alone: the same bits."""
    field, (start, heading) = random_field("volume"), scattered(300)
    many = keeps_promises(trace(field, RayBundle(start, heading), method="adaptive", precision=precision), 300)
    for row in (0, 1, 149, 150, 299):
        ray = RayBundle(start[row : row + 1], heading[row : row + 1])
        one = keeps_promises(trace(field, ray, method="adaptive", precision=precision), 1)
        assert_same_bits(many, one, slice(row, row + 1))
