"""The lookup of a volume's cell in C++ is that of the loops in grid.py, to the bit."""

import numpy as np
import pytest
import warp as wp

from aerokernels.process.quiet_warp import start_warp
from aerokernels.tracing.engines.warp.kernels.native_lookup import build_volume_lookup
from aerokernels.tracing.engines.warp.library import library_of


def by_loops(cell: np.ndarray, weights: np.ndarray) -> list[float]:
    """Value and slopes of coefficients (4, 4, 4) by weights (6, 4): rows along the last axis, summed along it last."""
    wa, sa, wb, sb, wc, sc = weights
    rows = np.zeros((3, 4), cell.dtype)
    for i in range(4):
        sheet = np.zeros((2, 4), cell.dtype)
        for j in range(4):
            sheet += np.array([wb[j], sb[j]])[:, None] * cell[i, j]
        rows += np.array([wa[i], sa[i], wa[i]])[:, None] * sheet[[0, 0, 1]]
    terms = np.array([wc, wc, wc, sc]) * rows[[0, 1, 2, 0]]
    return list(((terms[:, 0] + terms[:, 1]) + terms[:, 2]) + terms[:, 3])


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_lookup_on_a_processor_sums_in_the_order_of_the_loops(precision):
    """Random coefficients and weights of sizes from 1e-3 to 1e3, eight places in a box of 6 x 7 x 9 nodes."""
    start_warp()
    library = library_of(precision)
    real, vec4 = library.types.real, library.types.vec4
    lookup = build_volume_lookup(library)

    @wp.kernel(module="unique", enable_backward=False)
    def look(
        coefficients: wp.array(dtype=real),
        starts: wp.array(dtype=int),
        pitch: wp.vec3i,
        weights: wp.array(dtype=vec4, ndim=2),
        found_out: wp.array(dtype=vec4),
    ):
        n = wp.tid()
        w = weights[n]
        found_out[n] = lookup(coefficients, starts[n], pitch, w[0], w[1], w[2], w[3], w[4], w[5])

    rng = np.random.default_rng(0)
    box = (rng.standard_normal((6, 7, 9)) * 10.0 ** rng.uniform(-3, 3, (6, 7, 9))).astype(precision)
    weights = (rng.standard_normal((8, 6, 4)) * 10.0 ** rng.uniform(-3, 3, (8, 6, 4))).astype(precision)
    corner = rng.integers(0, (3, 4, 6), (8, 3))
    corner[0] = 2, 3, 5  # the last cell
    found = wp.zeros(8, dtype=vec4, device="cpu")
    inputs = [
        wp.array(box.ravel(), dtype=real, device="cpu"),
        wp.array((corner @ (63, 9, 1)).astype(np.int32), dtype=int, device="cpu"),
        wp.vec3i(63, 9, 1),
        wp.array(weights, dtype=vec4, device="cpu"),
    ]
    wp.launch(look, dim=8, inputs=inputs, outputs=[found], device="cpu")
    right = [by_loops(box[a : a + 4, b : b + 4, c : c + 4], w) for (a, b, c), w in zip(corner, weights, strict=True)]
    assert found.numpy().tobytes() == np.array(right, precision).tobytes()
