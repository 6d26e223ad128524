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
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.plain_text import cut
from aerokernels.files.writing import FULL, draft_of, in_room, only_writer
from aerokernels.process.foreign_files import fault_text
from aerokernels.series.snapshot import nearest_in_time

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


class MemoryStore:
    """The maps and numbers of the finished snapshots, in memory.

    Attributes:
        count: Number of finished snapshots.
    """

    def __init__(self, template: "xarray.Dataset"):
        """Start with no finished snapshot; `template` has coordinates, weights and attributes."""
        self.template, self.count = template, 0
        self._total = template.sizes["time"]
        self._rows = np.full((self._total, len(KEPT)), np.nan)
        self._arrays: dict[str, Any] = {}

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Prepare arrays for the maps."""
        shape = tuple(self.template.sizes[name] for name in ("time", "y", "x"))
        self._arrays = {name: np.empty(shape, kind) for name, (kind, _, _) in MAPS.items()}
        yield

    def add(self, maps: Mapping[str, np.ndarray], numbers: Mapping[str, float]) -> None:
        """Store a snapshot: its maps, and its row of KEPT."""
        for name, array in maps.items():
            self._arrays[name][self.count] = array
        self._rows[self.count] = [numbers.get(name, np.nan) for name in KEPT]
        self.count += 1

    def column(self, name: str) -> np.ndarray:
        """Return one of KEPT of all finished snapshots, shape (count,)."""
        return np.array(self._rows[: self.count, KEPT.index(name)])

    def _number(self, name: str) -> np.ndarray:
        """Return one of NUMBERS of all finished snapshots, shape (count,): errors by all causes, of every snapshot."""
        number = name.removesuffix("_error")
        if number in VALUES and number != name:
            return np.hypot(nearest_in_time(self.column(f"{number}_model")), self.column(f"{number}_pixels"))
        return nearest_in_time(self.column(name)) if name == "error" else self.column(name)

    def finish(self) -> "xarray.Dataset":
        """Return the dataset."""
        dataset = self.template.copy()
        for name, (_, units, words) in MAPS.items():
            dataset[name] = (("time", "y", "x"), self._arrays[name], {"units": units, "long_name": words})
        for name, (units, words) in NUMBERS.items():
            dataset[name] = (("time",), self._number(name), {"units": units, "long_name": words})
        return dataset


class ZarrStore(MemoryStore):
    """The same in a Zarr store, which is created with the first snapshot, so that an early failure leaves nothing.

    Attributes:
        changed_count: Number of finished snapshots that are not kept because files have changed since.
    """

    def __init__(
        self,
        path: Path,
        template: "xarray.Dataset",
        define: Callable[[int], Mapping[str, Any]],
        is_unchanged: Callable[[int, float, float], bool] = lambda number, stamp, mark: True,
    ):
        """Open a store, or prepare one; raises a ValueError where the path is something else, or of another series.

        `define` returns what distinguishes a run through so many snapshots from others with the same store, and
        `is_unchanged` whether a snapshot is the one that was stored with these codes of its stamp and its mark.
        """
        try:
            import zarr  # noqa: F401
        except ImportError:
            raise ImportError("out needs Zarr: pip install 'aerokernels[dask]', or leave out= away") from None
        super().__init__(template)
        self.path, self.changed_count = path, 0
        self._definition = _plain(define(self._total))  # now: the first snapshot of an iterator can be read once
        self._has_grown, self._seen_count = False, 0
        if (path / "zarr.json").is_file():
            self._read(define, is_unchanged)
        elif path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise self._refused("something else is there")

    def _refused(self, why: str) -> ValueError:
        return ValueError(f"out={self.path}: {why}; take another name, or remove it")

    @contextmanager
    def _group(self) -> Iterator[Any]:
        """Open the store; whatever Zarr raises for damaged data becomes a ValueError with the store's name."""
        import zarr

        try:
            yield zarr.open_group(str(self.path), mode="r+", use_consolidated=False)
        except Exception as fault:
            if isinstance(fault, OSError) and fault.errno in FULL:
                raise
            raise self._refused(f"the store is damaged ({fault_text(fault)})") from fault

    def _read(self, define: Callable[[int], Any], is_unchanged: Callable[[int, float, float], bool]) -> None:
        """Take what an earlier run has finished."""
        with self._group() as group:
            if text := group.attrs.get("definition"):
                earlier, rows = json.loads(text), np.asarray(group["done"][:], np.float64)
                count = (earlier.get("time") or [0])[0]
                self._has_grown = 0 < count < self._total and earlier == _plain(define(count))
        if not text:
            raise self._refused("something else is there")
        if earlier != self._definition and not self._has_grown:
            raise self._refused(f"it contains another series, {_change(earlier, self._definition)}")
        if rows.shape[1:] != (len(KEPT),) or len(rows) > self._total:
            raise self._refused("the store is damaged (done has another shape than the series)")
        self._seen_count = _count_of(rows)
        finished = range(self._seen_count)
        self.count = next((k for k in finished if not is_unchanged(k, rows[k, -2], rows[k, -1])), self._seen_count)
        self.changed_count = self._seen_count - self.count
        self._rows[: self.count] = rows[: self.count]

    @property
    def is_finished(self) -> bool:
        """Whether all snapshots are finished, and the numbers are in the store."""
        with self._group() as group:
            return self.count == self._total and bool(group.attrs.get("finished", False))

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Hold the lock of the store that the first snapshot takes."""
        with ExitStack() as self._open:
            yield

    def _begin(self) -> None:
        """Lock the store, and create it, or bring it to where this run goes on.

        Raises:
            ValueError: Another process writes there, or wrote since the store was read.
        """
        self._open.enter_context(only_writer(self.path))
        if not (self.path / "zarr.json").is_file():
            self._create()
        with self._group() as group:
            count = _count_of(group["done"][:])
        if count != self._seen_count:
            raise ValueError(f"out={self.path}: another process is at work there; wait for it, or take another")
        with self._group() as group:
            if self._has_grown:  # its definition last, in case of a kill
                for name in ("time", "done", *MAPS, *NUMBERS):
                    group[name].resize((self._total, *group[name].shape[1:]))
                group["time"][:] = self.template["time"].values
                group.attrs["provenance"] = self.template.attrs["provenance"]
                group.attrs["definition"] = json.dumps(self._definition)
            if self.changed_count:
                group["done"][self.count :] = np.nan
            if self.changed_count or self._has_grown:
                group.attrs.pop("finished", 0)
            self._arrays = {name: group[name] for name in (*MAPS, "done")}

    def _create(self) -> None:
        """Create the store with all its arrays, empty; under a temporary name, so that it appears whole."""
        import zarr

        draft = draft_of(self.path)
        times, *sides = (self.template.sizes[name] for name in ("time", "y", "x"))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self.template.to_zarr(draft, mode="w", consolidated=False)
            group = zarr.open_group(str(draft), mode="r+")

            def make(name: str, kind: str, shape: tuple, chunks: tuple, dims: tuple, about: dict[str, str]) -> None:
                fill = False if kind == "?" else np.nan
                group.create_array(name, shape=shape, chunks=chunks, dtype=np.dtype(kind), fill_value=fill,
                                   dimension_names=dims, attributes=about)  # fmt: skip

            for name, (kind, units, words) in MAPS.items():
                about = {"units": units, "long_name": words}
                make(name, kind, (times, *sides), (1, *sides), ("time", "y", "x"), about)
            for name, (units, words) in NUMBERS.items():
                make(name, "f8", (times,), (times,), ("time",), {"units": units, "long_name": words})
            make("done", "f8", (times, len(KEPT)), (1, len(KEPT)), ("time", "kept"), {"kept": ", ".join(KEPT)})
            group.attrs["definition"] = json.dumps(self._definition)
            if self.path.is_dir():
                self.path.rmdir()  # empty, or it would have been refused
            draft.rename(self.path)
        finally:
            shutil.rmtree(draft, ignore_errors=True)

    def add(self, maps: Mapping[str, np.ndarray], numbers: Mapping[str, float]) -> None:
        """Store a snapshot: first its maps, then its row of `done`.

        Raises:
            OutputError: The disk is full; earlier snapshots remain, and a later run continues after them.
        """
        with in_room(self.path):
            if not self._arrays:
                self._begin()
            super().add(maps, numbers)
            self._arrays["done"][self.count - 1] = self._rows[self.count - 1]

    def finish(self) -> "xarray.Dataset":
        """Write the numbers, unless they are there, and open the whole store lazily."""
        import xarray
        import zarr

        with in_room(self.path), self._group() as group:
            if not group.attrs.get("finished", False):
                for name in NUMBERS:
                    group[name][:] = self._number(name)
                group.attrs["finished"] = 1  # NetCDF has no attributes that are true or false
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore")  # consolidated metadata are not part of the Zarr 3 specification
                    zarr.consolidate_metadata(str(self.path))
            dataset = xarray.open_zarr(self.path, consolidated=False, chunks=None).drop_vars("done")
        dataset.attrs.pop("definition")
        return dataset


def _plain(definition: Mapping[str, Any]) -> Any:
    """Return a definition as it is read from a store."""
    return json.loads(json.dumps(definition, default=str))


def _count_of(rows: np.ndarray) -> int:
    """Return the number of finished snapshots, by the rows of `done`."""
    left = ~np.isfinite(np.asarray(rows)[:, KEPT.index("slope")])
    return int(np.argmax(left)) if left.any() else len(rows)


def _change(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """Return the first difference of two definitions in words."""
    key = next(key for key in (*old, *new) if old.get(key) != new.get(key))
    was, now = old.get(key), new.get(key)
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        return _change(was, now)
    if key in (FIRST, LAST):
        return f"whose {key} has other densities"
    if isinstance(was, list) and isinstance(now, list) and len(was) != len(now):
        return f"of {len(was)} {key} and not of {len(now)}"
    if isinstance(was, list) and isinstance(now, list):
        was, now = next((one, other) for one, other in zip(was, now, strict=True) if one != other)
    return f"whose {key} was {cut(json.dumps(was))} and is {cut(json.dumps(now))}"
