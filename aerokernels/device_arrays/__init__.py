"""Arrays on a device: taken from other libraries, made there, kept there, and copied to the host when they are read.

Warp holds the memory. `array.py` has one number or three for each ray, `on_touch.py` attributes that are copied to the
host when they are first read, `pinned.py` the copies, `fetching.py` those that are made ahead, `rays.py` rays checked
or made on the device, `foreign.py` what comes from other libraries. Nothing here imports Warp before it is used.
"""

from .array import DeviceArray, extremes_of, in_reach, is_one_row, on_host, rows_there, rows_where
from .foreign import device_array, host_array, plain_array
from .on_touch import read_on_touch

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
    "rows_there",
    "rows_where",
]
