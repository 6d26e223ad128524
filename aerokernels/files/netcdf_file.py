"""Write NetCDF-4 files, with a clear error on a full disk: HDF5 writes to a file object that never fails."""

import io
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray


def write_netcdf(path: Path, dataset: "xarray.Dataset", encoding: Mapping[str, Any] | None = None) -> None:
    """Write a dataset as NetCDF-4; `encoding` by variable, as in xarray.

    Raises:
        OSError: The disk is full, or fails; the file is then incomplete.
    """
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    with RetryingFile(path) as disk:
        with h5netcdf.File(disk, "w") as file:
            dataset.dump_to_store(H5NetCDFStore(file, autoclose=False), encoding=encoding or {})
        if disk.failure:
            raise disk.failure


class RetryingFile(io.FileIO):
    """A file that accepts every byte, drops the bytes that cannot be written, and stores the reason.

    HDF5 cannot close a file to which it cannot write: it prints many errors and ends the process with a segmentation
    fault. With this file it can close, and the caller raises `failure` instead.

    Args:
        path: The file, created or emptied.
    """

    def __init__(self, path: Path) -> None:
        """Create or empty the file."""
        super().__init__(path, "w+")
        self.failure: OSError | None = None
        """The first error."""

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
        """Shorten or lengthen the file, if there is space."""
        try:
            return super().truncate(size)
        except OSError as error:
            self.failure = self.failure or error
            return size or 0

    def readinto(self, buffer: Any) -> int:
        """Read what was written, with zeros for dropped bytes."""
        room = memoryview(buffer).cast("B")
        count = super().readinto(room)
        room[count:] = bytes(len(room) - count)
        return len(room)
