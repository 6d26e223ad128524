"""`aerokernels scenes`: list or copy the scenes that ship with the library."""

from pathlib import Path
from typing import Annotated

import typer

scenes = typer.Typer(
    name="scenes", help="List the shipped scenes, or copy one as a starting point.", add_completion=False
)


@scenes.callback(invoke_without_command=True)
def show(context: typer.Context) -> None:
    """List the shipped scenes, or copy one as a starting point."""
    if context.invoked_subcommand is not None:
        return
    from aerokernels.commands._table import print_table
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
    from aerokernels.commands._output import note
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
