"""Arrays on a device: imported from other libraries or made there, and copied to the host when they are first read.

Warp owns the memory. `array.py` has arrays of one number or three per ray, attributes that are copied to the host when
they are first read, and arrays of other libraries, `pinned.py` the copies, `rays.py` rays that are checked or made on
the device, `selection.py` rays found there. Nothing here imports Warp before it is used.
"""

from .array import (
    DeviceArray,
    device_array,
    extremes_of,
    host_array,
    in_reach,
    is_one_row,
    on_host,
    plain_array,
    read_on_touch,
    rows_beside,
    rows_where,
)

__all__ = [
    "DeviceArray",
    "device_array",
    "extremes_of",
    "host_array",
    "in_reach",
    "is_one_row",
    "on_host",
    "plain_array",
    "read_on_touch",
    "rows_beside",
    "rows_where",
]
