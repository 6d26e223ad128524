"""Linear reconstruction of the density in solid cells, from averages over cells or from values at points.

In every cell the density is its value at a middle plus a slope, kept within what the cell and its corners have. The
average over a cell stays what the file says; linear functions of point data are kept exactly.
"""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from .dataset import Block
from .raster import CellFacts
from .solids import Chunk, corner_chunks


@dataclass(frozen=True, eq=False)
class Linear:
    """A linear function in each cell.

    Attributes:
        value: At the middle, shape (n,).
        slope: Shape (n, 3).
        middle: Shape (n, 3) [m].
        low: Least value allowed, shape (n,).
        high: Greatest, shape (n,).
    """

    value: np.ndarray
    slope: np.ndarray
    middle: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def at(self, cell: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Values at points (n, 3) that lie in cells (n,)."""
        rise = np.einsum("nk,nk->n", points - self.middle[cell], self.slope[cell])
        return np.clip(self.value[cell] + rise, self.low[cell], self.high[cell])

    @classmethod
    def joined(cls, parts: list["Linear"]) -> "Linear":
        """The cells of several blocks, one after the other."""
        if len(parts) == 1:
            return parts[0]
        return cls(*(np.concatenate([getattr(part, name) for part in parts])
                     for name in ("value", "slope", "middle", "low", "high")))  # fmt: skip


def reconstruct(block: Block, points: np.ndarray, density: np.ndarray, where: str, facts: CellFacts) -> Linear:
    """Reconstruct a block.

    Args:
        block: The block.
        points: Its points in the optical frame [m], shape (point_count, 3).
        density: Of its cells or its points.
        where: "cell" or "point".
        facts: Of its cells.
    """
    count = block.cell_count
    at_points = density if where == "point" else _point_means(block, points, density)
    value = density.copy() if where == "cell" else np.zeros(count)
    middle = facts.middle.copy()
    low, high, slope = value.copy(), value.copy(), np.zeros((count, 3))
    across = np.ascontiguousarray(points.T)

    def work(chunk: Chunk) -> None:
        cell = chunk.cell
        corner, reach = at_points[chunk.corners], across[:, chunk.corners]
        mean, centre = corner.mean(axis=0), reach.mean(axis=1)
        slope[cell] = _fitted(reach - centre[:, None], corner - mean)
        if where == "point":
            value[cell], middle[cell] = mean, centre.T
        low[cell] = np.minimum(corner.min(axis=0), value[cell])
        high[cell] = np.maximum(corner.max(axis=0), value[cell])

    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        for _ in pool.map(work, corner_chunks(block)):
            pass
    if block.cells is not None and block.cells.faces is not None:
        _between_neighbours(block, points, density, where, facts, (value, slope, low, high))
    return Linear(value, slope, middle, low, high)


def _point_means(block: Block, points: np.ndarray, density: np.ndarray) -> np.ndarray:
    """Mean over the cells at each point."""
    total, count = np.zeros(len(points)), np.zeros(len(points))
    blank = block.blank if block.blank is not None and len(block.blank) == len(density) else None
    for chunk in corner_chunks(block):
        cell, corners = chunk.cell, chunk.corners
        if blank is not None:
            keep = ~blank[cell]
            cell, corners = cell[keep], corners[:, keep]
        flat = corners.ravel()
        low, high = (int(flat.min()), int(flat.max()) + 1) if len(flat) else (0, 0)
        if high - low > 20 * len(flat):
            np.add.at(total, flat, np.tile(density[cell], len(corners)))
            np.add.at(count, flat, 1.0)
            continue
        total[low:high] += np.bincount(flat - low, np.tile(density[cell], len(corners)), high - low)
        count[low:high] += np.bincount(flat - low, minlength=high - low)
    return np.asarray(total / np.maximum(count, 1.0))


def _fitted(step: np.ndarray, rise: np.ndarray) -> np.ndarray:
    """The slope that fits the corners best: step (3, k, n), rise (k, n), result (n, 3)."""
    square = {(i, j): (step[i] * step[j]).sum(axis=0) for i in range(3) for j in range(i, 3)}
    right = [(step[i] * rise).sum(axis=0) for i in range(3)]
    xx, xy, xz, yy, yz, zz = (square[key] for key in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    d, e, f = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    determinant = xx * a + xy * b + xz * c
    good = np.abs(determinant) > 1e-30 * (xx + yy + zz) ** 3
    inverse = np.where(good, 1.0, 0.0) / np.where(good, determinant, 1.0)
    return np.stack([
        (a * right[0] + b * right[1] + c * right[2]) * inverse,
        (b * right[0] + d * right[1] + e * right[2]) * inverse,
        (c * right[0] + e * right[1] + f * right[2]) * inverse,
    ], axis=1)  # fmt: skip


def _between_neighbours(block: Block, points, density, where, facts: CellFacts, out) -> None:
    """Polyhedra: the slope by Green and Gauss, with face values on the line between the middles of two neighbours."""
    assert block.cells is not None and block.cells.faces is not None
    faces = block.cells.faces
    value, slope, low, high = out
    if where == "point":
        width = np.diff(faces.start)
        mean = np.add.reduceat(density[faces.points], faces.start[:-1]) / width
        total = np.bincount(faces.owner, mean, len(value)) + np.bincount(
            faces.neighbour, mean[: len(faces.neighbour)], len(value)
        )
        share = np.bincount(faces.owner, minlength=len(value)) + np.bincount(faces.neighbour, minlength=len(value))
        value[:] = total / np.maximum(share, 1)
    inner = len(faces.neighbour)
    one, other = faces.owner[:inner], faces.neighbour
    total = np.zeros_like(slope)
    begin, width = faces.start[:-1], np.diff(faces.start)
    at = points[faces.points]
    mean = np.add.reduceat(at, begin, axis=0) / width[:, None]
    following = np.arange(1, len(at) + 1)
    following[faces.start[1:] - 1] = begin
    area = np.add.reduceat(
        0.5 * np.cross(at - np.repeat(mean, width, axis=0), (at - np.repeat(mean, width, axis=0))[following]), begin
    )
    near = np.abs(np.einsum("nk,nk->n", area[:inner], mean[:inner] - facts.middle[one]))
    far = np.abs(np.einsum("nk,nk->n", area[:inner], facts.middle[other] - mean[:inner]))
    share = near / np.maximum(near + far, 1e-300)
    at_face = value[faces.owner].copy()
    at_face[:inner] += share * (value[other] - value[one])
    for axis in range(3):
        flow = area[:, axis] * at_face
        total[:, axis] = np.bincount(faces.owner, flow, len(value)) - np.bincount(other, flow[:inner], len(value))
    with np.errstate(all="ignore"):
        found = total / facts.volume[:, None]
    low[:], high[:] = value, value
    np.minimum.at(low, one, value[other])
    np.minimum.at(low, other, value[one])
    np.maximum.at(high, one, value[other])
    np.maximum.at(high, other, value[one])
    slope[:] = np.where(np.isfinite(found), found, 0.0)
    if not inner:  # faces that do not know their neighbours tell nothing of a slope
        slope[:] = 0.0
