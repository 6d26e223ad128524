"""Test whether rays belong to a family found earlier: other rays of the same bundle, such as those of a new seed.

Finding a family needs least squares and singular values of some rays on the host, which takes longer than interpolating
ten million rays on a GPU. Whether rays belong to a known family is tested for each ray separately, as it is for every
ray that is interpolated: rays on a device are tested there, and only six numbers are copied back.
"""

import numpy as np

from ...device_arrays import DeviceArray
from ...medium import IndexField
from ...rays import RayBundle
from ..stop import ArcLength
from .family import SAMPLE, Family, closeness, some_rows

# Ray counts for which a field caches the rows that are tested, and families whose numbers stay on a device.
CACHED = 4


def known_family(
    field: IndexField, rays: RayBundle, until, known: list[Family], limit: float = np.inf
) -> Family | None:
    """The first of the known families to which these rays belong and whose range of parameters fits theirs; or None.

    `limit` is the OPD error allowed to each ray [m].
    """
    close = closeness(field, limit)
    for family in known:
        if family.close > close:
            continue  # it was found at a looser tolerance, for which more distant lines counted as one
        if isinstance(until, ArcLength) and np.isfinite(family.ahead):
            continue  # the length of the rays matters, so they cannot be shifted along their lines
        # An image has many bundles: testing a few rays rules out most families.
        if len(known) > 1 and not family.holds_for(rays.pilot.position, rays.pilot.direction).all():
            continue
        ends = parameter_range(field, rays, family)
        if ends is not None and family.serves(*ends):
            return family
    return None


def parameter_range(field: IndexField, rays: RayBundle, family: Family) -> tuple[np.ndarray, np.ndarray] | None:
    """The least and greatest parameters of the sampled rays, each of shape (2,); the sample is that of `find_family`.

    None where some of them do not belong to the family.
    """
    count = rays.ray_count
    rows = field.derive(("rows of a family", count), lambda: some_rows(count, SAMPLE), CACHED)
    position, direction = rays.held("position"), rays.held("direction")
    if isinstance(position, DeviceArray) and isinstance(direction, DeviceArray):
        from ..engines.warp.family_range import family_on_device, range_on_device, rows_on_device

        device = position.device
        there = field.derive(
            ("rows of a family on a device", device, count), lambda: rows_on_device(rows, device), CACHED
        )
        frame = field.derive(
            ("family on a device", device, family.key), lambda: family_on_device(family, device), CACHED
        )
        return range_on_device(frame, family.converges, there, position.buffer, direction.buffer)
    some, along = np.asarray(position[rows]), np.asarray(direction[rows])
    if not family.holds_for(some, along).all():
        return None
    parameters = family.parameters(some, along)
    return parameters.min(axis=0), parameters.max(axis=0)
