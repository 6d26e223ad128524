"""Time kernels on a GPU without the overhead of a call: many launches in a row, and new seeds of a Strehl ratio.

The first table is for a million rays of the bundles of `aerokernels bench bundles`, every ray traced: the kernel stage
of a call, one launch with a wait, and ten launches in a row, with results on the device; beside them a launch of
Dr.Jit's 32 steps, if it is installed. The second table is for 2,304 rays of a disc in the cone scene, prepared: a new
seed, and the kernels' part of it. Wall times [ms], medians.
"""

import argparse
import importlib.util
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from aerokernels import Disc, prepare_strehl, trace
from aerokernels.benchmark.bundle_scenes import APERTURE, CONE_HALF, SLOPE, WAVELENGTH, bundle_scene
from aerokernels.rays import RayBundle
from aerokernels.tracing.engines import engine_of
from aerokernels.tracing.plan import TracePlan
from aerokernels.validation.cone import cone_field
from aerokernels.validation.report import markdown_table

KINDS = ("incoherent", "slanted", "divergent")
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


def launches(field: Any, rays: RayBundle, plan: TracePlan, until: Any, repeats: int) -> tuple[float, float]:
    """Return the time of one launch with a wait, and the time per launch of IN_A_ROW launches [ms]."""
    engine = engine_of(plan.backend, plan.device)
    prepared = engine.prepare(field, plan, until, WAVELENGTH, frozenset(OUTPUTS), rays.direction)
    starts = [engine.put(np.asarray(rays.position)), engine.put(np.asarray(rays.direction))]
    results = prepared.allocate(rays.ray_count)

    def run(count: int) -> None:
        for _ in range(count):
            prepared.launch(starts, results, rays.ray_count)
        engine.wait()

    run(1)
    return median(lambda: run(1), repeats), median(lambda: run(IN_A_ROW), repeats) / IN_A_ROW


def drjit_launch(rays: RayBundle, repeats: int) -> float:
    """Return the time of one launch of Dr.Jit's scheme of 32 steps with a wait, by its own clock [ms]."""
    from aerokernels.benchmark.peers import drjit_schemes

    *_, scheme = drjit_schemes(cone_field(), rays, (32,))
    scheme.run()  # compiles
    return 1e3 * float(np.median([scheme.run().seconds for _ in range(repeats)]))


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--backend", action="append", help="again for more; opencl and warp if left out")
    parser.add_argument("--device", default=None)
    parser.add_argument("--rays", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=9)
    given = parser.parse_args()
    targets = [{"backend": name, "device": given.device} for name in given.backend or ("opencl", "warp")]
    rows = []
    for kind in KINDS:
        scene = bundle_scene(kind)
        field, rays = scene.make_field(), scene.make_rays(given.rays, 1)
        for target in targets:
            options = {"until": scene.until, "wavelength": WAVELENGTH, "outputs": OUTPUTS, "bundle": "off", **target}
            found = [trace(field, rays, **options) for _ in range(given.repeats + 2)][2:]
            stage = 1e3 * float(np.median([each.seconds["kernel"] for each in found]))
            one, many = launches(field, rays, found[-1].plan, scene.until, given.repeats)
            rows.append([kind, str(target["backend"]), f"{stage:.3f}", f"{one:.3f}", f"{many:.3f}"])
        if importlib.util.find_spec("drjit") is not None:
            rows.append([kind, "Dr.Jit", "", f"{drjit_launch(rays, given.repeats):.3f}", ""])
    print(markdown_table(["bundle", "by", "stage", "one", f"of {IN_A_ROW} in a row"], rows))
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
