"""Maps of a series as they are computed: in memory, or in a Zarr store that a kill at any moment leaves consistent.

Each snapshot's maps are chunks of their own, each written in one step. The snapshot's row of the array `done` follows,
with its numbers. After an interruption the maps that `done` lists are kept, and the others are what an uninterrupted
run would have computed, bit for bit. Maps of files that have changed since are not kept, nor are those after them,
which were computed with numbers of theirs. What defines the run is an attribute of the store.
"""

import hashlib
import json
import shutil
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.plain_text import cut
from aerokernels.files.writing import FULL, draft_of, in_room, only_writer
from aerokernels.process.foreign_files import fault_text
from aerokernels.series.map_errors import nearest_in_time

if TYPE_CHECKING:
    import xarray

MAPS = {
    "opd": ("f8", "m", "optical path difference, terms removed"),
    "valid": ("?", "1", "whether the ray came through"),
}
VALUES = {
    "strehl": ("1", "Strehl ratio of opd"),
    "boresight_x": ("rad", "tilt of the wavefront along x"),
    "boresight_y": ("rad", "tilt of the wavefront along y"),
    "piston": ("m", "mean optical path difference"),
    "opd_rms": ("m", "rms of the optical path difference, mean and tilt removed"),
    "opd_rms_with_tilt": ("m", "rms of the optical path difference, mean removed"),
}
OTHERS = {
    "error": ("m", "error of opd in a pixel, terms removed; it covers the truth in 95 of 100 pixels"),
    "known": ("1", "share of the pupil whose rays came through; the rest is in no number"),
    "traced": ("1", "1 where the snapshot was traced in full, 0 on straight lines"),
    "slope": ("1", "mean square of the wavefront's slopes"),
    "probe": ("m", "bending's part of opd where it was measured, rms"),
}
# What a finished store has of each snapshot, with units and meanings.
NUMBERS = {
    **VALUES,
    **{
        f"{name}_error": (units, f"error of {name}; it covers the truth in 95 of 100 cases")
        for name, (units, _) in VALUES.items()
    },
    **OTHERS,
}
# What `done` has of each snapshot: its numbers, errors by the model, NaN where they were not computed, and by the
# pixels, and codes of its files' stamp and of its samples' mark (see `code_of`).
KEPT = (*VALUES, *OTHERS, *(f"{name}_{cause}" for name in VALUES for cause in ("model", "pixels")), "stamp", "mark")
# Keys of a definition: hashes of samples. Runs from one initial flow differ in their last snapshots.
FIRST, LAST = "first snapshot", "last snapshot"


def code_of(text: str) -> float:
    """Return a whole number below 2^52 that tells a text from others."""
    return float(int(hashlib.sha256(text.encode()).hexdigest()[:13], 16))


class Done:
    """The numbers of the finished snapshots, in their order: one block of memory from the start.

    Attributes:
        count: Number of finished snapshots.
    """

    def __init__(self, total: int):
        """Start with none of `total` finished."""
        self.count, self._table = 0, np.full((total, len(KEPT)), np.nan)

    def add(self, numbers: Mapping[str, float]) -> np.ndarray:
        """Add a snapshot; return its row."""
        self._table[self.count] = [numbers.get(name, np.nan) for name in KEPT]
        self.count += 1
        return self._table[self.count - 1]

    def keep(self, rows: np.ndarray) -> None:
        """Take the rows of an earlier run."""
        self.count = len(rows)
        self._table[: self.count] = rows

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
    def writing(self) -> Iterator[None]:
        """Do nothing: there is nothing to open."""
        yield

    def add(self, maps: Mapping[str, np.ndarray], numbers: Mapping[str, float]) -> None:
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
    """A Zarr store.

    Attributes:
        done: The numbers of the finished snapshots.
        changed_count: Number of finished snapshots that are not kept because files have changed since.
    """

    def __init__(
        self,
        path: Path,
        template: "xarray.Dataset",
        define: Callable[[int], Mapping[str, Any]],
        is_unchanged: Callable[[int, float, float], bool] = lambda number, stamp, mark: True,
    ):
        """Open a store, or prepare one that is created with the first snapshot.

        Args:
            path: The store.
            template: Coordinates, weights and attributes.
            define: Returns what distinguishes a run through so many snapshots from others with the same store.
            is_unchanged: Whether a snapshot is the one that was stored with these codes of its stamp and its mark.

        Raises:
            ValueError: The path is something else, or a store of another series.
            ImportError: Zarr is not installed.
        """
        try:
            import zarr  # noqa: F401
        except ImportError:
            raise ImportError("out needs Zarr: pip install 'aerokernels[dask]', or leave out= away") from None
        self.path, self.template = path, template
        self.done = Done(template.sizes["time"])
        self.changed_count = 0
        self._total = template.sizes["time"]
        self._definition = _plain(define(self._total))  # now: the first snapshot of an iterator can be read once
        self._has_grown, self._seen_count = False, 0
        self._arrays: dict[str, Any] = {}
        if (path / "zarr.json").is_file():
            self._read(define, is_unchanged)
        elif path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise ValueError(f"out={path}: something else is there; take another name, or remove it")

    def _read(self, define: Callable[[int], Any], is_unchanged: Callable[[int, float, float], bool]) -> None:
        """Take what an earlier run has finished."""
        import zarr

        with self._in_words():
            group = zarr.open_group(str(self.path), mode="r")
            if text := group.attrs.get("definition"):
                earlier, rows = json.loads(text), np.asarray(group["done"][:], np.float64)
                count = (earlier.get("time") or [0])[0]
                self._has_grown = 0 < count < self._total and earlier == _plain(define(count))
        if not text:
            raise ValueError(f"out={self.path}: something else is there; take another name, or remove it")
        if earlier != self._definition and not self._has_grown:
            text = f"it contains another series, {_change(earlier, self._definition)}"
            raise ValueError(f"out={self.path}: {text}; take another name, or remove it")
        if rows.shape[1:] != (len(KEPT),) or len(rows) > self._total:
            raise self._damaged("done in the store has another shape than the series")
        self._seen_count = _count_of(rows)
        finished = range(self._seen_count)
        count = next((k for k in finished if not is_unchanged(k, rows[k, -2], rows[k, -1])), self._seen_count)
        self.changed_count = self._seen_count - count
        self.done.keep(rows[:count])

    def _damaged(self, what: str) -> ValueError:
        return ValueError(f"out={self.path}: {what}; take another name, or remove it")

    @contextmanager
    def _in_words(self) -> Iterator[None]:
        """Convert any error that Zarr raises for damaged data to a ValueError with the store's name."""
        try:
            yield
        except Exception as fault:
            if isinstance(fault, OSError) and fault.errno in FULL:
                raise
            raise self._damaged(f"the store is damaged ({fault_text(fault)})") from fault

    @property
    def is_finished(self) -> bool:
        """Whether all snapshots are finished, and the numbers are in the store."""
        return self.done.count == self._total and bool(self._group(self._total).attrs.get("finished", False))

    def _group(self, times: int) -> Any:
        """Return the store, after checking that its arrays fit the series and contain the maps that `done` lists.

        Raises:
            ValueError: It is damaged.
        """
        import zarr

        sizes = (self.template.sizes["y"], self.template.sizes["x"])
        with self._in_words():
            group = zarr.open_group(str(self.path), mode="r+")
            shapes = {**dict.fromkeys(MAPS, (times, *sizes)), **dict.fromkeys(NUMBERS, (times,))}
            other = next((name for name, shape in shapes.items() if group[name].shape != shape), None)
        if other:
            raise self._damaged(f"{other} in the store has another shape than the series")
        for number in range(self.done.count):  # Zarr reads a lost chunk as fill values
            for name in MAPS:
                if not (self.path / name / "c" / str(number) / "0" / "0").is_file():
                    raise self._damaged(f"{name} of snapshot {number}, which `done` lists, is lost")
        return group

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Open the store for writing; it is created with the first snapshot, so that an early failure leaves nothing.

        Raises:
            OutputError: The disk is full.
        """
        with ExitStack() as self._open:
            yield

    def _begin(self) -> None:
        """Lock the store, and create it, or bring it to where this run goes on.

        Raises:
            ValueError: Another process writes there, or wrote since the store was read.
        """
        import zarr

        self._open.enter_context(only_writer(self.path))
        if not (self.path / "zarr.json").is_file():
            self._create()
        with self._in_words():
            group = zarr.open_group(str(self.path), mode="r+")
            count = _count_of(group["done"][:])
        if count != self._seen_count:
            raise ValueError(f"out={self.path}: another process is at work there; wait for it, or take another")
        with self._in_words():
            if self._has_grown:
                self._lengthen(group)
            if self.changed_count:
                group["done"][self.done.count :] = np.nan
            if (self.changed_count or self._has_grown) and group.attrs.pop("finished", 0):
                _consolidate(self.path)
        group = self._group(self._total)
        self._arrays = {name: group[name] for name in (*MAPS, "done")}

    def _create(self) -> None:
        """Create the store with all its arrays, empty; under a temporary name, so that it appears whole."""
        draft = draft_of(self.path)
        try:
            self._make_arrays(draft)
            if self.path.is_dir():
                self.path.rmdir()  # empty, or it would have been refused
            draft.rename(self.path)
        finally:
            shutil.rmtree(draft, ignore_errors=True)

    def _make_arrays(self, path: Path) -> None:
        import zarr

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.template.to_zarr(path, mode="w", consolidated=False)
        group = zarr.open_group(str(path), mode="r+")
        times, *sides = (self.template.sizes[name] for name in ("time", "y", "x"))

        def make(name: str, kind: str, shape: tuple, chunks: tuple, dims: tuple, about: dict[str, str]) -> None:
            group.create_array(
                name,
                shape=shape,
                chunks=chunks,
                dtype=np.dtype(kind),
                fill_value=False if kind == "?" else np.nan,
                dimension_names=dims,
                attributes=about,
            )

        for name, (kind, units, words) in MAPS.items():
            about = {"units": units, "long_name": words}
            make(name, kind, (times, *sides), (1, *sides), ("time", "y", "x"), about)
        for name, (units, words) in NUMBERS.items():
            make(name, "f8", (times,), (times,), ("time",), {"units": units, "long_name": words})
        make("done", "f8", (times, len(KEPT)), (1, len(KEPT)), ("time", "kept"), {"kept": ", ".join(KEPT)})
        group.attrs["definition"] = json.dumps(self._definition)
        _consolidate(path)

    def _lengthen(self, group: Any) -> None:
        """Give the store the times of this run, of which it has the first; its definition last, in case of a kill."""
        for name in ("time", "done", *MAPS, *NUMBERS):
            array = group[name]
            array.resize((self._total, *array.shape[1:]))
            if name == "time":
                array[:] = self.template["time"].values
        group.attrs["provenance"] = self.template.attrs["provenance"]
        group.attrs["definition"] = json.dumps(self._definition)
        _consolidate(self.path)

    def add(self, maps: Mapping[str, np.ndarray], numbers: Mapping[str, float]) -> None:
        """Store a snapshot: first its maps, then its row of `done`.

        Raises:
            OutputError: The disk is full; earlier snapshots remain, and a later run continues after them.
        """
        with in_room(self.path):
            if not self._arrays:
                self._begin()
            number = self.done.count
            for name, array in maps.items():
                self._arrays[name][number] = array
            self._arrays["done"][number] = self.done.add(numbers)

    def finish(self) -> "xarray.Dataset":
        """Write the numbers, and open the whole store lazily.

        Raises:
            ValueError: The store is damaged.
        """
        import xarray

        group = self._group(self._total)
        with in_room(self.path), self._in_words():
            for name in NUMBERS:
                column = self.done.told(name)
                if not np.array_equal(group[name][:], column, equal_nan=True):  # not written yet, or lost since
                    group[name][:] = column
            if not group.attrs.get("finished", False):
                group.attrs["finished"] = 1  # NetCDF has no attributes that are true or false
                _consolidate(self.path)
            found = xarray.open_zarr(self.path, consolidated=False, chunks=None)
        if lost := {*MAPS, *NUMBERS, *self.template.coords} - set(found.variables):
            raise self._damaged(f"{min(lost)} is lost from the store")
        found = found.drop_vars("done")
        found.attrs.pop("definition")
        return found


def _plain(definition: Mapping[str, Any]) -> Any:
    """Return a definition as it is read from a store."""
    return json.loads(json.dumps(definition, default=str))


def _count_of(rows: np.ndarray) -> int:
    """Return the number of finished snapshots, by the rows of `done`."""
    left = ~np.isfinite(np.asarray(rows)[:, KEPT.index("slope")])
    return int(np.argmax(left)) if left.any() else len(rows)


def _consolidate(path: Path) -> None:
    """Collect the metadata of all arrays of a store in one place, where xarray looks first."""
    import zarr

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # consolidated metadata are not part of the Zarr 3 specification
        zarr.consolidate_metadata(str(path))


def _change(old: Any, new: Any, key: str = "") -> str:
    """Return the first difference of two definitions in words; empty if they are equal."""
    if old == new:
        return ""
    if isinstance(old, Mapping) and isinstance(new, Mapping):
        name = next(name for name in (*old, *new) if old.get(name) != new.get(name))
        inner = name if not key or name not in (*old, *new) else f"{key} {name}"
        if name in (FIRST, LAST) and name in old and name in new:
            return f"whose {name} has other densities"
        return _change(old.get(name), new.get(name), inner)
    if isinstance(old, list) and isinstance(new, list) and max(len(old), len(new)) > 3:
        count = "" if len(old) == len(new) else f" has {len(new)} instead of {len(old)} entries, and"
        place = next(k for k, (one, other) in enumerate(zip_longest(old, new, fillvalue=zip_longest)) if one != other)
        was, now = (_short(one[place]) if place < len(one) else "absent" for one in (old, new))
        return f"whose {key}{count} was {was} and is {now} at number {place}"
    return f"{key} was {_short(old)} and is {_short(new)}"


def _short(value: Any) -> str:
    return cut(json.dumps(value))
