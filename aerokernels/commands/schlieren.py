"""`aerokernels schlieren`: simulate schlieren pictures, shadowgraphs and interferograms of a flow."""

import math
from pathlib import Path
from typing import Annotated

import typer

from aerokernels.commands._output import note, print_table, shown_progress
from aerokernels.commands._scene import Backend, Device, Precision, Settings, naming_scene, scene_changes

Place = Annotated[
    str, typer.Argument(metavar="SCENE|FLOW", help="A TOML file, or the name of a shipped scene or a shipped flow.")
]


def schlieren(
    place: Place,
    out: Annotated[Path, typer.Option(help="Folder for the pictures, figure.png, pictures.nc and summary.json.")],
    kind: Annotated[
        list[str] | None, typer.Option(help="schlieren, shadowgraph or interferogram; repeatable [default: all].")
    ] = None,
    view: Annotated[str, typer.Option(help='Direction of the light: x, y, z or "X,Y,Z".')] = "x",
    extent: Annotated[
        str | None,
        typer.Option(metavar="FROM,TO,FROM,TO", help='Right and up: "-60 mm,5 mm,-40 mm,40 mm" [default: all].'),
    ] = None,
    width: Annotated[
        str | None, typer.Option(help="Length of the light's path through a planar flow, such as 50 mm.")
    ] = None,
    pixels: Annotated[int, typer.Option("--pixel-count", "--pixels", help="Pixels along the longer side.")] = 256,
    rays_per_pixel: Annotated[int, typer.Option(help="k: each pixel is the mean over k x k rays.")] = 1,
    spacing: Annotated[
        str | None,
        typer.Option(help="Node spacing of the flow's uniform grid, such as 0.1 mm [default: half a pixel]."),
    ] = None,
    knife_edge: Annotated[
        str,
        typer.Option(
            help="vertical, horizontal, or the direction of deflection that brightens the picture, such as "
            '"30 deg" from right toward up.'
        ),
    ] = "vertical",
    cut_off: Annotated[float, typer.Option(help="Share of the source image that the knife edge blocks.")] = 0.5,
    sensitivity: Annotated[
        float | None,
        typer.Option(
            help="Change of light per deflection [1/rad] [default: such that the picture uses the whole range]."
        ),
    ] = None,
    exposure: Annotated[
        float, typer.Option(help="Brightness of the schlieren picture's full light; 1 is white.")
    ] = 1.0,
    screen: Annotated[
        str,
        typer.Option("--distance", "--screen", help="Shadowgraph: distance of the screen from the middle of the flow."),
    ] = "0.5 m",
    source_angle: Annotated[str, typer.Option(help="Shadowgraph: angle that the light source subtends.")] = "0 rad",
    fringes: Annotated[
        str | None,
        typer.Option(
            "--fringe-spacing",
            "--fringes",
            help="Interferogram: spacing of the undisturbed fringes [default: infinite fringe].",
        ),
    ] = None,
    fringe_angle: Annotated[
        str, typer.Option(help="Interferogram: direction across the fringes, from right toward up.")
    ] = "90 deg",
    shock: Annotated[
        str | None,
        typer.Option(
            metavar="FROM,TO", help='Measure the shock\'s angle in this horizontal interval: "-60 mm,-30 mm".'
        ),
    ] = None,
    errors: Annotated[
        bool,
        typer.Option(
            "--errors",
            help="Measure the error of each pixel's brightness, from five or six more pictures of each kind.",
        ),
    ] = False,
    measured: Annotated[
        Path | None, typer.Option(help="A schlieren photograph (PNG, TIFF, ...) for the lower half of comparison.png.")
    ] = None,
    pixel_size: Annotated[
        str | None, typer.Option(help="Width of the photograph's pixels at the flow, such as 0.2 mm.")
    ] = None,
    nose: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN,ROW", help="Pixel of the nose tip in the photograph, counted from its upper left corner."
        ),
    ] = None,
    upstream: Annotated[
        str, typer.Option(help="Side of the photograph from which the flow comes: right or left.")
    ] = "right",
    roll: Annotated[str, typer.Option(help="Angle by which the photograph is turned, from right toward up.")] = "0 deg",
    backend: Backend = None,
    device: Device = None,
    precision: Precision = None,
    settings: Settings = None,
) -> None:
    """Make schlieren, shadowgraph and interferogram pictures.

    Rays are traced through the flow of a scene or a shipped flow.
    """
    from aerokernels.benches import read_picture
    from aerokernels.display.quantities import Quantity
    from aerokernels.files.writing import only_writer
    from aerokernels.jobs.pictures import KINDS, PictureOptions, make_pictures, picture_scene, write_pictures
    from aerokernels.jobs.store import check_output_folder

    options = PictureOptions(
        kinds=tuple(kind or KINDS),
        view=view if view in ("x", "y", "z") else _direction(view),  # type: ignore[arg-type]
        extent=None if extent is None else _numbers("--extent", extent, "length", 4),  # type: ignore[arg-type]
        width=None if width is None else _number("--width", width, "length"),
        pixel_count=pixels,
        rays_per_pixel=rays_per_pixel,
        spacing=None if spacing is None else _number("--spacing", spacing, "length"),
        knife_edge=knife_edge
        if knife_edge in ("vertical", "horizontal")
        else _number("--knife-edge", knife_edge, "angle"),
        cut_off=cut_off,
        sensitivity=sensitivity,
        exposure=exposure,
        screen_distance=_number("--screen", screen, "length"),
        source_angle=_number("--source-angle", source_angle, "angle"),
        fringe_spacing=None if fringes is None else _number("--fringes", fringes, "length"),
        fringe_angle=_number("--fringe-angle", fringe_angle, "angle"),
        shock_window=None if shock is None else _numbers("--shock", shock, "length", 2),  # type: ignore[arg-type]
        errors=errors,
    )
    photograph = None
    if measured is None:
        values = {"--pixel-size": pixel_size, "--nose": nose, "--upstream": upstream, "--roll": roll}
        defaults = {"--upstream": "right", "--roll": "0 deg"}
        if idle := [option for option, value in values.items() if value != defaults.get(option)]:
            raise ValueError(f"{', '.join(idle)}: needs a photograph; give one as --measured, or leave this out")
    else:
        if pixel_size is None or nose is None:
            raise ValueError(f"--measured {measured}: give --pixel-size and --nose too, which set its scale and place")
        photograph = read_picture(
            measured,
            pixel_size=_number("--pixel-size", pixel_size, "length"),
            nose=_numbers("--nose", nose, "dimensionless", 2),  # type: ignore[arg-type]
            upstream=upstream,
            roll=_number("--roll", roll, "angle"),
        )
    scene = picture_scene(place, scene_changes(backend, device, precision, None, settings))
    check_output_folder(out)
    with only_writer(out), shown_progress(scene.name) as progress:
        with naming_scene(place):
            bench = make_pictures(scene, options, measured=photograph, progress=progress)
        progress("writing the pictures", 0.9)
        files = write_pictures(bench, out)
    rows = [
        ("Pictures", ", ".join(bench.pictures)),
        ("Pixel", f"{1e3 * bench.line_of_sight.window.pitch[0]:.4g} mm"),
    ]
    for one, found_error in bench.pixel_errors.items():
        text = "not known" if found_error is None else "median {:.2g}, greatest {:.2g} of white".format(*found_error)
        rows.append((f"Error of the {one}", text))
    for words, result in (("Shock angle", bench.shock), ("Shock angle, photograph", bench.measured_shock)):
        if result is not None:
            angle = Quantity(math.degrees(result.angle), 2.0 * math.degrees(result.standard_error), "deg")
            rows.append((words, f"{angle} at {1e3 * result.place:.2f} mm"))
    if bench.comparison is not None:
        rows.append(("Correlation of the lower halves", f"{bench.comparison.correlation:.4f}"))
    print_table(scene.title or scene.name, ("quantity", "value"), rows)
    note(f"wrote {', '.join(files)} to {out}")


def _direction(text: str) -> tuple[float, ...]:
    if text.count(",") != 2:
        raise ValueError(f"--view {text!r}: give x, y or z, or a direction as three numbers, such as 1,0,0.2")
    return _numbers("--view", text, "dimensionless", 3)


def _number(option: str, text: str, dimension: str) -> float:
    from aerokernels.inputs.units import quantity

    try:
        number = quantity(text, dimension)
    except ValueError as error:
        raise ValueError(f"{option}: {error}") from None
    unit = {"length": "mm", "angle": "deg"}.get(dimension)
    if unit and number and not text.strip()[-1].isalpha():  # "2" would be 2 m, or 2 rad
        raise ValueError(f"{option} {text!r}: give a unit too, such as '{text.strip()} {unit}'")
    return number


def _numbers(option: str, text: str, dimension: str, count: int) -> tuple[float, ...]:
    parts = text.split(",")
    if len(parts) != count:
        raise ValueError(f"{option} {text!r}: give {count} values with commas between them")
    return tuple(_number(option, part, dimension) for part in parts)


COMMANDS = {"schlieren": schlieren}
