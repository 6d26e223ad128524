"""The memory that a volume takes while it is read, in sizes of its float32 array."""

import tracemalloc

import numpy as np
import pytest

from aerokernels import flow

AXES = [np.linspace(low, low + 0.1, count) for low, count in ((-0.05, 110), (0.0, 100), (0.2, 90))]


def density(x, y, z):
    return 1.0 + x + 0.5 * np.sin(20.0 * y) * z


@pytest.mark.parametrize("backwards", [False, True])
def test_a_volume_takes_at_most_five_times_its_array(tmp_path, backwards: bool):
    """Set-up: 110 x 100 x 90 densities in float32, [x, y, z] or [z, y, x]. Peaks of NumPy's allocations are counted.

    Expected: at most 5 arrays, of which the field's own float64 is 2 and that of its index 2 more; coordinates of each
    sample, which no uniform grid needs, would be 6. The values are those of the array, bit by bit.
    """
    values = density(*np.meshgrid(*AXES, indexing="ij")).astype(np.float32)
    small = [axis[::step] for axis, step in zip(AXES, (30, 40, 50), strict=True)]
    np.savez(tmp_path / "small.npz", **dict(zip("xyz", small, strict=True)), rho=values[::30, ::40, ::50])
    stored = values.T.copy() if backwards else values
    np.savez(tmp_path / "a.npz", **dict(zip("xyz", AXES, strict=True)), rho=stored)
    flow.read(tmp_path / "small.npz").index_field()  # imports what is needed
    tracemalloc.start()
    try:
        field = flow.read(tmp_path / "a.npz")
        index = field.index_field()
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 5.0 * values.nbytes and index.is_uniform
    assert np.array_equal(field.density, values) and field.density.dtype == np.float64
    np.testing.assert_allclose(field.box, [[axis[0] for axis in AXES], [axis[-1] for axis in AXES]], rtol=1e-15)
