"""One run: a scene from its flow to the reported range."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aerokernels import __version__
from aerokernels.echo import EchoResult, echo
from aerokernels.medium import IndexField
from aerokernels.prepare import Prepared, prepare_field
from aerokernels.scene import Scene
from aerokernels.strehl import StrehlEstimate, estimate_strehl
from aerokernels.study.report import render_report
from aerokernels.study.scene_text import scene_toml
from aerokernels.study.store import (
    REPORT_FILE,
    RESULT_FILE,
    SUMMARY_FILE,
    staged_folder,
    write_result,
    write_summary,
)
from aerokernels.study.views import PupilMap, RayFan, Spot, forward_pupil, pupil_map, ray_fan, spot
from aerokernels.tracing.backends import choose_backend

if TYPE_CHECKING:
    import xarray

Progress = Callable[[str, float], None]

# Name of each stage, what to call it, and the fraction of the job that lies before it.
STAGES = {
    "prepare": ("reading and resampling the flow", 0.0),
    "strehl": ("tracing for the Strehl ratio", 0.1),
    "wavefront": ("tracing the wavefront", 0.5),
    "fan": ("tracing the picture's rays", 0.6),
    "echo": ("tracing the echo", 0.7),
}


@dataclass(frozen=True, eq=False)
class RunResult:
    """Everything that a run made.

    Attributes:
        scene: The scene.
        prepared: Its flow and index fields.
        strehl: The Strehl ratio of the view straight ahead.
        pupil: The optical path difference over the receiver's pupil.
        fan: Rays for the picture.
        echo: The laser echo and its range.
        seconds: Wall time of each stage, and "total".
    """

    scene: Scene
    prepared: Prepared
    strehl: StrehlEstimate
    pupil: PupilMap
    fan: RayFan
    echo: EchoResult
    seconds: Mapping[str, float]

    @cached_property
    def summary(self) -> dict[str, Any]:
        """The run in numbers, SI: what goes to summary.json."""
        return summarise(self)

    @cached_property
    def spot(self) -> Spot:
        """The point spread function of the wavefront."""
        return spot(self.pupil, self.scene.flow.wavelength)

    def to_xarray(self) -> "xarray.Dataset":
        """The run as one dataset with units: what goes to result.nc."""
        from aerokernels.study.dataset import run_dataset

        return run_dataset(self)


def scene_strehl(field: IndexField, scene: Scene) -> StrehlEstimate:
    """The Strehl ratio of a plane wave that looks forward through the receiver's pupil of a scene."""
    table = scene.trace
    return estimate_strehl(
        field,
        forward_pupil(scene),
        wavelength=scene.flow.wavelength,
        ray_count=scene.strehl.ray_count,
        method=table.method,
        tolerance=table.tolerance,
        step=table.step,
        max_steps=table.max_steps,
        remove=scene.strehl.remove,
        backend=table.backend,
        device=table.device,
        precision=table.precision,
        allow_truncation=table.allow_truncation,
    )


def simulate(scene: Scene, *, progress: Progress | None = None) -> RunResult:
    """Run a scene: flow, index, Strehl ratio, wavefront, echo, range.

    Args:
        scene: The scene.
        progress: Called with the stage that begins, in words, and the fraction of the job done before it.

    Raises:
        ValueError: Something in the scene that only shows when it is computed: an absent backend or device, a target
            inside the flow, an echo below the threshold in vacuum.
    """
    seconds: dict[str, float] = {}
    start = time.perf_counter()

    def staged(name: str, work: Callable[[], Any]) -> Any:
        if progress is not None:
            progress(*STAGES[name])
        begin = time.perf_counter()
        made = work()
        seconds[name] = time.perf_counter() - begin
        return made

    choose_backend(scene.trace.backend, scene.trace.device)  # refused here, before anything is computed
    prepared = staged("prepare", lambda: prepare_field(scene))
    field = prepared.field
    result = RunResult(
        scene=scene,
        prepared=prepared,
        strehl=staged("strehl", lambda: scene_strehl(field, scene)),
        pupil=staged("wavefront", lambda: pupil_map(field, scene)),
        fan=staged("fan", lambda: ray_fan(field, scene, prepared.front)),
        echo=staged("echo", lambda: echo(scene, field=field)),
        seconds=seconds,
    )
    seconds["total"] = time.perf_counter() - start
    return result


def summarise(result: RunResult) -> dict[str, Any]:
    """The numbers of summary.json; lengths in m, angles in rad, powers in W; null where there is none."""
    scene, strehl, echo_result = result.scene, result.strehl, result.echo
    plan = strehl.plan.as_dict()
    traces = (strehl.seconds, result.pupil.trace.seconds, result.fan.seconds)
    density = result.prepared.density
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
        "echo_strehl": echo_result.mean_strehl,
        "echo_peak_w": echo_result.peak_power,
        "echo_peak_v": echo_result.peak_voltage,
        "range_m": echo_result.range,
        "range_error_m": echo_result.range_error,
        "ranges_m": dict(echo_result.ranges),
        "range_statistics_m": {
            method: {
                "systematic_error": found.systematic_error,
                "random_error": found.random_error,
                "random_error_interval": found.random_interval,
                "cramer_rao_bound": found.cramer_rao_bound,
                "missed_count": found.missed_count,
            }
            for method, found in echo_result.statistics.items()
        },
        "noise_rms_v": echo_result.noise_rms,
        "return_factor": scene.receiver.return_factor,
        "true_range_m": echo_result.distance,
        "mach": density.conditions.mach if density.conditions else 0.0,
        "ambient_density_kg_m3": density.ambient_density,
        "wavelength_m": scene.flow.wavelength,
        "ray_count": strehl.ray_count,
        "traced_ray_count": strehl.traced_ray_count,
        "evaluation_count": strehl.evaluation_count,
        "trace_seconds": sum(seconds["kernel"] for seconds in traces) + echo_result.information["trace_seconds"],
        "compile_seconds": sum(seconds["compile"] for seconds in traces),
        "total_seconds": result.seconds["total"],
        "backend": plan["backend"],
        "device": plan["device"],
        "precision": plan["precision"],
        "plan": plan,
        "error": dict(strehl.error),
        "seconds": {**result.seconds, "prepare": dict(result.prepared.seconds)},
        "provenance": density.provenance,
        "version": __version__,
    }


def write_run(result: RunResult, out: Path) -> None:
    """Write summary.json, result.nc and report.html to the folder `out`: all of them, or none."""
    dataset = result.to_xarray()
    with staged_folder(out) as folder:
        write_result(folder / RESULT_FILE, dataset)
        (folder / REPORT_FILE).write_text(
            render_report(dataset, result.summary, scene_toml(result.scene)), encoding="utf-8"
        )
        write_summary(folder / SUMMARY_FILE, result.summary)
