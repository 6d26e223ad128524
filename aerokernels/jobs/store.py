"""Write a job's results, NetCDF, JSON and others, to its folder: all of them, or none.

All files are first written to a hidden folder and moved into place at the end, so that a failure, an interrupt or a
full disk leaves the folder unchanged.
"""

import contextlib
import json
import math
import os
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.plain_text import plain_json
from aerokernels.files.netcdf_reading import open_netcdf
from aerokernels.files.writing import draft_of, in_room, only_writer, replacing, write_netcdf

if TYPE_CHECKING:
    import xarray

RESULT_FILE, SUMMARY_FILE, REPORT_FILE = "result.nc", "summary.json", "report.html"
MAPS_FILE = "series.zarr"


def check_output_folder(out: Path, own: Sequence[str] = ()) -> None:
    """Reject, before anything is computed, a folder that cannot take results.

    Only a folder with the summary.json of a result may be overwritten. `own` are names of files that an unfinished job
    of the same kind leaves behind, which is resumed.
    """
    folder = next(one for one in (out, *out.absolute().parents) if one.exists() or one.is_symlink())
    if not folder.is_dir():
        raise ValueError(f"out={out}: {folder} is not a folder; choose another name")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ValueError(f"out={out}: no permission to write in {folder}; choose another folder")
    others = sorted(path.name for path in out.iterdir() if not path.name.startswith(".")) if folder == out else []
    # The maps of a series are hours of work: no other job may overwrite a folder that holds them.
    has_maps = MAPS_FILE in others and MAPS_FILE not in own
    if has_maps or (others and not set(own) & set(others) and not _is_summary(_read_summary(out))):
        raise ValueError(
            f"out={out}: the folder holds {MAPS_FILE if has_maps else others[0]}{' and more' * (len(others) > 1)}, and "
            "no result of an earlier run: choose another folder, or empty this one"
        )


def _read_summary(out: Path) -> Any:
    """Return the content of a folder's summary.json; None if it does not exist or cannot be read."""
    try:
        return json.loads((out / SUMMARY_FILE).read_bytes())
    except (OSError, ValueError, RecursionError):
        return None


def _is_summary(summary: Any) -> bool:
    return isinstance(summary, dict) and "version" in summary


@contextlib.contextmanager
def staged_folder(out: Path) -> Iterator[Path]:
    """Yield a hidden folder to write in; on success its files replace the files of the same names in `out`.

    Files that the summary.json of an earlier result names and that the new result does not have are removed; all other
    files in `out` stay. On any exception, interrupts included, the hidden folder is removed and `out` is left as it
    was: absent if it was absent. summary.json, which lists the files, comes last.
    """
    out = out.absolute()
    with in_room(out), only_writer(out):
        staging = draft_of(out)  # also removes the draft of a killed process
        staging = draft_of(out / "result") if out.is_dir() else staging  # `out` may be a file system of its own
        try:
            staging.mkdir()
            yield staging
            names = sorted((path.name for path in staging.iterdir()), key=lambda name: (name == SUMMARY_FILE, name))
            summary = _read_summary(staging)
            if isinstance(summary, dict):
                write_summary(staging / SUMMARY_FILE, {**summary, "files": sorted(names)})
            if not out.exists():
                staging.rename(out)
                return
            if taken := [name for name in names if (out / name).is_dir()]:
                raise ValueError(f"out={out}: {taken[0]} is a folder there; choose another folder")
            earlier = _read_summary(out)
            listed = earlier.get("files") if _is_summary(earlier) else None
            for name in names:
                (staging / name).replace(out / name)
            for name in listed if isinstance(listed, list) else ():
                if isinstance(name, str) and name not in names and Path(name).name == name:
                    (out / name).unlink(missing_ok=True)
        finally:
            shutil.rmtree(staging, ignore_errors=True)


def to_json(value: Any) -> Any:
    """Convert `value` to plain JSON types: NumPy scalars and arrays are unpacked, NaN and infinity become null."""
    return json.loads(json.dumps(value, default=_plain), parse_constant=lambda _: None)


def _plain(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    return list(value) if isinstance(value, (set, frozenset)) else str(value)


def flat(tree: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Return the keys and values of nested mappings, keys joined by dots and values as JSON."""
    rows: list[tuple[str, str]] = []
    for key, value in tree.items():
        if isinstance(value, Mapping) and value:
            rows += flat(value, f"{prefix}{key}.")
        else:
            rows.append((f"{prefix}{key}", json.dumps(value, ensure_ascii=False)))
    return rows


def number_or_nan(value: float | None) -> float:
    """Return a number as JSON holds it as a float; NaN for null."""
    return math.nan if value is None else float(value)


def write_summary(path: Path, summary: Mapping[str, Any]) -> None:
    """Write `summary` as strict JSON: NaN and infinity become null."""
    text = plain_json(json.dumps(to_json(summary), indent=2, allow_nan=False, ensure_ascii=False))
    path.write_text(text + "\n", encoding="utf-8")


def write_result(path: Path, dataset: "xarray.Dataset") -> None:
    """Write `dataset` as NetCDF-4 with compressed arrays."""
    lacking = sorted(str(name) for name, variable in dataset.variables.items() if "units" not in variable.attrs)
    if lacking:
        raise ValueError(f"every variable of a result needs a `units` attribute; these have none: {', '.join(lacking)}")
    encoding = {
        str(name): {"zlib": True, "complevel": 4}
        for name, variable in dataset.variables.items()
        if variable.size > 1000 and variable.dtype.kind in "fiu"
    }
    write_netcdf(path, dataset, encoding)


def replace_result(path: Path, dataset: "xarray.Dataset") -> None:
    """Write `dataset` like `write_result`, but atomically: a reader finds the complete old or the complete new file."""
    with replacing(path, name="out=") as (draft,):
        write_result(draft, dataset)


def write_text(path: Path, text: str) -> None:
    """Replace a text file atomically; raises the errors of `replace_result`."""
    with replacing(path, name="out=") as (draft,):
        draft.write_text(text, encoding="utf-8")


def read_result(path: Path) -> "xarray.Dataset":
    """Read a `result.nc` into memory; raises the ValueError of `open_netcdf`."""
    return open_netcdf(path, str(path), whole=True)


def variable(dims: str | tuple[str, ...], values: Any, units: str, long_name: str) -> tuple[Any, ...]:
    """Return a variable with its unit and meaning, as xarray.Dataset takes it."""
    return dims, values, {"units": units, "long_name": long_name}
