"""Collect the cases of a sweep in one labelled dataset: numbers as in summary.json, one dimension per key."""

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.jobs.numbers import NUMBERS, TEXTS
from aerokernels.jobs.store import number_or_nan
from aerokernels.jobs.sweeps.definition import CASE, Definition, coordinates
from aerokernels.scene import Scene

if TYPE_CHECKING:
    import xarray

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

    from aerokernels.jobs.run_files import scene_toml
    from aerokernels.scene.loading import changes_in_words

    dims, shape = definition.dims, definition.shape
    summaries = [records.get(k, {}).get("summary") or {} for k in range(definition.case_count)]
    errors = [summary.get("errors") or {} for summary in summaries]

    def shaped(values: Sequence[Any], dtype: Any = np.float64) -> np.ndarray:
        flat = np.empty(len(values), dtype=dtype)
        flat[:] = values
        return flat.reshape(shape)

    variables: dict[str, Any] = {}
    for name, number in NUMBERS.items():
        values = shaped([number_or_nan(summary.get(name)) for summary in summaries])
        variables[name] = (dims, values, {"units": number.unit, "long_name": number.words})
        if any(name in one for one in errors):
            values = shaped([number_or_nan(one.get(name)) for one in errors])
            about = {"units": number.unit, "long_name": f"{number.words}: error"}
            variables[f"{name}_error"] = (dims, values, about)
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
    attributes: dict[str, Any] = {
        "title": f"sweep of {', '.join(definition.keys)} in {definition.label}{changes_in_words(definition.settings)}",
        "source": f"aerokernels {described['version']}",
        "sweep": json.dumps(described, ensure_ascii=False),
        "scene": scene_toml(first) if first else "",
        "case_count": definition.case_count,
        "failed_count": int(failed.sum()),
        **provenance,
    }
    return xarray.Dataset(variables, labels, attributes)


def failure_of(record: Mapping[str, Any]) -> str:
    """Return why a case failed, or the failures of its stages as "stage: reason; ..."; empty if nothing failed."""
    if "summary" not in record:
        return str(record.get("error", "not computed"))
    return "; ".join(f"{stage}: {why}" for stage, why in (record["summary"].get("failures") or {}).items())
