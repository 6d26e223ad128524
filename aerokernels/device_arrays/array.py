"""Arrays on a device, one row per ray, that are copied to the host when first read there; arrays of other libraries.

Arrays of CuPy, PyTorch, JAX and Warp are imported by DLPack and `__cuda_array_interface__`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np

from ..process.opened import OPENED
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


# DLPack's numbers of memory that the CPU reads: its own, and memory pinned for a GPU.
PROCESSOR, PINNED = 1, 3


def host_array(found: Any) -> np.ndarray:
    """Return an array of any library as a NumPy array, float32 or float64; one on a device is copied.

    Raises:
        TypeError: It is not an array of real numbers.
    """
    array = plain_array(found)
    if array.dtype == object or not np.issubdtype(array.dtype, np.number) or np.iscomplexobj(array):
        raise TypeError(f"a snapshot must be an array of real numbers or a DensityField, got {type(found).__name__}")
    return array if array.dtype in (np.float32, np.float64) else array.astype(np.float64)


def plain_array(found: Any) -> np.ndarray:
    """Return any object as a NumPy array; arrays on a device are copied, arrays on the host only if necessary.

    An object that is not an array is converted by `numpy.asarray`.
    """
    if isinstance(found, np.ndarray):
        return found
    if is_on_device(found):
        array = _as_warp(found)
        return to_host(array.contiguous().flatten()).reshape(array.shape)
    if hasattr(found, "__dlpack__") and not hasattr(found, "__array__") and not hasattr(found, "__array_interface__"):
        return np.from_dlpack(found)
    return np.asarray(found.detach() if getattr(found, "requires_grad", False) else found)


def device_array(found: Any) -> Any:
    """Return an array on a GPU as a Warp array without a copy; None if it is elsewhere, or has whole numbers."""
    if isinstance(found, np.ndarray) or not is_on_device(found):
        return None
    import warp

    array = _as_warp(found)
    return array.contiguous() if array.dtype in (warp.float32, warp.float64) else None


def is_on_device(found: Any) -> bool:
    """Return whether an array is in memory that only a GPU reads, by `__cuda_array_interface__` or DLPack."""
    if hasattr(found, "__cuda_array_interface__"):
        return True
    device = getattr(found, "__dlpack_device__", None)
    return device is not None and int(device()[0]) not in (PROCESSOR, PINNED)


def _as_warp(found: Any) -> Any:
    """Return an array on a device as a Warp array of numbers, not of vectors."""
    import warp

    from ..process.quiet_warp import start_warp

    start_warp()
    if getattr(found, "requires_grad", False) and hasattr(found, "detach"):
        found = found.detach()
    if isinstance(found, warp.array) and found.dtype in (warp.float32, warp.float64):
        return found
    with OPENED.lock:  # it may open a device: see `quiet_warp.open_device`
        return warp.from_dlpack(found) if hasattr(found, "__dlpack__") else warp.array(found, copy=False)
