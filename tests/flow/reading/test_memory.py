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


@pytest.mark.parametrize(
    ("frame", "turned"),
    [({"optical": "-x"}, lambda x, y, z: (z, y, -x)), ({"optical": "+y", "up": "+x"}, lambda x, y, z: (z, x, y))],
)
def test_a_grid_that_is_kept_is_where_the_frame_puts_it(tmp_path, frame, turned):
    """Set-up: unlike axes, millimetres and an origin. Expected: each node's density at its place in the frame."""
    values = density(*np.meshgrid(*AXES, indexing="ij"))
    np.savez(tmp_path / "a.npz", **{n: 1e3 * axis for n, axis in zip("xyz", AXES, strict=True)}, rho=values)
    field = flow.read(tmp_path / "a.npz", frame={**frame, "origin": (10.0, 20.0, 30.0)}, length_unit="mm")
    places = np.random.default_rng(1).integers(1, 88, (50, 3))
    own = np.stack([axis[k] for axis, k in zip(AXES, places.T, strict=True)])
    moved = np.stack(turned(*(own - np.array([[0.01], [0.02], [0.03]]))), axis=1)
    assert field.resampling is None
    np.testing.assert_allclose(field.density_at(moved), density(*own), rtol=1e-10)


def test_a_grid_of_uneven_axes_is_resampled(tmp_path):
    """Set-up: nodes along z whose distances grow. Expected: a grid with a measured error, right in between."""
    axes = [AXES[0][::6], AXES[1][::6], 0.2 + 0.1 * np.linspace(0.0, 1.0, 20) ** 1.5]
    values = 1.0 + axes[0][:, None, None] + 2.0 * axes[1][:, None] - axes[2]
    np.savez(tmp_path / "a.npz", **dict(zip("xyz", axes, strict=True)), rho=values.astype(np.float32))
    field = flow.read(tmp_path / "a.npz")
    at = np.array([[0.0, 0.05, 0.25], [0.02, 0.03, 0.21]])
    assert field.resampling is not None
    np.testing.assert_allclose(field.density_at(at), 1.0 + at[:, 0] + 2.0 * at[:, 1] - at[:, 2], rtol=1e-5)
