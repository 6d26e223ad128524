"""Array on a device, one row per ray, that is copied to the host when it is first read there."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from .foreign import plain_array
from .pinned import Lent, layout_of, to_host


class DeviceArray:
    """A Warp array of numbers or vectors that can be read through NumPy, DLPack and `__cuda_array_interface__`.

    It has one row per ray. `host` is a NumPy array of it, copied when first read, unless the copy has been started
    before, and cached; on Warp's CPU device nothing is copied. It pickles as this NumPy array.

    Attributes:
        buffer: The warp.array.
        extremes: Result of `extremes_of`, once it has been requested.
    """

    def __init__(self, buffer: Any, coming: Lent | None = None):
        """Wrap a one-dimensional array, and its copy that is on the way to the host, if any."""
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
        """Return all rows, for NumPy."""
        return np.array(self.host, dtype=dtype, copy=copy)

    def __dlpack__(self, *, stream: Any = None, **options: Any) -> Any:
        """Return the array itself for another library, which must read it on the same device."""
        return self.buffer.__dlpack__(stream)

    def __dlpack_device__(self) -> tuple[int, int]:
        """Return DLPack's numbers of the device."""
        kind, number = self.buffer.__dlpack_device__()
        return int(kind), int(number)

    @property
    def __cuda_array_interface__(self) -> dict:
        """The array itself, on a CUDA device."""
        return dict(self.buffer.__cuda_array_interface__)

    def __reduce__(self) -> tuple:
        """Pickle as the host's NumPy array."""
        return np.array, (self.host,)

    def __getitem__(self, rows: Any) -> np.ndarray:
        """Return rows, given as a slice, numbers or a mask, as a NumPy array; only these are copied from the device."""
        if self._host is not None:
            return np.asarray(self._host[rows])
        if isinstance(rows, slice):
            first, last, step = rows.indices(len(self))
            if step == 1 and last > first:
                return to_host(self.buffer[first:last])
            rows = np.arange(first, last, step)
        rows, count = np.asarray(rows), len(self)
        if rows.dtype == bool:
            if rows.shape != (count,):
                raise IndexError(f"a mask of shape {rows.shape} does not fit {count} rows")
            rows = np.flatnonzero(rows)
        if not len(rows):
            return np.zeros((0, *self.host_shape[1:]), self.dtype)
        if not (-count <= rows.min() and rows.max() < count):
            raise IndexError(f"rows {rows.min()} to {rows.max()} are not all among {count}")
        return to_host(self._at(rows % count).contiguous())

    def __setitem__(self, rows: Any, values: "np.ndarray | DeviceArray") -> None:
        """Write rows, given by their numbers: an array of NumPy's or Warp's, or Rows."""
        import warp

        if not len(rows):
            return
        if isinstance(values, DeviceArray):
            given = values.buffer
        else:
            given = warp.array(np.ascontiguousarray(values, self.dtype), dtype=self.buffer.dtype, device=self.device)
        warp.copy(self._at(rows), given)
        if self._coming is not None:  # the host's copy gets the new values too
            numbers = rows.host if isinstance(rows, Rows) else plain_array(rows)
            self._coming.arrived()[numbers] = np.asarray(values)
        self._host = self.extremes = None

    def part(self, rows: Any) -> "DeviceArray":
        """Return rows, given as in `__setitem__`, as a new array on the device."""
        return DeviceArray(self._at(rows).contiguous())

    @property
    def host_shape(self) -> tuple[int, ...]:
        """Shape as a NumPy array."""
        return layout_of(self.buffer)[0]

    @property
    def dtype(self) -> np.dtype:
        """NumPy's type of the numbers."""
        return layout_of(self.buffer)[1]

    def _at(self, rows: Any) -> Any:
        import warp

        rows = rows.there if isinstance(rows, Rows) else rows
        if isinstance(rows, np.ndarray) or rows.device != self.buffer.device:
            rows = warp.array(plain_array(rows), dtype=warp.int32, device=self.device)
        return warp.indexedarray(self.buffer, [rows])


@dataclass(frozen=True, eq=False)
class Rows:
    """Numbers of rows that are used several times, on the host and as a warp.array on a device."""

    host: np.ndarray
    there: Any

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.host)


@dataclass(frozen=True, eq=False)
class Extremes:
    """Extremes of positions or directions.

    Attributes:
        low: Least value of each component, shape (3,).
        high: Greatest value of each component, shape (3,).
        rows: Rays that have them, alternately the least and the greatest of each component, shape (6,).
    """

    low: np.ndarray
    high: np.ndarray
    rows: np.ndarray


def extremes_of(array: np.ndarray | DeviceArray) -> Extremes:
    """Return the extremes of positions or directions, shape (n, 3)."""
    if isinstance(array, DeviceArray):
        if array.extremes is None:
            from .selection import extremes

            array.extremes = Extremes(*extremes(array.buffer))
        return array.extremes
    ends = [(int(np.argmin(values)), int(np.argmax(values))) for values in array.T]
    low, high = (np.array([values[end[k]] for values, end in zip(array.T, ends, strict=True)]) for k in (0, 1))
    return Extremes(low, high, np.ravel(ends))


def in_reach(array: Any, device: str) -> bool:
    """Return whether `array` is a DeviceArray on this device of Warp."""
    return isinstance(array, DeviceArray) and array.device == device


def is_one_row(array: np.ndarray | DeviceArray) -> bool:
    """Return whether all rows of an array (n, 3) are the same memory: the common direction of parallel rays."""
    return isinstance(array, np.ndarray) and array.ndim == 2 and len(array) > 1 and array.strides[0] == 0


def on_host(arrays: dict[str, Any]) -> dict[str, np.ndarray]:
    """Return arrays by name as NumPy arrays, copied from the device if necessary."""
    return {name: np.asarray(array) for name, array in arrays.items()}


def rows_beside(array: np.ndarray | DeviceArray, rows: np.ndarray) -> Any:
    """Return row numbers also where `array` is, to be used several times."""
    if not isinstance(array, DeviceArray):
        return rows
    import warp

    return Rows(rows, warp.array(rows, dtype=warp.int32, device=array.device))


def rows_where(
    status: np.ndarray | DeviceArray, code: int, error: np.ndarray | DeviceArray | None = None, limit: float = 0.0
) -> np.ndarray:
    """Return the numbers, ascending, of the rays with a status, or with an error that is not within a limit, if given.

    Args:
        status: Status code of each ray.
        code: Status code to find.
        error: Error of each ray, on the same device as `status`.
        limit: Greatest error; NaN counts as greater.
    """
    if isinstance(status, DeviceArray) and (error is None or isinstance(error, DeviceArray)):
        from .selection import selected_rows

        return selected_rows(status.buffer, code, None if error is None else error.buffer, limit)
    found = np.asarray(status) == code
    if error is not None:
        found |= ~(np.asarray(error) <= limit)
    return np.flatnonzero(found)


C = TypeVar("C", bound=type)


class _OnTouch:
    """Descriptor of an array that is copied to the host when first read; the object's own dictionary holds it."""

    def __init__(self, name: str):
        self.name = name

    def __get__(self, instance: Any, owner: Any = None) -> Any:
        if instance is None:
            return None
        try:
            found = instance.__dict__[self.name]
        except KeyError:
            raise AttributeError(self.name) from None
        return found.host if isinstance(found, DeviceArray) else found

    def __set__(self, instance: Any, value: Any) -> None:
        instance.__dict__[self.name] = value


def read_on_touch(*names: str) -> Callable[[C], C]:
    """Decorate a data class: these fields may hold a DeviceArray, which reads as a NumPy array."""

    def decorate(target: C) -> C:
        for name in names:
            setattr(target, name, _OnTouch(name))
        return target

    return decorate
