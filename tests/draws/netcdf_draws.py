"""Random NetCDF contents as read by HDF5, without the file: echoes, run results, wavefronts, flows, index fields.

Variables, dimensions, units, fill values and attributes are interpreted by this package; HDF5 itself, which takes ten
milliseconds and a process, is not run. As in input_draws.py: an answer with finite numbers, or a refusal in one line.
"""

import json
import math
import random
import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from aerokernels.echo.result import echo_of_result
from aerokernels.files.netcdf_reading import FileVariable, dataset_of, errors_naming
from aerokernels.flow.reading.readers.netcdf import labelled_dataset
from aerokernels.flow.series_files import series_of_dataset
from aerokernels.jobs.recorded import waveforms
from aerokernels.jobs.run_folder import RunFolder, match_runs, run_of
from aerokernels.medium import IndexField
from aerokernels.wavefront import Wavefront
from aerokernels.wavefront.result import SIGN_CONVENTION

from .flow_draws import check_dataset
from .input_draws import NUMBERS, TEXTS, Draw
from .record_draws import check_echoes
from .refusals import check_refusal
from .spoiling import ODD_WORDS, spoilt_text

PATH = Path("drawn.nc")
KINDS = ("i4", "f4", "S3", "U3", "?", "c16", "O", "M8[ns]", "m8[ns]", "u1", "f2", "i8")
KEYS = ("units", "scale_factor", "add_offset", "_FillValue", "missing_value", "coordinates", "calendar", "dtype",
        "bounds", "ambient_density", "long_name", "grid_mapping", "_Unsigned", "time", "pixel", "wavelength", "radius",
        "sign_convention", "blocked", "direction", "removed", "opd_error", "scene", "ambient_index",
        "interpolation", "cell_averages", "cell_methods", "flag_values")  # fmt: skip
NAMES = ("rho", "t", "x", "r", "", "a/b", "\x1b", "Density", "time", "voltage", "p", "T", "y", "echo", "label_a b",
         "weight")  # fmt: skip
ODD: tuple[Any, ...] = (
    *TEXTS, *ODD_WORDS, *NUMBERS, 3.0, -1, 0, np.float64("nan"), np.int16(2), np.array([1.0, 2.0]), np.array([]),
    b"\xff", True, [], ["a", "b"], "kg m-3", "mm", "ns", "1", "seconds since 1970-01-01", "days since 0000-00-00",
    "hours since x", "since", "x y", np.array(["a", "b"]), np.array([[1.0]]), np.float32(0.5), np.array([2.0]),
)  # fmt: skip

MIDDLE = np.array([[5e-4, 1.5e-3, 2e-3]])

# Texts of NumPy's, Python's and xarray's own errors, which name nothing of the file.
BARE = re.compile(r"could not|ufunc|truth value|This function|broadcast|has no attr|unhashable|out of bounds|reshape|"
                  r"not supported|length-1|must be real|invalid literal|argument must|object is not")  # fmt: skip

Held = dict[str, Any]
Far = dict[str, FileVariable]


def variable(dims: tuple[str, ...], values: Any, **attributes: Any) -> FileVariable:
    """A variable of a file whose values were read together with its description."""
    values = np.asarray(values)
    return FileVariable(dims, values.shape, values.dtype, attributes, None, values)


def spoil(far: Far, held: Held, draw: random.Random) -> None:
    """Change some variables and attributes of a valid file: names, axes, shapes, types, values, units."""
    for _ in range(draw.choice((0, 1, 1, 1, 2, 3))):
        if not far:
            return
        name, way = draw.choice(list(far)), draw.randrange(11)
        one = far[name]
        assert one.values is not None
        if way <= 3:
            far[name] = one._replace(attributes={**one.attributes, draw.choice(KEYS): draw.choice(ODD)})
        elif way == 4:
            held[draw.choice((*KEYS, *held))] = draw.choice(ODD)
        elif way == 5:
            far[draw.choice(NAMES)] = far.pop(name)
        elif way == 6:
            kind = draw.choice(KINDS)
            with np.errstate(all="ignore"), suppress(ArithmeticError, RuntimeError, ValueError, TypeError):
                far[name] = one._replace(values=one.values.astype(kind), dtype=np.dtype(kind))
        elif way == 7 and one.values.size:
            values = one.values.astype(object).ravel()
            values[draw.randrange(values.size)] = draw.choice((np.nan, np.inf, -np.inf, -1.0, 0.0, 1e300, 1e-300))
            with suppress(ArithmeticError, TypeError, ValueError):
                far[name] = one._replace(values=values.astype(one.values.dtype).reshape(one.shape))
        elif way == 8:
            other = draw.choice(((), ("other",), one.dims[::-1], one.dims[1:], (*one.dims, "other"), one.dims * 2))
            sizes = dict(zip(one.dims, one.shape, strict=True))
            shape = tuple(sizes.get(dim, draw.choice((0, 1, 2, 20))) for dim in other)
            values = np.resize(one.values, shape)
            far[name] = one._replace(dims=other, shape=shape, values=values)
        elif way == 9 and one.dims:
            shape = (draw.choice((0, 1, 2, 7)), *one.shape[1:])  # of another length than others along its dimension
            far[name] = one._replace(shape=shape, values=np.resize(one.values, shape))
        elif way == 10:
            del far[name]
        if draw.random() < 0.05:
            held.pop(draw.choice((*held, "none")), None)


def _check_refusal(fault: Exception, named: object = "") -> bool:
    text = str(fault)
    own = "cannot be read as NetCDF" not in text and "cannot be read (" not in text
    if own and BARE.search(text):
        raise AssertionError(f"refused as {text[:300]!r}") from fault
    return check_refusal(fault, named)


def _require(good: bool, what: str) -> None:
    if not good:
        raise AssertionError(what)


def _finite(values: Any) -> bool:
    return bool(np.isfinite(np.asarray(values, dtype=np.float64)).all())


def echoes(draw: random.Random, folder: Path) -> bool:
    """A file of recorded echoes."""
    time = 1e-9 * np.arange(1.0, 21.0)
    far = {"voltage": variable(("echo", "sample"), np.linspace(0.0, 1.0, 40).reshape(2, 20), units="V")}
    if draw.random() < 0.5:
        far["time"] = variable(("sample",), time, units="s")
    else:
        far["sample_period"] = variable(("echo",), [1e-9, 2e-9], units="s")
        far["first_sample_time"] = variable(("echo",), [0.0, 1e-9])
    if draw.random() < 0.5:
        far["label_mach"] = variable(("echo",), np.array(["3", "é"], object))
    held: Held = {}
    spoil(far, held, draw)
    try:
        with errors_naming(PATH):
            data = dataset_of(PATH, far, held, False).load()
        return check_echoes(waveforms(data, PATH))
    except ValueError as fault:
        return _check_refusal(fault, PATH)


SCENE = "[detector]\nthreshold = 0.01\n[target]\ndistance = 30.0\n"


def result(draw: random.Random, folder: Path) -> bool:
    """The result.nc of a run beside its summary.json, for a comparison with echoes and for a board."""
    time = 2e-7 + 1e-10 * np.arange(40.0)
    voltage = np.exp(-(((time - 2.02e-7) / 1e-9) ** 2))
    far = {
        "time": variable(("time",), time, units="s"),
        "echo_voltage": variable(("time",), voltage, units="V"),
    }
    held: Held = {"scene": SCENE if draw.random() < 0.8 else spoilt_text(SCENE, draw).decode("utf-8", "replace")}
    summary: Any = {"scene": "a", "mach": 3.0, "true_range_m": 30.0, "errors": {"range_m": 0.1}, "failures": {}}
    spoil(far, held, draw)
    if draw.random() < 0.5:
        odd = draw.choice((*NUMBERS, "x", None, [], {}, {"echo": "lost"}, {"echo": 3}, ["echo"], True, 10**400))
        summary[draw.choice(list(summary))] = odd
    if draw.random() < 0.03:
        summary = draw.choice(([], 3, "x", None, {}))
    summary = json.loads(json.dumps(summary))
    try:
        with errors_naming(PATH):
            data = dataset_of(PATH, far, held, False).load()
        if draw.random() < 0.3:
            found = echo_of_result(PATH, data)
            good = _finite(found) and bool((np.diff(found[0]) > 0.0).all())
            _require(good, f"an echo: {found}")
            return True
        run = run_of(PATH, summary, data)
    except ValueError as fault:
        return _check_refusal(fault, PATH)
    _check_run(run)
    return True


def _check_run(run: RunFolder) -> None:
    good = run.time.shape == run.voltage.shape and run.time.ndim == 1 and _finite(run.time) and _finite(run.voltage)
    _require(good and bool((np.diff(run.time) > 0.0).all()), f"volts at increasing times: {run}")
    _require(math.isfinite(run.distance) and hasattr(run.detector, "get"), f"a distance and a detector: {run}")
    _require(isinstance(run.name, str) and isinstance(run.error_of("range_m"), float), f"a name and errors: {run}")
    run.error_of("range_m", "centroid")
    with suppress(ValueError):
        match_runs([(("mach", "3"),)], [run])


def wavefront(draw: random.Random, folder: Path) -> bool:
    """A wavefront written by `to_xarray`."""
    side = 1e-3 * (np.arange(4.0) - 1.5)
    maps = {"opd": 1e-8 * np.arange(16.0), "weight": np.ones(16), "intensity": np.ones(16)}
    far = {name: variable(("y", "x"), own.reshape(4, 4), units="1") for name, own in maps.items()}
    far["opd"] = far["opd"]._replace(attributes={"units": "m"})
    far |= {name: variable((name,), side, units="m") for name in "xy"}
    held: Held = {"wavelength": 905e-9, "pixel": 1e-3, "sign_convention": SIGN_CONVENTION, "radius": 2e-3,
                  "blocked": 0.0, "removed": "piston tilt", "opd_error": 1e-9}  # fmt: skip
    if draw.random() < 0.5:
        held["direction"] = np.array([0.0, 0.0, 1.0])
    spoil(far, held, draw)
    try:
        with errors_naming(PATH):
            data = dataset_of(PATH, far, held, True).load()
    except ValueError as fault:
        return _check_refusal(fault, PATH)
    try:
        found = Wavefront.from_xarray(data)
        strehl = found.strehl()
    except ValueError as fault:
        return _check_refusal(fault)
    _require(found.opd.dtype == np.float64 and _finite(found.opd[found.lit]) and found.weight.max() > 0.0, "an OPD")
    _require(0.0 <= strehl <= 1.0 + 1e-12, f"a Strehl ratio: {strehl}")
    good = math.isfinite(found.pixel * found.wavelength * float(found.radius or 0.0)) and 0.0 <= found.blocked <= 1.0
    _require(good, f"lengths: {found.pixel} {found.wavelength} {found.radius} {found.blocked}")
    _require(found.direction is None or (np.shape(found.direction) == (3,) and _finite(found.direction)), "a direction")
    return True


def _flow(draw: random.Random, axes: dict[str, int], timed: bool) -> tuple[Far, Held]:
    sizes = {"time": 3, **axes} if timed else axes
    shape = tuple(sizes.values())
    count = math.prod(shape)
    far = {"density": variable(tuple(sizes), 1.0 + 1e-3 * np.arange(count).reshape(shape), units="kg/m3")}
    for name, size in sizes.items():
        far[name] = variable((name,), 1e-3 * np.arange(float(size)), units="s" if name == "time" else "m")
    held: Held = {"ambient_density": 1.2}
    spoil(far, held, draw)
    return far, held


AXES: tuple[dict[str, int], ...] = ({"y": 4, "z": 5}, {"r": 4, "z": 5}, {"x": 2, "y": 4, "z": 5})


def flow(draw: random.Random, folder: Path) -> bool:
    """A flow at one or several times, as read by `flow.read`."""
    far, held = _flow(draw, draw.choice(AXES), draw.random() < 0.4)
    try:
        with errors_naming(PATH):
            data = dataset_of(PATH, far, held, False).load()
        return check_dataset(PATH, labelled_dataset(PATH, data, None, draw.choice((None, "first", 1e-3)), "NetCDF"))
    except ValueError as fault:
        return _check_refusal(fault)


def attributes(draw: random.Random, folder: Path) -> bool:
    """A series, as read by `open_series`."""
    far, held = _flow(draw, draw.choice(AXES), True)
    try:
        with errors_naming(PATH):
            data = dataset_of(PATH, far, held, True)
        series = series_of_dataset(data, {}, str(PATH), {})
        _require(_finite(series.time) and bool((np.diff(series.time) > 0).all()), f"times {series.time}")
        field = series[draw.randrange(len(series))]
        _require(_finite(field.density), "finite densities")  # type: ignore[attr-defined]  # of samples
    except ValueError as fault:
        return _check_refusal(fault)
    return True


def index(draw: random.Random, folder: Path) -> bool:
    """An array of contrast, as read by `IndexField.from_xarray`."""
    far, held = _flow(draw, draw.choice(AXES), False)
    if "density" in far:
        own = far["density"]
        assert own.values is not None
        if own.attributes.get("units") == "kg/m3":  # if the draw has not changed it: a contrast is a ratio
            own = own._replace(attributes={**own.attributes, "units": "1"})
        with suppress(TypeError), np.errstate(all="ignore"):
            far["density"] = own._replace(values=own.values * 1e-4)
    try:
        with errors_naming(PATH):
            data = dataset_of(PATH, far, held, False).load()
    except ValueError as fault:
        return _check_refusal(fault, PATH)
    if "density" not in data:
        return False
    try:
        field = IndexField.from_xarray(data["density"])
    except ValueError as fault:
        return _check_refusal(fault)
    except TypeError as fault:
        _require("IndexField" in str(fault), f"an argument that is named: {fault}")
        return _check_refusal(fault)
    _require(_finite(field.contrast_at(MIDDLE)) and math.isfinite(field.ambient_index), "finite contrasts")
    return True


DRAWS: dict[str, Draw] = {
    "netcdf-echoes": echoes,
    "netcdf-result": result,
    "netcdf-wavefront": wavefront,
    "netcdf-flow": flow,
    "netcdf-series": attributes,
    "netcdf-index": index,
}
