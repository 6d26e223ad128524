"""Speed of `optical_series` on a GPU: the copy of pinned memory, the map beside it, and a volume's field of regard.

For each direction of rays: seconds of the copy of a volume from pinned memory to the device; seconds from the volume to
the map of optical path differences on the host, for a volume in ordinary memory of the host, in pinned memory, and on
the device; and the map's error. The share is the copy's time over the map's.
"""

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from aerokernels.medium import IndexField
from aerokernels.process.quiet_warp import start_warp
from aerokernels.pupils import Disc
from aerokernels.series import look_map
from aerokernels.series.line_integrals import LineIntegrals
from aerokernels.series.pupil_grid import pupil_grid
from aerokernels.validation.fourier_fields import CONSTANT, WAVELENGTH, Fourier
from aerokernels.validation.series_speed import (
    DIRECTIONS,
    SPACING,
    exact_map,
    map_error,
    mesh_of_shape,
    pupil_before,
    timed,
)

COLUMNS = ("what", "pinned copy", "host to map", "share", "pinned to map", "share", "device to map", "error")
REPEATS = 12
REGARD_NODES, REGARD_SPACING = 65, 2e-3


def quickest(call: Callable[[], Any]) -> float:
    """Least wall time of a call [s]."""
    return timed(call, REPEATS)[0]


def measure_gpu(shape: tuple[int, int, int], pixels: int, device: str) -> Iterator[dict[str, Any]]:
    """The figures, one dictionary for each direction.

    Args:
        shape: Nodes of the volume.
        pixels: Across the pupil.
        device: Its name in Warp; "cpu" is accepted too.
    """
    import warp as wp

    start_warp()
    field = Fourier.random(8, wavenumber=200.0, amplitude=1e-3)
    mesh = mesh_of_shape(shape)
    volume = field.on_grid(mesh.origin, SPACING, shape, 0.0, np.float32)
    cuda = device != "cpu"
    pinned = wp.empty(volume.shape, dtype=wp.float32, device="cpu", pinned=cuda)
    np.asarray(pinned)[:] = volume
    there = wp.empty(volume.shape, dtype=wp.float32, device=device)

    def copied() -> None:
        wp.copy(there, pinned)
        wp.synchronize_device(device)

    seconds = quickest(copied)
    for name, way in DIRECTIONS.items():
        along = np.array(way) / np.linalg.norm(way)
        grid = pupil_grid(pupil_before(mesh, np.array(way)), pixels)
        lines = LineIntegrals(mesh, grid.points, along)
        assert lines.lattice is not None
        summed = lines.lattice.on_gpu
        truth = exact_map(field, grid, along, lines)
        yield {
            "what": f"{'x'.join(map(str, shape))}, {name}",
            "device": device,
            "bytes": int(volume.nbytes),
            "copy_seconds": seconds,
            "host_seconds": quickest(partial(summed, volume, device, field.mean)),
            "pinned_seconds": quickest(partial(summed, pinned, device, field.mean)),
            "device_seconds": quickest(partial(summed, there, device, field.mean)),
            "error_m": map_error(summed(there, device, field.mean), truth, grid),
        }


def measure_regard(device: str, step: float = 1.0, ray_count: int = 256 * 256) -> dict[str, Any]:
    """Seconds of a look map over the hemisphere ahead, after a coarse one that builds what it needs.

    Args:
        device: Its name in Warp.
        step: Angle between directions [degrees].
        ray_count: Rays of each direction.
    """
    field = Fourier.random(8, amplitude=1e-3)
    count, spacing = REGARD_NODES, REGARD_SPACING
    origin = np.array([-0.5 * spacing * (count - 1)] * 2 + [5.0 * spacing])
    contrast = CONSTANT * (field.on_grid(origin, spacing, (count,) * 3, 0.0) - field.mean)
    index = IndexField.from_samples(
        contrast, origin=origin, spacing=[spacing] * 3, geometry="volume", wavelength=WAVELENGTH
    )
    seconds = []
    for each in (45.0, step):
        angles = np.radians(np.arange(-90.0, 90.0 + 0.5 * each, each))
        begin = time.perf_counter()
        found = look_map(index, angles, angles, Disc(0.02, [0, 0, 0]), ray_count=ray_count, device=device)
        seconds.append(time.perf_counter() - begin)
    return {
        "what": f"field of regard, {found.strehl.size} directions x {ray_count} rays, {count} nodes a side",
        "device": device,
        "first_seconds": seconds[0],
        "regard_seconds": seconds[1],
    }


def gpu_row(one: dict[str, Any]) -> tuple[str, ...]:
    """A row of texts, in the order of COLUMNS."""
    if "regard_seconds" in one:
        return (one["what"], "", "", "", "", "", f"{one['regard_seconds']:.1f} s", "")
    copy = one["copy_seconds"]
    return (
        one["what"],
        f"{1e-9 * one['bytes'] / copy:.1f} GB/s",
        f"{1e3 * one['host_seconds']:.2f} ms",
        f"{100.0 * copy / one['host_seconds']:.0f} %",
        f"{1e3 * one['pinned_seconds']:.2f} ms",
        f"{100.0 * copy / one['pinned_seconds']:.0f} %",
        f"{1e3 * one['device_seconds']:.2f} ms",
        f"{one['error_m']:.1e} m",
    )
