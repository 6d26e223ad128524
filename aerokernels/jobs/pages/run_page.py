"""The report of a run, from its dataset and its summary alone, so that a finished run can be shown again."""

import math
import tomllib
from collections.abc import Callable, Mapping
from datetime import datetime
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.quantities import CAUSES, REMEDIES, TOTAL, WORTHLESS, Quantity, two_digits
from aerokernels.display.shown import is_flat
from aerokernels.jobs.numbers import NUMBERS, quantity_of, remark_rows
from aerokernels.jobs.pages.air import Air
from aerokernels.jobs.pages.echo import Echo
from aerokernels.jobs.pages.front import GROUPS, Front
from aerokernels.jobs.pages.page import Answer, Bar, Page, Panel, Row, shown
from aerokernels.jobs.store import flat, number_or_nan

if TYPE_CHECKING:
    import xarray

BACKENDS = {"opencl": "OpenCL", "warp": "Warp", "reference": "NumPy"}
CAUSE_NAMES = {
    "step": "Steps along a ray",
    "precision": "Rounding",
    "interpolation": "Between the flow's samples",
    "jumps": "Place of jumps",
    "resampling": "Uniform grid",
    "truncation": "End of the known air",
    "refractivity": "Index of the air",
    "bundle": "Rays between rays",
    "sampling": "Number of rays",
}
RAW_LEFT_OUT = ("scene_values", "plan")
LEAST_SHARE = 0.01  # of the total error, below which causes are listed together


def run_page(dataset: "xarray.Dataset", summary: Mapping[str, Any]) -> Page:
    """Return the report of a run.

    Args:
        dataset: The content of result.nc.
        summary: The content of summary.json.
    """
    echo = Echo(dataset, summary) if "echo_voltage" in dataset else None
    panels: list[Panel] = []
    plots: list[Callable[[], Mapping[str, Any]]] = []
    front = None
    if "density" in dataset:
        air = Air(dataset)
        plots.append(air.plot)
        panels += air.panels()
    if {"opd", "zernike", "point_spread"} <= set(dataset.variables):
        error = number_or_nan(dataset["opd"].attrs.get("rms_error_m"))
        front = Front(dataset, error)
        plots.append(front.plot)
        panels += front.panels()
    if echo is not None:
        panels += echo.panels()
    panels.append(_budget(summary.get("error") or {}))
    return Page(
        "run",
        str(summary.get("title") or summary.get("scene", "run")),
        _asked(dataset, summary),
        [_strehl(summary), _bent(summary, front), _range(summary, echo)],
        panels,
        _numbers(dataset, summary, echo),
        remarks=remark_rows(summary),
        alarm=summary.get("verdict") == WORTHLESS,
        scene=str(dataset.attrs["scene"]),
        repeat=("aerokernels run scene.toml --out out", 'import aerokernels as ak\n\nrun = ak.simulate("scene.toml")'),
        details=_details(summary),
        words=("strehl", "opd", "boresight", "density", "rays", *(("echo", "range") if echo else ()), "error"),
        raw=flat({key: value for key, value in summary.items() if key not in RAW_LEFT_OUT}),
        plots=plots,
    )


def _asked(dataset: "xarray.Dataset", summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return what was asked."""
    scene = tomllib.loads(str(dataset.attrs["scene"]))
    receiver, pupil, values = scene["receiver"], scene["pupil"], summary.get("scene_values") or {}
    angles = values.get("pupil") or pupil
    rows = [
        ("Scene", str(summary.get("scene"))),
        ("Date", _date(dataset)),
        ("Flow", str(summary.get("provenance", "")).removeprefix("shipped field ")),
        ("Mach number", _number(summary.get("mach"), "g")),
        ("Free-stream density", f"{_number(summary.get('ambient_density_kg_m3'), '.4g')} kg/m³"),
        ("Wavelength", f"{1e9 * summary['wavelength_m']:g} nm"),
        ("Pupil", _pupil(receiver, values.get("receiver") or {})),
        ("Direction", f"azimuth {_degrees(angles, 'azimuth')}, elevation {_degrees(angles, 'elevation')}"),
        ("Target distance", f"{summary['true_range_m']:g} m"),
    ]
    by = BACKENDS.get(str(summary["backend"]), str(summary["backend"]))
    rows.append(("Computed by", f"{by} on {summary['device']}, {summary['precision']}"))
    return [(name, text) for name, text in rows if not text.startswith("none")]


def _date(dataset: "xarray.Dataset") -> str:
    stamp = str(dataset.attrs.get("history", "")).partition(": ")[0]
    try:
        return f"{datetime.fromisoformat(stamp):%B %-d, %Y, %H:%M} UTC"
    except ValueError:
        return "none"


def _pupil(receiver: Mapping[str, Any], values: Mapping[str, Any]) -> str:
    shape = str(receiver.get("shape", "disc"))
    size = values.get("diameter", receiver.get("diameter"))
    return f"{shape}, {1e3 * size:g} mm" if isinstance(size, (int, float)) else shape


def _degrees(angles: Mapping[str, Any], name: str) -> str:
    value = angles.get(name, 0.0)
    return f"{math.degrees(value):g}°" if isinstance(value, (int, float)) else str(value)


def _number(value: Any, form: str) -> str:
    return f"{value:{form}}" if isinstance(value, (int, float)) and math.isfinite(value) else "none"


def _strehl(summary: Mapping[str, Any]) -> Answer:
    """Return the answer of the Strehl ratio."""
    ratio = quantity_of(summary, "strehl")
    cause = _largest(summary.get("error") or {})
    more = f"Strehl ratio {shown(ratio)}." + (f" The largest cause of the error: {cause}." if cause else "")
    cost = Quantity(100.0 * (1.0 - ratio.value), None if ratio.error is None else 100.0 * ratio.error, "%")
    return Answer.of("The flow costs", cost, "of the peak of the focus.", more)


def _largest(budget: Mapping[str, Any]) -> str:
    """Return the name of the greatest cause of an error."""
    causes = {cause: number_or_nan(error) for cause, error in budget.items() if cause != TOTAL and error}
    return CAUSE_NAMES.get(max(causes, key=lambda one: causes[one]), "").lower() if causes else ""


def _bent(summary: Mapping[str, Any], front: Front | None) -> Answer:
    """Return the answer of the wavefront."""
    rms, wave = quantity_of(summary, "opd_rms_m"), float(summary["wavelength_m"])
    waves = rms.value / wave
    size = "" if not waves else f", 1/{1.0 / waves:.0f} of a wave" if waves < 0.4 else f", {waves:.2g} waves"
    more = ""
    if front is not None:
        most = max(front.sizes, key=lambda name: front.sizes[name].value)
        share = front.sizes[most].value ** 2 / (sum(one.value**2 for one in front.sizes.values()) or 1.0)
        known = front.sizes[most].value > (front.sizes[most].error or 0.0)
        if share > 0.5 and known and most in GROUPS:
            more = f"{'Nearly all' if share > 0.98 else f'{100.0 * share:.0f} %'} of it is {most}."
        rest = quantity_of_map(front.dataset, "opd_without_focus")
        if rest is not None:
            more += f" Left without tilt and focus: {shown(rest, 1e9, 'nm')}."
    return Answer.of("The wavefront is bent by", rms.scaled(1e9, "nm"), f"rms{size}.", more.strip())


def quantity_of_map(dataset: "xarray.Dataset", name: str, number: str = "rms") -> Quantity | None:
    """Return the rms of a map, or another number of it, with its error [m]; None without the map."""
    if name not in dataset or f"{number}_m" not in dataset[name].attrs:
        return None
    attributes = dataset[name].attrs
    return Quantity(float(attributes[f"{number}_m"]), number_or_nan(attributes.get(f"{number}_error_m")))


def _range(summary: Mapping[str, Any], echo: Echo | None) -> Answer:
    """Return the answer of the range."""
    error = quantity_of(summary, "range_error_m")
    if math.isnan(error.value):
        failures = summary.get("failures") or {}
        reason = str(failures.get("range") or failures.get("echo") or "the echo was left out")
        return Answer("The range was", "not read", more=f"{reason[:1].upper()}{reason[1:]}.")
    side = "long" if error.value > 0.0 else "short"
    more = "" if echo is None else echo.reason
    size = Quantity(abs(error.value), error.error)
    return Answer.of("The range reads", size.scaled(1e3, "mm"), f"{side}.", more, "The range is off by at most")


def _budget(budget: Mapping[str, Any]) -> Panel:
    """Return the panel of the causes of the Strehl ratio's error, each with its remedy."""
    errors = {cause: number_or_nan(budget.get(cause)) for cause in CAUSES if cause in budget}
    total = number_or_nan(budget.get(TOTAL))
    known = {cause: error for cause, error in errors.items() if math.isfinite(error)}
    top = max([*known.values(), total if math.isfinite(total) else 0.0]) or 1.0
    great = {cause: error for cause, error in known.items() if error >= LEAST_SHARE * top}
    rows = [
        Bar(CAUSE_NAMES[cause], two_digits(error), 100.0 * error / top, remark=_remedy(cause))
        for cause, error in sorted(great.items(), key=lambda one: -one[1])
    ]
    small = [CAUSE_NAMES[cause] for cause in known if cause not in great]
    if small:
        least = max(known[cause] for cause in known if cause not in great)
        rows.append(Bar("Others", f"≤ {least:.1g}", 100.0 * least / top, remark=", ".join(small), kind="below"))
    rows += [Bar(CAUSE_NAMES[cause], "not known", remark=_remedy(cause)) for cause in errors if cause not in known]
    rows.append(Bar("Total", two_digits(total), 100.0 * total / top if math.isfinite(total) else 0.0, kind="total"))
    says = "Causes of the error of the Strehl ratio, with what lowers each."
    return Panel("budget", "Where the error comes from", says, rows=rows)


def _remedy(cause: str) -> str:
    words = REMEDIES.get(cause, "").partition(": ")[2]
    return f"{words[:1].upper()}{words[1:]}." if words else ""


def _numbers(dataset: "xarray.Dataset", summary: Mapping[str, Any], echo: Echo | None) -> list[tuple[str, list[Row]]]:
    """Return the numbers in groups, in the units that people use."""

    def row(key: str, word: str, remark: str = "", unit: str = "") -> Row:
        one = NUMBERS[key]
        label = one.name or f"{one.words[:1].upper()}{one.words[1:]}"
        return label, one.text(quantity_of(summary, key)).replace("+-", "±"), remark, word

    rms, wave = number_or_nan(summary.get("opd_rms_m")), float(summary["wavelength_m"])
    quality = [
        row("strehl", "strehl", "peak of the focus over that without flow"),
        row("strehl_marechal", "strehl", "from the rms alone"),
        row("opd_rms_m", "opd", f"{rms / wave:.3g} waves"),
        row("boresight_rad", "boresight"),
    ]
    if "opd" in dataset and not is_flat(dataset["opd"].values, "m"):
        valley = quantity_of_map(dataset, "opd", "peak_to_valley")
        if valley is not None:
            quality.insert(3, ("OPD, peak to valley", shown(valley, 1e9, "nm"), "", "opd"))
        rest = quantity_of_map(dataset, "opd_without_focus")
        if rest is not None:
            quality.insert(4, ("Left without tilt and focus", shown(rest, 1e9, "nm"), "rms", "opd"))
    groups = [("Image quality", quality)]
    if echo is not None:
        free = (number_or_nan(dataset.attrs.get(f"vacuum_peak_{unit}")) for unit in "vw")
        volts, watts = free
        noise = number_or_nan(summary.get("noise_rms_v"))
        groups.append(
            (
                "Laser echo",
                [
                    row("echo_peak_v", "echo", f"{volts:.4g} V without flow"),
                    row("echo_peak_w", "echo", f"{1e6 * watts:.4g} µW without flow"),
                    row("echo_strehl", "strehl", "mean over the target"),
                    ("Noise", f"{1e3 * noise:.3g} mV rms" if noise else "off", "", "echo"),
                    row("range_m", "range"),
                    row("range_error_m", "range"),
                    row("still_air_m", "range"),
                ],
            )
        )
    rays = f"{summary['traced_ray_count']:,} traced"
    seconds = f"{summary['trace_seconds']:.2f} s in kernels, {summary['compile_seconds']:.2f} s compiling"
    if "ray_optics" in dataset.attrs:
        size, error = (float(dataset.attrs[f"ray_optics_strehl_change{name}"]) for name in ("", "_error"))
        verdict, _, why = str(dataset.attrs["ray_optics"]).partition(": ")
        remark = verdict if verdict == "rays are good" else why.replace("+-", "±")
        quality.append(("Strehl ratio, wave less rays", shown(Quantity(size, error), signed=True), remark, "strehl"))
    work = [
        ("Rays for the Strehl ratio", f"{summary['ray_count']:,}", rays, "rays"),
        ("Time", f"{summary['total_seconds']:.1f} s", seconds, ""),
    ]
    if "density" in dataset:
        most, ambient = float(np.nanmax(dataset["density"].values)), number_or_nan(summary["ambient_density_kg_m3"])
        remark = f"{most / ambient:.2g} times the free stream" if ambient > 0.0 else ""
        work.insert(0, ("Greatest density", f"{most:.3g} kg/m³", remark, "density"))
    return [*groups, ("Air and work", work)]


def _details(summary: Mapping[str, Any]) -> list[tuple[str, list[str]]]:
    """Return the folded lists: plan, and origin of the flow with the time of each stage."""
    rows = flat(summary.get("seconds") or {})
    times = ", ".join(f"{name.replace('.', ' ')} {float(value):.2f} s" for name, value in rows)
    origin = [f"Flow: {summary.get('provenance', '')}.", f"Time: {times}."]
    return [
        ("Plan: what was done, what was skipped, and why", list((summary.get("plan") or {}).get("reasons", []))),
        ("Origin of the flow, and time", origin),
    ]
