"""Time a trace on Warp's device with rays and results there or on the host, beside the kernel and a plain copy.

Every row is the cone scene of `aerokernels bench bundles`. "Kernel" is the clock's stage. Rays on the host are NumPy
arrays, and every requested result is read as one. "Plain copy" copies the same bytes to the device and back through
pinned memory, one after the other, and nothing else. Parallel rays upload their direction once, so there are two plain
copies. The shares are ratios of medians of the same run: device arrays relative to the kernel's rate (goal: half), host
arrays relative to the plain copy's (goal: 60 %).
"""

import argparse
import time
from collections.abc import Callable
from functools import partial
from itertools import count as count_from
from itertools import cycle
from typing import Any

import numpy as np
import warp as wp

from aerokernels import Disc, RayBundle, trace
from aerokernels.benchmark.bundle_scenes import APERTURE, CONE_HALF, SLOPE, bundle_scene, rays_on
from aerokernels.tracing.result import RAY_OUTPUTS
from aerokernels.validation.report import markdown_table

HEADING = ["bundle", "outputs", "rays and results", "seconds", "M rays/s", "kernel, M rays/s", "share", "asked"]
FEW = ("direction", "opd")


def median(work: Callable[[], Any], repeats: int) -> tuple[float, float]:
    """Return the median seconds of a call and of its stage "kernel", after a call that is not counted."""
    walls, kernels = [], []
    for _ in range(repeats + 1):
        begin = time.perf_counter()
        result = work()
        walls.append(time.perf_counter() - begin)
        kernels.append(result.seconds["kernel"] if result is not None else np.nan)
        del result  # frees its memory for the next one
    return float(np.median(walls[1:])), float(np.median(kernels[1:]))


def plain_copy(device: str, up: int, down: int, repeats: int) -> float:
    """Return the seconds for copying so many bytes to the device, and others back, through pinned memory."""
    pinned = wp.get_device(device).is_cuda
    host = [wp.empty(size, dtype=wp.uint8, device="cpu", pinned=pinned) for size in (up, down)]
    there = [wp.empty(size, dtype=wp.uint8, device=device) for size in (up, down)]

    def copy() -> None:
        wp.copy(there[0], host[0])
        wp.copy(host[1], there[1])
        wp.synchronize_device(device)

    return median(copy, repeats)[0]


def made(count: int, seed: int, device: str) -> RayBundle:
    """Return slanted rays through a disc, made on the device."""
    pupil = Disc(APERTURE, -CONE_HALF[2] * SLOPE / SLOPE[2], SLOPE)
    return RayBundle.collimated(pupil, count, direction=SLOPE, seed=seed, device=device)


def rows(kind: str, count: int, repeats: int, device: str) -> list[list[str]]:
    """Return the table's rows of one bundle."""
    scene = bundle_scene(kind)
    field, host = scene.make_field(), scene.make_rays(count, 1)
    there = rays_on(device, host)
    others = cycle(
        [rays_on(device, scene.make_rays(count, seed)) for seed in (2, 3)]
    )  # a field caches only the last bundle
    choices = {"until": scene.until, "backend": "warp", "device": device}
    seeds = count_from(1)
    found = []
    for outputs in (FEW, tuple(RAY_OUTPUTS)):
        call = partial(trace, field, outputs=outputs, **choices)
        what = ", ".join(outputs) if outputs is FEW else "all"
        works: dict[str, Callable[[], Any]] = {"on the device, the same again": partial(call, there)}
        if outputs is FEW:
            works["on the device, others of the bundle"] = lambda call=call: call(next(others))
            if kind == "slanted":
                works["made on the device, and traced"] = lambda call=call: call(made(count, next(seeds), device))
        for name, work in works.items():
            wall, kernel = median(work, repeats)
            share = f"{kernel / wall:.0%} of the kernel's"
            found.append([kind, what, name, *_speed(count, wall, kernel), share, "50 %"])
        wall, kernel = median(partial(read, call, host, outputs), repeats)
        up, down = host.position.nbytes + host.direction.nbytes, read(call, host, outputs).seconds["bytes"]
        for size, which in {_moved(host): "what is moved", up: "the arrays'"}.items():
            copy = plain_copy(device, size, int(down), repeats)
            share = f"{copy / wall:.0%} of a plain copy of {which}"
            found.append([kind, what, "on the host", *_speed(count, wall, kernel), share, "60 %"])
            rate = f"{(size + down) / copy / 1e9:.1f} GB/s"
            found.append([kind, what, f"plain copy of {which} bytes", *_speed(count, copy, np.nan), rate, ""])
    return found


def _moved(rays: RayBundle) -> int:
    """Number of bytes of rays that are uploaded: a direction shared by all rays counts once."""
    return sum(each.nbytes if each.strides[0] else each[:1].nbytes for each in (rays.position, rays.direction))


def read(call: Callable[[RayBundle], Any], rays: RayBundle, outputs: tuple[str, ...]) -> Any:
    """Trace, and read all results on the host; seconds["bytes"] is their size."""
    result = call(rays)
    result.seconds["bytes"] = sum(getattr(result, name).nbytes for name in (*outputs, "traced_status"))
    return result


def _speed(count: int, wall: float, kernel: float) -> list[str]:
    return [f"{wall:.4g}", f"{count / wall / 1e6:.4g}", "" if np.isnan(kernel) else f"{count / kernel / 1e6:.4g}"]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rays", type=int, default=10_000_000, help="rays of a bundle (10,000,000)")
    parser.add_argument("--repeats", type=int, default=5, help="timed calls of each row, after one that is not counted")
    parser.add_argument("--device", default=None, help="Warp's name of the device; the first GPU, else the CPU")
    parser.add_argument("--bundles", nargs="+", default=["slanted", "divergent", "incoherent"], metavar="KIND")
    given = parser.parse_args()
    wp.config.quiet = True
    device = given.device or ("cuda:0" if wp.is_cuda_available() else "cpu")
    name = wp.get_device(device).name
    print(f"{name} ({device}), {given.rays:,} rays, medians of {given.repeats} calls\n")
    for kind in given.bundles:
        print(markdown_table(HEADING, rows(kind, given.rays, given.repeats, device)), "\n", flush=True)


if __name__ == "__main__":
    main()
