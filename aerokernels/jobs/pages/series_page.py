"""The report of a series: its statistics in words, a film of the maps, spectra, modes, and every number."""

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels.display.figures import Axis, Line, Lines, Raster
from aerokernels.display.quantities import Quantity
from aerokernels.display.shown import is_flat
from aerokernels.jobs.numbers import SERIES_NUMBERS, quantity_of
from aerokernels.jobs.pages.page import Answer, Page, Panel, Row, shown
from aerokernels.jobs.store import flat

if TYPE_CHECKING:
    import xarray

STANDARD_ERRORS = 2.0  # of which an error consists
MOST_FRAMES, FRAME_SIDE = 60, 64  # most frames of the film, and most pixels along a side
MOST_MODES = 3
LEAST_POWER = 1e-9  # of the greatest power of a spectrum, below which it is rounding
SATURATED = 0.8  # share of the pupil's width beyond which a correlation length is only a least length


def series_page(maps: "xarray.Dataset", found: "xarray.Dataset", summary: Mapping[str, Any], scene: str) -> Page:
    """Return the report of a series.

    Args:
        maps: The content of series.zarr.
        found: The content of statistics.nc, with the attribute "pupil_axes".
        summary: The content of summary.json.
        scene: The scene as it was run, with all defaults.
    """
    pictures = _Pictures(maps, found)
    remarks = [("Warning", str(text)) for text in summary["warnings"]]
    if summary["skipped"]:
        remarks.append(("Skipped", str(summary["skipped"])))
    lost = 1.0 - float(summary["known_share"])
    if lost > 1e-3:
        remarks.append(("Known air", f"{100.0 * lost:.3g} % of the pupil has no optical path; no number includes it."))
    return Page(
        "series",
        str(summary.get("title") or summary["scene"]),
        _asked(maps, summary),
        _answers(summary),
        pictures.panels(),
        _numbers(found, summary),
        remarks=remarks,
        scene=scene,
        repeat=(
            "aerokernels series scene.toml --out out",
            "import aerokernels as ak\n\nak.optical_series(series, pupil)",
        ),
        details=[
            (
                "How the maps were computed",
                [f"{summary['plan']}.", *([str(summary["ends"])] if summary["ends"] else [])],
            ),
            ("Origin of the flow", [f"{summary['provenance']}."]),
        ],
        words=("opd", "strehl", "jitter", "error"),
        raw=flat(summary),
    )


def _asked(maps: "xarray.Dataset", summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    time = maps["time"].values
    span = f"{summary['snapshot_count']} over {1e3 * float(np.ptp(time)):.4g} ms"
    return [
        ("Scene", str(summary["scene"])),
        ("Flow", str(summary["provenance"])),
        ("Snapshots", span),
        ("Independent ones", f"{summary['independent_count']:.3g}"),
        ("Wavelength", f"{1e9 * summary['wavelength_m']:g} nm"),
        ("Pupil", str(maps.attrs.get("pupil", "")).partition(" at ")[0].lower() + f", {1e3 * _width(maps):.3g} mm"),
        ("Removed", str(maps.attrs.get("remove", "")).replace(",", ", ")),
        ("Error of a map", f"{1e9 * summary['opd_error_m']:.2g} nm" if summary["opd_error_m"] else "not known"),
    ]


def _width(maps: "xarray.Dataset") -> float:
    """Return the width of the maps [m]."""
    x = maps["x"].values
    return float(np.ptp(x)) * len(x) / max(len(x) - 1, 1)


def _answers(summary: Mapping[str, Any]) -> list[Answer]:
    answers = []
    rms = quantity_of(summary, "opd_rms")
    if not math.isnan(rms.value):
        waves = rms.value / float(summary["wavelength_m"])
        after = "rms over the pupil, tilt removed."
        more = f"{waves:.2g} waves; {shown(quantity_of(summary, 'opd_rms_with_tilt'), 1e9, 'nm')} with tilt."
        answers.append(Answer.of("The wavefront is bent by", rms.scaled(1e9, "nm"), after, more))
    ratio = quantity_of(summary, "strehl")
    if not math.isnan(ratio.value):
        cost = Quantity(100.0 * (1.0 - ratio.value), None if ratio.error is None else 100.0 * ratio.error, "%")
        more = f"Mean Strehl ratio {shown(ratio)}, tilt included."
        answers.append(Answer.of("The flow costs", cost, "of the peak of the focus, on average.", more))
    jitter = {axis: quantity_of(summary, f"jitter_{axis}") for axis in "xy"}
    jitter = {axis: one for axis, one in jitter.items() if not math.isnan(one.value)}
    if jitter:
        axis = max(jitter, key=lambda one: jitter[one].value)
        others = ", ".join(f"{shown(one, 1e6, 'µrad')} along {name}" for name, one in jitter.items() if name != axis)
        answers.append(
            Answer.of("The image jitters by", jitter[axis].scaled(1e6, "µrad"), f"rms along {axis}.", others)
        )
    return answers


def _numbers(found: "xarray.Dataset", summary: Mapping[str, Any]) -> list[tuple[str, list[Row]]]:
    main: list[Row] = []
    for key, one in SERIES_NUMBERS.items():
        if summary.get(key) is None:
            continue
        number, remark = quantity_of(summary, key), ""
        text = one.text(number).replace("+-", "±")
        if key.startswith("correlation_length") and number.value > SATURATED * _width(found):
            text, remark = f"≥ {1e3 * number.value:.3g} mm", "as long as the pupil is wide: a least length"
        word = "strehl" if key.startswith("strehl") else "jitter" if key.startswith("jitter") else "opd"
        main.append((f"{one.name[:1].upper()}{one.name[1:]}", text, remark, word))
    factors = {"m": (1e9, "nm"), "rad": (1e6, "µrad")}
    rest: list[Row] = []
    for name in summary["errors"]:
        if name in SERIES_NUMBERS:
            continue
        unit = str(found[name].attrs["units"]).removeprefix("1")
        factor, words = factors.get(unit, (1.0, unit))
        label = str(found[name].attrs.get("long_name", name.replace("_", " ")))
        rest.append((f"{label[:1].upper()}{label[1:]}", shown(quantity_of(summary, name), factor, words), "", ""))
    return [("Statistics", main), ("More", rest)]


class _Pictures:
    """The pictures of a series, in mm, nm and microradian."""

    def __init__(self, maps: "xarray.Dataset", found: "xarray.Dataset") -> None:
        self.maps, self.found = maps, found
        first, second = found.attrs["pupil_axes"]
        ends = []
        for name in "xy":
            place = 1e3 * found[name].values
            half = 0.5 * float(np.ptp(place)) / max(len(place) - 1, 1)
            ends.append((float(place[0]) - half, float(place[-1]) + half))
        self.x, self.y = Axis(f"{first} [mm]", ends[0], "mm"), Axis(f"{second} [mm]", ends[1], "mm")

    def panels(self) -> list[Panel]:
        """Return all panels that have something to show."""
        found = self.found
        moving = not is_flat([0.0, *found["opd_std"].values.ravel()], "m")
        panels = [self._film(), self._map("opd_mean", "Steady map", True), self._map("opd_std", "Rms in time", False)]
        panels += [self._over_time("opd_rms", "OPD of each snapshot", "OPD rms, tilt removed", 1e9, "nm", "one")]
        panels += [self._over_time("strehl", "Strehl ratio of each snapshot", "Strehl ratio", 1.0, "", "twosolid")]
        if "spectrum_opd" in found and moving:
            panels += self._spectra()
        if not is_flat([0.0, *found["opd_rms_aperture"].values], "m"):
            panels.append(self._apertures())
        if "pod_mode" in found and moving:
            panels += self._modes()
        return panels

    def _film(self) -> Panel:
        maps, title = self.maps, "Film of the optical path difference"
        count = maps.sizes["time"]
        chosen = np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).round().astype(int))
        values = 1e9 * np.asarray(maps["opd"].values)[chosen]
        if is_flat(1e-9 * values, "m", _greatest(maps["error"])):
            return Panel("film", title, "The optical path difference is the same in all pixels and snapshots.")
        thin = max(1, max(values.shape[1:]) // FRAME_SIDE)
        most = float(np.nanpercentile(np.abs(values), 99.5))
        times = [
            f"Snapshot {number + 1} of {count}, {1e3 * float(maps['time'].values[number]):.4g} ms" for number in chosen
        ]
        scale = Axis("OPD [nm], + is delayed", (-most, most), "nm")
        shown = Raster(self.x, self.y, values[:, ::thin, ::thin], scale, "delay", times=times)
        return Panel(
            "film", title, times[0], "Optical path difference over the pupil, in time.", shown, "Tilt removed."
        )

    def _map(self, name: str, title: str, even: bool) -> Panel:
        values, error = self.found[name].values, STANDARD_ERRORS * _greatest(self.found[f"{name}_error"])
        key = name.replace("_", "-")
        if is_flat(values, "m", error):
            middle = 0.0 if even else 1e9 * float(np.nanmedian(values)) if np.isfinite(values).any() else math.nan
            return Panel(key, title, f"{middle:.3g} nm everywhere, but for rounding.")
        most = 1e9 * float(np.nanmax(np.abs(values)))
        scale = Axis("OPD [nm]", (-most, most) if even else (1e9 * float(np.nanmin(values)), most), "nm")
        grey = 1e9 * error if math.isfinite(error) and even else 0.0
        shown = Raster(self.x, self.y, 1e9 * values[None], scale, "delay" if even else "value", grey)
        says = f"Error at most {1e9 * error:.2g} nm." if math.isfinite(error) else "Its error is not known."
        return Panel(key, title, says, f"{title} over the pupil.", shown, "Grey: below its error." if grey else "")

    def _over_time(self, name: str, title: str, words: str, factor: float, unit: str, style: str) -> Panel:
        maps, key = self.maps, f"time-{name.replace('_', '-')}"
        values, errors = maps[name].values, maps[f"{name}_error"].values
        label = f"{words} [{unit}]" if unit else words
        if is_flat(values, "m" if unit else "1", _greatest(errors)):
            return Panel(key, title, f"{label}: {factor * _greatest(values):.3g} at all times, but for rounding.")
        time = 1e3 * maps["time"].values
        lines = [Line(time, factor * values, "", style, factor * errors)]
        says = f"From {factor * np.nanmin(values):.4g} to {factor * np.nanmax(values):.4g} {unit}".strip() + "."
        x = Axis("time [ms]", (float(time[0]), float(time[-1])), "ms")
        return Panel(key, title, says, f"{words} against time.", Lines(x, Axis(label, unit=unit), lines))

    def _spectra(self) -> list[Panel]:
        found = self.found
        strouhal = "strouhal" in found.coords
        place = found["strouhal" if strouhal else "frequency"].values[1:]
        words = "Strouhal number f D / U" if strouhal else "frequency [Hz]"
        x = Axis(words, (float(place[0]), float(place[-1])), "" if strouhal else "Hz", log=True)
        panels = []
        for name, title, parts, factor, unit in (
            ("spectrum-opd", "Spectrum of the OPD", [("spectrum_opd", "", "one")], 1e18, "nm²/Hz"),
            (
                "spectrum-tilt",
                "Spectrum of the tilt",
                [("spectrum_jitter_x", "along x", "one"), ("spectrum_jitter_y", "along y", "two")],
                1e12,
                "µrad²/Hz",
            ),
        ):
            lines = []
            top = max(_greatest(found[one].values[1:]) for one, _, _ in parts)
            for one, label, style in parts:
                power = np.where(found[one].values[1:] > LEAST_POWER * top, factor * found[one].values[1:], np.nan)
                if np.isfinite(power).any():
                    error = STANDARD_ERRORS * factor * found[f"{one}_error"].values[1:]
                    lines.append(Line(place, power, label, style, np.minimum(error, 0.9 * np.nan_to_num(power))))
            if lines:
                shown = Lines(x, Axis(f"power [{unit}]", unit=unit, log=True), lines)
                says = "Power over frequency, with its error. What is below rounding is left out."
                panels.append(Panel(name, title, says, f"{title} over frequency.", shown))
        return panels

    def _apertures(self) -> Panel:
        found = self.found
        error = 1e9 * STANDARD_ERRORS * np.nan_to_num(found["opd_rms_aperture_error"].values)
        rms, size = 1e9 * found["opd_rms_aperture"].values, 1e3 * found["aperture"].values
        lines = [Line(size, rms, "", "one", error, dots=True, joined=True)]
        shown = Lines(Axis("diameter [mm]", unit="mm"), Axis("OPD rms, tilt removed [nm]", unit="nm"), lines)
        says = "OPD rms over round parts of the pupil."
        return Panel("aperture", "Smaller apertures", says, "OPD rms against the diameter of a round part.", shown)

    def _modes(self) -> list[Panel]:
        found = self.found
        panels = []
        for k in range(min(MOST_MODES, int((found["pod_energy"].values > 0.0).sum()))):
            values = found["pod_mode"].values[k]
            most = float(np.nanmax(np.abs(values)))
            share = Quantity(
                100.0 * float(found["pod_share"][k]), 100.0 * STANDARD_ERRORS * float(found["pod_share_error"][k]), "%"
            )
            shown_map = Raster(self.x, self.y, values[None], Axis("shape", (-most, most)), "delay")
            title = f"Proper orthogonal mode {k + 1}"
            panels.append(Panel(f"mode-{k + 1}", title, f"{shown(share)} of the variance.", f"{title}.", shown_map))
        return panels


def _greatest(values: Any) -> float:
    """Return the greatest finite value; NaN without one."""
    known = np.asarray(values, float)
    return float(np.nanmax(known)) if np.isfinite(known).any() else math.nan
