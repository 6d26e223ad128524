"""Numbers on a device, one row for each ray, that are copied to the host when they are first read there."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from .fetching import Coming
from .foreign import plain_array
from .pinned import layout_of, to_host


class DeviceArray:
    """An array of Warp's, of numbers or of vectors, that NumPy, DLPack and `__cuda_array_interface__` read.

    It has one row for each ray. `host` is the same as a NumPy array, copied when it is first read, unless it is on its
    way already, and kept; on Warp's CPU device nothing is copied. It pickles as that.

    Attributes:
        buffer: The warp.array.
        extremes: See `extremes_of`, where it has been asked for.
    """

    def __init__(self, buffer: Any, coming: Coming | None = None):
        """Take over an array of one dimension, and what of it comes to the host."""
        self.buffer = buffer
        self._coming = coming
        self._host: np.ndarray | None = None
        self.extremes: Extremes | None = None

    @property
    def device(self) -> str:
        """Warp's name of the device: "cpu", "cuda:0"."""
        return str(self.buffer.device.alias)

    @property
    def host(self) -> np.ndarray:
        """All rows as a NumPy array."""
        if self._host is None:
            self._host = to_host(self.buffer) if self._coming is None else self._coming.arrived()
            self._coming = None
        return self._host

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.buffer)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """All rows, for NumPy."""
        return np.array(self.host, dtype=dtype, copy=copy)

    def __dlpack__(self, *, stream: Any = None, **options: Any) -> Any:
        """The array itself, for whatever library asks; its device is the one to read it on."""
        return self.buffer.__dlpack__(stream)

    def __dlpack_device__(self) -> tuple[int, int]:
        """DLPack's numbers of the device."""
        kind, number = self.buffer.__dlpack_device__()
        return int(kind), int(number)

    @property
    def __cuda_array_interface__(self) -> dict:
        """The array itself, of a CUDA device."""
        return dict(self.buffer.__cuda_array_interface__)

    def __reduce__(self) -> tuple:
        """Pickled as what the host reads."""
        return np.array, (self.host,)

    def __getitem__(self, rows: Any) -> np.ndarray:
        """Some rows, a slice or an array of their numbers, as a NumPy array; no other is copied from the device."""
        if self._host is not None:
            return np.asarray(self._host[rows])
        if isinstance(rows, slice):
            first, last, step = rows.indices(len(self))
            if step == 1 and last > first:
                return np.asarray(self.buffer[first:last].numpy())
            rows = np.arange(first, last, step)
        rows, count = np.asarray(rows), len(self)
        if rows.dtype == bool:
            if rows.shape != (count,):
                raise IndexError(f"a mask of shape {rows.shape} is not one of {count} rows")
            rows = np.flatnonzero(rows)
        if not len(rows):
            return np.zeros((0, *self.host_shape[1:]), self.dtype)
        if not (-count <= rows.min() and rows.max() < count):
            raise IndexError(f"rows {rows.min()} to {rows.max()} are not all among {count}")
        return np.asarray(self._at(rows % count).contiguous().numpy())

    def __setitem__(self, rows: Any, values: "np.ndarray | DeviceArray") -> None:
        """Write some rows, by an array of their numbers, NumPy's or Warp's."""
        import warp

        if not len(rows):
            return
        if isinstance(values, DeviceArray):
            given = values.buffer
        else:
            given = warp.array(np.ascontiguousarray(values, self.dtype), dtype=self.buffer.dtype, device=self.device)
        warp.copy(self._at(rows), given)
        if self._coming is not None:  # nobody has read it yet
            self._coming.arrived()[plain_array(rows)] = np.asarray(values)
        self._host = self.extremes = None

    def part(self, rows: Any) -> "DeviceArray":
        """Some rows, by an array of their numbers, NumPy's or Warp's, in an array of their own on the device."""
        return DeviceArray(self._at(rows).contiguous())

    @property
    def host_shape(self) -> tuple[int, ...]:
        """Its shape as a NumPy array."""
        return layout_of(self.buffer)[0]

    @property
    def dtype(self) -> np.dtype:
        """NumPy's type of its numbers."""
        return layout_of(self.buffer)[1]

    def _at(self, rows: Any) -> Any:
        import warp

        if isinstance(rows, np.ndarray) or rows.device != self.buffer.device:
            rows = warp.array(plain_array(rows), dtype=warp.int32, device=self.device)
        return warp.indexedarray(self.buffer, [rows])


@dataclass(frozen=True, eq=False)
class Extremes:
    """The ends of places or directions.

    Attributes:
        low: The least of each component, shape (3,).
        high: The greatest, shape (3,).
        rows: The rays that have them, the least and the greatest of each component in turn, shape (6,).
    """

    low: np.ndarray
    high: np.ndarray
    rows: np.ndarray


def extremes_of(array: np.ndarray | DeviceArray) -> Extremes:
    """The ends of places or directions, shape (n, 3)."""
    if isinstance(array, DeviceArray):
        if array.extremes is None:
            from .selection import extremes

            array.extremes = Extremes(*extremes(array.buffer))
        return array.extremes
    ends = [(int(np.argmin(values)), int(np.argmax(values))) for values in array.T]
    low, high = (np.array([values[end[k]] for values, end in zip(array.T, ends, strict=True)]) for k in (0, 1))
    return Extremes(low, high, np.ravel(ends))


def in_reach(array: Any, device: str) -> bool:
    """Whether it is an array that lies on this device of Warp's."""
    return isinstance(array, DeviceArray) and array.device == device


def is_one_row(array: np.ndarray | DeviceArray) -> bool:
    """Whether all rows of an array (n, 3) are one in memory: a direction that parallel rays share."""
    return isinstance(array, np.ndarray) and array.ndim == 2 and len(array) > 1 and array.strides[0] == 0


def on_host(arrays: dict[str, Any]) -> dict[str, np.ndarray]:
    """Arrays by name as NumPy's, copied from a device where they lie there."""
    return {name: np.asarray(array) for name, array in arrays.items()}


def rows_there(status: np.ndarray | DeviceArray, code: int) -> Any:
    """Numbers of the rays with a status, ascending, where the status is: a warp.array, or a NumPy array."""
    if isinstance(status, DeviceArray):
        from .selection import rows_on_device

        return rows_on_device(status.buffer, code)
    return np.flatnonzero(np.asarray(status) == code)


def rows_where(
    status: np.ndarray | DeviceArray, code: int, error: np.ndarray | DeviceArray | None = None, limit: float = 0.0
) -> np.ndarray:
    """Numbers of the rays with a status, ascending; of those, too, whose error is not within a limit, if it is given.

    Args:
        status: A code for each ray.
        code: The one sought.
        error: A number for each ray, where the status is.
        limit: What it must not exceed; one that is no number does.
    """
    if isinstance(status, DeviceArray) and (error is None or isinstance(error, DeviceArray)):
        from .selection import selected_rows

        return selected_rows(status.buffer, code, None if error is None else error.buffer, limit)
    found = np.asarray(status) == code
    if error is not None:
        found |= ~(np.asarray(error) <= limit)
    return np.flatnonzero(found)
