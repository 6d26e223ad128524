"""Order rays so that successive ones share the field's cells from end to end.

A processor moves some rays in step, a packet (kernels/include/packet.h). Where all of them are in one column of cells,
they share its coefficients; otherwise each gathers its own, which takes several times as long. Rays are ordered by the
cells in which their lines cross the two faces of the field's box that they run between, wider cells first.
"""

import numpy as np

from ..medium import IndexField

# Bundles of fewer rays keep their order.
LEAST_RAYS = 4096  # speed only
# Rays of a packet, packets that are sampled, and the cells over which a packet may spread in the bundle's own order.
PACKET, PACKETS, SPREAD = 16, 64, 1.0  # speed only
# Rays run along an axis if their directions have at least this component along it.
LEAST_COMPONENT = 0.2  # speed only
# Bits of a cell's number that distinguish cells within a wide cell, and bits of the wide cell's number.
FINE_BITS, WIDE_BITS = 3, 12  # speed only


def coherent_order(field: IndexField, position: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
    """Row numbers of rays (n, 3) in a coherent order, shape (n,); None if they already are or ordering does not pay."""
    count = len(position)
    if count < LEAST_RAYS or not field.is_uniform:
        return None
    first = np.linspace(0, count - PACKET, PACKETS).astype(np.int64)
    some = (first[:, None] + np.arange(PACKET)).ravel()
    axis = _main_axis(field, direction[some])
    if axis is None:
        return None
    spread = np.ptp(_cells(field, position[some], direction[some], axis).reshape(PACKETS, PACKET, -1), axis=1)
    if np.median(spread.max(axis=1)) <= SPREAD:
        return None
    cells = _cells(field, position, direction, axis)
    key = np.zeros(count, np.int64)
    for column in cells.T:
        key = key << WIDE_BITS | column >> FINE_BITS
    for column in cells.T:
        key = key << FINE_BITS | column & (1 << FINE_BITS) - 1
    return np.argsort(key, kind="stable")


def _main_axis(field: IndexField, direction: np.ndarray) -> int | None:
    """The axis that all rays run along, among those along which the box ends; None where there is none."""
    low, high = field.box
    steep = np.abs(direction).min(axis=0) * (np.isfinite(low) & np.isfinite(high))
    if field.geometry == "axisymmetric":
        steep[:2] = 0.0
    axis = int(np.argmax(steep))
    return axis if steep[axis] >= LEAST_COMPONENT else None


def _cells(field: IndexField, position: np.ndarray, direction: np.ndarray, axis: int) -> np.ndarray:
    """Cells in which lines cross both faces across an axis, along the field's other axes, shape (n, 2 or 4)."""
    dimension = len(field.spacing)
    low, last = np.asarray(field.samples.low), np.array(field.samples.shape) - 2
    own = axis - (3 - dimension)
    found = []
    for face in (low[own], np.asarray(field.samples.high)[own]):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            place = position + ((face - position[:, axis]) / direction[:, axis])[:, None] * direction
            local = field.local_coordinates(place)
        for other in range(dimension):
            if other != own:
                cell = np.nan_to_num((local[:, other] - low[other]) / field.spacing[other])
                found.append(np.clip(cell, 0, min(last[other], (1 << WIDE_BITS) - 1)).astype(np.int64))
    return np.stack(found, axis=1)
