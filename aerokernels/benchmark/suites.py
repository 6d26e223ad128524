"""The suites: the cone scene ray by ray, one Strehl ratio of a million rays, and many of them over flow and density."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from aerokernels.benchmark.bundle_suite import bundle_runs
from aerokernels.benchmark.ceiling import share
from aerokernels.benchmark.cone import cone_field, cone_rays, cone_truth
from aerokernels.benchmark.errors import UNDISTURBED, chosen_rays, errors
from aerokernels.benchmark.measuring import Timing, measure, plan_facts, rate, spread, traced_clocks
from aerokernels.benchmark.scenes import WAVELENGTH, PupilScene, strehl_scene
from aerokernels.benchmark.targets import Settings, on_processor
from aerokernels.flow import shipped
from aerokernels.flow.shipped import PLANE_NAMES
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.strehl import StrehlEstimate, strehl
from aerokernels.strehl.estimate import PreparedStrehl, estimate_strehl, prepare_strehl
from aerokernels.tracing import Plane, trace
from aerokernels.tracing.engines.choice import choose_backend

OUTPUTS = ("direction", "optical_path")
# Rays of the radial quadrature whose Strehl ratio serves as the truth.
TRUTH_RAYS = 1 << 15
TRUTH_TOLERANCE = 1e-5  # [waves]
# Free-stream densities of the sweep, as multiples of the shipped flow's.
DENSITIES = (0.5, 1.0, 2.0)
Targets = list[tuple[str, str]]


def cone_runs(settings: Settings, targets: Targets, ceilings: dict[str, dict]) -> Iterator[dict]:
    """The cone scene by every method, precision and target."""
    field, rays = cone_field(), cone_rays(settings.ray_count)
    rows = chosen_rays(rays.ray_count)
    truth = cone_truth(rays[rows])
    for options in _choices(settings, targets):
        timing = measure(partial(trace, field, rays, outputs=OUTPUTS, **options), settings.repeats)
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
                partial(trace, cone_field(), rays, outputs=OUTPUTS, **options), 0
            ).first_seconds,
            "rays_traced": rays.ray_count,
            "evaluations_per_ray": evaluations,
            "error": errors(truth, result.direction[rows], result.optical_path[rows] - UNDISTURBED, result.ok[rows]),
            "ceiling": _share(field, options, evaluations * rays.ray_count, timing, ceilings),
        }


def strehl_runs(settings: Settings, targets: Targets, ceilings: dict[str, dict]) -> Iterator[dict]:
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
                "ceiling": _share(scene.field, options, found.evaluation_count, timing, ceilings),
            }


def sweep_runs(settings: Settings, targets: Targets, ceilings: dict[str, dict]) -> Iterator[dict]:
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


RUNS = {"cone": cone_runs, "strehl": strehl_runs, "sweep": sweep_runs, "bundles": bundle_runs}


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


def _share(field: IndexField, options: dict, evaluations: float, timing: Timing, ceilings: dict[str, dict]) -> dict:
    per_second = rate(evaluations, [result.seconds["kernel"] for result in timing.results])
    plan = timing.results[-1].plan
    return share(
        None if plan.bundle is not None else field,  # ceiling.py counts lookups of a field, not of interpolated rays
        options["precision"],
        None if per_second is None else per_second["median"],
        ceilings[f"{options['backend']} {options['device']}"],
        leapfrog=plan.sample_count > 0,
    )
