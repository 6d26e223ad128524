"""What a run writes to its folder: the numbers of summary.json, each with its error, and the dataset of result.nc."""

import json
import math
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as attribute
from datetime import UTC, datetime
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__
from aerokernels.display.quantities import TOTAL, Verdict, greatest_ratio_error, judge, main_cause
from aerokernels.display.shown import shown
from aerokernels.focus import StrehlEstimate
from aerokernels.jobs.numbers import NUMBERS, table_rows
from aerokernels.jobs.pages.air import body_variables, density_variables
from aerokernels.jobs.store import number_or_nan, to_json, variable
from aerokernels.lidar import EchoResult
from aerokernels.prepare import Prepared
from aerokernels.scene import Scene
from aerokernels.scene.pupil_table import axis_words
from aerokernels.wavefronts import Wavefront, point_spread_function

if TYPE_CHECKING:
    import xarray

    from aerokernels.waves import Validity

TERMS = 11  # Zernike polynomials whose coefficients are written, up to spherical aberration
SPOT_PADDING, SPOT_RINGS = 8, 8.0  # samples per wavelength / diameter of the spot, and its half-width in these


@dataclass(frozen=True, eq=False)
class RayFan:
    """Rays in the plane of a pupil's direction of view and its second axis (x = 0 if it faces ahead)."""

    # intersection of each ray with each plane [m], shape (ray_count, plane_count, 3); NaN after its end
    position: np.ndarray
    # displacement from the undisturbed ray along the second axis [m], shape (ray_count, plane_count)
    deviation: np.ndarray


@shown
@dataclass(frozen=True, eq=False, repr=False)
class RunResult:
    """The results of all stages of a run, its summary and its dataset; it prints as the command line's table.

    Attributes:
        scene: The scene.
        prepared: Its flow and index fields.
        strehl: The Strehl ratio of a plane wave through the scene's pupil.
        wavefront: The optical path difference over the scene's pupil, piston removed; None if that stage failed.
        fan: Rays for the figures; None if that stage failed.
        echo: The laser echo and its range; None if no light returns.
        seconds: Wall time [s] of each part ("prepare", "strehl", "wavefront", "fan", "echo", "error"), and "total".
        stages: Wall time [s] of the run by activity, such as compiling or running kernels: see STAGES in clock.py.
        failed: The reason for each stage that failed: "wavefront", "rays", "echo".
    """

    scene: Scene
    prepared: Prepared
    strehl: StrehlEstimate
    wavefront: Wavefront | None
    fan: RayFan | None
    echo: EchoResult | None
    seconds: Mapping[str, float]
    stages: Mapping[str, float]
    failed: Mapping[str, str] = attribute(default_factory=dict)

    @property
    def failures(self) -> dict[str, str]:
        """The reason for each stage without a result; "range" is for an echo that cannot be ranged."""
        reason = self.echo.reason if self.echo is not None else None
        return {**self.failed, **({"range": reason} if reason else {})}

    @property
    def verdict(self) -> Verdict:
        """Whether the Strehl ratio and the echo's peak are meaningful given their errors, and why."""
        numbers = {"Strehl ratio": self.strehl.quantities["value"]}
        if self.echo is not None:
            numbers["echo's peak power"] = self.echo.quantities["peak_power"]
        return judge(numbers, main_cause(self.strehl.error))

    @cached_property
    def ray_optics(self) -> "Validity | None":
        """Whether rays give the Strehl ratio, by a wave through the field; None if that cannot be computed."""
        from aerokernels.waves import validity

        try:
            return validity(self.prepared.field, self.scene.view, wavefront=self.wavefront)
        except ValueError:  # the pupil does not see the field
            return None

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The run's numbers, in SI units, as written to summary.json; computed when first read."""
        return summarise(self)

    def __repr__(self) -> str:
        """The title and the rows of the command line's table."""
        rows = table_rows(self.summary)
        width = max(len(name) for name, _ in rows)
        return "\n".join([self.scene.title or self.scene.name, *(f"  {name:<{width}}  {text}" for name, text in rows)])

    def _picture(self) -> Any:
        return None if self.wavefront is None else self.wavefront._picture()

    def to_xarray(self) -> "xarray.Dataset":
        """Return the run as one dataset with units, as written to result.nc."""
        return run_dataset(self, self.summary)


def summarise(result: RunResult) -> dict[str, Any]:
    """Return the content of summary.json; lengths in m, angles in rad, powers in W; NaN if there is no result.

    "errors" has the errors of estimates by the same keys; that of a ratio between 0 and 1 is at most what these bounds
    allow. "error" is the error budget of the Strehl ratio by cause, "failures" why a stage has no result.
    "stage_seconds" counts each moment once, by activity; "seconds" is by part of the run.
    """
    scene, strehl, density, verdict = result.scene, result.strehl, result.prepared.density, result.verdict
    plan, seen = strehl.plan.as_dict(), strehl.quantities
    numbers = {
        "strehl": (strehl.value, seen["value"].error),
        "strehl_marechal": (strehl.marechal, seen["marechal"].error),
        "opd_rms_m": (strehl.opd_rms, seen["opd_rms"].error),
        # The vector's length changes by at most the length of the vector of the components' errors.
        "boresight_rad": (
            float(np.hypot(*strehl.boresight)),
            math.hypot(*(seen[f"boresight_{axis}"].error or 0.0 for axis in "xy")),
        ),
        "boresight_x_rad": (float(strehl.boresight[0]), seen["boresight_x"].error),
        "boresight_y_rad": (float(strehl.boresight[1]), seen["boresight_y"].error),
    }
    for key, number in NUMBERS.items():
        if number.of_echo:
            one = None if result.echo is None else result.echo.quantities[number.of_echo]
            numbers[key] = (math.nan, math.nan) if one is None else (one.value, one.error)
    ranges, range_errors = _ranges(result.echo)
    return {
        "scene": scene.name,
        "title": scene.title,
        **{key: value for key, (value, _) in numbers.items()},
        "strehl_standard_error": strehl.standard_error,
        **ranges,
        "errors": {**{key: error for key, (_, error) in numbers.items()}, "ranges_m": range_errors},
        "verdict": verdict.level,
        "warnings": [verdict.reason] if verdict else [],
        "failures": dict(result.failures),
        "return_factor": scene.receiver.return_factor,
        "true_range_m": float(scene.target.distance),
        "mach": math.nan if density is None else density.mach,
        "ambient_density_kg_m3": math.nan if density is None else density.ambient_density,
        "wavelength_m": scene.flow.wavelength,
        "ray_count": strehl.ray_count,
        "traced_ray_count": strehl.traced_ray_count,
        "evaluation_count": strehl.evaluation_count,
        "trace_seconds": result.stages["kernel"],
        "compile_seconds": result.stages["compile"],
        "total_seconds": result.seconds["total"],
        **{name: plan[name] for name in ("backend", "device", "precision")},
        "plan": plan,
        "error": {
            cause: float(np.minimum(one, greatest_ratio_error(strehl.value))) for cause, one in strehl.error.items()
        },
        "seconds": {**result.seconds, "prepare": dict(result.prepared.seconds)},
        "stage_seconds": dict(result.stages),
        "provenance": result.prepared.provenance,
        "scene_values": scene.as_dict(),
        "version": __version__,
    }


def _ranges(echo: EchoResult | None) -> tuple[dict[str, Any], dict[str, float]]:
    """Return what the echo gives by ranging method, and the errors of the ranges."""
    if echo is None:
        return {"ranges_m": {}, "range_uncertainty_m": {}, "range_statistics_m": {}, "noise_rms_v": math.nan}, {}
    uncertainty = {method: {cause: float(one) for cause, one in echo.error[method].items()} for method in echo.ranges}
    statistics = {
        method: {
            "systematic_error": one.systematic_error,
            "random_error": one.random_error,
            "random_error_interval": one.random_interval,
            "cramer_rao_bound": one.cramer_rao_bound,
            "missed_count": one.missed_count,
        }
        for method, one in echo.statistics.items()
    }
    return {
        "ranges_m": dict(echo.ranges),
        "range_uncertainty_m": uncertainty,
        "range_statistics_m": statistics,
        "noise_rms_v": echo.noise_rms,
    }, {method: errors[TOTAL] for method, errors in uncertainty.items()}


def run_dataset(result: RunResult, summary: Mapping[str, Any]) -> "xarray.Dataset":
    """Make the dataset of a run's arrays and its summary; arrays of a failed stage are absent.

    The times of the stages are only in summary.json, so that equal runs give equal datasets.
    """
    import xarray

    first, second = axis_words(result.scene.view)
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {
        "axis": variable("axis", np.array(["x", "y", "z"]), "1", "component"),
        "wavelength": variable((), result.scene.flow.wavelength, "m", "vacuum wavelength of the light"),
    }
    coordinates["wavelength"][2]["standard_name"] = "radiation_wavelength"
    flow = result.prepared.density
    if flow is not None:
        variables |= density_variables(flow)
        for name in "yz":
            corner = variables[f"density_{name}"][1]
            middle = 0.25 * (corner[1:, 1:] + corner[:-1, 1:] + corner[1:, :-1] + corner[:-1, :-1])
            coordinates[f"cell_{name}"] = variable(("cell_i", "cell_j"), middle, "m", f"{name} of the cells' centres")
    if result.fan is not None:
        variables["ray_position"] = variable(("ray", "plane", "axis"), result.fan.position, "m", "rays of the picture")
        words = f"displacement along {second} from the straight ray"
        variables["ray_deviation"] = variable(("ray", "plane"), result.fan.deviation, "m", words)
    if result.wavefront is not None:
        variables |= _maps(result.wavefront)
        variables |= _terms(result.wavefront)
        coordinate = result.wavefront.coordinate
        angle, spread, perfect = _spot(result.wavefront)
        angles = ("angle_y", "angle_x")
        variables["point_spread"] = variable(angles, spread, "1", "intensity over the undisturbed peak")
        variables["point_spread_perfect"] = variable(angles, perfect, "1", "the same without flow")
        for name, along in (("x", first), ("y", second)):
            coordinates[f"pupil_{name}"] = variable(f"pupil_{name}", coordinate, "m", f"along {along} in the pupil")
            coordinates[f"angle_{name}"] = variable(f"angle_{name}", angle, "rad", f"angle toward {along}")
    variables |= body_variables(result.prepared.field.body)
    dataset = xarray.Dataset(variables, coordinates, _attributes(result, summary, (first, second)))
    if result.echo is None:
        return dataset
    echo = result.echo.to_xarray()
    dataset.attrs |= {
        name: value for name, value in echo.attrs.items() if name not in summary and "seconds" not in name
    }
    echo = echo.drop_vars("axis", errors="ignore")
    for label in echo.variables:
        echo[label].attrs.setdefault("units", "1")  # labels have no unit
    return dataset.merge(echo, combine_attrs="override")


def _attributes(result: RunResult, summary: Mapping[str, Any], axes: tuple[str, str]) -> dict[str, Any]:
    """Return the attributes of a run's dataset: the scene, the summary, and what its figures show."""
    scene, flow = result.scene, result.prepared.density
    numbers = {name: value for name, value in to_json(summary).items() if not name.endswith("seconds")}
    attributes = {
        "Conventions": "CF-1.11",
        "title": scene.title or scene.name,
        "history": f"{written_at():%Y-%m-%dT%H:%M:%SZ}: made by aerokernels {__version__}",
        "source": f"aerokernels {__version__}",
        "geometry": result.prepared.field.geometry,
        "pupil_axes": list(axes),
        "flow_front_m": result.prepared.front,
        "scene": scene_toml(scene),
        "summary": json.dumps(numbers),
        **{name: number_or_nan(numbers[name]) for name in ("strehl", "range_m", "true_range_m")},
        **{f"{name}_error": number_or_nan(numbers["errors"][name]) for name in ("strehl", "range_m")},
    }
    if flow is not None:
        attributes["ambient_density"] = flow.ambient_density
        if flow.ambient_density > 0.0:
            attributes["index_per_density"] = (result.prepared.field.ambient_index - 1.0) / flow.ambient_density
    if scene.detector.ranging == "leading-edge":  # the other methods use no fixed level
        attributes["threshold_v"] = scene.detector.threshold
    if result.ray_optics is not None:
        attributes["ray_optics"] = result.ray_optics.reason
        attributes["ray_optics_strehl_change"] = result.ray_optics.strehl_change
        attributes["ray_optics_strehl_change_error"] = number_or_nan(result.ray_optics.error)
    return attributes


def _maps(wave: Wavefront) -> dict[str, Any]:
    """Return the OPD over the pupil without piston, tilt and focus with errors of its rms, and errors by pixel."""
    maps = {}
    for name, terms in (("opd", ()), ("opd_without_tilt", ("tilt",)), ("opd_without_focus", ("tilt", "focus"))):
        one = wave.remove(*terms)
        maps[name] = variable(
            ("pupil_y", "pupil_x"), one.opd, "m", f"optical path difference, {', '.join(one.removed)} removed"
        )
        rms = one.quantities["opd_rms"]
        maps[name][2].update(rms_m=rms.value, rms_error_m=number_or_nan(rms.error))
    valley = wave.quantities["peak_to_valley"]
    maps["opd"][2].update(peak_to_valley_m=valley.value, peak_to_valley_error_m=number_or_nan(valley.error))
    maps["opd"][2]["ancillary_variables"] = "opd_error"
    for name, values, unit, words in (
        ("opd_error", wave.pixel_errors, "m", "error of the optical path difference of each pixel from the mean"),
        ("pupil_weight", wave.weight, "1", "amplitude transmission of the pixel"),
        ("pupil_intensity", wave.intensity, "1", "mean intensity in the pixel"),
    ):
        maps[name] = variable(("pupil_y", "pupil_x"), values, unit, words)
    return maps


def _terms(wave: Wavefront) -> dict[str, Any]:
    """Return the first Zernike coefficients with their errors, by Noll's index; nothing of too small a pupil."""
    try:
        table = wave.zernike_table(TERMS)
    except ValueError:
        return {}
    rest = wave.without_zernike(*range(1, TERMS + 1)).quantities["opd_rms"]
    columns = (
        ("noll_index", "index", "1", "Noll's index of the Zernike polynomial"),
        ("zernike_name", "name", "1", "name of the polynomial"),
        ("zernike", "value", "m", "coefficient of the polynomial of rms 1"),
        ("zernike_error", "error", "m", "error of the coefficient"),
    )
    terms = {
        name: variable("noll_index", np.array([getattr(term, key) for term in table]), unit, words)
        for name, key, unit, words in columns
    }
    terms["zernike"][2].update(rest_rms_m=rest.value, rest_rms_error_m=number_or_nan(rest.error))
    return terms


def _spot(wave: Wavefront) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the field angles [rad] of a wavefront's focus, the intensity there and that without flow."""
    options: dict[str, Any] = {"padding": SPOT_PADDING}
    options["half_width"] = SPOT_RINGS * wave.wavelength / (wave.pixel * len(wave.opd))
    spread = wave.psf(**options)
    perfect = point_spread_function(np.zeros(wave.opd.shape), wave.weight, wave.pixel, wave.wavelength, **options)
    return spread.angle, spread.intensity, perfect.intensity


def written_at() -> datetime:
    """Return the time stamp for files: now, or SOURCE_DATE_EPOCH if it is set, so that equal runs give equal files."""
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    known = epoch.isascii() and epoch.isdigit() and len(epoch) <= 11  # up to the year 5138
    return datetime.fromtimestamp(int(epoch), UTC) if known else datetime.now(UTC)


def scene_toml(scene: Scene) -> str:
    """Return all keys of a scene, defaults included, as a TOML text that loads to an equal scene."""
    tables = {key: value for key, value in scene.as_dict().items() if isinstance(value, Mapping)}
    single = {key: value for key, value in scene.as_dict().items() if not isinstance(value, Mapping)}
    parts = [_assignments(single), *([f"[{name}]", *_assignments(table)] for name, table in tables.items())]
    return "\n\n".join("\n".join(part) for part in parts if part) + "\n"


def _assignments(values: Mapping[str, Any]) -> list[str]:
    # TOML has no null, and an absent key means the same.
    return [
        f"{key if re.fullmatch('[A-Za-z0-9_-]+', key) else _value(key)} = {_value(value)}"
        for key, value in values.items()
        if value is not None
    ]


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return f"{{{', '.join(_assignments(value))}}}"
    # JSON texts, numbers and lists are valid TOML too, but for the delete character, which TOML wants escaped.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
