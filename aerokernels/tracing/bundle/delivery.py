"""Interpolates the results of rays from a table of patches, and marks the rays that no patch covers.

This is the NumPy version of the kernels `deliver_bundle`: it is easier to read, and tests compare the two.
"""

import numpy as np

from ...pupils.vectors import lengths
from ...rays import RayBundle
from ..status import NOT_DELIVERED, RayStatus
from .nodes import undisturbed_length
from .table import BundleTable

CHUNK = 1 << 15


def deliver(table: BundleTable, rays: RayBundle, outputs: frozenset) -> dict[str, np.ndarray]:
    """Per-ray arrays by name, including the status; entries of rays that no patch covers are zero."""
    parts = [
        _deliver(table, rays.position[k : k + CHUNK], rays.direction[k : k + CHUNK], outputs)
        for k in range(0, rays.ray_count, CHUNK)
    ]
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def _deliver(table: BundleTable, position: np.ndarray, direction: np.ndarray, outputs: frozenset) -> dict:
    ambient = table.ways.field.ambient_index
    block, parameters = table.find(position, direction)
    length = undisturbed_length(table.ways.field, position, direction, table.ways.until)
    good = (block >= 0) & np.isfinite(length) & (length > 0.0)
    status = np.where(good, int(RayStatus.OK), NOT_DELIVERED).astype(np.int32)
    length = np.where(good, length, 0.0)
    block = np.where(good, block, 0)
    values = np.where(good[:, None], table.evaluate(block, parameters), 0.0)
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
