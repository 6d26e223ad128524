"""`aerokernels bench`: measure how fast and how accurately this machine traces."""

import json
from pathlib import Path
from typing import Annotated

import typer


def bench(
    suites: Annotated[
        list[str] | None, typer.Argument(metavar="[SUITE]...", help="cone, strehl, sweep, bundles [all].")
    ] = None,
    backend: Annotated[
        list[str] | None, typer.Option(help="warp, opencl or reference; repeatable [default: all available].")
    ] = None,
    device: Annotated[str | None, typer.Option(help="cpu, cuda:0, or an OpenCL device's name; see `backends`.")] = None,
    precision: Annotated[
        list[str] | None, typer.Option(help="float32 or float64; repeatable [default: float32].")
    ] = None,
    method: Annotated[list[str] | None, typer.Option(help="Repeatable [default: auto, adaptive and straight].")] = None,
    tolerance: Annotated[
        list[float] | None,
        typer.Option(help="Requested OPD error [waves]; repeatable, for run time against error [default: 1e-3]."),
    ] = None,
    rays: Annotated[int, typer.Option(help="Rays per trace and per Strehl ratio.")] = 1_000_000,
    repeats: Annotated[int, typer.Option(help="Number of timed calls of each run.")] = 5,
    out: Annotated[Path | None, typer.Option(help="Write everything measured to this JSON file.")] = None,
) -> None:
    """Measure the speed and the error of tracing.

    Report rays per second, CPU seconds and the share of the hardware's peak performance.
    """
    from aerokernels.benchmark import Settings, run_bench
    from aerokernels.benchmark.measuring import COLUMNS, table_rows
    from aerokernels.commands._output import note
    from aerokernels.commands._table import print_table
    from aerokernels.files.writing import replacing

    settings = Settings(
        suites=tuple(suites or ()),
        backends=tuple(backend or ()),
        device=device,
        precisions=tuple(precision or Settings.precisions),
        methods=tuple(method or Settings.methods),
        tolerances=tuple(tolerance or Settings.tolerances),
        ray_count=rays,
        repeats=repeats,
    )
    if out is not None and (out.is_dir() or not out.parent.is_dir()):
        raise ValueError(f"--out {out}: give a file name in an existing folder")
    measured = run_bench(settings, report=note)
    if out is not None:
        with replacing(out, name="--out ") as (draft,):
            draft.write_text(json.dumps(measured, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    print_table(f"Benchmark on {measured['machine']['cpu']}", COLUMNS, table_rows(measured))
    if out is not None:
        note(f"wrote {out}")
