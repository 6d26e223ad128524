"""Write the HTML report of a run: numbers with errors, figures, error budget, plan with reasons, and the scene.

The page is self-contained: figures are embedded, and it loads nothing.
"""

import json
import math
import re
from collections.abc import Iterable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

from aerokernels.display.error_budget import two_digits
from aerokernels.display.flatness import NOTHING, told
from aerokernels.display.quantities import Quantity, listed
from aerokernels.display.verdict import WORTHLESS
from aerokernels.jobs import plots
from aerokernels.jobs.figure_layout import png_or_fault
from aerokernels.jobs.page import cards, named_values, page, paragraph, picture, remarks, section, text_block
from aerokernels.jobs.store import RATIO_KEYS, number_or_nan, to_json

if TYPE_CHECKING:
    import xarray

CITATION = (
    "Simulation Test of The Aerodynamic Environment of A Missile-Borne Pulsed Laser Forward Detection System "
    "at High Flight Speed"
)

# Key in summary.json, name shown, unit shown, factor from SI, whether a plus sign is written.
HEADLINES = (
    ("strehl", "Strehl ratio", "", 1.0, False),
    ("strehl_marechal", "Strehl ratio, Maréchal", "", 1.0, False),
    ("opd_rms_m", "OPD, rms", "nm", 1e9, False),
    ("echo_peak_w", "Echo peak power", "µW", 1e6, False),
    ("echo_peak_v", "Echo peak voltage", "V", 1.0, False),
    ("range_m", "Reported range", "m", 1.0, False),
    ("range_error_m", "Range error", "mm", 1e3, True),
    ("still_air_m", "Range error of the air at rest", "mm", 1e3, True),
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

# Groups of numbers in summary.json.
GROUPS = {
    "ranges_m": "range by {} [m]",
    "range_uncertainty_m": "uncertainty of the range by {} [m]",
    "range_statistics_m": "statistics of the range by {} [m]",
    "stage_seconds": "time, {} [s]",
}
# Numbers whose keys say too little, by their full keys.
LABELS = {
    "averages_lacking.rows_max": "deficit of the interpolant, rows of cells, greatest [share of the densities' range]",
    "averages_lacking.rows_rms": "deficit of the interpolant, rows of cells, rms [share of the densities' range]",
    "averages_lacking.row_path_m": "deficit of the interpolant, rows of cells, greatest [m of optical path]",
    "averages_lacking.cells_max": "deficit of the interpolant, single cells, greatest [share of the densities' range]",
    "averages_lacking.cells_rms": "deficit of the interpolant, single cells, rms [share of the densities' range]",
}


def quantity_of(summary: Mapping[str, Any], key: str) -> Quantity:
    """Return a number of a summary with its error; NaN for null, and for an error that the summary does not have."""
    value, error = to_json(summary.get(key)), to_json((summary.get("errors") or {}).get(key))
    return Quantity(number_or_nan(value), number_or_nan(error), is_ratio=key in RATIO_KEYS)


def headline_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the main quantities of a run's summary as rows of name and text with error and unit."""
    rows = []
    for key, words, unit, factor, signed in HEADLINES:
        rows.append((words, told(quantity_of(summary, key), factor, unit, signed)))
    angles = [quantity_of(summary, f"boresight_{axis}_rad") for axis in "xy"]
    boresight = [angle.scaled(1e6, "µrad") for angle in angles]
    if not any(math.isnan(angle.value) for angle in boresight):
        look = (summary.get("scene_values") or {}).get("pupil") or {}
        ahead = not (look.get("azimuth") or look.get("elevation"))
        nothing = all(told(angle, 1e6, "µrad") == NOTHING for angle in angles)
        text = NOTHING if nothing else listed(boresight, signed=True)
        rows.append((f"Boresight error {'x, y' if ahead else 'along the pupil’s axes 1, 2'}", text))
    return rows


def remark_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return rows of remarks: the verdict on the Strehl ratio, and the reason for each stage without a result."""
    worthless = summary.get("verdict") == WORTHLESS
    rows = [("Not meaningful" if worthless else "Warning", str(reason)) for reason in summary.get("warnings") or ()]
    for stage, reason in (summary.get("failures") or {}).items():
        rows.append((STAGE_WORDS.get(stage, f"No {stage}"), str(reason)))
    return rows


def _words(value: Any) -> str:
    value = to_json(value)
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list) and all(isinstance(item, (int, float, str)) for item in value):
        return "; ".join(map(_words, value))
    if isinstance(value, (list, dict)):
        return json.dumps(value, ensure_ascii=False)
    return str(value)


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _label(name: str) -> str:
    """Return the name of a key of summary.json in words, with its unit."""
    from aerokernels.jobs.sweeps.dataset import NUMBERS, TEXTS

    if name in NUMBERS:
        unit, words = NUMBERS[name]
        return f"{words} [{unit}]" if unit != "1" else words
    if name in TEXTS:
        return TEXTS[name]
    if name in LABELS:
        return LABELS[name]
    group, dot, own = name.partition(".")
    if dot and group in GROUPS:
        return GROUPS[group].format(re.sub(r"[-_]", " ", own.replace(".", ", ")))
    return " ".join(name.replace("_", " ").split())


def _numbers(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return every number of a summary by its name, with its error if it is an estimate."""
    apart = {"plan", "error", "errors", "seconds", "scene", "version", "verdict", "warnings", "failures"}
    apart |= {"scene_values", "title"}
    apart.add("strehl_standard_error")  # contained in the error budget as "sampling"
    errors = dict(_flat(summary.get("errors") or {}))
    rows = []
    for name, value in _flat({key: value for key, value in summary.items() if key not in apart}):
        number, error = to_json(value), to_json(errors.get(name))
        if name in errors and isinstance(number, (int, float)):
            rows.append((_label(name), Quantity(number, number_or_nan(error), is_ratio=name in RATIO_KEYS).text()))
        elif name.startswith("range_uncertainty_m.") and number is not None:  # these numbers are errors
            rows.append((_label(name), f"{number:.2g}"))
        else:
            rows.append((_label(name), _words(value)))
    return rows


def _budget(error: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of the error budget; each entry is an error, for which two digits suffice."""
    rows = []
    for cause, value in error.items():
        words = two_digits(number_or_nan(to_json(value)))
        rows.append((cause, f"{words} ({CAUSES[cause]})" if cause in CAUSES else words))
    return rows


def _named_section(title: str, content: Mapping[str, Any]) -> str:
    return section(title, named_values((name, _words(value)) for name, value in _flat(content)))


def draw_pictures(dataset: "xarray.Dataset") -> tuple[dict[str, bytes], dict[str, str]]:
    """Return the report's figures as PNG files by name, and by "picture NAME" why a figure could not be drawn.

    A figure whose data are missing because a stage failed is in neither: the stage's own reason is reported.
    """
    drawn, undrawn = {}, {}
    for name, (_, draw) in plots.FIGURES.items():
        if not plots.NEEDED[name] <= set(dataset.variables):
            continue
        data = png_or_fault(partial(draw, dataset))
        if isinstance(data, str):
            undrawn[f"picture {name}"] = data
        else:
            drawn[name] = data
    return drawn, undrawn


def render_report(pictures: Mapping[str, bytes], summary: Mapping[str, Any], scene_text: str) -> str:
    """Write the report.

    Args:
        pictures: PNG files by the names in `plots.FIGURES`, as `draw_pictures` makes them.
        summary: The content of `summary.json`.
        scene_text: The scene as it was run, with all defaults filled in.

    Returns:
        A complete HTML document.
    """
    version = str(summary.get("version"))
    lead = ", ".join(str(summary.get(key)) for key in ("backend", "device", "precision")) + f", aerokernels {version}"
    shown = [
        picture(name, caption, pictures[name])
        if name in pictures
        else paragraph(f"No picture: {caption} The reason is given at the top of the page.")
        for name, (caption, _) in plots.FIGURES.items()
    ]
    cite = f"The method follows the paper below; please cite it together with aerokernels {version}."
    parts = [
        remarks(remark_rows(summary), "alarm" if summary.get("verdict") == WORTHLESS else "note")
        + cards(headline_rows(summary)),
        section("Pictures", "".join(shown)),
        section("Numbers (SI), each with its error", named_values(_numbers(summary))),
        section("Error budget of the Strehl ratio", named_values(_budget(summary.get("error") or {}))),
        _named_section("Plan: what was done, what was skipped, and why", summary.get("plan", {})),
        _named_section("Seconds per stage", summary.get("seconds", {})),
        section("Scene as it was run", text_block(scene_text)),
        section("How to cite", paragraph(cite) + text_block(CITATION)),
    ]
    return page(str(summary.get("title") or summary.get("scene", "run")), lead, parts)
