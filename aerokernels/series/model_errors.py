"""The part of the errors of statistics that is due to the maps they are made of.

Errors of maps do not become smaller by averaging in time: they are those of one grid and one gas. A mean has the root
mean square of the snapshots' errors; other lengths have the share of the OPD rms that its error is, squares of lengths
twice that, and a Strehl ratio S of the rms changes by 2 S |ln S| of it. Errors of maps are twice a standard error.
"""

from typing import Any

import numpy as np

from .statistic_parts import Table, in_time, terms_of

# Statistics and the numbers of snapshots of which they are means, or rms deviations.
OF_SNAPSHOTS = {
    "strehl": "strehl",
    "opd_rms": "opd_rms",
    "opd_rms_with_tilt": "opd_rms_with_tilt",
    "boresight_x": "boresight_x",
    "boresight_y": "boresight_y",
    "jitter_x": "boresight_x",
    "jitter_y": "boresight_y",
    "opd_mean": "",
}
LENGTHS = ("opd_std", "opd_rms_steady", "opd_rms_unsteady", "opd_rms_aperture", "opd_rms_linking", "opd_rms_path")
# Powers of the OPD and of the tilts.
POWERS = dict.fromkeys((*LENGTHS, "opd_rms_point"), ("opd_rms", 1.0))
POWERS |= dict.fromkeys(("spectrum_opd", "pod_energy"), ("opd_rms", 2.0))
POWERS |= {f"spectrum_jitter_{axis}": (f"boresight_{axis}", 2.0) for axis in "xy"}
RATIOS = ("strehl_large_aperture", "strehl_aperture")


def add_model_errors(table: Table, dataset: Any, wavelength: float) -> None:
    """Add the errors of the maps of `optical_series` to those of a table; other maps have none.

    Args:
        table: The statistics.
        dataset: The maps.
        wavelength: Vacuum wavelength of the statistics [m].
    """
    whole = "opd_rms" if "tilt" in terms_of(dataset) else "opd_rms_with_tilt"

    def error(name: str) -> float:
        return 0.5 * _rms(dataset, f"{name}_error" if name else "error")

    def share(name: str) -> float:
        size = _rms(dataset, name)
        return error(name) / size if size > 0.0 else 0.0

    def add(name: str, more: Any) -> None:
        if f"{name}_error" in table.variables:
            dims, before, about = table.variables[f"{name}_error"]
            table.variables[f"{name}_error"] = dims, np.hypot(before, more), about

    needed = {"error", *(f"{name}_error" for name in OF_SNAPSHOTS.values() if name)}
    if not needed <= set(dataset.data_vars):
        return
    by_rms = [*RATIOS, *(["strehl"] if wavelength != dataset.attrs.get("wavelength") else [])]
    for name, of in OF_SNAPSHOTS.items():
        if name not in by_rms:
            add(name, error(of))
    for name, (of, power) in POWERS.items():
        if name in table.variables:
            add(name, power * share(whole if of == "opd_rms" else of) * np.abs(table.variables[name][1]))
    for name in by_rms:
        value = np.clip(table.variables[name][1], 1e-300, 1.0)
        add(name, 2.0 * value * np.abs(np.log(value)) * share(whole))


def _rms(dataset: Any, name: str) -> float:
    return float(np.sqrt(np.mean(in_time(dataset, name) ** 2)))
