"""The map of sheared_lattice.py on a Warp device; only one number a line returns to the host."""

from typing import Any

import numpy as np

from aerokernels.process.opened import OPENED
from aerokernels.series.shear_kernels import launch


def to_device(samples: Any, device: str) -> Any:
    """Return samples as a flat Warp array on a device; one on a GPU stays there.

    Later work on the device waits for the copy, which may still be in progress; samples on the host have been read.
    """
    import warp as wp

    from ..device_arrays.pinned import bring
    from ..process.quiet_warp import open_device

    there = open_device(device)
    if isinstance(samples, wp.array):
        flat = samples.contiguous().flatten()
        if flat.device.is_cuda or not there.is_cuda:
            return flat
        copy = wp.empty_like(flat, device=there)
        wp.copy(copy, flat)
        wp.synchronize_stream(there)
        return copy
    values = np.ascontiguousarray(samples).reshape(-1)
    copy = wp.empty(values.size, dtype=wp.dtype_from_numpy(values.dtype), device=there)
    for _ in bring([values], [copy]):
        pass
    return copy


class DeviceLattice:
    """Sums along the lines of a lattice, on a device."""

    def __init__(self, lattice: Any, precision: str, device: str):
        """Copy the data that depend on the direction to the device, and build the kernels.

        Args:
            lattice: The ShearedLattice.
            precision: Of the samples, "float32" or "float64".
            device: By its name in Warp.
        """
        import warp as wp

        from ..process.quiet_warp import open_device
        from .shear_kernels import shear_kernels

        open_device(device)
        self._device = device
        real: Any = {"float32": wp.float32, "float64": wp.float64}[precision]
        taps = [one.shape[1] for one in lattice.blends]
        lanes = 4 if taps[1] > 1 else 1  # neighbouring lines of one thread, which share most of their nodes
        planes = lattice.shape[lattice.axis]
        strides = np.array([lattice.shape[1] * lattice.shape[2], lattice.shape[2], 1])
        parts = (
            32 if lattice.axis == 2 and planes >= 32 else 1
        )  # planes contiguous in memory: a warp reads them together
        options = precision, *taps, lanes, parts
        self._kernels = OPENED.once(("kernels of sheared lattices", *options), lambda: shear_kernels(*options))

        def put(array: np.ndarray, kind: Any = real) -> Any:
            return wp.array(np.ascontiguousarray(array), dtype=kind, device=device)

        def matrix(rows: Any) -> list[Any]:
            indices = [put(one.astype(np.int32), wp.int32) for one in (rows.indptr, rows.indices)]
            return [*indices, put(rows.data)]

        height, width = map(int, lattice.size)
        self._parts, self._lines = parts, height * width
        self._before = [
            wp.vec3i(*(lattice.shape[k] for k in (*lattice.others, lattice.axis))),
            wp.vec3i(*(int(strides[k]) for k in (*lattice.others, lattice.axis))),
            put(lattice.shift, wp.int32),
            *map(put, (*lattice.blends, lattice.weights)),
            wp.vec2i(*map(int, lattice.low)),
            width,
        ]
        self._groups = height * -(-width // lanes)
        self._partial = wp.empty(self._lines * parts, dtype=real, device=device)
        self._total = wp.empty(self._lines, dtype=real, device=device) if parts > 1 else self._partial
        # Interpolation between the lines of the lattice: a sparse matrix along each axis, and a rule to pick points.
        maps = lattice.values.maps
        sizes = [(maps[0].shape[0], width), (maps[0].shape[0], maps[1].shape[0])]
        across = [wp.vec4i(width, 1, width, 1), wp.vec4i(1, width, 1, sizes[1][1])]
        self._maps = [
            (matrix(one), strides, (size[a], size[1 - a]), wp.empty(size[0] * size[1], dtype=real, device=device))
            for a, (one, strides, size) in enumerate(zip(maps, across, sizes, strict=True))
        ]
        index, rows = lattice.values.rule
        self._index = None if index is None else put(index.astype(np.int32), wp.int32)
        self._rows = None if rows is None else matrix(rows)
        count = lattice.values.count
        self._found = wp.empty(count, dtype=real, device=device)
        self._host = wp.empty(count, dtype=real, device="cpu", pinned=device != "cpu")

    def __call__(self, samples: Any, offset: float) -> np.ndarray:
        """Return sums of samples, a flat array on the device, minus a constant: shape (n,), float64."""
        import warp as wp

        from ..device_arrays.launching import launch as warp_launch

        shear, gather, rows, take = self._kernels
        device = self._device
        launch(shear, self._groups * self._parts, [samples, offset, *self._before], [self._partial], device)
        if self._parts > 1:
            warp_launch(gather, self._lines, [self._partial, self._total], device)
        values = self._total
        for matrix, strides, size, out in self._maps:
            warp_launch(rows, size, [values, *matrix, strides, out], device)
            values = out
        if self._rows is None:
            warp_launch(take, self._found.size, [values, self._index, self._found], device)
        else:
            once = wp.vec4i(1, 0, 1, 0)
            warp_launch(rows, (self._found.size, 1), [values, *self._rows, once, self._found], device)
        wp.copy(self._host, self._found)
        if device != "cpu":
            wp.synchronize_stream(wp.get_stream(device))
        return np.asarray(self._host).astype(np.float64)
