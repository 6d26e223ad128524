"""Write the HTML report of a run: numbers with errors, figures, error budget, plan with reasons, and the scene.

The page is self-contained: figures are embedded, and it loads nothing.
"""

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from aerokernels.display.quantities import WORTHLESS, Quantity, listed, two_digits
from aerokernels.display.shown import NOTHING, told
from aerokernels.jobs import plots
from aerokernels.jobs.numbers import NUMBERS, TEXTS, is_ratio, quantity_of
from aerokernels.jobs.page import Drawn, drawn, page
from aerokernels.jobs.store import number_or_nan, to_json

if TYPE_CHECKING:
    import xarray

CITATION = (
    "Simulation Test of The Aerodynamic Environment of A Missile-Borne Pulsed Laser Forward Detection System "
    "at High Flight Speed"
)
# Heading of the remark on a stage without a result.
STAGE_WORDS = {
    "wavefront": "No wavefront",
    "rays": "No rays in the pictures",
    "echo": "No echo",
    "range": "No range",
}
CAUSES = {
    "step": "step size of the rays",
    "precision": "precision of the kernels",
    "interpolation": "interpolation between the flow's own samples",
    "jumps": "place of jumps between the flow's own samples",
    "resampling": "resampling of the flow to a uniform grid",
    "truncation": "air beyond the region that was resampled",
    "refractivity": "relation between density and index",
    "bundle": "interpolation between traced rays of a bundle",
    "sampling": "number of rays",
    "total": "root sum of squares of the entries above; covers the truth in 95 of 100 cases",
}
# Groups of numbers in summary.json, in words.
GROUPS = {
    "ranges_m": "range by {} [m]",
    "range_uncertainty_m": "uncertainty of the range by {} [m]",
    "range_statistics_m": "statistics of the range by {} [m]",
    "stage_seconds": "time, {} [s]",
}
# What the table of numbers leaves out: other parts of the page, and the error budget's "sampling".
ELSEWHERE = {"plan", "error", "errors", "seconds", "scene", "version", "verdict", "warnings", "failures"}
ELSEWHERE |= {"scene_values", "title", "strehl_standard_error"}


def headline_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the main quantities of a run's summary as rows of name and text with error and unit."""
    rows = [(one.name, one.text(quantity_of(summary, key))) for key, one in NUMBERS.items() if one.name]
    angles = [quantity_of(summary, f"boresight_{axis}_rad") for axis in "xy"]
    if not any(math.isnan(angle.value) for angle in angles):
        look = (summary.get("scene_values") or {}).get("pupil") or {}
        ahead = not (look.get("azimuth") or look.get("elevation"))
        nothing = all(told(angle, 1e6, "µrad") == NOTHING for angle in angles)
        text = NOTHING if nothing else listed([angle.scaled(1e6, "µrad") for angle in angles], signed=True)
        rows.append((f"Boresight error {'x, y' if ahead else 'along the pupil’s axes 1, 2'}", text))
    return rows


def remark_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return rows of remarks: the verdict on the Strehl ratio, and the reason for each stage without a result."""
    worthless = summary.get("verdict") == WORTHLESS
    rows = [("Not meaningful" if worthless else "Warning", str(reason)) for reason in summary.get("warnings") or ()]
    for stage, reason in (summary.get("failures") or {}).items():
        rows.append((STAGE_WORDS.get(stage, f"No {stage}"), str(reason)))
    return rows


def run_figures(dataset: "xarray.Dataset") -> list[Drawn]:
    """Draw the figures of a run, but for those whose data are missing because a stage failed."""
    there = set(dataset.variables)
    return drawn(
        (name, caption, partial(draw, dataset))
        for name, (caption, draw, needed) in plots.FIGURES.items()
        if needed <= there
    )


def render_report(figures: Sequence[Drawn], summary: Mapping[str, Any], scene_text: str) -> str:
    """Return the report as an HTML document: `figures` by `run_figures`, summary.json, and the scene as it was run."""
    version = str(summary.get("version"))
    cite = f"The method follows the paper below; please cite it together with aerokernels {version}."
    return page(
        str(summary.get("title") or summary.get("scene", "run")),
        ", ".join(str(summary.get(key)) for key in ("backend", "device", "precision")) + f", aerokernels {version}",
        [
            {"title": "Pictures", "figures": figures},
            {"title": "Numbers (SI), each with its error", "rows": _numbers(summary)},
            {"title": "Error budget of the Strehl ratio", "rows": _budget(summary.get("error") or {})},
            {"title": "Plan: what was done, what was skipped, and why", "rows": _all_of(summary.get("plan", {}))},
            {"title": "Seconds per stage", "rows": _all_of(summary.get("seconds", {}))},
            {"title": "Scene as it was run", "text": scene_text},
            {"title": "How to cite", "paragraphs": [cite], "text": CITATION},
        ],
        cards=headline_rows(summary),
        remarks=remark_rows(summary),
        alarm=summary.get("verdict") == WORTHLESS,
    )


def _numbers(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return every number of a summary by its name, with its error if it is an estimate."""
    errors = dict(_flat(summary.get("errors") or {}))
    rows = []
    for name, value in _flat({key: value for key, value in summary.items() if key not in ELSEWHERE}):
        number = to_json(value)
        if name in errors and isinstance(number, (int, float)):
            text = Quantity(number, number_or_nan(to_json(errors[name])), is_ratio=is_ratio(name)).text()
        elif name.startswith("range_uncertainty_m.") and number is not None:  # these numbers are errors
            text = f"{number:.2g}"
        else:
            text = _words(number)
        rows.append((_label(name), text))
    return rows


def _budget(error: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of the error budget; each entry is an error, for which two digits suffice."""
    words = {cause: two_digits(number_or_nan(to_json(value))) for cause, value in error.items()}
    return [(cause, f"{text} ({CAUSES[cause]})" if cause in CAUSES else text) for cause, text in words.items()]


def _all_of(content: Mapping[str, Any]) -> list[tuple[str, str]]:
    return [(name, _words(to_json(value))) for name, value in _flat(content)]


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _label(name: str) -> str:
    """Return the name of a key of summary.json in words, with its unit."""
    if name in NUMBERS:
        return NUMBERS[name].label
    if name in TEXTS:
        return TEXTS[name]
    group, dot, own = name.partition(".")
    if dot and group in GROUPS:
        return GROUPS[group].format(re.sub(r"[-_]", " ", own.replace(".", ", ")))
    return " ".join(name.replace("_", " ").split())


def _words(value: Any) -> str:
    """Return a JSON value in words."""
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list) and all(isinstance(item, (int, float, str)) for item in value):
        return "; ".join(map(_words, value))
    return json.dumps(value, ensure_ascii=False) if isinstance(value, (list, dict)) else str(value)
