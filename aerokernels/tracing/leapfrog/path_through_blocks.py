"""Find the blocks of a uniform grid that straight lines pass, and how far beside them a ray may get."""

from dataclasses import dataclass

import numpy as np

from ...derived import cached_on
from ..straight_lines import Lines, local_range

# Blocks by which a ray may be deflected sideways, in addition to the drift of its straight line.
DEFLECTED = 0.5
# Sets of blocks for which lines cache their path.
CACHED = 2  # speed only


@dataclass(frozen=True, eq=False)
class Layers:
    """Layers of blocks across an axis that all lines run along.

    Attributes:
        axis: The axis.
        lever_arms: Greatest lever arm of any line from its entry into each layer [m], along that axis.
        beside: The other axes, and along each the number of adjacent blocks that a ray may meet in a layer.
        thickness: Thickness of a layer [m].
        least: The least component of a line's direction along the axis.
    """

    axis: int
    lever_arms: np.ndarray
    beside: tuple[tuple[int, int], ...]
    thickness: float
    least: float


@dataclass(frozen=True, eq=False)
class BlockPath:
    """Where lines pass the blocks of a grid.

    Attributes:
        part: The blocks that the lines pass, with one more to each side.
        longest: Length of the longest line [m].
        lever_arm: The greatest lever arm [m].
        layers: Layers of blocks for each axis that all lines run along, the one that they run along most first.
    """

    part: tuple[slice, ...]
    longest: float
    lever_arm: float
    layers: tuple[Layers, ...]


@cached_on("lines", CACHED)
def path_of(lines: Lines, geometry: str, low: np.ndarray, size: np.ndarray, shape: tuple[int, ...]) -> BlockPath:
    """The path of lines through the blocks of a grid.

    Args:
        lines: The lines.
        geometry: The geometry of their field.
        low: The lowest corner of the grid [m].
        size: The size of a block [m].
        shape: Number of blocks along each axis.
    """
    local = local_range(lines, geometry)
    # One block more to each side, for the deflection of rays and for rays between those of `lines`.
    first = np.clip(np.floor((local[0] - low) / size).astype(int) - 1, 0, np.array(shape) - 1)
    last = np.clip(np.floor((local[1] - low) / size).astype(int) + 1, first, np.array(shape) - 1)
    part = tuple(slice(begin, end + 1) for begin, end in zip(first.tolist(), last.tolist(), strict=True))
    longest = float(lines.length.max(initial=0.0))
    components = np.abs(lines.direction[:, 3 - len(shape) :])
    drift = along_axes(np.abs(lines.direction).max(axis=0, initial=0.0), geometry) * longest / size
    layers = []
    for axis in range(geometry == "axisymmetric", len(shape)):
        least = float(components[:, axis].min(initial=1.0))
        if least * longest > size[axis]:  # otherwise a sum over layers bounds no better than the greatest value
            faces = low[axis] + (first[axis] + np.arange(last[axis] - first[axis] + 2)) * size[axis]
            levers = _lever_arms_from(lines, faces, axis + 3 - len(shape))
            others = [other for other in range(len(shape)) if other != axis]
            beside = tuple((other, 1 + int(np.ceil(drift[other] + DEFLECTED))) for other in others)
            levers = levers.reshape([-1 if other == axis else 1 for other in range(len(shape))])
            layers.append(Layers(axis, levers, beside, float(size[axis]), least))
    layers.sort(key=lambda each: -each.least)  # the axis along which lines run most gives the least bound
    return BlockPath(part, longest, float(lines.lever_arm.max(initial=0.0)), tuple(layers))


def _lever_arms_from(lines: Lines, faces: np.ndarray, component: int) -> np.ndarray:
    """The greatest lever arm of any line from its entry into each layer between planes across an axis [m]."""
    start, rate = lines.start[:, component].copy(), 1.0 / lines.direction[:, component]
    levers = np.zeros(len(faces) - 1)
    if not len(start):
        return levers
    before = (faces[0] - start) * rate
    for layer, face in enumerate(faces[1:]):
        behind = (face - start) * rate
        nearest = np.minimum(np.maximum(np.minimum(before, behind), 0.0), lines.length)
        levers[layer] = max((lines.lever_arm - lines.tangent * nearest).max(), 0.0)
        before = behind
    return levers


def along_axes(steepness, geometry: str) -> np.ndarray:
    """Greatest absolute components along the grid's own axes, which are r and z for an axisymmetric grid."""
    x, y, z = steepness
    return np.array({"volume": (x, y, z), "planar": (y, z), "axisymmetric": (min(np.hypot(x, y), 1.0), z)}[geometry])
