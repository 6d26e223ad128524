"""Commands that tell what there is: fields, scenes, backends; and bench, what this machine reaches."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from aerokernels.commands._output import note, output, print_table, say
from aerokernels.display.plain_text import plain

if TYPE_CHECKING:
    from aerokernels.flow import Contents, DensityField
    from aerokernels.medium import Body, SolidBody

Picture = Annotated[
    Path | None,
    typer.Option("--picture", "--out", help="Write a picture of the density to this file (.png, .pdf, .svg)."),
]


def fields(
    path: Annotated[Path | None, typer.Argument(help="A CFD file or case [default: the shipped fields].")] = None,
    picture: Picture = None,
    density: Annotated[str | None, typer.Option(help="Name of the density's array.")] = None,
    optical: Annotated[str | None, typer.Option(help='Optical axis in the file\'s axes, such as "-x".')] = None,
    up: Annotated[str | None, typer.Option(help="Direction of +y in the file's axes.")] = None,
    length_unit: Annotated[str | None, typer.Option(help="Unit of the file's coordinates, such as mm.")] = None,
    time: Annotated[str | None, typer.Option(help="latest, first, or a time [s].")] = None,
    walls: Annotated[list[str] | None, typer.Option(help="Name of a boundary patch of the body. Repeatable.")] = None,
    geometry: Annotated[str | None, typer.Option(help="axisymmetric: x is the axis and y the radius.")] = None,
) -> None:
    """List the shipped flow fields, or a flow file's contents.

    Of a file: format, geometry, extents, arrays with their ranges, times, patches, and the density field it gives.
    """
    if path is None:
        _shipped()
        return
    from aerokernels.flow import contents, read, shipped_names

    if str(path) in shipped_names() and not path.exists():
        raise ValueError(f"{path} is a shipped field, not a file: `aerokernels fields` without a path lists those")
    when = _time(time)
    result = contents(path, time=when)
    rows = _rows(result)
    try:
        frame = {"optical": optical, "up": up}
        flow = read(
            path, density=density, frame=frame, length_unit=length_unit, time=when, geometry=geometry, walls=walls
        )
    except ValueError as fault:
        if picture is not None or density is not None:
            raise
        rows.append(("as a density field", f"not usable yet: {str(fault).removeprefix(f'{path}: ')}"))
        flow = None
    if flow is not None:
        rows += _field_rows(flow)
    print_table(str(path), ("what", "value"), rows)
    if flow is not None and picture is not None:
        from aerokernels.jobs.pages.air import save_flow_figure

        save_flow_figure(flow, picture)
        note(f"wrote {picture}")


def _time(text: str | None) -> float | str | None:
    if text is None or text in ("latest", "first"):
        return text
    try:
        moment = float(text)
    except ValueError:
        moment = math.nan
    if not math.isfinite(moment):
        raise ValueError(f"--time {text!r}: give latest, first or a time in seconds")
    return moment


def _rows(result: "Contents") -> list[tuple[str, str]]:
    rows = [("format", result.format), ("geometry", result.geometry or "determined from its points")]
    rows += [("zone", zone) for zone in result.zones[:20]]
    if len(result.zones) > 20:
        rows.append(("zone", f"and {len(result.zones) - 20} more"))
    rows += [
        (f"extent in {axis}", _span(low, high)) for axis, low, high in zip("xyz", result.low, result.high, strict=True)
    ]
    for array in result.arrays:
        kind = "" if array.components == 1 else f", {array.components} components"
        bad = f", {array.bad} not finite" if array.bad else ""
        rows.append((f"array {array.name}", f"{_span(array.low, array.high)} ({array.where}{kind}{bad})"))
    if result.times:
        listed = ", ".join(f"{value:g}" for value in result.times[:12]) + (", ..." if len(result.times) > 12 else "")
        rows.append(
            ("times", f"{len(result.times)}: {listed}; shown: {result.time:g}" if result.time is not None else listed)
        )
    rows += [("patch", f"{name} ({kind})") for name, kind in result.patches]
    rows += [("note", note) for note in result.notes]
    return rows


def _span(low: float, high: float) -> str:
    """Return "low to high"; a negative zero is written as zero."""
    return f"{low + 0.0:.6g} to {high + 0.0:.6g}"


def _field_rows(flow: "DensityField") -> list[tuple[str, str]]:
    low, high = flow.box
    axes = {"volume": "xyz", "planar": "yz", "axisymmetric": "rz"}[flow.geometry]
    rows = [("as a density field", flow.provenance)]
    rows += [
        (f"{axis} in the optical frame", f"{_span(1e3 * a, 1e3 * b)} mm")
        for axis, a, b in zip(axes, low, high, strict=True)
    ]
    rows.append(("ambient density", f"{flow.ambient_density:.6g} kg/m3"))
    rows.append(("body", _body_in_words(flow.body)))
    return rows


def _body_in_words(body: "Body | SolidBody | None") -> str:
    if body is None:
        return "none"
    if body.geometry == "volume":
        return f"{len(body.triangles)} triangles"  # type: ignore[union-attr]
    return f"{len(body.profile)} points around it"  # type: ignore[union-attr]


def _shipped() -> None:
    from aerokernels.flow import shipped, shipped_names

    rows = []
    for name in shipped_names():
        field = shipped(name)
        stream = field.conditions
        rows.append(
            (
                name,
                f"{stream.mach:g}" if stream else "-",
                f"{field.ambient_density:.4f} kg/m3",
                f"{stream.pressure:.0f} Pa" if stream else "-",
                f"{stream.temperature:.2f} K" if stream else "-",
                f"{stream.velocity:.1f} m/s" if stream else "-",
                f"{field.density.min():.3f} to {field.density.max():.3f} kg/m3",
                f"{field.density.size} {'nodes' if field.geometry == 'volume' else 'cells'}, {field.geometry}",
                field.provenance,
            )
        )
    columns = ("field", "Mach", "free stream", "pressure", "temperature", "velocity", "density", "mesh", "provenance")
    print_table("Shipped flow fields", columns, rows)


scenes = typer.Typer(
    name="scenes", help="List the shipped scenes, or copy one as a starting point.", add_completion=False
)


@scenes.callback(invoke_without_command=True)
def show(context: typer.Context) -> None:
    """List the shipped scenes, or copy one as a starting point."""
    if context.invoked_subcommand is not None:
        return
    from aerokernels.scene import Scene
    from aerokernels.scene.loading import shipped_scenes

    rows = []
    for name in shipped_scenes():
        scene = Scene.load(name)
        rows.append((name, str(scene.flow.source), f"{scene.target.distance:g} m", scene.title or ""))
    print_table("Shipped scenes", ("scene", "flow", "target", "title"), rows)


@scenes.command("copy")
def copy(
    name: Annotated[str, typer.Argument(help="Name of a shipped scene.")],
    to: Annotated[Path | None, typer.Argument(help="File or folder to copy it to. [default: NAME.toml here]")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> None:
    """Copy a shipped scene to a file, with its comments."""
    from aerokernels.files.writing import replacing
    from aerokernels.scene.loading import shipped_scene_text

    text = shipped_scene_text(name)
    place = Path(f"{name}.toml") if to is None else to / f"{name}.toml" if to.is_dir() else to
    if not place.parent.is_dir():
        raise ValueError(f"{place}: the folder {place.parent} does not exist; make it, or choose another one")
    if place.exists() and not force:
        raise ValueError(f"{place} already exists: choose another name, or give --force to replace it")
    with replacing(place) as (draft,):
        draft.write_text(text, encoding="utf-8")
    note(f"wrote {place}; run it with: aerokernels run {place} --out out")


def backends() -> None:
    """List this machine's backends and devices.

    Also show active work-arounds, and what `auto` chooses and why.
    """
    from dataclasses import asdict

    from aerokernels.tracing import available_backends
    from aerokernels.tracing.engines.choice import choose_backend

    result = available_backends()
    backend, device, reason = choose_backend("auto", None)
    print_table(
        "Backends and devices",
        ("backend", "device", "version", "float64", "memory", "what it is"),
        [
            (
                info.backend,
                info.device,
                info.version,
                "-" if info.device == "-" else "yes" if info.float64 else "no",
                f"{info.memory / 2**30:.1f} GiB" if info.memory else "-",
                info.description if info.available else f"absent: {info.reason}",
            )
            for info in result
        ],
        {
            "backends": [asdict(info) for info in result],
            "auto": {"backend": backend, "device": device, "reason": reason},
        },
    )
    for info in result:
        if info.workaround:
            (note if output.as_json else say)(f"work-around on {info.device}: {info.workaround}")
    reason = reason.removeprefix(f"backend {backend} on {device}: ")
    if not output.as_json:
        say(plain(f"auto chooses {backend} on {device}: {reason}"))


def bench(
    suites: Annotated[list[str] | None, typer.Argument(metavar="[SUITE]...", help="cone, strehl [both].")] = None,
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
    from aerokernels.benchmark.measuring import COLUMNS, Settings, table_row
    from aerokernels.benchmark.suites import run_bench
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
    print_table(f"Benchmark on {measured['machine']['cpu']}", COLUMNS, list(map(table_row, measured["runs"])))
    if out is not None:
        note(f"wrote {out}")


COMMANDS = {"fields": fields, "scenes": scenes, "backends": backends, "bench": bench}
