"""The numbers of summary.json and of sweeps: unit, meaning, and how each is shown in tables and reports."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from aerokernels.display.quantities import WORTHLESS, Quantity, listed
from aerokernels.display.shown import NOTHING, quantity_text
from aerokernels.jobs.store import number_or_nan, to_json

FACTORS = {"": 1.0, "V": 1.0, "m": 1.0, "mm": 1e3, "nm": 1e9, "µrad": 1e6, "µW": 1e6}  # from SI to units shown


@dataclass(frozen=True)
class Number:
    """A number of a summary."""

    unit: str  # SI unit; "1" for none
    words: str  # what it is
    name: str = ""  # what it is called among the main numbers; empty if it is not one of them
    shown: str = ""  # unit in which it is shown there
    signed: bool = False  # whether a plus sign is written there
    is_ratio: bool = False  # whether it is between 0 and 1
    of_echo: str = ""  # its name in `EchoResult.quantities`; empty if it is no number of the echo

    @property
    def factor(self) -> float:
        """From SI to the unit shown."""
        return FACTORS[self.shown]

    @property
    def label(self) -> str:
        """What it is, with its SI unit."""
        return f"{self.words} [{self.unit}]" if self.unit != "1" else self.words

    def text(self, number: Quantity) -> str:
        """Return a number with its error as it is shown, in words where it is below rounding."""
        return quantity_text(number, self.factor, self.shown, self.signed)


# In the order of summary.json's main numbers.
NUMBERS = {
    "strehl": Number("1", "Strehl ratio", "Strehl ratio", is_ratio=True),
    "strehl_standard_error": Number("1", "standard error of the Strehl ratio's sampling"),
    "strehl_marechal": Number("1", "Strehl ratio by Maréchal's approximation", "Strehl ratio, Maréchal", is_ratio=True),
    "opd_rms_m": Number("m", "optical path difference, rms over the pupil", "OPD, rms", "nm"),
    "boresight_rad": Number("rad", "boresight error", shown="µrad"),
    "boresight_x_rad": Number("rad", "boresight error toward x"),
    "boresight_y_rad": Number("rad", "boresight error toward y"),
    "echo_strehl": Number("1", "Strehl ratio of the return path", is_ratio=True, of_echo="strehl"),
    "echo_peak_w": Number("W", "peak power of the echo", "Echo peak power", "µW", of_echo="peak_power"),
    "echo_peak_v": Number("V", "peak voltage of the echo", "Echo peak voltage", "V", of_echo="peak_voltage"),
    "range_m": Number("m", "reported range", "Reported range", "m", of_echo="range"),
    "range_error_m": Number("m", "reported minus true range", "Range error", "mm", True, of_echo="range_error"),
    "still_air_m": Number(
        "m",
        "part of the range error that the air at rest causes, not the flow",
        "Range error of the air at rest",
        "mm",
        True,
        of_echo="still_air",
    ),
    "true_range_m": Number("m", "true range"),
    "noise_rms_v": Number("V", "noise of the recorded voltage without echo, rms"),
    "mach": Number("1", "Mach number of the flow"),
    "ambient_density_kg_m3": Number("kg m-3", "free-stream density"),
    "wavelength_m": Number("m", "vacuum wavelength"),
    "ray_count": Number("1", "requested rays over the pupil"),
    "traced_ray_count": Number("1", "rays traced for the Strehl ratio"),
    "evaluation_count": Number("1", "evaluations of the field for the Strehl ratio"),
    "trace_seconds": Number("s", "time in kernels"),
    "compile_seconds": Number("s", "time for compiling kernels"),
    "total_seconds": Number("s", "wall time, without stages reused from other cases of a sweep"),
    "processor_seconds": Number("s", "processor time of the case, all threads of its worker"),
}
TEXTS = {
    "verdict": "whether the answer is meaningful given its errors",
    "backend": "backend that ran the kernels",
    "device": "device that ran the kernels",
    "precision": "precision of the kernels",
    "provenance": "origin of the flow",
    "version": "version of aerokernels",
}
# The main numbers of a series' summary.
SERIES_NUMBERS = {
    "opd_rms": Number("m", "", "OPD, rms, tilt removed", "nm"),
    "opd_rms_with_tilt": Number("m", "", "OPD, rms", "nm"),
    "strehl": Number("1", "", "Strehl ratio, exact mean", is_ratio=True),
    "strehl_large_aperture": Number("1", "", "Strehl ratio, large-aperture approximation"),
    "jitter_x": Number("rad", "", "jitter along x", "µrad"),
    "jitter_y": Number("rad", "", "jitter along y", "µrad"),
    "correlation_length_x": Number("m", "", "correlation length along x", "mm"),
    "correlation_length_y": Number("m", "", "correlation length along y", "mm"),
}


def is_ratio(key: str) -> bool:
    """Whether a number of a summary is between 0 and 1."""
    return key in NUMBERS and NUMBERS[key].is_ratio


def quantity_of(summary: Mapping[str, Any], key: str) -> Quantity:
    """Return a number of a summary with its error; NaN for null, and for an error that the summary does not have."""
    value, error = to_json(summary.get(key)), to_json((summary.get("errors") or {}).get(key))
    return Quantity(number_or_nan(value), number_or_nan(error), is_ratio=is_ratio(key))


# Heading of the remark on a stage without a result.
STAGES = {"wavefront": "No wavefront", "rays": "No rays in the pictures", "echo": "No echo", "range": "No range"}


def headline_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the main quantities of a run's summary as rows of name and text with error and unit."""
    rows = [(one.name, one.text(quantity_of(summary, key))) for key, one in NUMBERS.items() if one.name]
    angles = [quantity_of(summary, f"boresight_{axis}_rad") for axis in "xy"]
    if not any(math.isnan(angle.value) for angle in angles):
        look = (summary.get("scene_values") or {}).get("pupil") or {}
        ahead = not (look.get("azimuth") or look.get("elevation"))
        nothing = all(quantity_text(angle, 1e6, "µrad") == NOTHING for angle in angles)
        text = NOTHING if nothing else listed([angle.scaled(1e6, "µrad") for angle in angles], signed=True)
        rows.append((f"Boresight error {'x, y' if ahead else 'along the pupil’s axes 1, 2'}", text))
    return rows


def remark_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return rows of remarks: the verdict on the Strehl ratio, and the reason for each stage without a result."""
    worthless = summary.get("verdict") == WORTHLESS
    rows = [("Not meaningful" if worthless else "Warning", str(reason)) for reason in summary.get("warnings") or ()]
    for stage, reason in (summary.get("failures") or {}).items():
        rows.append((STAGES.get(stage, f"No {stage}"), str(reason)))
    return rows


def table_rows(summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the rows of a run's table: main quantities, remarks, and what they cost."""
    rays = f"{summary['ray_count']:,} requested, {summary['traced_ray_count']:,} traced"
    time = f"{summary['total_seconds']:.2f} s, of which {summary['compile_seconds']:.2f} s compiling kernels"
    where = f"{summary['backend']} on {summary['device']}, {summary['precision']}"
    costs = [("Rays for the Strehl ratio", rays), ("Computed by", where), ("Time", time)]
    return [*headline_rows(summary), *remark_rows(summary), *costs]
