"""The parts of the statistics of a series, each of which adds its variables and their errors, and the warnings."""

import math
from typing import Any

import numpy as np

from aerokernels.pupils import Disc
from aerokernels.series.modes import (
    Mean,
    Modes,
    Spectrum,
    about_mean,
    integral_length,
    mean_of,
    mean_spectrum,
    root_of,
    sample_rate,
    standard_errors,
    student_share,
    two_point_correlation,
    welch,
)
from aerokernels.series.pupil_grid import MapReader

BLOCKS = 10  # blocks of the series, whose differences give the error of numbers that are not plain means


class Table:
    """Variables, collected one by one."""

    def __init__(self) -> None:
        """Start with no variables."""
        self.variables: dict[str, Any] = {}

    def number(self, name: str, mean: Mean, units: str, words: str) -> None:
        """Add a number and its error."""
        attributes = {"units": units, "long_name": words, "effective_count": mean.effective_count}
        self.variables[name] = ((), mean.value, attributes)
        self.variables[f"{name}_error"] = ((), mean.error, {"units": units, "long_name": f"{words}: standard error"})

    def array(self, name: str, dims: tuple[str, ...], values: Any, error: Any, units: str, words: str) -> None:
        """Add an array and its error."""
        self.variables[name] = (dims, np.asarray(values), {"units": units, "long_name": words})
        if error is not None:
            described = {"units": units, "long_name": f"{words}: standard error"}
            self.variables[f"{name}_error"] = (dims, np.asarray(error), described)


def spread_map(values: np.ndarray, lit: np.ndarray) -> np.ndarray:
    """Return a map of the values of lit pixels, NaN elsewhere."""
    result = np.full(lit.shape, np.nan)
    result[lit] = values
    return result


def terms_of(dataset: Any) -> tuple[str, ...]:
    """Return the names of the terms that were removed from a dataset's maps; piston and tilt where it does not say."""
    return tuple(term.strip() for term in str(dataset.attrs.get("remove", "piston,tilt")).split(","))


def in_time(dataset: Any, *names: str) -> np.ndarray:
    """Return numbers of each snapshot, shape (t, n); `dataset.where(...)` repeats them in all pixels that it keeps."""
    result = [dataset[name] for name in names]
    return np.stack([one.max([axis for axis in one.dims if axis != "time"]).values for one in result], axis=1)


def pupil_width(x: np.ndarray, y: np.ndarray) -> float:
    """Return the pupil's greater side [m]."""
    sides = [float(axis[-1] - axis[0]) * len(axis) / (len(axis) - 1) for axis in (x, y) if len(axis) > 1]
    return max(sides)


def add_spectra(table, coordinates, time, opd, weight, tilts, segment, velocity, length) -> None:
    """Add power spectra of the maps, mean over the pupil, and of their tilts."""
    rate = sample_rate(time)
    ours: dict[str, tuple[Spectrum, str, str]] = {}
    whole = mean_spectrum(opd, weight, rate, segment)
    ours["spectrum_opd"] = (whole, "m2 Hz-1", "power spectral density of opd, mean over the pupil")
    for k, axis in enumerate("xy"):
        one = welch(tilts[:, k], rate, segment)
        ours[f"spectrum_jitter_{axis}"] = (one, "rad2 Hz-1", f"power spectral density of the tilt along {axis}")
    for name, (spectrum, units, words) in ours.items():
        table.array(name, ("frequency",), spectrum.density, spectrum.error, units, words)
    coordinates["frequency"] = whole.frequency
    if velocity is not None:
        coordinates["strouhal"] = ("frequency", whole.frequency * length / velocity)


def add_apertures(table, coordinates, opd, points, weight, wavelength, apertures, lit) -> None:
    """Add rms and Strehl ratio over concentric round parts of the pupil, with mean and tilt over each removed."""
    width = pupil_width(coordinates["x"], coordinates["y"])
    asked = np.array(width * np.array([0.25, 0.5, 0.75, 1.0]) if apertures is None else apertures, dtype=np.float64)
    if asked.ndim != 1 or not (np.isfinite(asked).all() and (asked > 0.0).all()):
        raise ValueError(f"apertures must be positive diameters in metres, got {apertures!r}")
    if (asked > width * (1.0 + 1e-9)).any():
        raise ValueError(f"an aperture of {asked.max():g} m is wider than the maps, {width:g} m: give metres")
    centred = []  # edges of the pixels about the middle
    for axis in (coordinates["x"], coordinates["y"]):
        step = float(axis[1] - axis[0]) if len(axis) > 1 else 1.0
        edges = np.append(axis - 0.5 * step, axis[-1] + 0.5 * step)
        centred.append(edges - 0.5 * (edges[0] + edges[-1]))
    rows: list[list[float]] = []
    for diameter in asked:
        shares = np.minimum(Disc(0.5 * diameter).coverage(*centred)[lit], weight / weight.max())
        inside = shares > 0.0
        if inside.sum() < 12:  # too few pixels
            rows.append([math.nan] * 4)
            continue
        reader = MapReader(points[inside], shares[inside], ("piston", "tilt"), wavelength)
        result = [reader(one[inside]) for one in opd]
        rms = root_of(mean_of(np.array([one.rms_without_tilt**2 for one in result])))
        ratio = mean_of(np.array([one.strehl for one in result]))
        rows.append([rms.value, rms.error, ratio.value, ratio.error])
    values = np.array(rows).reshape(len(asked), 4)
    described = "over a round part of the pupil, its mean and tilt removed"
    words = f"optical path difference {described}, rms"
    table.array("opd_rms_aperture", ("aperture",), values[:, 0], values[:, 1], "m", words)
    table.array("strehl_aperture", ("aperture",), values[:, 2], values[:, 3], "1", f"Strehl ratio {described}")
    coordinates["aperture"] = asked


def add_modes(table, coordinates, modes: Modes | None, lit) -> None:
    """Add proper orthogonal modes; None: there are none."""
    if modes is None:
        return
    squares, counts = standard_errors(modes.coefficient**2)
    _, independent = standard_errors(modes.coefficient)
    share, mixed = _mixing(modes.energy, counts)
    # A mode takes energy of others that it mixes with, and loses that of its mean.
    about = np.hypot(np.sum(share * mixed, axis=1), modes.energy / np.maximum(independent - 1.0, 1.0))
    errors = np.hypot(squares, about)
    table.array("pod_energy", ("mode",), modes.energy, errors, "m2", "mean square of a proper orthogonal mode")
    whole = modes.total if modes.total > 0.0 else math.nan
    words = "share of the unsteady mean square in a mode"
    table.array("pod_share", ("mode",), modes.energy / whole, errors / whole, "1", words)
    shapes = np.stack([spread_map(one, lit) for one in modes.shape])
    mixture = np.sqrt(share**2 @ np.nan_to_num(modes.shape) ** 2) + 0.0 * modes.shape
    off = np.stack([spread_map(one, lit) for one in mixture])
    table.array("pod_mode", ("mode", "y", "x"), shapes, off, "1", "proper orthogonal mode, mean square 1")
    table.array("pod_coefficient", ("time", "mode"), modes.coefficient, None, "m", "coefficient of a mode")
    coordinates["mode"] = np.arange(len(modes.energy))


def _mixing(energy: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the share of each mode j in each mode k, and the error of their covariance, shapes (k, j).

    The share is sqrt(e_k e_j / N) / (e_k - e_j), at most 1 (G. R. North et al., Mon. Weather Rev. 110 (1982) 699).
    """
    gap = np.abs(energy[:, None] - energy)
    mixed = np.sqrt(np.outer(energy, energy) / np.maximum(counts[:, None], 1.0))
    share = np.where(mixed < gap, mixed / np.where(gap > 0.0, gap, 1.0), 1.0)
    np.fill_diagonal(share, 0.0)
    return share, mixed


def add_correlation(table, coordinates, opd, lit, x, y) -> None:
    """Add the two-point correlation and its lengths, with errors from the differences of parts of the series."""
    if len(opd) < 2:
        return
    result = two_point_correlation(opd, lit)
    middle = tuple(size // 2 for size in result.shape)
    steps = [float(axis[1] - axis[0]) if len(axis) > 1 else 1.0 for axis in (y, x)]
    blocks = min(BLOCKS, len(opd) // 2)
    # About the mean of the whole series: a part's own mean would remove slow fluctuations, and with them the spread.
    left = about_mean(opd)
    parts = [two_point_correlation(part, lit, 0.0) for part in np.array_split(left, blocks)] if blocks >= 4 else []
    power = result[middle]
    ratio = result / power if power > 0.0 else np.full(result.shape, np.nan)
    differences = [(part - ratio * part[middle]) / power for part in parts] if power > 0.0 else []
    # Neighbouring parts are correlated, so that their spread is too small: scale it by the ratio for the mean square.
    by_parts = _error_by_parts([part[middle] for part in parts]) if parts else 0.0
    more = max(1.0, mean_of(np.mean(left**2, axis=1)).error / by_parts) if by_parts > 0.0 else 1.0
    more *= student_share(blocks)
    error = more * _error_by_parts(differences) if differences else np.full(result.shape, np.nan)
    table.array("correlation", ("lag_y", "lag_x"), ratio, error, "1", "correlation of unsteady opd at two points")
    lines = {"y": (slice(middle[0], None), middle[1]), "x": (middle[0], slice(middle[1], None))}
    for axis, step in zip("yx", steps, strict=True):
        line = lines[axis]
        value = integral_length(result[line], step)
        # Leaving out one part at a time shows where the first zero may jump, which no linear estimate does.
        without = [integral_length((result - part / blocks)[line], step) for part in parts]
        off = float(more * (blocks - 1) * _error_by_parts(without)) if parts else math.nan
        words = f"correlation length along {axis}, integral to the first zero"
        table.number(f"correlation_length_{axis}", Mean(value, off, float(len(parts))), "m", words)
    coordinates["lag_y"] = steps[0] * (np.arange(result.shape[0]) - middle[0])
    coordinates["lag_x"] = steps[1] * (np.arange(result.shape[1]) - middle[1])


def _error_by_parts(values: list) -> np.ndarray:
    """Return the standard error of a mean over parts of a series, from their differences."""
    return np.asarray(np.std(values, axis=0, ddof=1) / math.sqrt(len(values)))


def lost_pixels(finite: np.ndarray, share: np.ndarray) -> str:
    """Return a warning of pixels that have a number in some snapshots, shape (t, y, x), but not in all; or empty.

    Pixels that have no number in any snapshot do not count: a caller leaves them out on purpose.
    """
    share = np.where(finite.any(axis=0), share, 0.0)
    lost = (share * ~finite.all(axis=0)).sum() / share.sum()
    if not lost > 1e-3:
        return ""
    each = (share * ~finite).sum(axis=(1, 2)) / share.sum()
    worst = int(each.argmax())
    return (
        f"{100.0 * lost:.3g} % of the pupil is in no statistic, because it has no number in some of the snapshots, "
        f"{100.0 * each[worst]:.3g} % of it in snapshot {worst}: leave out such snapshots by dataset.isel(time=...), "
        "or take a smaller pupil"
    )


def uneven_times(time: np.ndarray) -> str:
    """Return a warning of times [s], shape (t,), for which means over snapshots are not means over time."""
    if len(time) < 3:
        return ""
    steps = np.diff(time)
    stands_for = 0.5 * (np.append(steps, 0.0) + np.insert(steps, 0, 0.0))
    stands_for[[0, -1]] *= 2.0  # the ends stand for as much time on their other side
    shares = len(time) * stands_for / stands_for.sum()
    if not 0.5 * np.abs(shares - 1.0).mean() > 0.05:
        return ""
    return (
        f"the times are uneven, with steps of {steps.min():.3g} to {steps.max():.3g} s, and each snapshot counts once: "
        "numbers are means over the snapshots and not over time; for those interpolate the maps to even times by "
        "dataset.interp(time=...), or leave out snapshots where they are dense"
    )


def few_independent(independent: float, count: int) -> str:
    """Return a warning of maps that count as few independent ones, of `count` snapshots; empty if these suffice."""
    if not independent < 10.0:
        return ""
    return (
        f"the statistics rest on {independent:.2g} independent snapshots (of {count}), fewer than 10: they and their "
        "errors are uncertain; take snapshots over a longer time"
    )


# Statistics, the numbers of snapshots whose errors they have, and the power of these numbers that they are; 0 for those
# that are means of such numbers, or rms deviations.
SHARES = {
    **{name: (name, 0.0) for name in ("strehl", "opd_rms", "opd_rms_with_tilt", "boresight_x", "boresight_y")},
    **{f"jitter_{axis}": (f"boresight_{axis}", 0.0) for axis in "xy"},
    **dict.fromkeys(("opd_std", "opd_rms_steady", "opd_rms_unsteady", "opd_rms_aperture"), ("", 1.0)),
    **dict.fromkeys(("spectrum_opd", "pod_energy"), ("", 2.0)),
    **{f"spectrum_jitter_{axis}": (f"boresight_{axis}", 2.0) for axis in "xy"},
}


def add_model_errors(table: Table, dataset: Any, wavelength: float) -> None:
    """Add the errors of the maps of `optical_series` to those of a table; other maps have none.

    They do not become smaller by averaging in time: they are those of one grid and one gas. A mean has the root mean
    square of the snapshots' errors; other lengths have the share of the OPD rms that its error is, squares of lengths
    twice that, and a Strehl ratio S of the rms changes by 2 S |ln S| of it. Errors of maps are twice a standard error.
    """
    if not {"error", *(f"{name}_error" for name, _ in SHARES.values() if name)} <= set(dataset.data_vars):
        return
    whole = "opd_rms" if "tilt" in terms_of(dataset) else "opd_rms_with_tilt"

    def rms(name: str) -> float:
        return float(np.sqrt(np.mean(in_time(dataset, name) ** 2)))

    def share(name: str) -> float:
        size = rms(name)
        return 0.5 * rms(f"{name}_error") / size if size > 0.0 else 0.0

    def add(name: str, more: Any) -> None:
        if f"{name}_error" in table.variables:
            dims, before, about = table.variables[f"{name}_error"]
            table.variables[f"{name}_error"] = dims, np.hypot(before, more), about

    by_rms = ["strehl_large_aperture", "strehl_aperture"]
    if wavelength != dataset.attrs.get("wavelength"):
        by_rms.append("strehl")
    add("opd_mean", 0.5 * rms("error"))
    for name, (of, power) in SHARES.items():
        if power == 0.0 and name not in by_rms:
            add(name, 0.5 * rms(f"{of}_error"))
        elif power > 0.0 and name in table.variables:
            add(name, power * share(of or whole) * np.abs(table.variables[name][1]))
    for name in by_rms:
        value = np.clip(table.variables[name][1], 1e-300, 1.0)
        add(name, 2.0 * value * np.abs(np.log(value)) * share(whole))
