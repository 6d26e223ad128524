"""Write the HTML report of a series: numbers with errors, maps, modes, spectra, time traces, and a film."""

import io
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.flatness import is_flat, say_flat, told
from aerokernels.display.quantities import Quantity
from aerokernels.jobs.figure_layout import Panel, panelled_figure, plain_decades
from aerokernels.jobs.page import (
    Picture,
    cards,
    embedded,
    page,
    paragraph,
    pictures,
    remarks,
    section,
    table,
    text_block,
)
from aerokernels.jobs.plots import axes_of
from aerokernels.jobs.report import quantity_of
from aerokernels.jobs.scene_text import scene_toml
from aerokernels.scene import Scene
from aerokernels.tracing.pupil.air import GREATEST_SHARE

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

STANDARD_ERRORS = 2.0  # of which an error consists: it covers the truth in at least 95 of 100 cases
MOST_FRAMES, FRAME_SIDE = 60, 320  # most frames of the film, and least pixels along a side
HEADLINES = (
    ("opd_rms", "OPD, rms, tilt removed", "nm", 1e9),
    ("opd_rms_with_tilt", "OPD, rms", "nm", 1e9),
    ("strehl", "Strehl ratio, exact mean", "", 1.0),
    ("strehl_large_aperture", "Strehl ratio, large-aperture approximation", "", 1.0),
    ("jitter_x", "jitter along x", "µrad", 1e6),
    ("jitter_y", "jitter along y", "µrad", 1e6),
    ("correlation_length_x", "correlation length along x", "mm", 1e3),
    ("correlation_length_y", "correlation length along y", "mm", 1e3),
)
SLIDER = """<script>
const frames = FRAMES, times = TIMES, film = document.getElementById("film-frame");
function show(k) { film.src = frames[k]; document.getElementById("film-time").textContent = times[k]; }
document.getElementById("film-slider").addEventListener("input", event => show(event.target.value));
show(0);
</script>"""


def headline_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the main statistics of a series' summary as rows of name and text with error and unit."""
    return [
        (words, told(quantity_of(summary, name), factor, unit))
        for name, words, unit, factor in HEADLINES
        if summary.get(name) is not None
    ]


def series_report(scene: Scene, maps: "xarray.Dataset", found: "xarray.Dataset", summary: Mapping[str, Any]) -> str:
    """Return the HTML page of a finished series."""
    lead = f"{summary['snapshot_count']} snapshots, as many as {summary['independent_count']:.3g} independent ones, "
    lead += f"{summary['traced_count']} traced in full; "
    lead += f"{summary['provenance']}; aerokernels {summary['version']}"
    notes = [("Warning", text) for text in summary["warnings"]]
    notes += [(words, summary[key]) for key, words in (("drifting", "Drifts"), ("skipped", "Skipped")) if summary[key]]
    if summary["known_share"] < 1.0 - GREATEST_SHARE:
        lost = f"{100.0 * (1.0 - summary['known_share']):.3g} % of the pupil has no optical path; no number includes it"
        notes.append(("Known air", lost))
    units = {name: str(found[name].attrs["units"]).removeprefix("1") for name in summary["errors"]}
    numbers = [(name, told(quantity_of(summary, name), 1.0, unit)) for name, unit in units.items()]
    parts = [
        remarks(notes) + cards(headline_rows(summary)),
        section("Film of the optical path difference", film(maps)),
        section("Pictures", pictures(_pictures(maps, found))),
        section("Numbers (SI), each with its error", table(("quantity", "value"), numbers)),
        section("How the maps were computed", paragraph(str(summary["plan"]))),
        section("Scene as it was run", text_block(scene_toml(scene))),
    ]
    return page(scene.title or scene.name, lead, parts)


def film(maps: "xarray.Dataset") -> str:
    """Return HTML that shows evenly spaced maps with a slider."""
    count = maps.sizes["time"]
    chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(int))
    values = np.stack([maps["opd"].isel(time=int(number)).values for number in chosen])
    if is_flat(values, "m", _greatest(maps["error"])):
        return paragraph("The optical path difference is the same in all pixels and snapshots, but for rounding.")
    limit = float(np.nanpercentile(np.abs(values), 99.5))
    frames = [embedded(_frame(one, limit)) for one in values]
    times = [f"snapshot {number}, {float(maps.time[int(number)]):.6g} s" for number in chosen]
    script = SLIDER.replace("FRAMES", json.dumps(frames)).replace("TIMES", json.dumps(times))
    return (
        '<figure id="film"><img id="film-frame" alt="optical path difference of a snapshot">'
        f'<p><input id="film-slider" type="range" min="0" max="{len(frames) - 1}" value="0" '
        f'style="width:{FRAME_SIDE}px"> <span id="film-time"></span></p>'
        f"<figcaption>Blue to red: {-limit * 1e9:.3g} to {limit * 1e9:.3g} nm; x to the right, y upward."
        f"</figcaption></figure>{script}"
    )


def _frame(values: np.ndarray, limit: float) -> bytes:
    """Return a map as a PNG file, enlarged by a whole factor, y upward."""
    from matplotlib import colormaps
    from PIL import Image

    colours = colormaps["RdBu_r"](0.5 + 0.5 * np.clip(values / limit, -1.0, 1.0))
    colours[~np.isfinite(values)] = 1.0
    pixels = (255.0 * colours[::-1, :, :3]).round().astype(np.uint8)
    times = max(1, -(-FRAME_SIDE // max(pixels.shape[:2])))
    buffer = io.BytesIO()
    Image.fromarray(pixels.repeat(times, axis=0).repeat(times, axis=1)).save(buffer, "PNG", optimize=True)
    return buffer.getvalue()


def _pictures(maps: "xarray.Dataset", found: "xarray.Dataset") -> list[Picture]:
    shown: list[Picture] = [
        ("maps", "Steady map, and the rms in time about it", lambda: _maps_figure(found)),
        ("time", "OPD rms and Strehl ratio of each snapshot", lambda: _time_figure(maps)),
    ]
    if "spectrum_opd" in found and not is_flat([0.0, *found.opd_std.values.ravel()], "m"):
        shown.append(("spectra", "Power spectra, with their errors", lambda: _spectra_figure(found)))
    if not is_flat([0.0, *found.opd_rms_aperture.values], "m"):
        shown.append(("aperture", "OPD rms over round parts of the pupil", lambda: _aperture_figure(found)))
    if "pod_mode" in found and not is_flat([0.0, *found.opd_std.values.ravel()], "m"):
        shown.append(("modes", "The first proper orthogonal modes", lambda: _modes_figure(found)))
    return shown


def _greatest(values: Any) -> float:
    """Return the greatest finite value; NaN without one."""
    known = np.asarray(values, float)
    return float(np.nanmax(known)) if np.isfinite(known).any() else float("nan")


def _map(figure: "Figure", axes: Any, bar: Any, found: "xarray.Dataset", values: Any, label: str, even: bool) -> None:
    """Draw a map over the pupil, whose axes are in mm."""
    limit = float(np.nanmax(np.abs(values)))
    scale = {"vmin": -limit, "vmax": limit, "cmap": "RdBu_r"} if even else {"cmap": "viridis"}
    mesh = axes.pcolormesh(1e3 * found.x.values, 1e3 * found.y.values, values, shading="nearest", **scale)
    across, up = axes_of(found)
    axes.set(xlabel=f"{across} [mm]", ylabel=f"{up} [mm]", aspect="equal")
    figure.colorbar(mesh, cax=bar, label=label)


def _maps_figure(found: "xarray.Dataset") -> "Figure":
    figure, [(steady, first), (spread, second)] = panelled_figure(Panel(3.4, 3.4, bar=True), Panel(3.4, 3.4, bar=True))
    for axes, bar, name, words, even in (
        (steady, first, "opd_mean", "steady OPD", True),
        (spread, second, "opd_std", "rms in time", False),
    ):
        values = found[name].values
        if not is_flat(values, "m", STANDARD_ERRORS * _greatest(found[f"{name}_error"])):
            _map(figure, axes, bar, found, 1e9 * values, f"{words} [nm]", even)
            continue
        middle = 0.0 if even else 1e9 * float(np.nanmedian(values)) if np.isfinite(values).any() else float("nan")
        say_flat(axes, f"{words}: {middle:.3g} nm everywhere,\nbut for rounding", bar)
    return figure


def _time_figure(maps: "xarray.Dataset") -> "Figure":
    figure, [(rms, _), (ratio, _)] = panelled_figure(Panel(4.4, 2.8), Panel(4.4, 2.8))
    time = 1e3 * maps.time.values
    for axes, name, words, colour, unit, factor in (
        (rms, "opd_rms", "OPD rms, tilt removed", "#0b6e99", "m", 1e9),
        (ratio, "strehl", "Strehl ratio", "#c2410c", "1", 1.0),
    ):
        values = maps[name].values
        label = f"{words} [nm]" if factor != 1.0 else words
        if is_flat(values, unit, _greatest(maps[f"{name}_error"])):
            say_flat(axes, f"{label}: {factor * _greatest(values):.3g} at all times,\nbut for rounding")
            continue
        axes.plot(time, factor * values, color=colour, linewidth=1.0)
        axes.set(xlabel="time [ms]", ylabel=label)
    return figure


def _spectra_figure(found: "xarray.Dataset") -> "Figure":
    figure, [(opd, _), (tilt, _)] = panelled_figure(Panel(4.4, 3.2), Panel(4.4, 3.2))
    strouhal = "strouhal" in found.coords
    places = found["strouhal" if strouhal else "frequency"].values
    rows: list[tuple[Any, str, str, str, float]] = [
        (opd, "spectrum_opd", "OPD", "#0b6e99", 1e18),
        (tilt, "spectrum_jitter_x", "tilt along x", "#0b6e99", 1e12),
        (tilt, "spectrum_jitter_y", "tilt along y", "#c2410c", 1e12),
    ]
    for axes, name, words, colour, factor in rows:
        values, error = (factor * found[one].values[1:] for one in (name, f"{name}_error"))
        error *= STANDARD_ERRORS
        if not (values > 0.0).any():
            continue
        axes.loglog(places[1:], values, color=colour, linewidth=1.2, label=words)
        axes.fill_between(places[1:], np.maximum(values - error, 0.1 * values), values + error, color=colour, alpha=0.2)
    words = "Strouhal number f D / U" if strouhal else "frequency [Hz]"
    opd.set(xlabel=words, ylabel="nm²/Hz")
    tilt.set(xlabel=words, ylabel="µrad²/Hz")
    for axes in (opd, tilt):
        plain_decades(axes)
        if axes.get_legend_handles_labels()[0]:
            axes.legend()
    return figure


def _aperture_figure(found: "xarray.Dataset") -> "Figure":
    figure, [(axes, _)] = panelled_figure(Panel(6.0, 3.0))
    error = 1e9 * STANDARD_ERRORS * np.nan_to_num(found.opd_rms_aperture_error.values)
    axes.errorbar(
        1e3 * found.aperture.values, 1e9 * found.opd_rms_aperture.values, error, marker="o", capsize=3, color="#0b6e99"
    )
    axes.set(xlabel="diameter [mm]", ylabel="OPD rms, tilt removed [nm]")
    return figure


def _modes_figure(found: "xarray.Dataset") -> "Figure":
    count = min(3, int((found.pod_energy.values > 0.0).sum()))
    figure, panels = panelled_figure(*[Panel(2.6, 2.6, bar=True)] * count)
    for k, (axes, bar) in enumerate(panels):
        error = 100.0 * STANDARD_ERRORS * float(found.pod_share_error[k])
        share = Quantity(100.0 * float(found.pod_share[k]), error).text()
        _map(figure, axes, bar, found, found.pod_mode.values[k], "", True)
        axes.set_title(f"{share} %", y=1.0)
    return figure
