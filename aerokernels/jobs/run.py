"""Run a scene: from its flow to the Strehl ratio, the echo and the reported range."""

import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from aerokernels.display.progress import Progress, shows_progress
from aerokernels.flow import DensityField
from aerokernels.focus import StrehlEstimate
from aerokernels.focus.estimate import estimate_strehl
from aerokernels.inputs.arguments import checked
from aerokernels.inputs.kinds import wrong_kind
from aerokernels.jobs.pages.run_page import run_page
from aerokernels.jobs.run_files import RayFan, RunResult
from aerokernels.jobs.store import (
    REPORT_FILE,
    RESULT_FILE,
    SUMMARY_FILE,
    staged_folder,
    to_json,
    write_result,
    write_summary,
)
from aerokernels.lidar import EchoResult
from aerokernels.lidar.parts import Setup, trace_options
from aerokernels.lidar.rangefinder import check_echo
from aerokernels.lidar.simulate import echo_through
from aerokernels.medium import IndexField
from aerokernels.prepare import Prepared, prepare_field
from aerokernels.process.clock import clocked
from aerokernels.rays import RayBundle
from aerokernels.scene import Scene, warn_of_unused
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.engines.choice import choose_backend
from aerokernels.wavefronts import Wavefront, wavefront

T = TypeVar("T")

# Name of each stage, its description, and the fraction of the job done before it.
STAGES = {
    "prepare": ("reading and resampling the flow", 0.0),
    "strehl": ("tracing for the Strehl ratio", 0.1),
    "wavefront": ("tracing the wavefront", 0.5),
    "fan": ("tracing the picture's rays", 0.6),
    "error": ("estimating errors", 0.65),
    "echo": ("tracing the echo", 0.75),
}
MAP_PIXELS = 201  # pixels across the pupil's map
FAN_RAYS, FAN_PLANES = 15, 13


def scene_strehl(scene: Scene, field: IndexField) -> StrehlEstimate:
    """Estimate the Strehl ratio of a plane wave that arrives from the direction in which the scene's pupil looks."""
    return estimate_strehl(
        field,
        scene.view,
        **trace_options(scene),
        ray_count=scene.strehl.ray_count,
        remove=scene.strehl.remove,
        allow_truncation=scene.trace.allow_truncation,
    )


def scene_wavefront(scene: Scene, field: IndexField) -> Wavefront:
    """Trace the wavefront over a scene's pupil, piston removed."""
    try:
        traced = wavefront(
            field,
            scene.view,
            **trace_options(scene),
            pixel_count=MAP_PIXELS,
            allow_truncation=scene.trace.allow_truncation,
        )
    except ValueError as fault:
        raise ValueError(
            f"{fault}; check the pupil's place, {scene.view.center.tolist()} m, its size and where it looks against "
            "the body ([pupil], or receiver.aperture_z and receiver.diameter)"
        ) from None
    return traced.remove("piston")


def ray_fan(field: IndexField, scene: Scene, front: float) -> RayFan:
    """Trace a row of parallel rays from the pupil to a little beyond the flow, whose highest z is `front` [m]."""
    pupil = scene.view
    half, second = pupil.half_extent[1], pupil.axes[1]
    start = pupil.center + np.linspace(-half, half, FAN_RAYS)[:, None] * second
    rays = RayBundle(start, np.broadcast_to(pupil.normal, start.shape))
    end = 1.1 * _distance_out(field, scene, front)
    position = np.full((FAN_RAYS, FAN_PLANES, 3), np.nan)
    position[:, 0] = start
    for column, point in enumerate(np.linspace(pupil.center, pupil.center + end * pupil.normal, FAN_PLANES)):
        if column:
            traced = trace(field, rays, **trace_options(scene), until=Plane(point, pupil.normal), outputs=("position",))
            assert traced.position is not None  # requested by `outputs`
            position[traced.ok, column] = traced.position[traced.ok]
    return RayFan(position, position @ second - (start @ second)[:, None])


def _distance_out(field: IndexField, scene: Scene, front: float) -> float:
    """Return the length [m] of the line from a pupil's centre, in its direction of view, to the end of the flow."""
    pupil = scene.view
    low, high = (np.array(corner, dtype=np.float64) for corner in field.box)
    high[2] = front
    steep = np.abs(pupil.normal) > 1e-9
    ways = (np.where(pupil.normal > 0.0, high, low) - pupil.center)[steep] / pupil.normal[steep]
    ways = ways[np.isfinite(ways) & (ways > 0.0)]
    return float(ways.min()) if len(ways) else 2.0 * pupil.reach


@shows_progress("run", wait=0.0)
@checked
def simulate(
    scene: Scene | str | Path,
    *,
    field: IndexField | DensityField | None = None,
    progress: Progress | None = None,
    with_echo: bool = True,
) -> RunResult:
    """Run a scene: flow, index, Strehl ratio, wavefront, echo, range.

    Args:
        scene: The scene, the path of its TOML file, or the name of a shipped one.
        field: A flow to use unchanged in place of the scene's: flow.source and flow.density of the scene are then
            ignored. The index of a density field is computed by the scene's relation at the scene's wavelength.
        progress: Called with the description of each stage as it begins and the fraction of the job done before it;
            None shows a bar in terminals and notebooks.
        with_echo: Whether to simulate and range the laser echo; if not, `failures` says so.

    Returns:
        The run. A stage after the Strehl ratio that finds nothing does not stop the others: its result is None and its
        reason is in `failures`, for example if no light returns. An echo that cannot be ranged has no range.

    Raises:
        TypeError: `scene` or `field` of the wrong kind.
        ValueError: A scene file that is not valid; or an error that shows only during the computation: an absent
            backend or device, a target inside the flow, a pupil that no ray leaves, an index field of another
            wavelength than the scene's.
    """
    if isinstance(scene, (str, os.PathLike)):
        scene = Scene.load(scene)
    if not isinstance(scene, Scene):
        raise wrong_kind(scene, "scene", "a Scene, a path or a shipped scene's name")
    warn_of_unused(scene, "run")
    return run_stages(
        scene,
        partial(prepare_field, scene, field),
        partial(scene_strehl, scene),
        with_echo=with_echo,
        progress=progress,
    )


def run_stages(
    scene: Scene,
    prepare: Callable[[], Prepared],
    estimate: Callable[[IndexField], StrehlEstimate],
    *,
    with_views: bool = True,
    with_echo: bool = True,
    progress: Progress | None = None,
) -> RunResult:
    """Run the stages of a scene in turn; other arguments and errors as for `simulate`.

    `prepare` makes its flow and index fields, and `estimate` its Strehl ratio through the index field. `with_views`
    tells whether to trace the wavefront and the rays for the figures.
    """
    seconds: dict[str, float] = {}
    failed: dict[str, str] = {}

    def timed(name: str, work: Callable[[], T]) -> T:
        if progress is not None:
            progress(*STAGES[name])
        begin = time.perf_counter()
        try:
            return work()
        finally:
            seconds[name] = time.perf_counter() - begin

    def attempted(name: str, work: Callable[[], T], result: str) -> T | None:
        try:
            return timed(name, work)
        except ValueError as fault:  # bad input was rejected earlier, so this stage has nothing to find in the scene
            failed[result] = str(fault)
            return None

    waves = fan = echo = None
    with clocked() as stages:
        choose_backend(scene.trace.backend, scene.trace.device)  # rejects a missing device before anything is computed
        prepared = timed("prepare", prepare)
        index = prepared.field
        if with_echo:  # rejects a scene whose echo cannot be computed for any flow
            vacuum = check_echo(Setup.of_scene(scene), index)
        strehl = timed("strehl", lambda: estimate(index))
        if with_views:
            waves = attempted("wavefront", lambda: scene_wavefront(scene, index), "wavefront")
            fan = attempted("fan", lambda: ray_fan(index, scene, prepared.front), "rays")
        timed("error", lambda: (strehl.quantities, waves and waves.opd_error))
        if with_echo:

            def simulated() -> EchoResult:
                found = echo_through(index, vacuum, estimate=None if scene.has_own_pupil else strehl)
                _ = found.quantities  # the errors too, within the time of this stage
                return found

            echo = attempted("echo", simulated, "echo")
        else:
            failed["echo"] = "left out, as requested"
    seconds["total"] = stages["total"]
    return RunResult(scene, prepared, strehl, waves, fan, echo, seconds, stages, failed)


def write_run(result: RunResult, out: Path) -> dict[str, Any]:
    """Write summary.json, result.nc and report.html: all of them, or none; return the summary."""
    dataset = result.to_xarray()
    page = run_page(dataset, to_json(result.summary)).html()
    with staged_folder(out) as folder:
        write_result(folder / RESULT_FILE, dataset)
        (folder / REPORT_FILE).write_text(page, encoding="utf-8")
        write_summary(folder / SUMMARY_FILE, result.summary)
    return result.summary
