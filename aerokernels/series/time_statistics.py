"""What is published of optical path differences in time, each number with its standard error."""

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__

from ..flow import Series
from ..wavelength import DEFAULT_WAVELENGTH, check_wavelength
from .linking import linking_equation
from .modes import integral_length, orthogonal_modes, two_point_correlation
from .pupil_grid import MapReader, disc_coverage
from .spectra import Spectrum, sample_rate, welch
from .uncertainty import Mean, mean_of, root_of

if TYPE_CHECKING:
    import xarray

BLOCKS = 10  # of the series, whose differences are the error of what is no plain mean
APERTURES = (0.25, 0.5, 0.75, 1.0)  # of the pupil, by default
DRIFTS = 0.01  # probability below which a series is said to drift
LEAST_PIXELS = 12  # of an aperture


class _Table:
    """Variables as they come together."""

    def __init__(self) -> None:
        self.variables: dict[str, Any] = {}
        self.drifting: list[str] = []

    def number(self, name: str, mean: Mean, units: str, words: str) -> None:
        """A number, its error, and whether it drifts."""
        attributes = {"units": units, "long_name": words, "effective_count": mean.effective_count, "trend": mean.trend}
        self.variables[name] = ((), mean.value, attributes)
        self.variables[f"{name}_error"] = ((), mean.error, {"units": units, "long_name": f"{words}: standard error"})
        if mean.trend < DRIFTS:
            self.drifting.append(name)

    def array(self, name: str, dims: tuple[str, ...], values: Any, error: Any, units: str, words: str) -> None:
        """An array and its error."""
        self.variables[name] = (dims, np.asarray(values), {"units": units, "long_name": words})
        if error is not None:
            told = {"units": units, "long_name": f"{words}: standard error"}
            self.variables[f"{name}_error"] = (dims, np.asarray(error), told)


def statistics(
    dataset: "xarray.Dataset",
    *,
    velocity: float | None = None,
    length: float | None = None,
    apertures: Sequence[float] | None = None,
    mode_count: int = 10,
    segment: int | None = None,
    wavelength: float | None = None,
    series: Series | None = None,
) -> "xarray.Dataset":
    """Statistics of optical path differences in time.

    A standard error heeds that neighbouring samples depend on one another (see uncertainty.py); what drifts is named in
    the attribute `drifting`. Below four snapshots errors are NaN.

    Args:
        dataset: Of `optical_series`, or any with `opd` [m] over (time, y, x), NaN outside the pupil, in metres and
            seconds.
        velocity: Speed that frequencies are scaled by for the Strouhal number f D / U [m/s]; None: none.
        length: D [m]; None: the pupil's width.
        apertures: Diameters of concentric round parts of the pupil [m]; None: a quarter to all of it.
        mode_count: Proper orthogonal modes.
        segment: Samples of a segment of the spectra.
        wavelength: Vacuum wavelength [m]; None: the dataset's.
        series: The snapshots that the dataset was made of, for the linking equation; they are read once more.

    Returns:
        A dataset with NAME and NAME_error:
        `opd_mean` (y, x), the steady map; `opd_std` (y, x), the unsteady part's rms in time;
        `opd_rms` and `opd_rms_with_tilt`, root mean squares over pupil and time, mean and tilt of each map removed, or
        its mean only; `opd_rms_steady`, of the steady map; `opd_rms_unsteady`, of the rest;
        `boresight_x`, `boresight_y`, means, and `jitter_x`, `jitter_y`, rms about them [rad];
        `strehl`, the exact mean, beside `strehl_large_aperture`, the mean of exp(-(2 pi opd_rms / wavelength)^2);
        over `frequency` [Hz] (and `strouhal`): `spectrum_opd` [m2/Hz], the mean over the pupil, `spectrum_jitter_x`,
        `spectrum_jitter_y` [rad2/Hz];
        over `aperture` [m]: `opd_rms_aperture` and `strehl_aperture`, mean and tilt over that part removed;
        `pod_energy` (mode) [m2], `pod_share`, `pod_mode` (mode, y, x), `pod_coefficient` (time, mode) [m];
        `correlation` (lag_y, lag_x) and `correlation_length_x`, `correlation_length_y` [m];
        with `series`: `opd_rms_linking`, the linking equation's, `opd_rms_path`, the double integral of which it is a
        short form, and `opd_rms_point`, the same rms as the maps have it, their mean and tilt put back [m].

    Raises:
        TypeError: No dataset.
        ValueError: No `opd` over (time, y, x), a pupil without pixels, or a number that makes no sense.
    """
    opd, weight, lit = _checked(dataset)
    time, y, x = (np.asarray(dataset[name].values, dtype=np.float64) for name in ("time", "y", "x"))
    wave = check_wavelength(dataset.attrs.get("wavelength", DEFAULT_WAVELENGTH) if wavelength is None else wavelength)
    for name, value in (("velocity", velocity), ("length", length)):
        if value is not None and not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} must be positive, got {value!r}")
    if isinstance(mode_count, bool) or not isinstance(mode_count, (int, np.integer)) or mode_count < 1:
        raise ValueError(f"mode_count must be a whole number of at least 1, got {mode_count!r}")
    grid_x, grid_y = np.meshgrid(x, y)
    points = np.stack([grid_x[lit], grid_y[lit]], axis=1)
    table, skipped = _Table(), []
    tilts, squares, ratios = _readings(dataset, opd, points, weight, wave)
    _maps(table, opd, weight, lit)
    table.number("opd_rms", root_of(mean_of(squares[:, 1])), "m", "optical path difference, mean and tilt removed, rms")
    table.number(
        "opd_rms_with_tilt", root_of(mean_of(squares[:, 0])), "m", "optical path difference, mean removed, rms"
    )
    for k, axis in enumerate("xy"):
        table.number(f"boresight_{axis}", mean_of(tilts[:, k]), "rad", f"tilt along {axis}")
        about = (tilts[:, k] - tilts[:, k].mean()) ** 2
        table.number(f"jitter_{axis}", root_of(mean_of(about)), "rad", f"tilt along {axis} about its mean, rms")
    table.number("strehl", mean_of(ratios), "1", "Strehl ratio, exact mean")
    variance = squares[:, 1] if "tilt" in str(dataset.attrs.get("remove", "piston,tilt")) else squares[:, 0]
    large = np.exp(-((2.0 * np.pi / wave) ** 2) * variance)
    table.number("strehl_large_aperture", mean_of(large), "1", "Strehl ratio, large-aperture approximation")
    coordinates: dict[str, Any] = {"time": time, "y": y, "x": x}
    try:
        _spectra(table, coordinates, time, opd, weight, tilts, segment, velocity, length or _width(x, y))
    except ValueError as fault:
        if segment is not None:
            raise
        skipped.append(str(fault))
    _apertures(table, coordinates, opd, points, weight, wave, apertures, _covers(x, y, lit))
    _modes(table, coordinates, opd, weight, lit, int(mode_count))
    _correlation(table, coordinates, opd, lit, x, y)
    if series is not None:
        _linking(table, dataset, series, opd, points, weight, wave)
    return _dataset(table, coordinates, dataset, wave, skipped)


def _checked(dataset: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Maps of the pixels that are there at all times, shape (t, n), their weights, and which they are."""
    import xarray

    if not isinstance(dataset, xarray.Dataset):
        raise TypeError(f"dataset must be an xarray.Dataset of optical_series, got {type(dataset).__name__}")
    if "opd" not in dataset or set(dataset["opd"].dims) != {"time", "y", "x"}:
        raise ValueError("the dataset has no opd over (time, y, x): give what optical_series returns")
    maps = np.asarray(dataset["opd"].transpose("time", "y", "x").values, dtype=np.float64)
    share = dataset["weight"].values if "weight" in dataset else np.ones(maps.shape[1:])
    if len(maps) < 1:
        raise ValueError("the dataset has no snapshot")
    lit = np.isfinite(maps).all(axis=0) & (share > 0.0)
    if lit.sum() < 3:
        raise ValueError("fewer than 3 pixels of the pupil have a number at all times: is opd NaN?")
    weight = share[lit] / share[lit].sum()
    return maps[:, lit], weight, lit


def _width(x: np.ndarray, y: np.ndarray) -> float:
    """The pupil's greater side [m]."""
    sides = [float(axis[-1] - axis[0]) * len(axis) / (len(axis) - 1) for axis in (x, y) if len(axis) > 1]
    return max(sides)


def _readings(dataset: Any, opd: np.ndarray, points: np.ndarray, weight: np.ndarray, wavelength: float):
    """Tilts (t, 2), mean squares with and without tilt (t, 2), and Strehl ratios (t,), read off or kept."""
    reader = MapReader(points, weight, ("piston",), wavelength)
    found = [reader(one) for one in opd]
    tilts = np.array([one.tilt for one in found])
    squares = np.array([[one.rms**2, one.rms_without_tilt**2] for one in found])
    ratios = np.array([one.strehl for one in found])
    if {"boresight_x", "boresight_y"} <= set(dataset.data_vars):
        tilts = np.stack([dataset["boresight_x"].values, dataset["boresight_y"].values], axis=1)
    for k, name in enumerate(("opd_rms_with_tilt", "opd_rms")):
        if name in dataset:
            squares[:, k] = dataset[name].values ** 2
    if "strehl" in dataset:
        ratios = dataset["strehl"].values
    return tilts, squares, ratios


def _maps(table: _Table, opd: np.ndarray, weight: np.ndarray, lit: np.ndarray) -> None:
    """The steady map, and what is left."""
    count = len(opd)
    mean = opd.mean(axis=0)
    left = opd - mean
    spread = left.std(axis=0, ddof=1) if count > 1 else np.full(len(mean), np.nan)
    unsteady = left**2 @ weight
    # Maps as a whole are as independent as their mean square over the pupil, or as their first mode: the lesser.
    first = orthogonal_modes(opd, weight, 1).coefficient[:, 0] if count > 1 else np.zeros(count)
    effective = min(mean_of(unsteady).effective_count, mean_of(first).effective_count)
    known = count >= 4
    table.array(
        "opd_mean",
        ("y", "x"),
        _spread(mean, lit),
        _spread(spread / math.sqrt(effective) if known else np.full(len(mean), np.nan), lit),
        "m",
        "steady optical path difference, mean over time",
    )
    error = spread / math.sqrt(2.0 * effective) if known else np.full(len(mean), np.nan)
    table.array(
        "opd_std",
        ("y", "x"),
        _spread(spread, lit),
        _spread(error, lit),
        "m",
        "unsteady optical path difference, rms in time",
    )
    steady = float(np.sqrt(weight @ (mean - weight @ mean) ** 2))
    noise = float(np.sqrt(weight @ spread**2 / effective)) if known else math.nan
    table.number("opd_rms_steady", Mean(steady, noise, effective, math.nan), "m", "steady optical path difference, rms")
    table.number("opd_rms_unsteady", root_of(mean_of(unsteady)), "m", "unsteady optical path difference, rms")


def _spread(values: np.ndarray, lit: np.ndarray) -> np.ndarray:
    found = np.full(lit.shape, np.nan)
    found[lit] = values
    return found


def _spectra(table, coordinates, time, opd, weight, tilts, segment, velocity, length) -> None:
    rate = sample_rate(time)
    ours: dict[str, tuple[Spectrum, str, str]] = {}
    whole = welch(opd, rate, segment)
    over = Spectrum(whole.frequency, whole.density @ weight, whole.error @ weight, whole.segment_count)
    ours["spectrum_opd"] = (over, "m2 Hz-1", "power spectral density of opd, mean over the pupil")
    for k, axis in enumerate("xy"):
        one = welch(tilts[:, k], rate, segment)
        ours[f"spectrum_jitter_{axis}"] = (one, "rad2 Hz-1", f"power spectral density of the tilt along {axis}")
    for name, (spectrum, units, words) in ours.items():
        table.array(name, ("frequency",), spectrum.density, spectrum.error, units, words)
    coordinates["frequency"] = whole.frequency
    if velocity is not None:
        coordinates["strouhal"] = ("frequency", whole.frequency * length / velocity)


def _covers(x: np.ndarray, y: np.ndarray, lit: np.ndarray):
    """A function of a diameter [m] that gives the share of each lit pixel in a disc of it about the pupil's centre."""
    steps = [float(axis[1] - axis[0]) if len(axis) > 1 else 1.0 for axis in (x, y)]
    edges = [np.append(axis - 0.5 * step, axis[-1] + 0.5 * step) for axis, step in zip((x, y), steps, strict=True)]
    middle = [0.5 * (edge[0] + edge[-1]) for edge in edges]
    return lambda diameter: disc_coverage(0.5 * diameter, *(e - m for e, m in zip(edges, middle, strict=True)))[lit]


def _apertures(table, coordinates, opd, points, weight, wavelength, apertures, covers) -> None:
    """Concentric round parts of the pupil, mean and tilt over each removed."""
    width = _width(coordinates["x"], coordinates["y"])
    asked = np.array([share * width for share in APERTURES] if apertures is None else apertures, dtype=np.float64)
    if asked.ndim != 1 or not (np.isfinite(asked).all() and (asked > 0.0).all()):
        raise ValueError(f"apertures must be positive diameters in metres, got {apertures!r}")
    rows: list[list[float]] = []
    for diameter in asked:
        shares = np.minimum(covers(diameter), weight / weight.max())
        inside = shares > 0.0
        if inside.sum() < LEAST_PIXELS:
            rows.append([math.nan] * 4)
            continue
        reader = MapReader(points[inside], shares[inside], ("piston", "tilt"), wavelength)
        found = [reader(one[inside]) for one in opd]
        rms = root_of(mean_of(np.array([one.rms_without_tilt**2 for one in found])))
        ratio = mean_of(np.array([one.strehl for one in found]))
        rows.append([rms.value, rms.error, ratio.value, ratio.error])
    values = np.array(rows).reshape(len(asked), 4)
    told = "over a round part of the pupil, its mean and tilt removed"
    table.array(
        "opd_rms_aperture", ("aperture",), values[:, 0], values[:, 1], "m", f"optical path difference {told}, rms"
    )
    table.array("strehl_aperture", ("aperture",), values[:, 2], values[:, 3], "1", f"Strehl ratio {told}")
    coordinates["aperture"] = asked


def _modes(table, coordinates, opd, weight, lit, count) -> None:
    if len(opd) < 2:
        return
    modes = orthogonal_modes(opd, weight, count)
    squares = [mean_of(modes.coefficient[:, k] ** 2) for k in range(len(modes.energy))]
    errors = np.array([one.error for one in squares])
    table.array("pod_energy", ("mode",), modes.energy, errors, "m2", "mean square of a proper orthogonal mode")
    share = modes.energy / modes.total if modes.total > 0.0 else np.full(len(errors), np.nan)
    error = errors / modes.total if modes.total > 0.0 else np.full(len(errors), np.nan)
    table.array("pod_share", ("mode",), share, error, "1", "share of the unsteady mean square in a mode")
    shapes = np.stack([_spread(one, lit) for one in modes.shape])
    table.array("pod_mode", ("mode", "y", "x"), shapes, None, "1", "proper orthogonal mode, mean square 1")
    table.array("pod_coefficient", ("time", "mode"), modes.coefficient, None, "m", "coefficient of a mode")
    coordinates["mode"] = np.arange(len(modes.energy))


def _correlation(table, coordinates, opd, lit, x, y) -> None:
    """Two-point correlation and its lengths; their errors from the differences of parts of the series."""
    if len(opd) < 2:
        return
    found = two_point_correlation(opd, lit)
    middle = tuple(size // 2 for size in found.shape)
    steps = [float(axis[1] - axis[0]) if len(axis) > 1 else 1.0 for axis in (y, x)]
    blocks = min(BLOCKS, len(opd) // 2)
    parts = [two_point_correlation(part, lit) for part in np.array_split(opd, blocks)] if blocks >= 4 else []
    power = found[middle]
    ratio = found / power if power > 0.0 else np.full(found.shape, np.nan)
    spread = [part / part[middle] for part in parts if part[middle] > 0.0]
    error = (
        np.std(spread, axis=0, ddof=1) / math.sqrt(len(spread)) if len(spread) >= 4 else np.full(found.shape, np.nan)
    )
    table.array("correlation", ("lag_y", "lag_x"), ratio, error, "1", "correlation of unsteady opd at two points")
    lines = {"y": (slice(middle[0], None), middle[1]), "x": (middle[0], slice(middle[1], None))}
    for axis, step in zip("yx", steps, strict=True):
        value = integral_length(found[lines[axis]], step)
        each = [integral_length(part[lines[axis]], step) for part in parts]
        off = float(np.std(each, ddof=1) / math.sqrt(len(each))) if len(each) >= 4 else math.nan
        words = f"correlation length along {axis}, integral to the first zero"
        table.number(f"correlation_length_{axis}", Mean(value, off, float(len(each)), math.nan), "m", words)
    coordinates["lag_y"] = steps[0] * (np.arange(found.shape[0]) - middle[0])
    coordinates["lag_x"] = steps[1] * (np.arange(found.shape[1]) - middle[1])


def _linking(table, dataset, series, opd, points, weight, wavelength) -> None:
    """The linking equation beside what the maps give."""
    about = dataset.attrs
    missing = [name for name in ("pupil_center", "pupil_axes", "direction") if name not in about]
    if missing:
        raise ValueError(f"series goes with a dataset of optical_series; this one has no {missing[0]}")
    axes = np.asarray(about["pupil_axes"]).reshape(2, 3)
    start = np.asarray(about["pupil_center"]) + points @ axes
    found = linking_equation(
        series,
        start,
        about["direction"],
        wavelength,
        relation=about.get("relation", "gladstone-dale"),
        constant=about.get("constant"),
    )
    words = {"opd_rms_linking": "the linking equation", "opd_rms_path": "the covariance of density along the rays"}
    for name, (value, error) in found.items():
        mean = Mean(value, error, math.nan, math.nan)
        table.number(name, mean, "m", f"rms of optical path differences in time at a point, by {words[name]}")
    centred = points - weight @ points
    whole = opd + 0.0
    terms = str(about.get("remove", "")).split(",")
    if "piston" in terms:
        whole += dataset["piston"].values[:, None]
    if "tilt" in terms:
        whole += np.stack([dataset["boresight_x"].values, dataset["boresight_y"].values], axis=1) @ centred.T
    unsteady = (whole - whole.mean(axis=0)) ** 2 @ weight * len(whole) / max(len(whole) - 1, 1)
    told = "rms of optical path differences in time at a point, by the maps"
    table.number("opd_rms_point", root_of(mean_of(unsteady)), "m", told)


UNITS = {
    "time": "s",
    "y": "m",
    "x": "m",
    "frequency": "Hz",
    "strouhal": "1",
    "aperture": "m",
    "lag_x": "m",
    "lag_y": "m",
}


def _dataset(table: _Table, coordinates: dict[str, Any], source: Any, wavelength: float, skipped: list[str]):
    import xarray

    about = {
        "title": "statistics of optical path differences in time",
        "source": f"aerokernels {__version__}",
        "provenance": str(source.attrs.get("provenance", "")),
        "wavelength": wavelength,
        "snapshot_count": int(source.sizes["time"]),
        "drifting": ", ".join(table.drifting),
        "skipped": "; ".join(skipped),
    }
    found = xarray.Dataset(table.variables, coordinates, about)
    for name in coordinates:
        found[name].attrs["units"] = UNITS.get(name, "1")
    return found
