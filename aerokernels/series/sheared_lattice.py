r"""Sums along parallel lines through a volume: first along the lines through the nodes, then interpolated between them.

Parallel lines that cross the planes of nodes at one shift a plane cross each plane at one fraction of its cells. So for
the lines through the nodes of one plane the spline's weights are the same four in each plane, w_k B_a(shift_k), and the
spline's inverse, which is a convolution, commutes with the sum over the planes:

    g(line) = inverse  sum over the planes k of  w_k sum_ab B_a B_b f_k(node of the line + shift_k + a, b)

g is then interpolated, by the same spline, to the lines asked for. Samples are read as they are, each for the few
lines that pass it, by a Warp kernel on the CPU's cores or on a GPU; a set of samples on the GPU stays there. Fourth
order, as the spline is; along an axis without shift the weights are a single one.
"""

from typing import Any

import numpy as np

from ..medium import spline
from ..opened import OPENED
from .plane_values import PlaneValues
from .warp_launch import launch

STILL = 1e-9  # of a cell, over the box, that lines along an axis may be shifted
LANES, GPU_LANES = 12, 4  # lines of one thread
MARGIN, STILL_MARGIN = 2, 8  # cells of the lattice beyond the lines asked for, with shift and without


class ShearedLattice:
    """The map from samples to sums along lines."""

    def __init__(self, shape, axis: int, places: np.ndarray, slope, middle: int, weights, within, averages: bool):
        """Work out the geometry.

        Args:
            shape: Nodes along each axis of the volume, four or more.
            axis: The main axis.
            places: Where the lines cross the plane `middle` [cells], shape (n, 2).
            slope: Their shift from a plane to the next one [cells], shape (2,).
            middle: Number of that plane.
            weights: Of the planes [m], shape (plane_count,).
            within: Which lines are wanted; the others' sums are zero, shape (n,).
            averages: The samples are averages over cells.
        """
        others = [k for k in range(3) if k != axis]
        strides = np.array([shape[1] * shape[2], shape[2], 1])
        self._shape = tuple(shape)
        self._counts = [shape[others[0]], shape[others[1]], shape[axis]]
        self._strides = [int(strides[k]) for k in (*others, axis)]
        shift = np.asarray(slope)[None, :] * (np.arange(shape[axis]) - middle)[:, None]
        sheared = np.abs(shift).max(axis=0) > STILL
        base = np.where(sheared, np.floor(shift), 0.0)
        blends = [
            spline.weights("cubic", shift[:, a] - base[:, a])[0].T if sheared[a] else np.ones((len(shift), 1))
            for a in range(2)
        ]
        self._taps = [one.shape[1] for one in blends]
        self._shift = (base - sheared).astype(np.int32)
        self._weights = [*blends, np.asarray(weights)]
        wanted = places[within] if within.any() else np.zeros((1, 2))
        margin = np.where(sheared, MARGIN, STILL_MARGIN)
        low = np.floor(wanted.min(axis=0)).astype(int) - margin
        high = np.ceil(wanted.max(axis=0)).astype(int) + margin
        for a in range(2):  # without shift there is nothing beyond the box
            if not sheared[a]:
                low[a], high[a] = max(low[a], 0), min(high[a], self._counts[a] - 1)
        self._low, self._size = low, high - low + 1
        self._values = PlaneValues(places - low, self._size, within, "cubic", False, averages, tuple(sheared))
        self._held: dict[tuple[str, str, int], dict[str, Any]] = {}

    def __call__(self, samples: np.ndarray, offset: float = 0.0) -> np.ndarray:
        """Sums of samples less a constant, on the processor's cores, shape (n,), float64."""
        import warp as wp

        from ..quiet_warp import start_warp

        start_warp()
        found = np.ascontiguousarray(samples)
        held = self._kept(str(found.dtype), "cpu", LANES)
        flat = wp.array(found.reshape(-1), dtype=held["real"], device="cpu", copy=False)
        launch(held["shear"], held["groups"], [flat, offset, *held["before"]], [held["sum"]], "cpu")
        return self._values(held["sum"].numpy().reshape(self._size))

    def on_gpu(self, samples: Any, device: str, offset: float = 0.0) -> np.ndarray:
        """The same with all of the work on a device of Warp's; samples of the host are copied there."""
        import warp as wp

        from ..quiet_warp import start_warp

        start_warp()
        there = isinstance(samples, wp.array)
        device = str(samples.device) if there else device
        array = samples if there else np.ascontiguousarray(samples)
        held = self._kept(
            getattr(array.dtype, "__name__", str(array.dtype)), device, GPU_LANES if self._taps[1] > 1 else 1
        )
        flat = array.flatten() if there else wp.array(array.reshape(-1), dtype=held["real"], device=device)
        shear, rows = held["shear"], held["rows"]
        launch(shear, held["groups"], [flat, offset, *held["before"]], [held["sum"]], device)
        values, (height, width) = held["sum"], self._size
        for axis, matrix in enumerate(held["maps"]):
            count = matrix["rows"]
            if axis == 0:
                strides, other, height = wp.vec4i(width, 1, width, 1), width, count
            else:
                strides, other, width = wp.vec4i(1, width, 1, count), height, count
            inputs = [values, matrix["start"], matrix["column"], matrix["entry"], strides, matrix["out"]]
            wp.launch(rows, dim=(count, other), inputs=inputs, device=device)
            values = matrix["out"]
        return self._values.taken(values.numpy().reshape(height, width).astype(np.float64))

    def _kept(self, precision: str, device: str, lanes: int) -> dict[str, Any]:
        """The kernels and what they are given, on a device."""
        if (precision, device, lanes) in self._held:
            return self._held[precision, device, lanes]
        import warp as wp

        from .shear_kernels import build_kernels

        real = {"float32": wp.float32, "float64": wp.float64}[precision]
        options = precision, *self._taps, lanes
        shear, rows = OPENED.once(("kernels of sheared lattices", *options), lambda: build_kernels(*options))

        def put(array: np.ndarray, kind: Any) -> Any:
            return wp.array(np.ascontiguousarray(array), dtype=kind, device=device)

        held: dict[str, Any] = {"real": real, "shear": shear, "rows": rows}
        held["before"] = [
            wp.vec3i(*self._counts),
            wp.vec3i(*self._strides),
            put(self._shift, wp.int32),
            *(put(one, real) for one in self._weights),
            wp.vec2i(*map(int, self._low)),
            int(self._size[1]),
        ]
        held["groups"] = int(self._size[0]) * -(-int(self._size[1]) // lanes)
        held["sum"] = wp.empty(int(np.prod(self._size)), dtype=real, device=device)
        held["maps"], size = [], list(map(int, self._size))
        for axis, matrix in enumerate(self._values.maps):
            size[axis] = matrix.shape[0]
            part = {"rows": matrix.shape[0], "out": wp.empty(size[0] * size[1], dtype=real, device=device)}
            for name, array in (("start", matrix.indptr), ("column", matrix.indices)):
                part[name] = put(array.astype(np.int32), wp.int32)
            held["maps"].append({**part, "entry": put(matrix.data, real)})
        self._held[precision, device, lanes] = held
        return held
