"""Whether rays belong to a family that is known already: other rays of the same bundle, as of a new seed.

A family is found from some of the rays, by least squares and singular values, on the host; that takes longer than to
interpolate ten million rays on a GPU. Whether the same rays belong to a known one is asked of each of them by itself,
as it is asked of every ray that is delivered: rays on a device are asked there, and six numbers come back.
"""

import numpy as np

from ...device_arrays import DeviceArray
from ...medium import IndexField
from ...rays import RayBundle
from ..stop import ArcLength
from .family import SAMPLE, Family, some_rows

# Numbers of rays by which a field keeps the rows that are looked at.
KEPT = 4


def known_family(field: IndexField, rays: RayBundle, until, known: list[Family]) -> Family | None:
    """The first of the known families that these rays belong to, and whose range of parameters is theirs; or None."""
    for family in known:
        if isinstance(until, ArcLength) and np.isfinite(family.ahead):
            continue  # how long rays are matters: they cannot be moved along their lines
        ends = parameter_range(field, rays, family)
        if ends is not None and family.serves(*ends):
            return family
    return None


def parameter_range(field: IndexField, rays: RayBundle, family: Family) -> tuple[np.ndarray, np.ndarray] | None:
    """The least and greatest parameters of the rays that a family is found from, each of shape (2,).

    None where some of them do not belong to it.
    """
    count = rays.ray_count
    rows = field.derive(("rows of a family", count), lambda: some_rows(count, SAMPLE), KEPT)
    position, direction = rays.held("position"), rays.held("direction")
    if isinstance(position, DeviceArray) and isinstance(direction, DeviceArray):
        from ..engines.warp.family_range import range_on_device, rows_on_device

        key = ("rows of a family on a device", position.device, count)
        there = field.derive(key, lambda: rows_on_device(rows, position.device), KEPT)
        return range_on_device(family, there, position.buffer, direction.buffer)
    # Of a picture's bundles one is asked after the other: a single ray tells most of them apart.
    if not family.holds_for(np.asarray(position[:1]), np.asarray(direction[:1])).all():
        return None
    some, along = np.asarray(position[rows]), np.asarray(direction[rows])
    if not family.holds_for(some, along).all():
        return None
    parameters = family.parameters(some, along)
    return parameters.min(axis=0), parameters.max(axis=0)
