"""Arrays on a device: imported from other libraries or made there, and copied to the host when they are first read.

Warp owns the memory. `array.py` has arrays of one number or three per ray, and attributes that are copied to the host
when they are first read, `pinned.py` the copies, `rays.py` rays that are checked or made on the device,
`selection.py` rays found there, `foreign.py` arrays of other libraries. Nothing here imports Warp before it is used.
"""

from .array import (
    DeviceArray,
    extremes_of,
    in_reach,
    is_one_row,
    on_host,
    read_on_touch,
    rows_beside,
    rows_where,
)
from .foreign import device_array, host_array, plain_array

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
