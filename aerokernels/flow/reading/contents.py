"""List what a flow file contains: zones, cells, extents, arrays and their ranges, times, patches."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from aerokernels.flow.reading.dataset import Block, Dataset, ReadError, grid_of
from aerokernels.flow.reading.formats import load
from aerokernels.inputs.checks import check_path


@dataclass(frozen=True)
class ArrayRange:
    """An array of a file and its range."""

    name: str
    where: str  # "cells" or "points"
    components: int  # 1 for scalars, 3 for vectors
    low: float  # least finite value; NaN if there is none
    high: float
    bad: int  # number of values that are not finite


@dataclass(frozen=True)
class Contents:
    """The contents of a file.

    Attributes:
        path: The file or case.
        format: Name of the format.
        geometry: "planar", "axisymmetric", "volume", or None where only the points decide.
        zones: Description of each zone: its name, shape or cells, and points.
        low: Lowest corner in the file's unit and axes.
        high: Highest corner.
        arrays: The arrays.
        times: The times for which there are fields; empty for a file without times.
        time: The time that was read, or None.
        patches: Boundary patches: name and kind.
        notes: Further remarks for the user.
    """

    path: str
    format: str
    geometry: str | None
    zones: tuple[str, ...]
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    arrays: tuple[ArrayRange, ...]
    times: tuple[float, ...]
    time: float | None
    patches: tuple[tuple[str, str], ...]
    notes: tuple[str, ...]


def contents(path, *, time: float | str | None = None, **options: Any) -> Contents:
    """List the contents of a flow file or case.

    Args:
        path: As in `flow.read`.
        time: As in `flow.read`.
        options: `mesh`, `solution`, `variables`, as in `flow.read`.

    Raises:
        ValueError: A file that cannot be read (`ReadError`: file, place and remedy).
    """
    path = check_path(path, "path")
    dataset = load(path, time, options)
    parts = [
        np.concatenate(grid.edges()) if (grid := grid_of(block.points)) else block.points for block in dataset.blocks
    ]
    points = np.concatenate(parts) if parts else np.empty((0, 3))
    if not len(points):
        raise ReadError(path, "it has no points", "give a file with a mesh and its arrays")
    return Contents(
        str(path),
        dataset.format,
        dataset.geometry,
        tuple(_zone(block, number) for number, block in enumerate(dataset.blocks)),
        tuple(float(v) for v in np.nanmin(points, axis=0)),  # type: ignore[arg-type]
        tuple(float(v) for v in np.nanmax(points, axis=0)),  # type: ignore[arg-type]
        tuple(_ranges(dataset)),
        tuple(dataset.times),
        dataset.time,
        tuple((patch.name, patch.kind) for patch in dataset.patches),
        tuple(dataset.notes),
    )


def _zone(block: Block, number: int) -> str:
    name = block.name or f"zone {number + 1}"
    if block.shape is not None:
        return f"{name}: {' x '.join(map(str, block.shape))} points, structured"
    if block.cells is None:
        return f"{name}: {len(block.points)} points without cells"
    called = {1: "points", 3: "lines", 5: "triangles", 7: "polygons", 9: "quadrilaterals", 10: "tetrahedra",
              12: "hexahedra", 13: "prisms", 14: "pyramids", 42: "polyhedra"}  # fmt: skip
    kinds, counts = np.unique(block.cells.types, return_counts=True)
    described = ", ".join(
        f"{n} {called.get(int(kind), f'cells of type {kind}')}" for kind, n in zip(kinds, counts, strict=True)
    )
    return f"{name}: {described}, {len(block.points)} points"


def _ranges(dataset: Dataset):
    for where in ("cell", "point"):
        held = [block.arrays(where) for block in dataset.blocks]
        for name in dict.fromkeys(name for arrays in held for name in arrays):
            parts = [np.asarray(arrays[name]) for arrays in held if name in arrays]
            parts = [part for part in parts if np.issubdtype(part.dtype, np.number)]
            if not parts:
                continue
            flat = np.concatenate([part.ravel() for part in parts]).astype(np.float64)
            finite = flat[np.isfinite(flat)]
            low, high = (float(finite.min()), float(finite.max())) if len(finite) else (np.nan, np.nan)
            width = parts[0].shape[1] if parts[0].ndim > 1 else 1
            yield ArrayRange(name, f"{where}s", width, low, high, len(flat) - len(finite))
