"""Interpolates the results of rays from a table of patches, and marks the rays that no patch covers.

This is the NumPy version of the kernels `deliver_bundle`: it is easier to read, and tests compare the two.
"""

import numpy as np

from aerokernels.pupils.base import lengths
from aerokernels.rays import RayBundle
from aerokernels.tracing.bundle.lattice import CELLS, hermite_weights
from aerokernels.tracing.bundle.table import BundleTable, undisturbed_length
from aerokernels.tracing.status import NOT_DELIVERED, RayStatus

CHUNK = 1 << 15


def deliver(table: BundleTable, rays: RayBundle, outputs: frozenset) -> dict[str, np.ndarray]:
    """Per-ray arrays by name, including the status; entries of rays that no patch covers are zero."""
    parts = [
        _deliver(table, rays.position[k : k + CHUNK], rays.direction[k : k + CHUNK], outputs)
        for k in range(0, rays.ray_count, CHUNK)
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _deliver(table: BundleTable, position: np.ndarray, direction: np.ndarray, outputs: frozenset) -> dict:
    ambient = table.classes.field.ambient_index
    block, parameters = find(table, position, direction)
    length = undisturbed_length(table.classes.field, position, direction, table.classes.until)
    good = (block >= 0) & np.isfinite(length) & (length > 0.0)
    status = np.where(good, int(RayStatus.OK), NOT_DELIVERED).astype(np.int32)
    length = np.where(good, length, 0.0)
    block = np.where(good, block, 0)
    values = np.where(good[:, None], evaluate(table, block, parameters), 0.0)
    found = {"opd": values[:, 0], "optical_path": ambient * length + values[:, 0], "status": status}
    if table.channels > 1:
        turned = direction + values[:, 1:4]
        found["direction"] = turned / lengths(turned)[:, None]
    if table.channels > 4:
        found["position"] = position + length[:, None] * direction + values[:, 4:7]
        found["arc_length"] = length + values[:, 7]
    head = table.header[block]
    found["step_error"] = head[:, 5]
    found["step_count"], found["evaluation_count"] = head[:, 6].astype(np.int32), head[:, 7].astype(np.int32)
    found = {name: array for name, array in found.items() if name in outputs or name == "status"}
    for array in found.values():
        array[~good] = array[~good] if array is status else 0
    return found


def find(table: BundleTable, position: np.ndarray, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The block of each ray (n, 3), -1 for those that belong to none, and its parameters."""
    parameters = table.family.parameters(position, direction)
    place = np.floor((parameters - table.family.low) * table.rate).astype(np.int64)
    inside = ((place >= 0) & (place < table.map.shape)).all(axis=1)
    place = np.where(inside[:, None], place, 0)
    block = np.where(inside & table.family.holds_for(position, direction), table.map[tuple(place.T)], -1)
    if not table.classes.are_all_alike:
        alike = table.header[np.maximum(block, 0), 4] == table.classes.numbers(position, direction)
        block = np.where(alike, block, -1)
    return block, parameters


def evaluate(table: BundleTable, block: np.ndarray, parameters: np.ndarray) -> np.ndarray:
    """CHANNELS of rays in some blocks (n,) with their parameters (n, 2), shape (n, c)."""
    head = table.header[block]
    place = (parameters - head[:, :2]) * head[:, 2:4]
    cell = np.clip(place.astype(np.int64), 0, CELLS - 1)
    wu, wv = (hermite_weights(share) for share in (place - cell).T)
    found = np.zeros((len(block), table.channels))
    for a in (0, 1):
        for b in (0, 1):
            node = table.values[block, cell[:, 0] + a, cell[:, 1] + b]
            weights = [wu[2 * a + k % 2] * wv[2 * b + k // 2] for k in range(4)]
            found += np.einsum("kn,nkc->nc", np.stack(weights), node)
    return found
