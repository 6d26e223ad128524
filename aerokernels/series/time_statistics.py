"""The usual statistics of optical path differences in time, each with its standard error."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__
from aerokernels.flow.reading.arrays import stated_unit
from aerokernels.inputs.checks import warn_caller
from aerokernels.inputs.units import unit_of
from aerokernels.series.statistic_parts import add_model_errors, few_independent, lost_pixels, uneven_times

from ..inputs.arguments import checked, seconds
from ..inputs.checks import DEFAULT_WAVELENGTH, check_count, check_positive, check_wavelength
from ..wavefronts import weighted_mean
from .modes import Mean, about_mean_of, deviations_of, mean_of, orthogonal_modes, root_of, standard_errors
from .pupil_grid import MapReader
from .statistic_parts import (
    Table,
    add_apertures,
    add_correlation,
    add_modes,
    add_spectra,
    in_time,
    pupil_width,
    spread_map,
    terms_of,
)

if TYPE_CHECKING:
    import xarray


@checked
def statistics(
    dataset: "xarray.Dataset",
    *,
    velocity: float | None = None,
    length: float | None = None,
    apertures: Sequence[float] | None = None,
    mode_count: int = 10,
    segment: int | None = None,
    wavelength: float | None = None,
) -> "xarray.Dataset":
    """Return statistics of optical path differences in time.

    Means are over the snapshots, each of which counts once. Standard errors account for the correlation of snapshots
    and for a series too short to tell it: two of them are meant to contain the truth in 95 of 100 series, which few
    independent snapshots do not quite reach (see modes.py). Variances about a mean in time are corrected for
    the error of that mean. The errors of the maps' own numbers, as `optical_series` gives them, are added
    (statistic_parts.py). The attribute `independent_count` says how many independent snapshots there are. Below
    four snapshots errors are NaN.

    Args:
        dataset: Of `optical_series`, or any with `opd` over (time, y, x), NaN outside the pupil, in metres and
            seconds unless attributes `units` state other units.
        velocity: Speed for the Strouhal number f D / U [m/s]; None: no Strouhal number.
        length: D [m]; None: the pupil's width.
        apertures: Diameters of concentric round parts of the pupil [m]; None: a quarter to all of it.
        mode_count: Proper orthogonal modes.
        segment: Samples of a segment of the spectra.
        wavelength: Vacuum wavelength [m]; None: the dataset's.

    Returns:
        A dataset with NAME and NAME_error:
        `opd_mean` (y, x), the steady map; `opd_std` (y, x), the unsteady part's rms in time;
        `opd_rms` and `opd_rms_with_tilt`, root mean squares over pupil and time, with mean and tilt of each map
        removed, or its mean only; `opd_rms_steady`, of the steady map; `opd_rms_unsteady`, of the rest;
        `boresight_x`, `boresight_y`, means, and `jitter_x`, `jitter_y`, rms about them [rad];
        `strehl`, the exact mean, beside `strehl_large_aperture`, the mean of exp(-(2 pi opd_rms / wavelength)^2);
        over `frequency` [Hz] (and `strouhal`): `spectrum_opd` [m2/Hz], the mean over the pupil, `spectrum_jitter_x`,
        `spectrum_jitter_y` [rad2/Hz];
        over `aperture` [m]: `opd_rms_aperture` and `strehl_aperture`, mean and tilt over that part removed;
        `pod_energy` (mode) [m2], `pod_share`, `pod_mode` (mode, y, x), `pod_coefficient` (time, mode) [m];
        `correlation` (lag_y, lag_x) and `correlation_length_x`, `correlation_length_y` [m].
        Attributes: `skipped`, what could not be computed and why, and `warnings`, the texts of the warnings.

    Warns:
        UserWarning: Pixels that have no number in some snapshots, and are in no statistic; times so uneven that means
            over snapshots are not means over time; fewer than ten independent snapshots.

    Raises:
        TypeError: Not a dataset.
        ValueError: No `opd` over (time, y, x), a pupil without pixels, or an invalid number.
    """
    dataset = _in_order(dataset)
    opd, weight, lit, lost = _checked(dataset)
    time, y, x = (seconds(np.asarray(dataset[name].values)) * _unit(dataset, name) for name in ("time", "y", "x"))
    wave = check_wavelength(dataset.attrs.get("wavelength", DEFAULT_WAVELENGTH) if wavelength is None else wavelength)
    for name, value in (("velocity", velocity), ("length", length)):
        if value is not None:
            check_positive(value, name)
    check_count(mode_count, "mode_count", 1)
    grid_x, grid_y = np.meshgrid(x, y)
    points = np.stack([grid_x[lit], grid_y[lit]], axis=1)
    table, skipped = Table(), []
    warned = [text for text in (lost, uneven_times(time)) if text]
    tilts, squares, ratios = _readings(dataset, opd, points, weight, wave)
    modes = orthogonal_modes(opd, weight, int(mode_count)) if len(opd) > 1 else None
    independent = _maps(table, opd, weight, lit)
    if few := few_independent(independent, len(opd)):
        warned.append(few)
    for text in warned:
        warn_caller(text)
    table.number("opd_rms", root_of(mean_of(squares[:, 1])), "m", "optical path difference, mean and tilt removed, rms")
    rms = root_of(mean_of(squares[:, 0]))
    table.number("opd_rms_with_tilt", rms, "m", "optical path difference, mean removed, rms")
    for k, axis in enumerate("xy"):
        table.number(f"boresight_{axis}", mean_of(tilts[:, k]), "rad", f"tilt along {axis}")
        value, error = (float(one) for one in deviations_of(tilts[:, k]))
        about = mean_of((tilts[:, k] - tilts[:, k].mean()) ** 2)
        jitter = replace(about, value=value, error=error)
        table.number(f"jitter_{axis}", jitter, "rad", f"tilt along {axis} about its mean, rms")
    table.number("strehl", mean_of(ratios), "1", "Strehl ratio, exact mean")
    variance = squares[:, 1] if "tilt" in terms_of(dataset) else squares[:, 0]
    large = np.exp(-((2.0 * np.pi / wave) ** 2) * variance)
    table.number("strehl_large_aperture", mean_of(large), "1", "Strehl ratio, large-aperture approximation")
    coordinates: dict[str, Any] = {"time": time, "y": y, "x": x}
    try:
        add_spectra(table, coordinates, time, opd, weight, tilts, segment, velocity, length or pupil_width(x, y))
    except ValueError as fault:
        if segment is not None:
            raise
        skipped.append(str(fault))
    add_apertures(table, coordinates, opd, points, weight, wave, apertures, lit)
    add_modes(table, coordinates, modes, lit)
    add_correlation(table, coordinates, opd, lit, x, y)
    add_model_errors(table, dataset, wave)
    found = _dataset(table, coordinates, dataset, wave, {"skipped": skipped, "warnings": warned})
    return found.assign_attrs(independent_count=independent)


def _in_order(dataset: Any) -> Any:
    """Return the dataset with its axes in the order time, y, x, and ascending along each."""
    import xarray

    if not isinstance(dataset, xarray.Dataset):
        raise TypeError(f"dataset must be an xarray.Dataset of optical_series, got {type(dataset).__name__}")
    if "opd" not in dataset or set(dataset["opd"].dims) != {"time", "y", "x"}:
        raise ValueError("the dataset has no opd over (time, y, x): give what optical_series returns")
    mixed = [name for name in ("time", "y", "x") if (np.diff(seconds(dataset[name].values)) < 0.0).any()]
    return (dataset.sortby(mixed) if mixed else dataset).transpose("time", "y", "x", ...)


def _unit(dataset: Any, name: str) -> float:
    """Return the unit of a variable in SI, 1 where none is stated, or for dates; raises a ValueError for others."""
    if dataset[name].dtype.kind in "mM":
        return 1.0
    try:
        stated = stated_unit(dataset[name].attrs).split(" since ")[0]  # "seconds since 2020-01-01"
        return unit_of(stated, "time" if name == "time" else "length").factor
    except ValueError as fault:
        raise ValueError(f"the unit of {name}: {fault}; give SI units") from None


def _checked(dataset: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, str]:
    """Return maps [m] of the pixels that are valid at all times, shape (t, n), their weights, and which they are.

    The last value is a warning of the others, or empty.
    """
    maps = np.asarray(dataset["opd"].values, dtype=np.float64) * _unit(dataset, "opd")
    share = dataset["weight"].values if "weight" in dataset else np.ones(maps.shape[1:])
    if len(maps) < 1:
        raise ValueError("the dataset has no snapshot")
    finite = np.isfinite(maps)
    lit = finite.all(axis=0) & (share > 0.0)
    if lit.sum() < 3:
        dark = np.flatnonzero(~finite[:, share > 0.0].any(axis=1))
        where = ": is opd NaN?"
        if 0 < len(dark) < len(maps):
            where = f"; snapshot {dark[0]} has none, one of {len(dark)}: leave those out, by dataset.isel(time=...)"
        raise ValueError(f"fewer than 3 pixels of the pupil have a number at all times{where}")
    weight = share[lit] / share[lit].sum()
    return maps[:, lit], weight, lit, lost_pixels(finite, share)


def _readings(dataset: Any, opd: np.ndarray, points: np.ndarray, weight: np.ndarray, wavelength: float):
    """Return tilts (t, 2), mean squares with and without tilt (t, 2), and Strehl ratios (t,).

    They are those of the maps, which may be a part of the pupil, filtered, or at another wavelength than the dataset's
    own numbers. A tilt that was removed from the maps is added back.
    """
    reader = MapReader(points, weight, ("piston",), wavelength)
    found = [reader(one) for one in opd]
    left = np.array([one.tilt for one in found])
    removed = np.zeros_like(left)
    if "tilt" in terms_of(dataset) and {"boresight_x", "boresight_y"} <= set(dataset.data_vars):
        removed = in_time(dataset, "boresight_x", "boresight_y")
    squares = np.array([[one.rms**2, one.rms_without_tilt**2] for one in found])
    centred = points - weighted_mean(weight, points)
    products = np.einsum("nk,n,nl->kl", centred, weight, centred)
    squares[:, 0] += np.einsum("tk,kl,tl->t", removed, products, removed + 2.0 * left)
    return left + removed, squares, np.array([one.strehl for one in found])


def _maps(table: Table, opd: np.ndarray, weight: np.ndarray, lit: np.ndarray) -> float:
    """Add the steady map and the unsteady part; return the number of independent maps, mean over the pupil."""
    mean = opd.mean(axis=0)
    error, each = standard_errors(opd)
    independent = float(weight @ each)
    words = "steady optical path difference, mean over time"
    table.array("opd_mean", ("y", "x"), spread_map(mean, lit), spread_map(error, lit), "m", words)
    spread, off = (spread_map(one, lit) for one in deviations_of(opd))
    table.array("opd_std", ("y", "x"), spread, off, "m", "unsteady optical path difference, rms in time")
    left = opd - mean
    unsteady = left**2 @ weight
    # What of the steady map is noise of a mean over few independent maps, about its own mean over the pupil.
    noise = float(np.mean(unsteady - (left @ weight) ** 2)) / max(independent - 1.0, 1.0)
    steady = math.sqrt(max(float(weight @ (mean - weight @ mean) ** 2) - noise, 0.0))
    rms = math.sqrt(float(weight @ error**2))
    words = "steady optical path difference, rms"
    table.number("opd_rms_steady", Mean(steady, rms, independent), "m", words)
    found = root_of(about_mean_of(unsteady, independent))
    table.number("opd_rms_unsteady", found, "m", "unsteady optical path difference, rms")
    return independent


def _dataset(table: Table, coordinates: dict[str, Any], source: Any, wavelength: float, said: dict[str, list[str]]):
    import xarray

    about = {
        "title": "statistics of optical path differences in time",
        "source": f"aerokernels {__version__}",
        "provenance": str(source.attrs.get("provenance", "")),
        "wavelength": wavelength,
        "errors": "standard errors, two of which cover the truth in 95 of 100 cases: by few snapshots and of the maps",
        "snapshot_count": int(source.sizes["time"]),
        **{name: "; ".join(texts) for name, texts in said.items()},
    }
    found = xarray.Dataset(table.variables, coordinates, about)
    units = {"time": "s", "frequency": "Hz", **dict.fromkeys(("x", "y", "aperture", "lag_x", "lag_y"), "m")}
    for name in coordinates:
        found[name].attrs["units"] = units.get(name, "1")
    return found
