"""Maps of a series as they are computed: in memory, or in a Zarr store that a kill at any moment leaves consistent.

Each snapshot's map is a chunk of its own, written in one step. Then a line with the snapshot's numbers is added to a
journal beside the store. After an interruption the maps that the journal lists are kept, and the rest is what an
uninterrupted run would have computed, bit for bit. Maps of files that have changed since are not kept, nor are those
after them, which were computed with numbers of theirs.
"""

import errno
import json
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.files.writing import FULL, OutputError, only_writer
from aerokernels.files.zarr_codecs import check_codecs
from aerokernels.process.foreign_files import FileFault, fault_text

from .journal import DamagedError, OtherSeriesError, line_of, read_journal
from .nearest_errors import nearest_in_time
from .store_arrays import KEPT, MAPS, NUMBERS, VALUES, consolidate, lengthen_arrays, make_arrays

if TYPE_CHECKING:
    import xarray


class Done:
    """The numbers of the finished snapshots, in their order: one block of memory from the start.

    Attributes:
        count: Number of finished snapshots.
    """

    def __init__(self, total: int):
        """Start with none of `total` finished."""
        self.count, self._table = 0, np.full((total, len(KEPT)), np.nan)

    def add(self, numbers: Mapping[str, float]) -> None:
        """Add a snapshot."""
        self._table[self.count] = [numbers[name] for name in KEPT]
        self.count += 1

    def column(self, name: str) -> np.ndarray:
        """Return one of KEPT of all finished snapshots, shape (count,)."""
        return np.array(self._table[: self.count, KEPT.index(name)])

    def told(self, name: str) -> np.ndarray:
        """Return one of NUMBERS of all finished snapshots, shape (count,): errors by all causes, of every snapshot."""
        number = name.removesuffix("_error")
        if number in VALUES and number != name:
            return np.hypot(self._nearest(f"{number}_model"), self.column(f"{number}_pixels"))
        return self._nearest(name) if name == "error" else self.column(name)

    def _nearest(self, name: str) -> np.ndarray:
        return nearest_in_time(self.column(name), self.column("slope"), len(self._table))


class MemoryStore:
    """Everything in memory.

    Attributes:
        done: The numbers of the finished snapshots.
    """

    def __init__(self, template: "xarray.Dataset"):
        """Start with no finished snapshot."""
        self.template = template
        self.done = Done(template.sizes["time"])
        shape = tuple(template.sizes[name] for name in ("time", "y", "x"))
        self._maps = {name: np.empty(shape, kind) for name, (kind, _, _) in MAPS.items()}

    @contextmanager
    def writing(self) -> Iterator["MemoryStore"]:
        """Do nothing: there is nothing to open."""
        yield self

    def add(self, maps: Mapping[str, np.ndarray], numbers: Mapping[str, float], source: Sequence[str] = ()) -> None:
        """Store a snapshot."""
        for name, array in maps.items():
            self._maps[name][self.done.count] = array
        self.done.add(numbers)

    def finish(self) -> "xarray.Dataset":
        """Return the dataset."""
        found = self.template.copy()
        for name, (_, units, words) in MAPS.items():
            found[name] = (("time", "y", "x"), self._maps[name], {"units": units, "long_name": words})
        for name, (units, words) in NUMBERS.items():
            found[name] = (("time",), self.done.told(name), {"units": units, "long_name": words})
        return found


class ZarrStore:
    """A Zarr store and its journal.

    Attributes:
        done: The numbers of the finished snapshots.
        changed_count: Number of finished snapshots that are not kept because files have changed since.
    """

    def __init__(
        self,
        path: Path,
        template: "xarray.Dataset",
        definition: Mapping[str, Any],
        is_unchanged: Callable[[int, str, str], bool] = lambda number, stamp, mark: True,
        earlier: Callable[[Mapping[str, Any]], Mapping[str, Any] | None] = lambda found: None,
    ):
        """Open a store, or prepare one that is created with the first snapshot.

        Args:
            path: The store.
            template: Coordinates, weights and attributes.
            definition: What distinguishes the run from others with the same store.
            is_unchanged: Whether a snapshot is the one that was stored with this stamp and this mark.
            earlier: Returns the definition of the same series when it had fewer snapshots, as many as in the definition
                found; None if it never had.

        Raises:
            ValueError: The path is something else, or a store of another series.
            ImportError: Zarr is not installed.
        """
        try:
            import zarr  # noqa: F401
        except ImportError:
            raise ImportError("out needs Zarr: pip install 'aerokernels[dask]', or leave out= away") from None
        self.path, self.template = path, template
        self.definition = json.loads(json.dumps(definition, default=str))
        self.journal = path.with_name(f".{path.name}.journal")
        self.done = Done(template.sizes["time"])
        self.changed_count, self._has_grown = 0, False
        self._kept_size = self._read_size = 0  # bytes of the journal that are kept, and of its whole lines
        self._arrays: dict[str, Any] = {}
        if self.journal.is_file() and path.is_dir():
            try:
                check_codecs(path)
            except FileFault as fault:
                raise self._damaged(f"the store is damaged ({fault})") from None
            self._read(is_unchanged, earlier)
        elif path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise ValueError(f"out={path}: something else is there; take another name, or remove it")

    def _read(self, is_unchanged: Callable[[int, str, str], bool], earlier: Callable[..., Any]) -> None:
        try:
            kept = read_journal(self.journal.read_bytes(), self.definition, KEPT, is_unchanged, earlier)
        except DamagedError:
            raise self._damaged() from None
        except OtherSeriesError as fault:
            text = f"it contains another series, {fault}; take another name, or remove it"
            raise ValueError(f"out={self.path}: {text}") from None
        if len(kept.rows) + kept.changed_count > self.template.sizes["time"]:
            raise self._damaged()
        self._kept_size, self._read_size, self.changed_count = kept.size, kept.whole, kept.changed_count
        self._has_grown = kept.has_grown
        for numbers in kept.rows:
            self.done.add(numbers)

    def _damaged(self, what: str = "") -> ValueError:
        what = what or f"its journal {self.journal.name} is damaged"
        return ValueError(f"out={self.path}: {what}; take another name, or remove both")

    @property
    def is_finished(self) -> bool:
        """Whether all snapshots are finished, and the numbers are in the store."""
        done = self.done.count == self.template.sizes["time"]
        return done and bool(self._group().attrs.get("finished", False))

    def _group(self) -> Any:
        """Return the store, after checking that its arrays fit this series and contain the maps that the journal lists.

        Raises:
            ValueError: It is damaged.
        """
        import zarr

        times, *sizes = (self.template.sizes[name] for name in ("time", "y", "x"))
        with self._in_words():
            group = zarr.open_group(str(self.path), mode="r+")
            shapes = {**dict.fromkeys(MAPS, (times, *sizes)), **dict.fromkeys(NUMBERS, (times,))}
            other = next((name for name, shape in shapes.items() if group[name].shape != shape), None)
        if other:
            raise self._damaged(f"{other} in the store has another shape than the series")
        # Zarr reads a lost chunk as fill values, as it does for a map without rays, for which it stores no chunk.
        for number in np.flatnonzero(np.isfinite(self.done.column("strehl"))):
            for name in MAPS:
                if not (self.path / name / "c" / str(number) / "0" / "0").is_file():
                    raise self._damaged(f"{name} of snapshot {number}, which the journal names, is lost")
        return group

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        """Convert any error that Zarr raises for damaged data to a ValueError with the store's name."""
        try:
            yield
        except Exception as fault:
            if isinstance(fault, OSError) and fault.errno in FULL:
                raise
            raise self._damaged(f"the store is damaged ({fault_text(fault)})") from fault

    @contextmanager
    def writing(self) -> Iterator["ZarrStore"]:
        """Open the store for writing; it is created with the first snapshot, so that an early failure leaves nothing.

        Raises:
            OutputError: The disk is full.
        """
        with ExitStack() as self._open:
            yield self

    def _begin(self) -> None:
        """Create the store if there is none, and open the journal."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._open.enter_context(self._alone())
        if not (self.journal.is_file() and self.path.is_dir()):
            self._create()
        elif self._has_grown:
            self._grow()
        self._file = self._open.enter_context(self.journal.open("ab", buffering=0))
        self._file.truncate(self._kept_size)
        group = self._group()
        if (self.changed_count or self._has_grown) and group.attrs.pop("finished", 0):
            consolidate(self.path)
        self._arrays = {name: group[name] for name in MAPS}

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Lock the store against another process that writes now, or that wrote since the journal was read.

        Raises:
            ValueError: There is such a process.
        """
        with only_writer(self.path):
            there = self.journal.is_file() and self.path.is_dir()
            if there and self.journal.read_bytes().rfind(b"\n") + 1 != self._read_size:
                raise self._busy()
            yield

    def _busy(self) -> ValueError:
        return ValueError(f"out={self.path}: another process is at work there; wait for it, or take another")

    def _create(self) -> None:
        """Create the store with all its arrays, empty, and the journal with its definition.

        The store is created under a temporary name and renamed last, so that no store exists without a journal.
        """
        making = self.path.with_name(f".{self.path.name}.partial")
        partial = self.journal.with_name(f"{self.journal.name}.partial")
        try:
            self._make(making, partial)
        finally:  # on success both have been renamed
            shutil.rmtree(making, ignore_errors=True)
            partial.unlink(missing_ok=True)

    def _make(self, making: Path, partial: Path) -> None:
        shutil.rmtree(making, ignore_errors=True)
        make_arrays(making, self.template)
        partial.write_text(json.dumps(self.definition) + "\n", encoding="utf-8")
        self._kept_size = self._read_size = partial.stat().st_size
        partial.replace(self.journal)
        if self.path.is_dir():
            self.path.rmdir()  # empty, or it would have been refused
        making.rename(self.path)

    def _grow(self) -> None:
        """Make the store longer, and then replace the definition in its journal; a kill between them does no harm."""
        with self._in_words():
            lengthen_arrays(self.path, self.template)
        _, _, rows = self.journal.read_bytes()[: self._kept_size].partition(b"\n")
        partial = self.journal.with_name(f"{self.journal.name}.partial")
        partial.write_bytes(json.dumps(self.definition).encode() + b"\n" + rows)
        self._kept_size = self._read_size = partial.stat().st_size
        partial.replace(self.journal)

    def add(self, maps: Mapping[str, np.ndarray], numbers: Mapping[str, float], source: Sequence[str] = ()) -> None:
        """Store a snapshot: first its maps, then its line in the journal, with its stamp and its mark if it has them.

        Raises:
            OutputError: The disk is full; earlier snapshots remain, and a later run continues after them.
        """
        with self._in_room():
            if not self._arrays:
                self._begin()
            for name, array in maps.items():
                self._arrays[name][self.done.count] = array
            line = line_of([float(numbers[name]) for name in KEPT], source)
            if self._file.write(line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.done.add(numbers)

    @contextmanager
    def _in_room(self) -> Iterator[None]:
        """Convert errors of a full disk to an OutputError with the store's name."""
        try:
            yield
        except OSError as fault:
            if fault.errno in FULL and not isinstance(fault, OutputError):
                raise OutputError(self.path, fault) from fault
            raise

    def finish(self) -> "xarray.Dataset":
        """Write the numbers, and open the whole store lazily.

        Raises:
            ValueError: The store is damaged.
        """
        import xarray

        group = self._group()
        with self._in_room(), self._in_words():
            for name in NUMBERS:
                column = self.done.told(name)
                if not np.array_equal(group[name][:], column, equal_nan=True):  # not written yet, or lost since
                    group[name][:] = column
            if not group.attrs.get("finished", False):
                group.attrs["finished"] = 1  # NetCDF has no attributes that are true or false
                consolidate(self.path)
            found = xarray.open_zarr(self.path, consolidated=False, chunks=None)
        if lost := {*MAPS, *NUMBERS, *self.template.coords} - set(found.variables):
            raise self._damaged(f"{min(lost)} is lost from the store")
        from .lazy_maps import name_damaged_arrays

        return name_damaged_arrays(self.path, found, MAPS)
