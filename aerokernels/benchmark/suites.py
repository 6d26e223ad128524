"""The suites: the cone scene ray by ray, and a Strehl ratio of a million rays."""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from aerokernels.benchmark.measuring import (
    UNDISTURBED,
    Settings,
    chosen_rays,
    errors,
    find_targets,
    machine,
    measure,
    on_processor,
    traced_clocks,
)
from aerokernels.benchmark.scenes import (
    WAVELENGTH,
    PupilScene,
    cone_field,
    cone_rays,
    cone_truth,
    strehl_scene,
)
from aerokernels.focus import strehl
from aerokernels.focus.estimate import estimate_strehl
from aerokernels.jobs.store import to_json
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.engines.choice import choose_backend
from aerokernels.tracing.plan import TracePlan

# Rays of the radial quadrature whose Strehl ratio serves as the truth.
TRUTH_RAYS = 1 << 15
TRUTH_TOLERANCE = 1e-5  # [waves]
SCHEMA = "aerokernels-bench/2"
Targets = list[tuple[str, str]]


def cone_runs(settings: Settings, targets: Targets) -> Iterator[dict]:
    """The cone scene by every method, precision and target."""
    field, rays = cone_field(), cone_rays(settings.ray_count)
    rows = chosen_rays(rays.ray_count)
    truth = cone_truth(rays[rows])
    for options in _choices(settings, targets):
        timing = measure(
            partial(trace, field, rays, outputs=("direction", "optical_path"), **options), settings.repeats
        )
        result = timing.results[-1]
        # The counts are a separate output, which the timed calls do not request.
        counted = trace(field, rays, outputs=("evaluation_count",), **options)
        assert counted.evaluation_count is not None
        evaluations = float(counted.evaluation_count.mean())
        yield {
            "suite": "cone",
            **_described(options, settings, result.plan),
            **traced_clocks(timing, rays.ray_count, on_processor(options["backend"], options["device"])),
            "fresh_field_seconds": measure(
                partial(trace, cone_field(), rays, outputs=("direction", "optical_path"), **options), 0
            ).first_seconds,
            "rays_traced": rays.ray_count,
            "evaluations_per_ray": evaluations,
            "error": errors(truth, result.direction[rows], result.optical_path[rows] - UNDISTURBED, result.ok[rows]),
        }


def strehl_runs(settings: Settings, targets: Targets) -> Iterator[dict]:
    """The Strehl ratio of the shipped Mach 3 field, from launch to value, with and without using the symmetry."""
    scene = strehl_scene()
    # The reference would take an hour for the radial quadrature.
    fast = [target for target in targets if target[0] != "reference"]
    true_value = radial_strehl(scene, fast[0] if fast else choose_backend("auto", "cpu")[:2])
    for options in _choices(settings, targets):
        for symmetry in ("auto", "off"):
            estimate = partial(estimate_strehl, ray_count=settings.ray_count, symmetry=symmetry, **options)
            timing = measure(partial(estimate, scene.field, scene.pupil), settings.repeats)
            fresh = strehl_scene()
            result = timing.results[-1]
            yield {
                "suite": "strehl",
                **_described({**options, "symmetry": symmetry}, settings, result.plan),
                **traced_clocks(timing, result.traced_ray_count, on_processor(options["backend"], options["device"])),
                "fresh_field_seconds": measure(partial(estimate, fresh.field, fresh.pupil), 0).first_seconds,
                "rays_traced": result.traced_ray_count,
                "evaluations_per_ray": result.evaluation_count / result.traced_ray_count,
                "value": result.value,
                "converged_value": true_value,
                "error": {"value": result.value - true_value, "budget": result.error},
                "blocked": result.blocked,
            }


def radial_strehl(scene: PupilScene, target: tuple[str, str]) -> float:
    """The Strehl ratio of an axisymmetric scene from rays along a radius, for equal shares of the area.

    It is computed independently: single rays in float64 to TRUTH_TOLERANCE, summed here by the midpoint rule in r^2.
    """
    pupil, (low, high) = scene.pupil, scene.field.box
    radius = pupil.radius * np.sqrt((np.arange(TRUTH_RAYS) + 0.5) / TRUTH_RAYS)
    start = pupil.center + np.c_[np.zeros(TRUTH_RAYS), radius, np.zeros(TRUTH_RAYS)]
    # The plane at which `estimate_strehl` stops rays: a pupil's radius and a little beyond the box.
    beyond = float(high[2] + pupil.radius + 1e-3 * np.linalg.norm(high - low))
    result = trace(
        scene.field,
        RayBundle(start, pupil.normal[None]),
        method="adaptive",
        precision="float64",
        tolerance=TRUTH_TOLERANCE,
        until=Plane(np.array([0.0, 0.0, beyond]), pupil.normal),
        backend=target[0],
        device=target[1],
        outputs=("opd",),
    )
    assert result.opd is not None
    return strehl(result.opd[result.ok], WAVELENGTH)


def _choices(settings: Settings, targets: Targets) -> Iterator[dict]:
    for backend, device in targets:
        for precision in settings.precisions:
            for method, tolerance in product(settings.methods, settings.tolerances):
                yield {
                    "method": method,
                    "precision": precision,
                    "backend": backend,
                    "device": device,
                    "tolerance": tolerance,
                    "wavelength": WAVELENGTH,
                }


def _described(options: dict, settings: Settings, plan: TracePlan) -> dict:
    """The settings of a run, and what was chosen."""
    return {
        "settings": {**options, "ray_count": settings.ray_count, "repeats": settings.repeats},
        "plan": {"method": plan.method, "step": plan.step, "reasons": list(plan.reasons)},
    }


RUNS = {"cone": cone_runs, "strehl": strehl_runs}


def run_bench(settings: Settings, report: Callable[[str], None] = lambda line: None) -> dict[str, Any]:
    """Measure the requested suites; return a dictionary for JSON, described in docs/performance-bench.md.

    `report` is called with a line of text when a part begins. A ValueError names a backend or device that is not
    available; nothing is measured then.
    """
    targets = find_targets(settings)
    begun = datetime.now(UTC).isoformat(timespec="seconds")
    runs = []
    for suite in settings.wanted:
        report(f"suite {suite}")
        for run in RUNS[suite](settings, targets):
            own = run["settings"]
            report(f"  {own['method']}, {own['precision']} on {own['backend']} {own['device']}: done")
            runs.append(run)
    return to_json({"schema": SCHEMA, "begun": begun, "machine": machine(), "runs": runs})
