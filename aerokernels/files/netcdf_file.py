"""Writing NetCDF-4, on a full disk too: HDF5 gets a file that does not fail there, but says so afterwards."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray


def write_netcdf(path: Path, dataset: "xarray.Dataset", encoding: Mapping[str, Any] | None = None) -> None:
    """Write a dataset as NetCDF-4; `encoding` by variable, as xarray has it.

    Raises:
        OSError: The disk is full, or fails; what was written by then is no whole file.
    """
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    with RetryingFile(path) as disk:
        with h5netcdf.File(disk, "w") as file:
            dataset.dump_to_store(H5NetCDFStore(file, autoclose=False), encoding=encoding or {})
        if disk.failure:
            raise disk.failure


class RetryingFile(io.FileIO):
    """Takes every byte; bytes for which there is no room are dropped, and the reason is kept.

    HDF5 cannot close a file to which it cannot write: it complains at length, and ends the process with a segmentation
    fault. With this file it can, and its user raises `failure` instead.

    Args:
        path: the file, made or emptied.
    """

    def __init__(self, path: Path) -> None:
        """Make the file."""
        super().__init__(path, "w+")
        self.failure: OSError | None = None
        """What went wrong first."""

    def write(self, data: Any) -> int:
        """Write all of `data`, or drop it."""
        rest = memoryview(data).cast("B")
        size = len(rest)
        try:
            while rest:
                rest = rest[super().write(rest) :]
        except OSError as error:
            self.failure = self.failure or error
        return size

    def truncate(self, size: int | None = None) -> int:
        """Cut or lengthen the file, where there is room."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0

    def readinto(self, buffer: Any) -> int:
        """What was written; zeros where it was dropped."""
        room = memoryview(buffer).cast("B")
        count = super().readinto(room)
        room[count:] = bytes(len(room) - count)
        return len(room)
