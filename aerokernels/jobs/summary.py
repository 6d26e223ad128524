"""The numbers of a run, each with its error, as written to summary.json.

strehl, range_m, ...   the numbers, SI; null if there is no result
errors                 the errors of the numbers by the same keys, in the same units; null if not known; no entry for
numbers that are not estimates (counts, settings, times). The error of a ratio between 0 and 1 is at most what these
bounds allow, max(ratio, 1 - ratio): the number is then not meaningful, as the verdict on the Strehl ratio says
still_air_m            the part of the range error that the air at rest between aperture and target causes, not the flow
range_uncertainty_m    the error of the range by cause, by ranging method
verdict, warnings      whether the answer is meaningful given its errors ("fine", "warning", "worthless"), and why
failures               why a stage has no result, by stage ("wavefront", "rays", "echo", "range", "picture echo", ...)
error                  the error budget of the Strehl ratio by cause, each at most what the bounds 0 and 1 allow
averages_lacking       deficit of the interpolant against the averages over rows and columns of the flow's cells and
over single cells, as shares of the range of densities, and over a row as optical path [m]; empty if the flow has no
averages over the cells of a mesh
scene_values           the whole scene as it was run, every key with its default, SI
seconds                wall time of each part of the run, and of "prepare" by its own parts; "total" is that of the run
stage_seconds          the same time by activity, each moment counted once (clock.py): trace_seconds is its "kernel",
compile_seconds its "compile"; both include the rays of the error budget
"""

import math
from typing import Any

import numpy as np

from aerokernels import __version__
from aerokernels.display.error_budget import TOTAL
from aerokernels.display.quantities import greatest_ratio_error
from aerokernels.echo import EchoResult
from aerokernels.jobs.run_parts import RunParts
from aerokernels.medium import AveragesLacking

# Keys of the echo's numbers, and their names in `EchoResult.quantities`.
ECHO_KEYS = {
    "echo_strehl": "strehl",
    "echo_peak_w": "peak_power",
    "echo_peak_v": "peak_voltage",
    "range_m": "range",
    "range_error_m": "range_error",
    "still_air_m": "still_air",
}


def summarise(result: RunParts) -> dict[str, Any]:
    """Return the content of summary.json; lengths in m, angles in rad, powers in W; NaN if there is no result."""
    scene, strehl = result.scene, result.strehl
    plan = strehl.plan.as_dict()
    density = result.prepared.density
    verdict = result.verdict
    echo_numbers, echo_errors = _echo_numbers(result.echo)
    return {
        "scene": scene.name,
        "title": scene.title,
        "strehl": strehl.value,
        "strehl_standard_error": strehl.standard_error,
        "strehl_marechal": strehl.marechal,
        "opd_rms_m": strehl.opd_rms,
        "boresight_rad": float(np.hypot(*strehl.boresight)),
        "boresight_x_rad": float(strehl.boresight[0]),
        "boresight_y_rad": float(strehl.boresight[1]),
        **echo_numbers,
        "errors": {**_strehl_errors(result), **echo_errors},
        "verdict": verdict.level,
        "warnings": [verdict.reason] if verdict else [],
        "failures": dict(result.failures),
        "return_factor": scene.receiver.return_factor,
        "true_range_m": float(scene.target.distance),
        "mach": math.nan if density is None else density.mach,
        "ambient_density_kg_m3": math.nan if density is None else density.ambient_density,
        "wavelength_m": scene.flow.wavelength,
        "ray_count": strehl.ray_count,
        "traced_ray_count": strehl.traced_ray_count,
        "evaluation_count": strehl.evaluation_count,
        "trace_seconds": result.stages["kernel"],
        "compile_seconds": result.stages["compile"],
        "total_seconds": result.seconds["total"],
        "backend": plan["backend"],
        "device": plan["device"],
        "precision": plan["precision"],
        "plan": plan,
        "error": {
            cause: float(np.minimum(one, greatest_ratio_error(strehl.value))) for cause, one in strehl.error.items()
        },
        "seconds": {**result.seconds, "prepare": dict(result.prepared.seconds)},
        "stage_seconds": dict(result.stages),
        "provenance": result.prepared.provenance,
        "averages_lacking": _averages_lacking(result.prepared.lacking),
        "scene_values": scene.as_dict(),
        "version": __version__,
    }


def _averages_lacking(lacking: AveragesLacking | None) -> dict[str, float]:
    """Return the deficits of rows of cells and of single cells; without the rows if the cells form none."""
    if lacking is None:
        return {}
    found = {
        "rows_max": lacking.rows_max,
        "rows_rms": lacking.rows_rms,
        "row_path_m": lacking.row_path,
        "cells_max": lacking.cells_max,
        "cells_rms": lacking.cells_rms,
    }
    return {name: value for name, value in found.items() if value is not None}


def _strehl_errors(result: RunParts) -> dict[str, float | None]:
    found = result.strehl.quantities
    return {
        "strehl": found["value"].error,
        "strehl_marechal": found["marechal"].error,
        "opd_rms_m": found["opd_rms"].error,
        # The vector's length changes by at most the length of the vector of the components' errors.
        "boresight_rad": math.hypot(*(found[f"boresight_{axis}"].error or 0.0 for axis in "xy")),
        "boresight_x_rad": found["boresight_x"].error,
        "boresight_y_rad": found["boresight_y"].error,
    }


def _echo_numbers(echo: EchoResult | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the numbers of the echo, NaN if there is no echo, and their errors."""
    if echo is None:
        nothing = dict.fromkeys(ECHO_KEYS, math.nan)
        empty = {"ranges_m": {}, "range_uncertainty_m": {}, "range_statistics_m": {}, "noise_rms_v": math.nan}
        return {**nothing, **empty}, {**nothing, "ranges_m": {}}
    found = echo.quantities
    numbers = {
        **{key: found[name].value for key, name in ECHO_KEYS.items()},
        "ranges_m": dict(echo.ranges),
        "range_uncertainty_m": {
            method: {cause: float(one) for cause, one in echo.error[method].items()} for method in echo.ranges
        },
        "range_statistics_m": {
            method: {
                "systematic_error": one.systematic_error,
                "random_error": one.random_error,
                "random_error_interval": one.random_interval,
                "cramer_rao_bound": one.cramer_rao_bound,
                "missed_count": one.missed_count,
            }
            for method, one in echo.statistics.items()
        },
        "noise_rms_v": echo.noise_rms,
    }
    errors = {key: found[name].error for key, name in ECHO_KEYS.items()}
    return numbers, {**errors, "ranges_m": {method: echo.error[method][TOTAL] for method in echo.ranges}}
