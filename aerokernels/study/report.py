"""One HTML page that tells a run: the numbers, the pictures, what was done and why, how far to trust it.

The page stands alone: pictures are inside it, and it loads nothing.
"""

import base64
import html
import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from aerokernels.study import plots
from aerokernels.study.store import plain

if TYPE_CHECKING:
    import xarray

CITATION = (
    "Simulation Test of The Aerodynamic Environment of A Missile-Borne Pulsed Laser Forward Detection System "
    "at High Flight Speed"
)

# key in summary.json, words, unit shown, factor from SI, digits format
HEADLINES = (
    ("strehl", "Strehl ratio", "", 1.0, ".5f"),
    ("strehl_marechal", "Strehl ratio, Maréchal", "", 1.0, ".5f"),
    ("opd_rms_m", "OPD, rms", "nm", 1e9, ".3g"),
    ("echo_peak_w", "Echo peak power", "µW", 1e6, ".4g"),
    ("echo_peak_v", "Echo peak voltage", "V", 1.0, ".4g"),
    ("range_m", "Reported range", "m", 1.0, ".6f"),
    ("range_error_m", "Range error", "mm", 1e3, "+.4f"),
)

CSS = """
body { font: 15px/1.55 system-ui, "Segoe UI", Roboto, sans-serif; color: #1d2630; background: white;
  margin: 0 auto; max-width: 1080px; padding: 28px 20px 60px; }
h1 { font-size: 1.6em; margin: 0 0 .1em; }
h2 { font-size: 1.15em; margin: 2.2em 0 .6em; border-bottom: 1px solid #e3e7eb; padding-bottom: .25em; }
.lead { color: #5b6470; margin: 0 0 1.4em; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(150px, 1fr)); gap: 10px; }
.card { background: #f3f6f8; border-radius: 8px; padding: 10px 14px; }
.card b { display: block; font-size: 1.35em; font-weight: 600; }
.card span { color: #5b6470; font-size: .87em; }
figure { margin: 1.4em 0; }
figure img { max-width: 100%; height: auto; }
figcaption { color: #5b6470; font-size: .92em; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { padding: 3px 18px 3px 0; border-bottom: 1px solid #eef1f3; vertical-align: top; text-align: left; }
th { font-weight: 500; color: #45505c; white-space: nowrap; }
td { overflow-wrap: anywhere; }
pre { background: #f3f6f8; border-radius: 8px; padding: 12px 14px; overflow-x: auto; font-size: .87em; }
"""


def headline_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The quantities that a reader asks for first, in words and with units, from a run's summary."""
    rows = []
    for key, words, unit, factor, digits in HEADLINES:
        value = plain(summary.get(key))
        rows.append((words, f"{factor * value:{digits}} {unit}".rstrip() if value is not None else "none"))
    boresight = [plain(summary.get(f"boresight_{axis}_rad")) for axis in "xy"]
    if None not in boresight:
        rows.append(("Boresight error x, y", ", ".join(f"{1e6 * angle:+.3g}" for angle in boresight) + " µrad"))
    return rows


def _words(value: Any) -> str:
    value = plain(value)
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
    return f"<table>{body}</table>" if body else "<p>nothing to tell</p>"


def _section(title: str, content: Any) -> str:
    if isinstance(content, Mapping):
        inner = _table(_flat(content))
    elif isinstance(content, (list, tuple)):
        inner = "<ul>" + "".join(f"<li>{html.escape(_words(item))}</li>" for item in content) + "</ul>"
    else:
        inner = f"<p>{html.escape(_words(content))}</p>"
    return f"<h2>{html.escape(title)}</h2>{inner}"


def render_report(dataset: "xarray.Dataset", summary: Mapping[str, Any], scene_text: str) -> str:
    """Write the report.

    Args:
        dataset: A run's dataset, as in `result.nc`; the pictures come from it alone.
        summary: What goes to `summary.json`.
        scene_text: The scene as it was run, all defaults filled in.

    Returns:
        A complete HTML document.
    """
    name = html.escape(str(summary.get("scene", "run")))
    cards = "".join(
        f'<div class="card"><b>{html.escape(value)}</b><span>{html.escape(words)}</span></div>'
        for words, value in headline_rows(summary)
    )
    pictures = []
    for key, (caption, draw) in plots.FIGURES.items():
        data = base64.b64encode(plots.png(draw(dataset))).decode("ascii")
        pictures.append(
            f'<figure id="{key}"><img alt="{html.escape(caption)}" src="data:image/png;base64,{data}">'
            f"<figcaption>{html.escape(caption)}</figcaption></figure>"
        )
    apart = {"plan", "error", "seconds", "scene", "version"}
    version = str(summary.get("version"))
    lead = ", ".join(str(summary.get(key)) for key in ("backend", "device", "precision")) + f", aerokernels {version}"
    parts = [
        f"<h1>{name}</h1><p class='lead'>{html.escape(lead)}</p><div class='cards'>{cards}</div>",
        "<h2>Pictures</h2>" + "".join(pictures),
        _section("Numbers (SI)", {key: value for key, value in summary.items() if key not in apart}),
        _section("Error budget of the Strehl ratio", summary.get("error", {})),
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
