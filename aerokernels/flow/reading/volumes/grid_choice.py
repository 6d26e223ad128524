"""Choose the grid that a volume is resampled to, and check the cells that are rasterised into it."""

import math

import numpy as np

from aerokernels.flow.reading.dataset import SOLID, Block, ReadError
from aerokernels.flow.reading.volumes.raster import CellFacts

DEFAULT_NODES = 8_000_000  # of a grid whose spacing the caller did not choose
NODE_LIMIT = 200_000_000
LEAST_NODES = 5


def choose_grid(path, blocks, moved, spacing, region):
    """Return first node [m], spacing [m] and shape of the grid for blocks with points `moved` to the optical frame [m].

    Raises:
        ValueError: A spacing or a region that does not give a grid.
    """
    low = np.min([points.min(axis=0) for points in moved], axis=0)
    high = np.max([points.max(axis=0) for points in moved], axis=0)
    if region is not None:
        first, last = _metres(
            region, "region must be the lowest and the highest corner [m], three numbers each", (2, 3)
        )
        if not (np.maximum(first, low) < np.minimum(last, high)).all():
            raise ValueError(f"region {region!r} is outside the flow of {path}, {low.tolist()} to {high.tolist()} m")
        low, high = np.maximum(first, low), np.minimum(last, high)
    extent = high - low
    if spacing is None:
        cells = max(sum(block.cell_count for block in blocks), 1)
        size = float((np.prod([np.ptp(np.concatenate(moved)[:, k]) for k in range(3)]) / cells) ** (1.0 / 3.0))
        step = max(size, float((extent.prod() / DEFAULT_NODES) ** (1.0 / 3.0)))
        # An axis along which the mesh is thinner still gets LEAST_NODES nodes; the other axes get fewer in return.
        thin = extent < step * (LEAST_NODES - 1)
        if thin.any() and not thin.all():
            long = extent[~thin]
            step = max(step, float((long.prod() * LEAST_NODES ** thin.sum() / DEFAULT_NODES) ** (1.0 / len(long))))
        wanted = np.full(3, step)
    else:
        form = "spacing must be positive: metres along every axis, or three numbers"
        wanted = np.broadcast_to(_metres(spacing, form, (), (3,)), (3,))
        if not (np.isfinite(wanted).all() and (wanted > 0.0).all()):
            raise ValueError(f"spacing must be positive, got {spacing!r}")
    nodes = np.maximum(np.ceil(extent / wanted * (1.0 - 1e-9)) + 1.0, LEAST_NODES)
    if nodes.prod() > NODE_LIMIT:
        raise ValueError(
            f"spacing {spacing!r} m asks for {nodes.prod():.3g} nodes, more than {NODE_LIMIT:.1g}: take a wider one"
        )
    shape = tuple(int(n) for n in nodes)
    return low, extent / (nodes - 1.0), shape


def _metres(given, form: str, *shapes: tuple[int, ...]) -> np.ndarray:
    """Return numbers of one of the shapes; raise ValueError with the expected form otherwise."""
    try:
        found = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise ValueError(f"{form}, got {given!r}") from None
    if found.shape not in shapes:
        raise ValueError(f"{form}, got {given!r}")
    return found


def check_solids(path, block: Block, points: np.ndarray, facts: CellFacts) -> None:
    """Reject cells that are inside out against the majority, cells of zero volume, and duplicate points."""
    solid = np.ones(block.cell_count, bool) if block.shape is not None else np.isin(block.cells.types, SOLID)  # type: ignore[union-attr]
    volume = facts.volume[solid]
    inverted = volume < 0.0
    if inverted.any() and not inverted.all():
        wrong = np.flatnonzero(solid)[inverted if inverted.mean() <= 0.5 else ~inverted]
        raise ReadError(
            path,
            f"{len(wrong)} of {len(volume)} cells are inside out, the first is cell {wrong[0]} at "
            f"{facts.middle[wrong[0]].tolist()} m",
            "order the corners of every cell the same way round",
        )
    if (volume == 0.0).any() and block.shape is None:
        wrong = np.flatnonzero(solid)[volume == 0.0]
        raise ReadError(path, f"{len(wrong)} cells have no volume, the first is cell {wrong[0]}", "repair the mesh")
    if block.shape is None and (pair := _double_points(points)) is not None:
        raise ReadError(
            path, f"points {pair[0]} and {pair[1]} lie in the same place", "merge duplicate nodes of the mesh"
        )


def _double_points(points: np.ndarray) -> tuple[int, int] | None:
    key = points @ np.array([1.0, math.pi, math.e])
    order = np.argsort(key, kind="stable")
    same = np.flatnonzero((points[order[1:]] == points[order[:-1]]).all(axis=1))
    return (int(order[same[0]]), int(order[same[0] + 1])) if len(same) else None
