"""Optical path differences of a series over a pupil: OPD(x, y, t), Strehl ratio and boresight of each snapshot."""

import hashlib
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__
from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.kinds import wrong_kind
from aerokernels.series.snapshot import NAMES, WRONG, Chosen

from ..display.progress import Progress, shows_progress
from ..flow import GridMesh, Series
from ..flow.series import mark_of
from ..inputs.arguments import checked
from ..inputs.checks import DEFAULT_WAVELENGTH, check_choice, check_positive, check_wavelength
from ..pupils.base import as_unit_vector
from ..tracing.plan import PRECISIONS
from ..tracing.pupil.air import GREATEST_SHARE, PAST_REFUSED, PupilAir, TruncationWarning
from ..wavefronts import check_terms
from .pupil_grid import MapReader, PupilGrid, pupil_grid
from .snapshot import METHODS, SnapshotResult, Snapshots, SnapshotSettings
from .store import FIRST, KEPT, LAST, MemoryStore, ZarrStore, code_of

if TYPE_CHECKING:
    import xarray

TRUNCATION, ENDS = "truncation", "ends"  # attributes: the warning of a pupil that misses air; where the flow ends


@shows_progress("series")
@checked
def optical_series(
    series: Series,
    pupil: Any,
    *,
    direction=None,
    remove=("piston", "tilt"),
    wavelength: float = DEFAULT_WAVELENGTH,
    relation: str | None = None,
    constant: float | None = None,
    composition=None,
    interpolation: str | None = None,
    pixel_count: int = 64,
    tolerance: float = 1e-3,
    method: str = "auto",
    backend: str = "auto",
    device: str | None = None,
    precision: str = "float32",
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> "xarray.Dataset":
    """Return maps of the optical path difference of every snapshot of a series over a pupil.

    Where the rays are nearly straight, OPD is linear in the density: the lines through the grid are prepared once, and
    a snapshot costs one pass over its samples. The bending that this leaves out is measured on the first snapshot, and
    again whenever it has grown; above the tolerance a snapshot is traced in full. Where rays leave the grid by a side,
    or miss it, all are. The next snapshot is read while one is computed; no more than these two are in memory.

    Args:
        series: The snapshots, as `flow.open_series` opens them.
        pupil: The pupil; rays leave it along its normal, or along `direction`.
        direction: Look direction, if not along the pupil's normal, shape (3,).
        remove: Terms removed from each map: "piston", "tilt".
        wavelength: Vacuum wavelength [m].
        relation: Density to index, see `flow.refractivity_model`; likewise `constant` and `composition`.
        constant: K [m3/kg].
        composition: Fractions of species.
        interpolation: Interpolant of the samples: "cubic" on grids by default, "linear", "monotone".
        pixel_count: Pixels along the pupil's greater side.
        tolerance: Requested OPD error [waves].
        method: "auto", "linear" (straight lines, whatever they leave out), or "trace" (every snapshot in full).
        backend: For snapshots that are traced, see `trace`; likewise `device` and `precision`.
        device: Device of the backend.
        precision: "float32" or "float64".
        out: A Zarr store to write to, snapshot by snapshot. An interrupted run continues in it, and its result equals
            that of an uninterrupted run bit for bit. None keeps all in memory.
        progress: Called with a description of the progress and its share; None shows a bar in terminals and notebooks.

    Returns:
        A dataset (time, y, x): `opd` [m], terms removed, NaN outside the pupil, and `valid`; over time `strehl`,
        `boresight_x` and `boresight_y` [rad], `opd_rms` and `opd_rms_with_tilt` [m] and `piston` [m], each with its
        error (`strehl_error` and so on), which covers the truth in 95 of 100 cases, `error` [m], that of `opd` in a
        pixel, the share of the pupil that is `known`, and whether a snapshot was `traced`; over (y, x) `weight`, the
        pixels' shares of the pupil. Its attribute `truncation` is the warning below, or empty, and `ends` says
        where the first snapshot ends in disturbed air, which the maps take as the whole flow. Lazy where `out` is
        given.
        Pixels whose rays end on a body, and with method="linear" those whose rays leave the grid sideways or miss it,
        are not valid, and in no number. Errors are computed on some snapshots (snapshot.py), the part of the
        pixels on each (pupil_grid.py).

    Warns:
        TruncationWarning: More than a thousandth of the pupil is not valid, or more than a hundredth of it looks past
            the box of the first snapshot computed (not with method="linear").

    Raises:
        TypeError: Not a series, or not a pupil.
        ValueError: An invalid name or number, rays that miss the grid, a snapshot that cannot be used, or a
            store that holds another series.
        ImportError: `out` without Zarr.
    """
    if not isinstance(series, Series):
        raise wrong_kind(series, "series", "a Series")
    check_choice(method, "method", METHODS)
    check_choice(precision, "precision", PRECISIONS)
    check_positive(tolerance, "tolerance", "waves")
    if len(series) == 0:
        raise ValueError("the series is empty: no snapshot")
    look = None if direction is None else as_unit_vector(direction, "direction")
    grid = pupil_grid(pupil, pixel_count, look)
    look = pupil.normal if look is None else look
    terms = check_terms(remove)
    options = {"backend": backend, "device": device, "precision": precision}
    wavelength = check_wavelength(wavelength)
    settings = SnapshotSettings(
        look, wavelength, relation, constant, composition, interpolation, tolerance, method, options
    )
    snapshots = Snapshots(series, grid, settings, terms)
    if snapshots.lines is not None and not snapshots.lines.inside.any():
        assert series.mesh is not None
        low, high = series.mesh.box
        raise ValueError(
            f"no ray of the pupil goes through the series' grid or mesh, {low.tolist()} to {high.tolist()} m: "
            "check the pupil's center, its normal and the units (metres are expected)"
        )
    template = _template(series, pupil, grid, settings, terms, snapshots)
    store = MemoryStore(template)
    if out is not None:
        define = partial(_definition, series, template, settings)
        store = ZarrStore(Path(out), template, define, partial(_is_unchanged, series))
        if store.changed_count:
            warn_caller(
                f"out={out}: files of snapshot {store.count} have changed since its map was stored: it and those "
                f"after it, {store.changed_count} in all, are computed again"
            )
        if store.count and store.is_finished:
            maps = store.finish()
            if text := maps.attrs.get(TRUNCATION, ""):
                warn_caller(text, TruncationWarning)
            return maps
    chosen = Chosen(len(series))
    for slope, probe in zip(*map(store.column, ("slope", "probe")), strict=True):
        snapshots.resume(slope, probe)
        chosen(slope)
    lit: np.ndarray | None = None
    first = store.count
    written: Future[None] | None = None

    def finished(count: int) -> None:
        """Wait until the maps of a snapshot are written, and report the progress."""
        if written is not None:
            written.result()
            if progress is not None:
                progress(f"{count} of {len(series)} snapshots", count / len(series))

    # While a snapshot is computed the next one is read and the maps of the one before are written.
    with store.writing(), ThreadPoolExecutor(1) as writer:
        for number, stamp, stored in _read_ahead(snapshots, first, len(series)):
            found = snapshots(number, stored)
            good = found.valid & np.isfinite(found.opd)
            if not good.any():
                raise ValueError(
                    f"snapshot {number}: no ray of the pupil came through; move the pupil, or turn its normal"
                )
            if number == first:
                # The store is created from the template, with the first snapshot.
                air = snapshots.air(pupil, number, stored)
                template.attrs[ENDS] = air.ends
                if method != "linear":
                    template.attrs[TRUNCATION] = _warn_of_air(air)
            if lit is None or not np.array_equal(good, lit):
                lit = good
                reader = grid.reader(good, terms, wavelength)
            wrong = snapshots.errors(found) if chosen(found.slope) else dict.fromkeys(WRONG, np.nan)
            entry = _entry(grid, found, good, reader, wrong)
            finished(number)
            if stamp is not None:
                entry[1].update(stamp=code_of(stamp), mark=code_of(mark_of(stored)))
            written = writer.submit(store.add, *entry)
        finished(len(series))
    known = store.column("known")
    if (least := float(known.min())) < 1.0 - GREATEST_SHARE:
        text = (
            f"{100.0 * (1.0 - least):.3g} % of the pupil is in no number of snapshot {int(known.argmin())}: its rays "
            "leave the grid sideways, miss it or end on a body (see `valid` and `known`); take a smaller pupil, a "
            "larger grid or another direction, or method='auto' where the air beside the grid is at rest"
        )
        warn_caller(text, TruncationWarning)
    return store.finish()


def _warn_of_air(air: PupilAir) -> str:
    """Warn if the pupil looks past the box, and return the warning or an empty text; refuse it if most of it does."""
    if not air.looks_past:
        return ""
    text = f"{air.past_described}: move the pupil, take a smaller one, or give a larger grid"
    if air.past > PAST_REFUSED:
        raise ValueError(text)
    warn_caller(text, TruncationWarning)
    return text


def _read_ahead(snapshots: Snapshots, first: int, stop: int) -> Iterator[tuple[int, str | None, Any]]:
    """Yield snapshots in order, each with its number and the stamp of its files.

    The next one is read while the current one is processed.
    """
    stamp = snapshots.series.stamp

    def read(number: int) -> tuple[str | None, Any]:
        # The stamp first: files that are written while they are read have another one afterwards.
        return None if stamp is None else stamp(number), snapshots.series.read(number)

    with ThreadPoolExecutor(1) as reader:
        following = reader.submit(read, first) if first < stop else None
        for number in range(first, stop):
            assert following is not None
            found = following.result()
            following = reader.submit(read, number + 1) if number + 1 < stop else None
            yield number, *found


def _entry(
    grid: PupilGrid, found: SnapshotResult, good: np.ndarray, reader: MapReader, wrong: dict[str, float]
) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Return the maps and numbers of a snapshot; `wrong` are errors by the model, NaN where they were not computed."""
    read = reader(found.opd[good])
    opd = np.full(len(good), np.nan)
    opd[good] = read.opd
    numbers = {
        **dict(zip(NAMES, read.numbers, strict=True)),
        **{f"{name}_model": wrong[name] for name in NAMES},
        **dict(zip((f"{name}_pixels" for name in NAMES), reader.sampling(found.opd[good], read), strict=True)),
        "error": wrong["error"],
        "known": float(grid.weight[grid.lit][good].sum()),
        "traced": float(found.traced),
        "slope": found.slope,
        "probe": found.probe,
    }
    return {"opd": grid.spread(opd), "valid": grid.spread(good, False)}, numbers


def _template(
    series: Series,
    pupil: Any,
    grid: PupilGrid,
    settings: SnapshotSettings,
    remove: tuple[str, ...],
    snapshots: Snapshots,
):
    """Return coordinates, weights and attributes: all that is known before the first snapshot."""
    import xarray

    def meaning(units: str, words: str) -> dict[str, str]:
        return {"units": units, "long_name": words}

    return xarray.Dataset(
        {"weight": (("y", "x"), grid.weight, meaning("1", "share of the pixel in means over the pupil"))},
        {
            "time": ("time", np.asarray(series.time), meaning("s", "time")),
            "y": ("y", grid.y, meaning("m", "along the pupil's second axis, across the look direction")),
            "x": ("x", grid.x, meaning("m", "along the pupil's first axis, across the look direction")),
        },
        {
            "title": "optical path difference in time",
            "source": f"aerokernels {__version__}",
            "provenance": series.provenance,
            "wavelength": settings.wavelength,
            "remove": ",".join(remove),
            "direction": settings.direction.tolist(),
            "pupil_center": pupil.center.tolist(),
            "pupil_axes": np.concatenate(grid.aperture.axes).tolist(),
            "relation": settings.relation or snapshots.model.name,
            **({} if settings.constant is None else {"constant": settings.constant}),
            "pupil": f"{type(pupil).__name__} at {pupil.center.tolist()} m, normal {pupil.normal.tolist()}",
            "tolerance": settings.tolerance,
            TRUNCATION: "",
            "errors": "each covers the truth in 95 of 100 cases; those of some snapshots are computed, and each other "
            "snapshot has those of the nearest of them in time, with its own pixels",
            ENDS: "",
            "plan": snapshots.reason
            or "straight lines worked out once; the bending is measured, and a snapshot traced where it is too large",
        },
    )


def _definition(series: Series, template: "xarray.Dataset", settings: SnapshotSettings, count: int) -> dict[str, Any]:
    """Return what distinguishes a run through the first `count` snapshots from others with the same store."""
    mesh, times = series.mesh, series.time[:count]
    return {
        "version": __version__,
        "numbers": list(KEPT),
        "series": {name: own[:count] if isinstance(own, list) else own for name, own in series.identity.items()},
        FIRST: series.mark(),
        LAST: series.mark(count - 1),
        "time": [count, float(times[0]), float(times[-1]), _digest(times)],
        "mesh": [mesh.geometry, mesh.origin.tolist(), mesh.spacing.tolist(), list(mesh.shape)]
        if isinstance(mesh, GridMesh)
        else [type(mesh).__name__, *([] if mesh is None else [mesh.geometry, _digest(mesh.vertices, mesh.cells)])],
        "ambient_density": series.ambient_density,
        "pupil": template.attrs["pupil"],
        "weights": _digest(template.weight.values),
        "pixels": [template.sizes["y"], template.sizes["x"], float(template.x[0]), float(template.y[0])],
        "direction": template.attrs["direction"],
        "remove": template.attrs["remove"],
        "wavelength": settings.wavelength,
        "relation": [settings.relation, settings.constant, str(settings.composition), settings.interpolation],
        "method": [settings.method, settings.tolerance, *map(str, settings.trace_options.values())],
    }


def _is_unchanged(series: Series, number: int, stamp: float, mark: float) -> bool:
    """Return whether a snapshot is the one whose files had this code of their stamp, and whose samples this one.

    Files that have been copied, or written again as they were, have another stamp: only these are read.
    """
    if series.stamp is None or code_of(series.stamp(number)) == stamp:
        return True
    try:
        return code_of(series.mark(number)) == mark
    except ValueError:  # it cannot be read any more, which is said when it is computed
        return False


def _digest(*arrays: np.ndarray) -> str:
    return hashlib.sha256(b"".join(np.ascontiguousarray(one).tobytes() for one in arrays)).hexdigest()[:16]
