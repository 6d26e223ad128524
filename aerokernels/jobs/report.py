"""One HTML page that tells a run: the numbers, the pictures, what was done and why, how far to trust it.

The page stands alone: pictures are inside it, and it loads nothing.
"""

import base64
import html
import json
import math
import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from aerokernels.jobs import plots
from aerokernels.jobs.store import to_json
from aerokernels.quantities import WORTHLESS, Quantity, listed

if TYPE_CHECKING:
    import xarray

CITATION = (
    "Simulation Test of The Aerodynamic Environment of A Missile-Borne Pulsed Laser Forward Detection System "
    "at High Flight Speed"
)

# key in summary.json, words, unit shown, factor from SI, whether a plus is written
HEADLINES = (
    ("strehl", "Strehl ratio", "", 1.0, False),
    ("strehl_marechal", "Strehl ratio, Maréchal", "", 1.0, False),
    ("opd_rms_m", "OPD, rms", "nm", 1e9, False),
    ("echo_peak_w", "Echo peak power", "µW", 1e6, False),
    ("echo_peak_v", "Echo peak voltage", "V", 1.0, False),
    ("range_m", "Reported range", "m", 1.0, False),
    ("range_error_m", "Range error", "mm", 1e3, True),
)
# What a stage without a result left out, in words.
STAGE_WORDS = {
    "wavefront": "No wavefront",
    "rays": "No rays to look at",
    "echo": "No echo",
    "range": "No range",
}
CAUSES = {
    "step": "steps of the rays",
    "interpolation": "samples of the field, as the flow came",
    "resampling": "uniform grid that the flow was resampled to",
    "precision": "precision of the kernels",
    "sampling": "number of rays, three standard errors",
    "truncation": "rays that leave the known air while it is disturbed",
    "refractivity": "model that makes the index from a density; not part of the total",
    "total": "root sum of squares of the others",
}

# Groups of numbers in summary.json.
GROUPS = {
    "ranges_m": "range by {} [m]",
    "range_uncertainty_m": "uncertainty of the range by {} [m]",
    "range_statistics_m": "statistics of the range by {} [m]",
    "stage_seconds": "time, {} [s]",
}

WIDE = 850  # [pixels] of a picture of two panels

CSS = """
body { font: 15px/1.55 system-ui, "Segoe UI", Roboto, sans-serif; color: #1d2630; background: white;
  margin: 0 auto; max-width: 1080px; padding: 28px 20px 60px; }
h1 { font-size: 1.6em; margin: 0 0 .1em; }
h2 { font-size: 1.15em; margin: 2.2em 0 .6em; border-bottom: 1px solid #e3e7eb; padding-bottom: .25em; }
.lead { color: #5b6470; margin: 0 0 1.4em; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(240px, 1fr)); gap: 10px; }
.card { background: #f3f6f8; border-radius: 8px; padding: 10px 14px; }
.card b { display: block; font-size: 1.22em; font-weight: 600; }
.card span { color: #5b6470; font-size: .87em; }
.alarm, .note { border-radius: 8px; padding: 10px 14px; margin: 0 0 12px; }
.alarm { background: #fde8e4; border-left: 5px solid #b42318; }
.note { background: #fff4dc; border-left: 5px solid #b7791f; }
.alarm p, .note p { margin: .15em 0; }
figure { margin: 1.4em 0; }
figure { overflow-x: auto; }
figure img { max-width: 100%; height: auto; }
figcaption { color: #5b6470; font-size: .92em; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { padding: 3px 18px 3px 0; border-bottom: 1px solid #eef1f3; vertical-align: top; text-align: left; }
th { font-weight: 500; color: #45505c; white-space: nowrap; }
td { overflow-wrap: anywhere; }
pre { background: #f3f6f8; border-radius: 8px; padding: 12px 14px; overflow-x: auto; font-size: .87em; }
@media (max-width: 700px) {
  body { padding: 16px 12px 40px; }
  .cards { grid-template-columns: 1fr 1fr; }
  .card { padding: 8px 10px; }
  figure img.wide { max-width: none; width: 760px; }
  th { white-space: normal; min-width: 8em; }
  td, th { padding-right: 10px; }
}
@media print {
  body { max-width: none; padding: 0; font-size: 11px; }
  .card, .alarm, .note { border: 1px solid #8a94a0; }
  figure, .card, tr { break-inside: avoid; }
  h2 { break-after: avoid; }
  pre { white-space: pre-wrap; }
}
"""


def quantity_of(summary: Mapping[str, Any], key: str, unit: str = "") -> Quantity:
    """A number of a summary with its error; NaN for null, and for the error of a summary that has none."""
    value, error = to_json(summary.get(key)), to_json((summary.get("errors") or {}).get(key))
    return Quantity(math.nan if value is None else value, math.nan if error is None else error, unit)


def headline_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The quantities that a reader asks for first, in words, with errors and units, from a run's summary."""
    rows = []
    for key, words, unit, factor, signed in HEADLINES:
        rows.append((words, quantity_of(summary, key).scaled(factor, unit).text(signed)))
    boresight = [quantity_of(summary, f"boresight_{axis}_rad").scaled(1e6, "µrad") for axis in "xy"]
    if not any(math.isnan(angle.value) for angle in boresight):
        look = (summary.get("scene_values") or {}).get("pupil") or {}
        ahead = not (look.get("azimuth") or look.get("elevation"))
        rows.append(
            (f"Boresight error {'x, y' if ahead else 'along the pupil’s axes 1, 2'}", listed(boresight, signed=True))
        )
    return rows


def remark_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What a reader must know beside the numbers: the verdict on the Strehl ratio, and what has no result, and why."""
    worthless = summary.get("verdict") == WORTHLESS
    rows = [("Worth nothing" if worthless else "Warning", str(reason)) for reason in summary.get("warnings") or ()]
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
        return ", ".join(_words(item) for item in value)
    if isinstance(value, (list, dict)):
        return json.dumps(value, ensure_ascii=False)
    return str(value)


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterable[tuple[str, Any]]:
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _table(rows: Iterable[tuple[str, Any]]) -> str:
    body = "".join(
        f"<tr><th>{html.escape(str(name))}</th><td>{html.escape(_words(value))}</td></tr>" for name, value in rows
    )
    return f"<table>{body}</table>" if body else "<p>none</p>"


def _label(name: str) -> str:
    """A key of summary.json in words, with its unit."""
    from aerokernels.jobs.sweeps.dataset import NUMBERS, TEXTS

    if name in NUMBERS:
        unit, words = NUMBERS[name]
        return f"{words} [{unit}]" if unit != "1" else words
    if name in TEXTS:
        return TEXTS[name]
    group, dot, own = name.partition(".")
    if dot and group in GROUPS:
        return GROUPS[group].format(" ".join(re.sub(r"[-_.]", " ", own).split()))
    return " ".join(name.replace("_", " ").split())


def _numbers(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Every number of a summary by its key, with its error where it is an estimate."""
    apart = {"plan", "error", "errors", "seconds", "scene", "version", "verdict", "warnings", "failures"}
    apart |= {"scene_values", "title"}
    apart.add("strehl_standard_error")  # it is a part of the error that is shown: the budget's sampling
    errors = dict(_flat(summary.get("errors") or {}))
    rows = []
    for name, value in _flat({key: value for key, value in summary.items() if key not in apart}):
        number, error = to_json(value), to_json(errors.get(name))
        if name in errors and isinstance(number, (int, float)):
            rows.append((_label(name), Quantity(number, math.nan if error is None else error).text()))
        elif name.startswith("range_uncertainty_m.") and number is not None:  # errors themselves
            rows.append((_label(name), f"{number:.2g}"))
        else:
            rows.append((_label(name), _words(value)))
    return rows


def _budget(error: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The error budget: each entry is an error, so two digits of it say all."""
    rows = []
    for cause, value in error.items():
        value = to_json(value)
        words = "not known" if value is None else f"{value:.2g}"
        rows.append((cause, f"{words} ({CAUSES[cause]})" if cause in CAUSES else words))
    return rows


def _remarks(summary: Mapping[str, Any]) -> str:
    rows = remark_rows(summary)
    if not rows:
        return ""
    kind = "alarm" if summary.get("verdict") == WORTHLESS else "note"
    lines = "".join(f"<p><b>{html.escape(words)}:</b> {html.escape(reason)}</p>" for words, reason in rows)
    return f"<div class='{kind}'>{lines}</div>"


def _section(title: str, content: Any) -> str:
    if isinstance(content, Mapping):
        inner = _table(_flat(content))
    elif isinstance(content, (list, tuple)):
        inner = "<ul>" + "".join(f"<li>{html.escape(_words(item))}</li>" for item in content) + "</ul>"
    else:
        inner = f"<p>{html.escape(_words(content))}</p>"
    return f"<h2>{html.escape(title)}</h2>{inner}"


def draw_pictures(dataset: "xarray.Dataset") -> tuple[dict[str, bytes], dict[str, str]]:
    """The report's pictures as PNG files by name; and why, for each that cannot be drawn, by "picture NAME".

    A picture whose data a failed stage did not leave is in neither: the stage's own reason says it.
    """
    drawn, undrawn = {}, {}
    for name, (_, draw) in plots.FIGURES.items():
        if not plots.NEEDED[name] <= set(dataset.variables):
            continue
        try:
            drawn[name] = plots.png(draw(dataset))
        except Exception as fault:  # a picture is an extra: whatever it cannot draw, the numbers stand
            undrawn[f"picture {name}"] = f"{type(fault).__name__}: {' '.join(str(fault).split())}"
    return drawn, undrawn


def _wide(picture: bytes) -> str:
    """The class of a picture that a phone shows at a legible size, to be moved sideways; a PNG's head has its width."""
    return ' class="wide"' if int.from_bytes(picture[16:20], "big") > WIDE else ""


def render_report(pictures: Mapping[str, bytes], summary: Mapping[str, Any], scene_text: str) -> str:
    """Write the report.

    Args:
        pictures: PNG files by the names in `plots.FIGURES`, as `draw_pictures` makes them.
        summary: What goes to `summary.json`.
        scene_text: The scene as it was run, all defaults filled in.

    Returns:
        A complete HTML document.
    """
    name = html.escape(str(summary.get("title") or summary.get("scene", "run")))
    cards = "".join(
        f'<div class="card"><b>{html.escape(value)}</b><span>{html.escape(words)}</span></div>'
        for words, value in headline_rows(summary)
    )
    shown = []
    for key, (caption, _) in plots.FIGURES.items():
        if key in pictures:
            data = base64.b64encode(pictures[key]).decode("ascii")
            shown.append(
                f'<figure id="{key}"><img alt="{html.escape(caption)}" src="data:image/png;base64,{data}"'
                f"{_wide(pictures[key])}>"
                f"<figcaption>{html.escape(caption)}</figcaption></figure>"
            )
        else:
            shown.append(f"<p>No picture of this: {html.escape(caption)} The reason stands at the top.</p>")
    version = str(summary.get("version"))
    lead = ", ".join(str(summary.get(key)) for key in ("backend", "device", "precision")) + f", aerokernels {version}"
    parts = [
        f"<h1>{name}</h1><p class='lead'>{html.escape(lead)}</p>{_remarks(summary)}<div class='cards'>{cards}</div>",
        "<h2>Pictures</h2>" + "".join(shown),
        "<h2>Numbers (SI), each with its error</h2>" + _table(_numbers(summary)),
        "<h2>Error budget of the Strehl ratio</h2>" + _table(_budget(summary.get("error") or {})),
        _section("Plan: what was done, what was skipped, and why", summary.get("plan", {})),
        _section("Seconds per stage", summary.get("seconds", {})),
        f"<h2>Scene as it was run</h2><pre>{html.escape(scene_text)}</pre>",
        "<h2>How to cite</h2><p>The method follows the paper below; please cite it together with aerokernels "
        f"{html.escape(version)}.</p><pre>{html.escape(CITATION)}</pre>",
    ]
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width'>"
        f"<title>{name} · aerokernels</title><style>{CSS}</style></head>\n<body>"
        + "\n".join(parts)
        + "</body></html>\n"
    )
