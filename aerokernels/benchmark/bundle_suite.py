"""The suite "bundles": rays of any kind, interpolated between traced rays, and traced one by one.

Three clocks for each: a new field (everything is computed anew, kernels are compiled), a new seed (other rays of the
same bundle), and the same call again. Kernel and CPU times are those of the last; by Warp on a GPU the kernel's time is
that of a call with rays on the device, since otherwise it includes copies of the rays.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import product
from typing import Any

import numpy as np

from aerokernels.benchmark.bundle_scenes import KINDS, BundleScene, bundle_scene, rays_on
from aerokernels.benchmark.cone import cone_truth
from aerokernels.benchmark.errors import chosen_rays, errors
from aerokernels.benchmark.measuring import measure, plan_facts, spread, traced_clocks
from aerokernels.benchmark.scenes import WAVELENGTH
from aerokernels.benchmark.targets import Settings, on_processor
from aerokernels.benchmark.truth import Truth
from aerokernels.medium import IndexField
from aerokernels.rays import RayBundle
from aerokernels.tracing import TraceResult, trace

OUTPUTS = ("direction", "opd")
# The tolerance of the float64 traces that serve as the truth where there is no formula, over the requested tolerance.
TIGHT = 0.02
WAYS = ("auto", "off")


def bundle_runs(settings: Settings, targets: list[tuple[str, str]], ceilings: dict[str, dict]) -> Iterator[dict]:
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
    call: Callable[..., TraceResult] = partial(trace, outputs=OUTPUTS, **options)
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
        "ceiling": None,
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
