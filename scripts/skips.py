"""Time what is skipped on wind-tunnel-mach3: each skip on and off, and all skips together against the plain tracer.

The two sides of a row alternate, and each pair of neighbours gives one ratio, so that other load on the machine affects
both alike; the error is that of the mean ratio. Times are end to end, after compilation and upload. The plain tracer is
the adaptive one with every ray of the disc, without its table of step bounds.
"""

import argparse
import time
from collections.abc import Callable
from functools import partial
from importlib import import_module

import numpy as np

from aerokernels import Plane, RayBundle, estimate_strehl, flow, trace
from aerokernels.prepare import prepare_field
from aerokernels.scene import Scene
from aerokernels.validation.report import markdown_table

HEADING = ["skip", "without", "with", "without [s]", "with [s]", "ratio", "change of the result"]


def no_tables(backend: str, work: Callable) -> Callable:
    """Return the same work without tables of step bounds: no step of more than STEP_LIMIT cells."""
    module = import_module(f"aerokernels.tracing.engines.{backend}.engine")

    def run():
        real = module.step_bound_tables
        shut = {"step_bound": np.zeros(1), "step_bound_start": np.full(64, -1, dtype=np.int32)}
        module.step_bound_tables = lambda *_: (shut, {"block_count": np.ones(3, dtype=int), "block": 1})
        try:
            return work()
        finally:
            module.step_bound_tables = real

    return run


def compare(without: Callable, with_: Callable, repeats: int) -> tuple[float, float, float, float, object, object]:
    """Return median seconds of both, the mean ratio and its standard error, and both results."""
    one, other = without(), with_()
    seconds = []
    for _ in range(repeats):
        pair = []
        for work in (without, with_):
            start = time.perf_counter()
            work()
            pair.append(time.perf_counter() - start)
        seconds.append(pair)
    times = np.array(seconds)
    ratio = times[:, 0] / times[:, 1]
    error = ratio.std(ddof=1) / np.sqrt(repeats) if repeats > 1 else np.nan
    return *np.median(times, axis=0), ratio.mean(), error, one, other


def rows(ray_count: int, repeats: int, backend: str) -> list[list[str]]:
    """Return the table's rows."""
    scene = Scene.load("wind-tunnel-mach3")
    prepared = prepare_field(scene)
    field, pupil = prepared.field, scene.view
    engine = {"backend": backend, "device": "cpu"}
    estimate = partial(estimate_strehl, field, pupil, ray_count=ray_count, **engine)
    plain = no_tables(backend, partial(estimate, method="adaptive", symmetry="off", seed=1))
    bundle = RayBundle.collimated(pupil, ray_count)
    far = Plane((0.0, 0.0, 0.02), (0.0, 0.0, 1.0))
    rays = partial(trace, field, bundle, until=far, **engine)
    density = flow.shipped("mach3")
    whole = partial(density.index_field(scene.flow.wavelength, scene.flow.relation).resample, 4.0 * scene.grid.spacing)
    part = partial(whole, region=prepared.region)
    cases = [
        (
            "smooth regions in one step",
            "none",
            "table of step bounds",
            plain,
            partial(estimate, method="adaptive", symmetry="off"),
        ),
        (
            "nearly straight rays",
            "adaptive",
            "leapfrog samples",
            partial(estimate, method="adaptive", symmetry="off"),
            partial(estimate, symmetry="off"),
        ),
        ("symmetric pupil", "disc", "radius", partial(estimate, symmetry="off"), estimate),
        ("what is not asked for", "all outputs", "OPD", rays, partial(rays, outputs=("opd",))),
        ("what rays cannot reach", "whole flow", "the part they can", whole, part),
        ("all for the Strehl ratio", "plain", "auto", plain, estimate),
    ]
    table = []
    for name, off, on, without, with_ in cases:
        slow, fast, ratio, error, one, other = compare(without, with_, repeats)
        change = f"{other.value - one.value:+.1e}" if hasattr(one, "value") else ""
        table.append([name, off, on, f"{slow:.3g}", f"{fast:.3g}", f"{ratio:.3g} ± {error:.2g}", change])
    return table


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rays", type=int, default=1_000_000, help="rays of a Strehl ratio (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=5, help="pairs of a row (default: %(default)s)")
    parser.add_argument("--backend", default="opencl", choices=("opencl", "warp"), help="(default: %(default)s)")
    arguments = parser.parse_args()
    print(markdown_table(HEADING, rows(arguments.rays, arguments.repeats, arguments.backend), text_columns=3), end="")


if __name__ == "__main__":
    main()
