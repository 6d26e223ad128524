r"""Sums along parallel lines through a volume: first along lines through the nodes, then interpolated between them.

Parallel lines that shift by the same amount from plane to plane cross each plane at the same fraction of its cells. So
for the lines through the nodes of one plane the spline's weights in another plane are the same four, w_k B_a(shift_k),
and the spline's inverse, which is a convolution, commutes with the sum over the planes:

    g(line) = inverse  sum over the planes k of  w_k sum_ab B_a B_b f_k(node of the line + shift_k + a, b)

g is then interpolated, by the same spline, to the requested lines. Samples are read as they are: on the processor by
products of matrices (sheared_products.py), on a GPU by a kernel (sheared_device.py), where samples on the GPU stay.
Fourth order, like the spline; along an axis without shift there is a single weight.
"""

from functools import cached_property
from typing import Any

import numpy as np

from ..medium import spline
from .plane_values import PlaneValues
from .sheared_products import ShearedProducts

STILL = 1e-9  # of a cell, over the box: a smaller shift counts as none
MARGIN, STILL_MARGIN = 2, 8  # cells of the lattice beyond the requested lines, with shift and without


class ShearedLattice:
    """The map from samples to sums along lines.

    Attributes:
        shape: Nodes along each axis of the volume.
        axis: The main axis.
        others: The other two axes.
        shift: Offset of the first node of each plane from a line's own node [cells], shape (plane_count, 2).
        blends: Weights of the nodes from there on along each axis, shapes (plane_count, taps).
        weights: Of the planes [m], shape (plane_count,).
        low: The lattice's first line along each axis [cells], shape (2,).
        size: Its lines along each axis, shape (2,).
        values: From the lattice to the requested lines.
    """

    def __init__(self, shape, axis: int, places: np.ndarray, slope, middle: int, weights, within, averages: bool):
        """Compute the geometry.

        Args:
            shape: Nodes along each axis of the volume, four or more.
            axis: The main axis.
            places: Where the lines cross the plane `middle` [cells], shape (n, 2).
            slope: Their shift from one plane to the next [cells], shape (2,).
            middle: Number of that plane.
            weights: Of the planes [m], shape (plane_count,).
            within: Which lines are needed; the others' sums are zero, shape (n,).
            averages: The samples are cell averages.
        """
        self.shape, self.axis = tuple(shape), axis
        self.others = [k for k in range(3) if k != axis]
        counts = [shape[k] for k in self.others]
        shift = np.asarray(slope)[None, :] * (np.arange(shape[axis]) - middle)[:, None]
        sheared = np.abs(shift).max(axis=0) > STILL
        base = np.where(sheared, np.floor(shift), 0.0)
        self.blends = [
            spline.weights("cubic", shift[:, a] - base[:, a])[0].T if sheared[a] else np.ones((len(shift), 1))
            for a in range(2)
        ]
        self.shift = (base - sheared).astype(np.int32)
        self.weights = np.asarray(weights)
        wanted = places[within] if within.any() else np.zeros((1, 2))
        margin = np.where(sheared, MARGIN, STILL_MARGIN)
        low = np.floor(wanted.min(axis=0)).astype(int) - margin
        high = np.ceil(wanted.max(axis=0)).astype(int) + margin
        for a in range(2):  # without shift no line is beyond the box
            if not sheared[a]:
                low[a], high[a] = max(low[a], 0), min(high[a], counts[a] - 1)
        self.low, self.size = low, high - low + 1
        self.values = PlaneValues(places - low, self.size, within, "cubic", False, averages, tuple(sheared))
        self._devices: dict[tuple[str, str], Any] = {}

    def __call__(self, samples: np.ndarray, offset: float = 0.0) -> np.ndarray:
        """Return sums of samples minus a constant, on the processor's cores, shape (n,), float64."""
        return self.values(self._products(samples, offset))

    @cached_property
    def _products(self) -> ShearedProducts:
        counts = [self.shape[k] for k in self.others]
        return ShearedProducts(self.axis, counts, self.shift, self.blends, self.weights, self.low, self.size)

    def on_device(self, samples: Any, device: str, offset: float = 0.0) -> np.ndarray:
        """Return the same sums, computed entirely on a Warp device.

        Args:
            samples: Samples; a Warp array on a GPU is summed there.
            device: By its name in Warp, for other samples.
            offset: The constant.
        """
        from aerokernels.series.sheared_device import DeviceLattice, to_device

        there = to_device(samples, device)
        key = there.dtype.__name__, str(there.device)
        if key not in self._devices:
            self._devices[key] = DeviceLattice(self, *key)
        return np.asarray(self._devices[key](there, offset))
