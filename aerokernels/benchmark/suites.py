"""The suites: the cone scene ray by ray, one Strehl ratio of a million rays, and many of them over flow and density."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from aerokernels.benchmark.measuring import (
    UNDISTURBED,
    Settings,
    chosen_rays,
    errors,
    measure,
    on_processor,
    plan_facts,
    rate,
    spread,
    traced_clocks,
)
from aerokernels.benchmark.scenes import (
    KINDS,
    WAVELENGTH,
    BundleScene,
    PupilScene,
    Truth,
    bundle_scene,
    cone_field,
    cone_rays,
    cone_truth,
    rays_on,
    strehl_scene,
)
from aerokernels.flow import shipped
from aerokernels.flow.shipped import PLANE_NAMES
from aerokernels.focus import StrehlEstimate, strehl
from aerokernels.focus.estimate import PreparedStrehl, estimate_strehl, prepare_strehl
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import Plane, TraceResult, trace
from aerokernels.tracing.engines.choice import choose_backend

# Rays of the radial quadrature whose Strehl ratio serves as the truth.
TRUTH_RAYS = 1 << 15
TRUTH_TOLERANCE = 1e-5  # [waves]
# Free-stream densities of the sweep, as multiples of the shipped flow's.
DENSITIES = (0.5, 1.0, 2.0)
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
            "settings": _settings(options, settings),
            "plan": plan_facts(result.plan),
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
            found = timing.results[-1]
            yield {
                "suite": "strehl",
                "settings": {**_settings(options, settings), "symmetry": symmetry},
                "plan": plan_facts(found.plan),
                **traced_clocks(timing, found.traced_ray_count, on_processor(options["backend"], options["device"])),
                "fresh_field_seconds": measure(partial(estimate, fresh.field, fresh.pupil), 0).first_seconds,
                "rays_traced": found.traced_ray_count,
                "evaluations_per_ray": found.evaluation_count / found.traced_ray_count,
                "value": found.value,
                "converged_value": true_value,
                "error": {"value": found.value - true_value, "budget": found.error},
                "blocked": found.blocked,
            }


def sweep_runs(settings: Settings, targets: Targets) -> Iterator[dict]:
    """A Strehl ratio for every shipped flow and some densities, each with a new field that is uploaded.

    They are computed with a prepared pupil, by `PreparedStrehl.for_fields` and one after the other by `with_field`, and
    without one, anew for each.
    """
    cases = [
        (name, shipped(name).ambient_density * factor if factor != 1.0 else None)
        for name in PLANE_NAMES
        for factor in DENSITIES
    ]
    scenes = [strehl_scene(name, density) for name, density in cases]
    for options in _choices(settings, targets):
        options_of_all = {"ray_count": settings.ray_count, **options}
        prepared = prepare_strehl(scenes[0].field, scenes[0].pupil, **options_of_all)
        timing = measure(partial(_estimates, scenes, prepared), settings.repeats)
        overlapped = measure(partial(_overlapped_estimates, scenes, prepared), settings.repeats)
        anew = measure(partial(_estimates, scenes, None, **options_of_all), settings.repeats)
        found = timing.results[-1]
        yield {
            "suite": "sweep",
            "settings": _settings(options, settings),
            "plan": plan_facts(found[0].plan),
            "first_call_seconds": timing.first_seconds,
            "compile_seconds": sum(each.seconds["compile"] for each in timing.first),
            "kernel_seconds": spread([sum(each.seconds["kernel"] for each in many) for many in timing.results]),
            "wall_seconds": spread(timing.wall_seconds),
            "cpu_seconds": spread(timing.cpu_seconds),
            "ratios_per_second": rate(len(cases), overlapped.wall_seconds),
            "cpu_seconds_overlapped": spread(overlapped.cpu_seconds),
            "ratios_per_second_one_by_one": rate(len(cases), timing.wall_seconds),
            "cpu_seconds_anew": spread(anew.cpu_seconds),
            "ratios_per_second_anew": rate(len(cases), anew.wall_seconds),
            "rays_traced": (traced := sum(each.traced_ray_count for each in found)),
            "evaluations_per_ray": sum(each.evaluation_count for each in found) / traced,
            "cases": [
                {"flow": name, "ambient_density": density or shipped(name).ambient_density, "value": each.value}
                for (name, density), each in zip(cases, found, strict=True)
            ],
        }


def _estimates(scenes: list[PupilScene], known: PreparedStrehl | None, **options: Any) -> list[StrehlEstimate]:
    """A Strehl ratio of each scene, by a prepared pupil or anew; the fields are new objects without cached results."""
    found = []
    for scene in scenes:
        field = _new_values(scene)
        known = known and known.with_field(field)
        found.append(known(0) if known else estimate_strehl(field, scene.pupil, **options))
    return found


def _overlapped_estimates(scenes: list[PupilScene], known: PreparedStrehl) -> list[StrehlEstimate]:
    """A Strehl ratio of each scene, computing two at a time where that is faster."""
    return list(known.for_fields(map(_new_values, scenes)))


def _new_values(scene: PupilScene) -> IndexField:
    """A copy of the scene's field without cached results."""
    return replace(scene.field, samples=replace(scene.field.samples))


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


def _settings(options: dict, settings: Settings) -> dict:
    return {**options, "ray_count": settings.ray_count, "repeats": settings.repeats}


# The tolerance of the float64 traces that serve as the truth where there is no formula, over the requested tolerance.
TIGHT = 0.02
WAYS = ("auto", "off")


def bundle_runs(settings: Settings, targets: list[tuple[str, str]]) -> Iterator[dict]:
    """Every bundle on every target, interpolated and ray by ray."""
    for kind in KINDS:
        scene = bundle_scene(kind)
        field, rays = scene.make_field(), scene.make_rays(settings.ray_count, 1)
        rows = chosen_rays(rays.ray_count)
        truth = _truth(scene, rays[rows], settings, targets)
        for backend, device in targets:
            for tolerance, bundle in product(settings.tolerances, WAYS):
                yield _run(scene, field, rays, rows, truth, settings, (backend, device), tolerance, bundle)


def _run(
    scene: BundleScene,
    field: IndexField,
    rays: RayBundle,
    rows: np.ndarray,
    truth: Truth,
    settings: Settings,
    target: tuple[str, str],
    tolerance: float,
    bundle: str,
) -> dict:
    backend, device = target
    options: dict[str, Any] = {
        "until": scene.until,
        "tolerance": tolerance,
        "wavelength": WAVELENGTH,
        "backend": backend,
        "device": device,
        "precision": settings.precisions[0],
        "bundle": bundle,
    }
    call: Callable[..., TraceResult] = partial(trace, outputs=("direction", "opd"), **options)
    compiled = measure(lambda: call(field, rays), 0)
    fresh = measure(lambda: call(replace(field), rays), 0)
    others = [scene.make_rays(settings.ray_count, seed) for seed in range(2, 2 + settings.repeats)]
    seeded = [measure(partial(call, field, some), 0).first_seconds for some in others]
    timing = measure(lambda: call(field, rays), settings.repeats)
    on_cpu, kernels = on_processor(backend, device), None
    if backend == "warp" and not on_cpu:
        there = rays_on(device, rays)
        kernels = measure(lambda: call(field, there), settings.repeats)
    result = timing.results[-1]
    assert result.direction is not None and result.opd is not None
    counts = result.plan.bundle
    traced = rays.ray_count if counts is None else counts.traced + counts.one_by_one
    predicted = result.plan.predicted_evaluations
    return {
        "suite": "bundles",
        "settings": {
            **{name: options[name] for name in ("backend", "device", "precision", "tolerance", "bundle")},
            "method": "auto",
            "kind": scene.kind,
            "ray_count": rays.ray_count,
            "repeats": settings.repeats,
        },
        "plan": plan_facts(result.plan),
        "fresh_field_seconds": fresh.first_seconds,
        "new_seed_seconds": spread(seeded),
        **traced_clocks(timing, rays.ray_count, on_cpu, kernels),
        "first_call_seconds": compiled.first_seconds,
        "compile_seconds": compiled.first.seconds["compile"],
        "rays_traced": traced,
        "evaluations_per_ray": predicted if predicted is not None else float("nan"),
        "error": errors(truth, result.direction[rows], result.opd[rows], result.ok[rows]),
    }


def _truth(scene: BundleScene, rays: RayBundle, settings: Settings, targets: list[tuple[str, str]]) -> Truth:
    if scene.kind != "turbulence":
        return cone_truth(rays)
    backend, device = targets[0]
    found = trace(
        scene.make_field(),
        rays,
        until=scene.until,
        method="adaptive",
        precision="float64",
        tolerance=TIGHT * min(settings.tolerances),
        wavelength=WAVELENGTH,
        backend=backend,
        device=device,
    )
    assert found.position is not None and found.direction is not None and found.opd is not None
    return Truth(found.position, found.direction, found.opd)


RUNS = {"cone": cone_runs, "strehl": strehl_runs, "sweep": sweep_runs, "bundles": bundle_runs}
