"""Products of matrices in pieces that one core does."""

import numpy as np
import pytest

from aerokernels.process import threads
from aerokernels.process.threads import product_on_one_core


@pytest.mark.parametrize("kind", [np.float32, np.complex128])
@pytest.mark.parametrize("stack", [(), (3,)])
def test_pieces_make_the_product(kind: type, stack: tuple[int, ...], monkeypatch):
    """Pieces of 1 to 40 rows of 40; each is no larger than BLAS leaves to one thread, where one row is not already."""
    rng = np.random.default_rng(1)
    left = rng.standard_normal((*stack, 40, 7)).astype(kind)
    right = rng.standard_normal((7, 5)).astype(kind)
    expected = np.einsum("...ij,jk->...ik", left, right)
    for most in (1, 280, 1000, 1 << 20):
        monkeypatch.setattr(threads, "SHARED_OUT", most)
        found = product_on_one_core(left, right)
        assert found.dtype == kind and found.shape == expected.shape
        np.testing.assert_allclose(found, expected, atol=1e-5)
