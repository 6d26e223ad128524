"""A high pass along one axis of a grid as products with cached matrices, for rays that run along that axis.

A cosine transform, weights of its components and the inverse transform form a linear operator that is symmetric under
reversal of the axis. Values that are even about the axis's middle and values that are odd therefore each have a matrix
of half the size. Where only some nodes are requested, only their columns are used.
"""

from dataclasses import dataclass

import numpy as np

from aerokernels.process.threads import product_on_one_core


@dataclass(frozen=True, eq=False)
class PassAlong:
    """The matrices of a high pass along an axis, applied to values at its nodes.

    Attributes:
        even: For sums of values and their mirror images, shape (nodes + 1) // 2 squared.
        odd: For their differences, shape nodes // 2 squared.
        whole: For the values themselves, shape (nodes, nodes).
    """

    even: np.ndarray
    odd: np.ndarray
    whole: np.ndarray

    @classmethod
    def of_shares(cls, share: np.ndarray) -> "PassAlong":
        """Make the matrices from the weights of the cosines that are passed, shape (nodes,)."""
        from scipy.fft import dct, idct

        count = len(share)
        half, whole = count // 2, idct(share * dct(np.eye(count), 1), 1)
        mirrored = whole[:, ::-1]
        even = 0.5 * (whole + mirrored)[: count - half, : count - half]
        odd = 0.5 * (whole - mirrored)[:half, :half]
        return cls(*(np.ascontiguousarray(part, share.dtype) for part in (even, odd, whole)))

    def of_all(self, values: np.ndarray) -> np.ndarray:
        """Return the passed part of values along the last axis."""
        count = values.shape[-1]
        half = count // 2
        rows = values.reshape(-1, count)
        mirrored = rows[:, ::-1]
        sums = rows[:, : count - half].copy()
        sums[:, :half] += mirrored[:, :half]
        both = product_on_one_core(sums, self.even)
        sided = product_on_one_core(rows[:, :half] - mirrored[:, :half], self.odd)
        found = np.empty_like(rows)
        found[:, : count - half] = both
        found[:, :half] += sided
        np.subtract(both[:, :half], sided, out=found[:, ::-1][:, :half])
        return found.reshape(values.shape)

    def of_some(self, values: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """Return the passed part at some nodes of the last axis, given by number, and 0 at the others."""
        rows = values.reshape(-1, values.shape[-1])
        found = np.zeros_like(rows)
        found[:, nodes] = product_on_one_core(rows, np.ascontiguousarray(self.whole[:, nodes]))
        return found.reshape(values.shape)
