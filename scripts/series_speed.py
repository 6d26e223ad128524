"""Speed and error of maps of optical path differences from snapshots of a volume, compared with the exact field.

A random field of Fourier modes on N x N x M nodes, float32, is seen along its last axis or at a slant by P x P rays.
For each direction: the time from samples in the host's memory to the map (LineIntegrals), that of a whole snapshot of
`optical_series`, and the rms error of the map, beside that of nearest-neighbour sums over the same nodes and beside the
error that `optical_series` reports.
"""

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.flow import GridMesh, Series, open_series
from aerokernels.pupils import Disc
from aerokernels.series import optical_series
from aerokernels.series.line_integrals import LineIntegrals
from aerokernels.series.pupil_grid import PupilGrid, pupil_grid
from scripts.studies.report import markdown_table
from tests.series.fourier import CONSTANT, WAVELENGTH, Fourier

SHAPE, PIXELS = (525, 525, 101), 512
SPACING = 1e-3
WAVENUMBER = 200.0  # standard deviation of the modes' wave vectors in each direction [rad/m]
DIRECTIONS = {"along an axis": (0.0, 0.0, 1.0), "across one": (0.15, 0.0, 1.0), "across two": (0.15, 0.1, 1.0)}
COLUMNS = ("rays", "map", "per second", "snapshot", "CPU", "error", "reported", "nearest", "ratio")


def timed(call: Callable[[], Any], repeats: int) -> tuple[float, float, Any]:
    """Least wall and CPU time of a call [s], after a first call, and its result."""
    found = call()
    wall, processor = [], []
    for _ in range(repeats):
        begin, spent = time.perf_counter(), time.process_time()
        found = call()
        processor.append(time.process_time() - spent)
        wall.append(time.perf_counter() - begin)
    return min(wall), min(processor), found


def nearest_sums(mesh: GridMesh, samples: np.ndarray, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Rectangle sums of the nearest node's sample over the planes across z, shape (n,)."""
    total = np.zeros(len(start))
    for plane in range(mesh.shape[2]):
        away = (mesh.origin[2] + plane * mesh.spacing[2] - start[:, 2]) / direction[2]
        place = (start[:, :2] + away[:, None] * direction[:2] - mesh.origin[:2]) / mesh.spacing[:2]
        i, j = np.clip(np.rint(place).astype(int), 0, np.array(mesh.shape[:2]) - 1).T
        total += samples[i, j, plane]
    return total * float(mesh.spacing[2] / direction[2])


def measure_series(
    shape: tuple[int, int, int] = SHAPE, pixels: int = PIXELS, snapshots: int = 6
) -> list[dict[str, Any]]:
    """Measure a series; return one dictionary for each direction.

    Args:
        shape: Nodes along x, y and z.
        pixels: Pixels across the pupil.
        snapshots: Length of the series that is timed; it alternates between two volumes.
    """
    field = Fourier.random(8, wavenumber=WAVENUMBER, amplitude=1e-3)
    mesh = mesh_of_shape(shape)
    volumes = [field.on_grid(mesh.origin, SPACING, shape, instant, np.float32) for instant in (0.0, 1e-5)]
    return [_one(name, np.array(way), mesh, volumes, field, pixels, snapshots) for name, way in DIRECTIONS.items()]


def mesh_of_shape(shape: tuple[int, int, int]) -> GridMesh:
    """A mesh centred on the z axis that starts at z = 0."""
    origin = [-0.5 * SPACING * (shape[0] - 1), -0.5 * SPACING * (shape[1] - 1), 0.0]
    return GridMesh("volume", origin, np.full(3, SPACING), shape)


def pupil_before(mesh: GridMesh, way: np.ndarray) -> Disc:
    """A pupil ahead of a volume whose rays along `way` all stay in the volume."""
    depth = SPACING * (mesh.shape[2] - 1)
    radius = 0.4 * SPACING * min(mesh.shape[:2])
    radius = min(radius, 0.5 * SPACING * (min(mesh.shape[:2]) - 3) - 0.5 * depth * float(np.abs(way[:2]).max()))
    center = -0.5 * depth * way - 0.01 * way
    center[2] = -0.01
    return Disc(radius, center)


def exact_map(field: Fourier, grid: PupilGrid, along: np.ndarray, lines: LineIntegrals) -> np.ndarray:
    """The exact optical path differences of the first snapshot [m]."""
    entry = grid.points - (grid.points[:, 2] / along[2])[:, None] * along
    return field.opd(entry, along, lines.length, 0.0)


def map_error(values: np.ndarray, truth: np.ndarray, grid: PupilGrid) -> float:
    """The rms error over the pupil of integrals of the density, without the mean [m]."""
    weight = grid.weight[grid.lit]
    difference = CONSTANT * values - truth
    return float(np.sqrt(weight @ (difference - weight @ difference) ** 2))


def _one(name, way, mesh: GridMesh, volumes, field: Fourier, pixels: int, snapshots: int) -> dict[str, Any]:
    along = way / np.linalg.norm(way)
    pupil = pupil_before(mesh, way)
    grid = pupil_grid(pupil, pixels)
    lines = LineIntegrals(mesh, grid.points, along)
    wall, processor, found = timed(lambda: lines(volumes[0], field.mean), max(2, snapshots // 2))
    truth = exact_map(field, grid, along, lines)

    def off(values: np.ndarray) -> float:
        return map_error(values, truth, grid)

    nearest = nearest_sums(mesh, volumes[0], grid.points, along)
    uniform = field.mean * (
        mesh.shape[2] * SPACING / along[2]
    )  # its share, one cell more than there are between planes
    series = _series(volumes, mesh, field.mean, snapshots)
    marks: list[tuple[float, float]] = []
    maps = optical_series(
        series,
        pupil,
        direction=along,
        pixel_count=pixels,
        remove=("piston",),
        progress=lambda text, share: marks.append((time.perf_counter(), time.process_time())),
    )
    steps = np.diff(np.array(marks), axis=0)
    quick = steps[steps[:, 0].argsort()[: max(1, len(steps) // 2)]]
    return {
        "rays": name,
        "map_seconds": wall,
        "map_cpu_seconds": processor,
        "bytes": int(volumes[0].nbytes),
        "snapshot_seconds": float(quick[:, 0].mean()),
        "snapshot_cpu_seconds": float(steps[:, 1].mean()),  # of all: some of a snapshot's work is done beside others
        "error_m": off(found),
        "reported_m": float(maps.error[0]),
        "nearest_m": off(nearest - uniform),
        "traced": float(maps.traced.sum()),
        "wavelength_m": WAVELENGTH,
    }


def _series(volumes: list[np.ndarray], mesh: GridMesh, ambient: float, count: int) -> Series:
    return open_series(
        [volumes[k % 2] for k in range(count)],
        time_step=1e-5,
        geometry="volume",
        origin=mesh.origin,
        spacing=mesh.spacing,
        ambient_density=ambient,
    )


def table_rows(found: list[dict[str, Any]]) -> list[tuple[str, ...]]:
    """One row of texts for each direction, in the order of COLUMNS."""
    return [
        (
            one["rays"],
            f"{1e3 * one['map_seconds']:.0f} ms",
            f"{1.0 / one['snapshot_seconds']:.1f}",
            f"{1e3 * one['snapshot_seconds']:.0f} ms",
            f"{1e3 * one['snapshot_cpu_seconds']:.0f} ms",
            f"{one['error_m']:.2e} m",
            f"{one['reported_m']:.2e} m",
            f"{one['nearest_m']:.2e} m",
            f"{one['nearest_m'] / one['error_m']:.0f}",
        )
        for one in found
    ]


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="scripts/series_speed", description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, help="write what was measured to this JSON file")
    parser.add_argument("--snapshots", type=int, default=8, metavar="COUNT", help="snapshots of a series")
    parser.add_argument("--quick", action="store_true", help="a small volume, to see that it works")
    options = parser.parse_args()
    if options.snapshots < 3:
        parser.error(f"--snapshots: {options.snapshots} is too few, give at least 3")
    shape, pixels = ((45, 45, 31), 24) if options.quick else (SHAPE, PIXELS)
    found = measure_series(shape, pixels, options.snapshots)
    print(markdown_table(COLUMNS, table_rows(found)))
    if options.out is not None:
        options.out.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
