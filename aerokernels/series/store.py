"""Maps of a series as they are made: in memory, or in a Zarr store that a kill at any moment leaves whole.

Each snapshot's map is a chunk of its own, written in one step, and then a line of a journal beside the store says that
it is there, with the snapshot's numbers. After a break the maps that the journal names are kept, and what follows is
what an unbroken run would have made, bit for bit.
"""

import errno
import json
import os
import shutil
import warnings
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.plain_text import cut
from aerokernels.files.drafts import FULL, OutputError
from aerokernels.files.one_writer import only_writer

if TYPE_CHECKING:
    import xarray

MAPS = {
    "opd": ("f8", "m", "optical path difference, terms removed"),
    "valid": ("?", "1", "whether the ray came through"),
}
NUMBERS = {
    "strehl": ("1", "Strehl ratio of opd"),
    "strehl_error": ("1", "what strehl may be off by for the error of opd and for the pixels"),
    "boresight_x": ("rad", "tilt of the wavefront along x"),
    "boresight_x_error": ("rad", "what boresight_x may be off by for the error of opd and for the pixels"),
    "boresight_y": ("rad", "tilt of the wavefront along y"),
    "boresight_y_error": ("rad", "what boresight_y may be off by for the error of opd and for the pixels"),
    "piston": ("m", "mean optical path difference"),
    "opd_rms": ("m", "rms of the optical path difference, mean and tilt removed"),
    "opd_rms_error": ("m", "what opd_rms may be off by for the error of opd and for the pixels"),
    "opd_rms_with_tilt": ("m", "rms of the optical path difference, mean removed"),
    "opd_rms_with_tilt_error": ("m", "what opd_rms_with_tilt may be off by for the error of opd and for the pixels"),
    "error": ("m", "what opd may be off by, rms over the pupil"),
    "known": ("1", "share of the pupil whose rays came through known air; the rest is in no number"),
    "traced": ("1", "1 where the snapshot was traced in full, 0 on straight lines"),
    "slope": ("1", "mean square of the wavefront's slopes"),
    "probe": ("m", "bending's part of opd where it was measured, rms"),
    "probe_interpolation": ("m", "the interpolant's part where it was measured, rms"),
}


FIRST = "first snapshot"  # of what a store is of: a mark of its samples


class Done:
    """The numbers of the snapshots that are done, in their order: one block of memory from the start.

    Attributes:
        count: How many are done.
    """

    def __init__(self, total: int):
        """Begin with none of `total`."""
        self.count, self._table = 0, np.full((total, len(NUMBERS)), np.nan)

    def add(self, numbers: Mapping[str, float]) -> None:
        """One more."""
        self._table[self.count] = [numbers[name] for name in NUMBERS]
        self.count += 1

    def column(self, name: str) -> np.ndarray:
        """A number of those that are done, shape (count,)."""
        return np.array(self._table[: self.count, list(NUMBERS).index(name)])


class MemoryStore:
    """Everything in memory.

    Attributes:
        done: The numbers of the snapshots that are done.
    """

    def __init__(self, template: "xarray.Dataset"):
        """Begin with nothing done."""
        self.template = template
        self.done = Done(template.sizes["time"])
        shape = tuple(template.sizes[name] for name in ("time", "y", "x"))
        self._maps = {name: np.empty(shape, kind) for name, (kind, _, _) in MAPS.items()}

    @contextmanager
    def writing(self) -> Iterator["MemoryStore"]:
        """Nothing to open."""
        yield self

    def add(self, maps: Mapping[str, np.ndarray], numbers: Mapping[str, float]) -> None:
        """Keep a snapshot."""
        for name, array in maps.items():
            self._maps[name][self.done.count] = array
        self.done.add(numbers)

    def finish(self) -> "xarray.Dataset":
        """The dataset."""
        found = self.template.copy()
        for name, (_, units, words) in MAPS.items():
            found[name] = (("time", "y", "x"), self._maps[name], {"units": units, "long_name": words})
        for name, (units, words) in NUMBERS.items():
            found[name] = (("time",), self.done.column(name), {"units": units, "long_name": words})
        return found


class ZarrStore:
    """A Zarr store and its journal.

    Attributes:
        done: The numbers of the snapshots that are done.
    """

    def __init__(self, path: Path, template: "xarray.Dataset", definition: Mapping[str, Any]):
        """Open a store, or prepare one that is made with the first snapshot.

        Raises:
            ValueError: Something else lies there, or a series of something else.
            ImportError: No Zarr.
        """
        try:
            import zarr  # noqa: F401
        except ImportError:
            raise ImportError("out needs Zarr: pip install 'aerokernels[dask]', or leave out= away") from None
        self.path, self.template = path, template
        self.definition = json.loads(json.dumps(definition, default=str))
        self.journal = path.with_name(f".{path.name}.journal")
        self.done = Done(template.sizes["time"])
        self._whole = 0
        self._arrays: dict[str, Any] = {}
        if self.journal.is_file() and path.is_dir():
            self._read()
        elif path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise ValueError(f"out={path}: something else lies there; take another name, or remove it")

    def _read(self) -> None:
        data = self.journal.read_bytes()
        self._whole = data.rfind(b"\n") + 1
        lines = data[: self._whole].splitlines()
        try:
            found, *rows = map(json.loads, lines or [b"null"])
            numbers = [dict(zip(NUMBERS, map(float, row), strict=True)) for row in rows]
        except (ArithmeticError, RecursionError, TypeError, ValueError):
            raise self._damaged() from None
        if not isinstance(found, (dict, type(None))) or len(numbers) > self.template.sizes["time"]:
            raise self._damaged()
        if found != self.definition:
            found = found or {}
            keys = {**found, **self.definition}
            key = next((key for key in keys if found.get(key) != self.definition.get(key)), "all")
            was, now = (cut(json.dumps(one.get(key))) for one in (found, self.definition))
            told = f"{key} was {was} and is {now}"
            told = "whose first snapshot has other densities" if key == FIRST else told
            raise ValueError(f"out={self.path}: it holds another series, {told}; take another name, or remove it")
        for row in numbers:
            self.done.add(row)

    def _damaged(self, what: str = "") -> ValueError:
        what = what or f"its journal {self.journal.name} is damaged"
        return ValueError(f"out={self.path}: {what}; take another name, or remove both")

    @property
    def is_finished(self) -> bool:
        """Whether all snapshots are there, and the numbers in the store."""
        done = self.done.count == self.template.sizes["time"]
        return done and bool(self._group().attrs.get("finished", False))

    def _group(self) -> Any:
        """The store, where its arrays are those of this series and hold the maps that the journal names.

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
        # Zarr reads a chunk that is lost as one without a ray, for which it keeps none.
        for number in np.flatnonzero(np.isfinite(self.done.column("strehl"))):
            for name in MAPS:
                if not (self.path / name / "c" / str(number) / "0" / "0").is_file():
                    raise self._damaged(f"{name} of snapshot {number}, which the journal names, is lost")
        return group

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        """Zarr meets what is damaged with any error: it is told with the store's name."""
        try:
            yield
        except Exception as fault:
            if isinstance(fault, OSError) and fault.errno in FULL:
                raise
            said = " ".join(f"{type(fault).__name__}: {str(fault)[:200]}".split())
            raise self._damaged(f"the store is damaged ({said})") from fault

    @contextmanager
    def writing(self) -> Iterator["ZarrStore"]:
        """Write to the store; it is made with the first snapshot, so that what fails at once leaves nothing.

        Raises:
            OutputError: No room for what is written.
        """
        with ExitStack() as self._open:
            yield self

    def _begin(self) -> None:
        """Make the store where there is none, and open the journal."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._open.enter_context(self._alone())
        if not (self.journal.is_file() and self.path.is_dir()):
            self._create()
        self._file = self._open.enter_context(self.journal.open("ab", buffering=0))
        self._file.truncate(self._whole)
        group = self._group()
        self._arrays = {name: group[name] for name in MAPS}

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Hold the store against another process: one that writes now, or that wrote since the journal was read.

        Raises:
            ValueError: There is one.
        """
        with only_writer(self.path, "out"):
            there = self.journal.is_file() and self.path.is_dir()
            if there and self.journal.read_bytes().rfind(b"\n") + 1 != self._whole:
                raise self._busy()
            yield

    def _busy(self) -> ValueError:
        return ValueError(f"out={self.path}: another process is at work there; wait for it, or take another")

    def _create(self) -> None:
        """The store with all its arrays, empty, and the journal with what it is of.

        The store is made under another name and gets its own last: there is none without a journal.
        """
        making = self.path.with_name(f".{self.path.name}.partial")
        partial = self.journal.with_name(f"{self.journal.name}.partial")
        try:
            self._make(making, partial)
        finally:  # where it was made it has its own name by now
            shutil.rmtree(making, ignore_errors=True)
            partial.unlink(missing_ok=True)

    def _make(self, making: Path, partial: Path) -> None:
        import zarr

        shutil.rmtree(making, ignore_errors=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.template.to_zarr(making, mode="w", consolidated=False)
        group = zarr.open_group(str(making), mode="r+")
        dims = ("time", "y", "x")
        times, *sides = (self.template.sizes[name] for name in dims)
        numbers = {name: ("f8", *told) for name, told in NUMBERS.items()}
        for name, (kind, units, words) in {**MAPS, **numbers}.items():
            is_map = name in MAPS
            group.create_array(
                name,
                shape=(times, *sides) if is_map else (times,),
                chunks=(1, *sides) if is_map else (times,),
                dtype=np.dtype(kind),
                fill_value=np.nan if kind == "f8" else False,
                dimension_names=dims if is_map else dims[:1],
                attributes={"units": units, "long_name": words},
            )
        _consolidate(making)
        partial.write_text(json.dumps(self.definition) + "\n", encoding="utf-8")
        self._whole = partial.stat().st_size
        partial.replace(self.journal)
        if self.path.is_dir():
            self.path.rmdir()  # empty, or it would have been refused
        making.rename(self.path)

    def add(self, maps: Mapping[str, np.ndarray], numbers: Mapping[str, float]) -> None:
        """Keep a snapshot: its maps first, and then the line that says so.

        Raises:
            OutputError: There is no room for it; what was kept before stays, and a series goes on there.
        """
        with self._in_room():
            if not self._arrays:
                self._begin()
            for name, array in maps.items():
                self._arrays[name][self.done.count] = array
            line = (json.dumps([float(numbers[name]) for name in NUMBERS]) + "\n").encode()
            if self._file.write(line) != len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        self.done.add(numbers)

    @contextmanager
    def _in_room(self) -> Iterator[None]:
        """A disk that is full is told with the store's name."""
        try:
            yield
        except OSError as fault:
            if fault.errno in FULL and not isinstance(fault, OutputError):
                raise OutputError(self.path, fault, "out=") from fault
            raise

    def finish(self) -> "xarray.Dataset":
        """Write the numbers, and open the whole lazily.

        Raises:
            ValueError: The store is damaged.
        """
        import xarray

        group = self._group()
        with self._in_room(), self._in_words():
            for name in NUMBERS:
                column = self.done.column(name)
                if not np.array_equal(group[name][:], column, equal_nan=True):  # none yet, or lost since
                    group[name][:] = column
            if not group.attrs.get("finished", False):
                group.attrs["finished"] = 1  # NetCDF has no attributes that are true or false
                _consolidate(self.path)
            found = xarray.open_zarr(self.path, consolidated=False, chunks=None)
        if lost := {*MAPS, *NUMBERS, *self.template.coords} - set(found.variables):
            raise self._damaged(f"{min(lost)} is lost from the store")
        from .lazy_maps import told_with_their_store

        return told_with_their_store(self.path, found, MAPS)


def _consolidate(path: Path) -> None:
    """Put what all arrays of a store are into one place, where xarray looks for it first."""
    import zarr

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that the third format of Zarr has no such place in its standard
        zarr.consolidate_metadata(str(path))
