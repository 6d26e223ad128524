"""`aerokernels fields`: list the shipped flow fields, or the contents of a user's flow file."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from aerokernels.flow import Contents, DensityField
    from aerokernels.medium import Body, SolidBody

Picture = Annotated[
    Path | None,
    typer.Option("--picture", "--out", help="Write a picture of the density to this file (.png, .pdf, .svg)."),
]

MOST_MEASURED = 100_000  # cells up to which conserving cell averages takes about a second
COST_OF_CONSERVING = "preparing the field then takes about ten times as long, a whole run up to twice as long"


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
    from aerokernels.commands._output import note
    from aerokernels.commands._table import print_table
    from aerokernels.flow import contents, read, shipped_names

    if str(path) in shipped_names() and not path.exists():
        raise ValueError(f"{path} is a shipped field, not a file: `aerokernels fields` without a path lists those")
    when = _time(time)
    found = contents(path, time=when)
    rows = _rows(found)
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
        from aerokernels.jobs.plots import save_flow_figure

        save_flow_figure(flow, picture, path.name)
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


def _rows(found: "Contents") -> list[tuple[str, str]]:
    rows = [("format", found.format), ("geometry", found.geometry or "determined from its points")]
    rows += [("zone", zone) for zone in found.zones[:20]]
    if len(found.zones) > 20:
        rows.append(("zone", f"and {len(found.zones) - 20} more"))
    rows += [
        (f"extent in {axis}", _span(low, high)) for axis, low, high in zip("xyz", found.low, found.high, strict=True)
    ]
    for array in found.arrays:
        kind = "" if array.components == 1 else f", {array.components} components"
        bad = f", {array.bad} not finite" if array.bad else ""
        rows.append((f"array {array.name}", f"{_span(array.low, array.high)} ({array.where}{kind}{bad})"))
    if found.times:
        listed = ", ".join(f"{value:g}" for value in found.times[:12]) + (", ..." if len(found.times) > 12 else "")
        rows.append(
            ("times", f"{len(found.times)}: {listed}; shown: {found.time:g}" if found.time is not None else listed)
        )
    rows += [("patch", f"{name} ({kind})") for name, kind in found.patches]
    rows += [("note", note) for note in found.notes]
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
    return rows + _lacking_rows(flow)


def _lacking_rows(flow: "DensityField") -> list[tuple[str, str]]:
    """Rows on the deficit of line integrals across a plane mesh's cells, where the file holds cell averages."""
    from aerokernels.flow import CellDensity

    if not isinstance(flow, CellDensity):
        return []
    slow = flow.mesh.parents is not None or flow.wall is not None  # these meshes conserve averages, which takes longer
    if slow and len(flow.mesh.cells) > MOST_MEASURED:
        text = f"not measured above {MOST_MEASURED} cells (this mesh has {len(flow.mesh.cells)}): use"
        return [("averages", f"{text} IndexField.averages_lacking")]
    try:
        index = flow.index_field()
    except ValueError as fault:
        return [("averages", f"deficit not known: {fault}")]
    lacking = index.averages_lacking
    assert lacking is not None
    name = "conserving" if index.mesh.whole is not None else "bilinear"
    rows = [("averages", f'deficit of interpolation "{name}": {lacking.in_words()}')]
    if name == "bilinear" and lacking.rows_max is not None and not lacking.keeps_rows:
        rows.append(("", f'interpolation = "conserving" lacks less of rows and columns; {COST_OF_CONSERVING}'))
    return rows


def _body_in_words(body: "Body | SolidBody | None") -> str:
    if body is None:
        return "none"
    if body.geometry == "volume":
        return f"{len(body.triangles)} triangles"  # type: ignore[union-attr]
    return f"{len(body.profile)} points around it"  # type: ignore[union-attr]


def _shipped() -> None:
    from aerokernels.commands._table import print_table
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
