"""Time kernels on a GPU without the overhead of a call: many launches in a row, and new seeds of a Strehl ratio.

The first table is for a million rays of the bundles of `aerokernels bench bundles`, interpolated between traced rays
and every ray traced: the kernel stage of a call, one launch with a wait, and ten launches in a row, with rays and
results on the device; beside them Dr.Jit's 32 steps, if it is installed. The second table is for
2,304 rays of a disc in the cone scene, prepared: a new seed, and the kernels' part of it. Wall times [ms], medians.
"""

import argparse
import importlib.util
import time
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import warp as wp

from aerokernels import Disc, prepare_strehl, trace
from aerokernels.benchmark.bundle_scenes import APERTURE, CONE_HALF, SLOPE, WAVELENGTH, bundle_scene, rays_on
from aerokernels.rays import RayBundle
from aerokernels.tracing.bundle.family import Family, find_family
from aerokernels.tracing.bundle.nodes import channels_of
from aerokernels.tracing.bundle.run import BundleRequest, find_table
from aerokernels.tracing.engines import Prepared, engine_of
from aerokernels.tracing.plan import TracePlan
from aerokernels.tracing.trace import run_plan
from aerokernels.validation.cone import cone_field
from aerokernels.validation.report import markdown_table

KINDS = ("slanted", "divergent", "turbulence", "incoherent")
OUTPUTS = ("direction", "opd")
IN_A_ROW, SEEDS = 10, 200


def median(work: Callable[[], Any], repeats: int) -> float:
    """Return the median wall time of a call [ms]."""
    spent = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        spent.append(1e3 * (time.perf_counter() - begin))
    return float(np.median(spent))


def kernel_of(field: Any, rays: RayBundle, plan: TracePlan, until: Any) -> Prepared:
    """Return the kernel that gives all rays, or all but a few, their results: it interpolates them or traces each."""
    engine, outputs = engine_of(plan.backend, plan.device), frozenset(OUTPUTS)
    if plan.bundle is None:
        return engine.prepare(field, plan, until, WAVELENGTH, outputs, rays.direction)
    choices = {name: getattr(plan, name) for name in ("backend", "device", "precision", "tolerance")}
    choices |= {"max_steps": None, "path_length": None}
    family = find_family(field, rays, until)
    assert isinstance(family, Family)
    table = find_table(
        BundleRequest(field, rays, until, WAVELENGTH, outputs, choices, run_plan), family, channels_of(outputs)
    )
    assert table is not None
    return engine.prepare_bundle(table, outputs)


def launches(prepared: Prepared, rays: RayBundle, repeats: int) -> tuple[float, float]:
    """Return the time of one launch with a wait, and the time per launch of IN_A_ROW launches [ms]."""
    engine = prepared.engine
    starts = [engine.put(np.asarray(rays.position)), engine.put(np.asarray(rays.direction))]
    results = prepared.allocate(rays.ray_count)

    def run(count: int) -> None:
        for _ in range(count):
            prepared.launch(starts, results, rays.ray_count)
        engine.wait()

    run(1)
    return median(lambda: run(1), repeats), median(lambda: run(IN_A_ROW), repeats) / IN_A_ROW


def drjit_launches(rays: RayBundle, repeats: int) -> tuple[float, float]:
    """Return the same two times for Dr.Jit's scheme of 32 steps."""
    from aerokernels.benchmark.peers import drjit_schemes

    *_, scheme = drjit_schemes(cone_field(), rays, (32,))
    assert scheme.start is not None and scheme.wait is not None

    def run(count: int) -> None:
        found = [scheme.start() for _ in range(count)]
        scheme.wait()
        del found

    run(1)  # compiles
    return median(lambda: run(1), repeats), median(lambda: run(IN_A_ROW), repeats) / IN_A_ROW


def _row(count: int, *milliseconds: float) -> list[str]:
    """Return the last columns of a row: the stage, where there is one, one launch, one of some, and its rate."""
    told = [f"{each:.3f}" for each in milliseconds]
    return [*[""] * (3 - len(told)), *told, f"{1e-6 * count / milliseconds[-1]:.2f}"]


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", action="append", help="again for more; opencl and warp if left out")
    parser.add_argument("--device", default=None)
    parser.add_argument("--rays", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=9)
    given = parser.parse_args()
    devices = {"opencl": given.device, "warp": given.device or ("cuda:0" if wp.is_cuda_available() else "cpu")}
    targets = [{"backend": name, "device": devices[name]} for name in given.backend or devices]
    rows = []
    for kind in KINDS:
        scene = bundle_scene(kind)
        field, rays = scene.make_field(), scene.make_rays(given.rays, 1)
        for target, bundle in product(targets, ("auto", "off") if kind != "incoherent" else ("off",)):
            options = {"until": scene.until, "wavelength": WAVELENGTH, "outputs": OUTPUTS, "bundle": bundle, **target}
            # Of rays on the host Warp would copy some while it traces others.
            placed = rays_on(str(target["device"]), rays) if target["backend"] == "warp" else rays
            found = [trace(field, placed, **options) for _ in range(given.repeats + 2)][2:]
            stage = 1e3 * float(np.median([each.seconds["kernel"] for each in found]))
            plan = found[-1].plan
            one, many = launches(kernel_of(field, rays, plan, scene.until), rays, given.repeats)
            way = "every ray" if plan.bundle is None else "interpolated"
            rows.append([kind, way, str(target["backend"]), *_row(given.rays, stage, one, many)])
        if kind != "turbulence" and importlib.util.find_spec("drjit") is not None:
            rows.append(
                [kind, "every ray", "Dr.Jit, 32 steps", *_row(given.rays, *drjit_launches(rays, given.repeats))]
            )
    print(markdown_table(["bundle", "rays", "by", "stage", "one", f"of {IN_A_ROW} in a row", "G rays/s"], rows))
    rows, pupil = [], Disc(APERTURE, -CONE_HALF[2] * SLOPE / SLOPE[2], SLOPE)
    for target in targets:
        prepared = prepare_strehl(cone_field(), pupil, wavelength=WAVELENGTH, **target)
        values = [prepared(seed) for seed in range(SEEDS)]
        stage = 1e3 * float(np.median([each.seconds["kernel"] for each in values[2:]]))
        whole = 1e3 * float(np.median([each.seconds["total"] for each in values[2:]]))
        rows.append([str(target["backend"]), str(values[-1].traced_ray_count), f"{whole:.3f}", f"{stage:.3f}"])
    print()
    print(markdown_table(["by", "rays", "new seed", "kernels"], rows))


if __name__ == "__main__":
    main()
