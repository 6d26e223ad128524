"""Collect the cases of a sweep in one labelled dataset: numbers as in summary.json, one dimension per key."""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.jobs.store import number_or_nan
from aerokernels.jobs.sweeps.definition import CASE, Definition, coordinates
from aerokernels.scene import Scene

if TYPE_CHECKING:
    import xarray

# Numbers of a summary that are stored, with unit and meaning; NaN if a case has no such number.
NUMBERS = {
    "strehl": ("1", "Strehl ratio"),
    "strehl_standard_error": ("1", "standard error of the Strehl ratio's sampling"),
    "strehl_marechal": ("1", "Strehl ratio by Maréchal's approximation"),
    "opd_rms_m": ("m", "optical path difference, rms over the pupil"),
    "boresight_rad": ("rad", "boresight error"),
    "boresight_x_rad": ("rad", "boresight error toward x"),
    "boresight_y_rad": ("rad", "boresight error toward y"),
    "echo_strehl": ("1", "Strehl ratio of the return path"),
    "echo_peak_w": ("W", "peak power of the echo"),
    "echo_peak_v": ("V", "peak voltage of the echo"),
    "range_m": ("m", "reported range"),
    "range_error_m": ("m", "reported minus true range"),
    "still_air_m": ("m", "part of the range error that the air at rest causes, not the flow"),
    "true_range_m": ("m", "true range"),
    "noise_rms_v": ("V", "noise of the recorded voltage without echo, rms"),
    "mach": ("1", "Mach number of the flow"),
    "ambient_density_kg_m3": ("kg m-3", "free-stream density"),
    "wavelength_m": ("m", "vacuum wavelength"),
    "ray_count": ("1", "requested rays over the pupil"),
    "traced_ray_count": ("1", "rays traced for the Strehl ratio"),
    "evaluation_count": ("1", "evaluations of the field for the Strehl ratio"),
    "trace_seconds": ("s", "time in kernels"),
    "compile_seconds": ("s", "time for compiling kernels"),
    "total_seconds": ("s", "wall time, without stages reused from other cases of a sweep"),
    "processor_seconds": ("s", "processor time of the case, all threads of its worker"),
    "tracing_processor_seconds": ("s", "processor time of tracing, plans and error budgets included"),
}
TEXTS = {
    "verdict": "whether the answer is meaningful given its errors",
    "backend": "backend that ran the kernels",
    "device": "device that ran the kernels",
    "precision": "precision of the kernels",
    "provenance": "origin of the flow",
    "version": "version of aerokernels",
}
METHODS, CAUSES = "ranging_method", "cause"


def sweep_dataset(
    definition: Definition,
    described: Mapping[str, Any],
    scenes: Sequence[Scene | None],
    records: Mapping[int, Mapping[str, Any]],
    provenance: Mapping[str, str],
) -> "xarray.Dataset":
    """Make the dataset of a sweep.

    Args:
        definition: The sweep.
        described: The sweep's description (`Definition.described`), stored as provenance.
        scenes: The scene of each case, None if it has none.
        records: The outcome of each case by its number.
        provenance: Further attributes.
    """
    import xarray

    from aerokernels.jobs.scene_text import scene_toml
    from aerokernels.scene.loading import changes_in_words

    dims, shape = definition.dims, definition.shape
    summaries = [records.get(k, {}).get("summary") or {} for k in range(definition.case_count)]
    errors = [summary.get("errors") or {} for summary in summaries]

    def shaped(values: Sequence[Any], dtype: Any = np.float64) -> np.ndarray:
        flat = np.empty(len(values), dtype=dtype)
        flat[:] = values
        return flat.reshape(shape)

    variables: dict[str, Any] = {}
    for name, (units, words) in NUMBERS.items():
        values = shaped([number_or_nan(summary.get(name)) for summary in summaries])
        variables[name] = (dims, values, {"units": units, "long_name": words})
        if any(name in one for one in errors):
            found = shaped([number_or_nan(one.get(name)) for one in errors])
            attributes = {"units": units, "long_name": f"{words}: error"}
            variables[f"{name}_error"] = (dims, found, attributes)
    tables = {
        "ranges_m": (METHODS, "m", "range by each method that read the echo"),
        "error": (CAUSES, "1", "error budget of the Strehl ratio by cause"),
    }
    labels: dict[str, Any] = {}
    for name, (dimension, units, words) in tables.items():
        columns = list(dict.fromkeys(key for summary in summaries for key in summary.get(name) or {}))
        if columns:
            parts = [shaped([number_or_nan((one.get(name) or {}).get(key)) for one in summaries]) for key in columns]
            variables[name] = ((*dims, dimension), np.stack(parts, axis=-1), {"units": units, "long_name": words})
            labels[dimension] = (dimension, np.array(columns, dtype=object), {"units": "1"})
    for name, words in TEXTS.items():
        values = shaped([str(summary.get(name) or "") for summary in summaries], object)
        variables[name] = (dims, values, {"units": "1", "long_name": words})
    plans = shaped([json.dumps(summary["plan"]) if summary.get("plan") else "" for summary in summaries], object)
    variables["plan"] = (dims, plans, {"units": "1", "long_name": "how the Strehl ratio's rays were traced, JSON"})
    reasons = shaped([failure_of(records.get(k, {})) for k in range(definition.case_count)], object)
    variables["failures"] = (dims, reasons, {"units": "1", "long_name": "why the case, or a stage of it, failed"})
    failed = shaped([not summary for summary in summaries], bool)
    variables["failed"] = (dims, failed, {"units": "1", "long_name": "whether the whole case failed"})

    for key, (dimension, values, units) in coordinates(definition, scenes).items():
        labels[key] = (dimension, values, {"units": units, "long_name": f"{key} of the scene"})
    if definition.mode != "grid":
        labels[CASE] = (CASE, np.arange(definition.case_count), {"units": "1", "long_name": "number of the case"})
    first = next((scene for scene in scenes if scene is not None), None)
    about: dict[str, Any] = {
        "title": f"sweep of {', '.join(definition.keys)} in {definition.label}{changes_in_words(definition.settings)}",
        "source": f"aerokernels {described['version']}",
        "sweep": json.dumps(described, ensure_ascii=False),
        "scene": scene_toml(first) if first else "",
        "case_count": definition.case_count,
        "failed_count": int(failed.sum()),
        **provenance,
    }
    return xarray.Dataset(variables, labels, about)


def failure_of(record: Mapping[str, Any]) -> str:
    """Return why a case failed, or the failures of its stages as "stage: reason; ..."; empty if nothing failed."""
    if "summary" not in record:
        return str(record.get("error", "not computed"))
    return "; ".join(f"{stage}: {why}" for stage, why in (record["summary"].get("failures") or {}).items())
