"""Options that all commands on a scene share, and how they change the scene."""

import contextlib
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from aerokernels.scene import Scene

SceneName = Annotated[
    str, typer.Argument(metavar="SCENE", help="A TOML file, the name of a shipped scene, or - for standard input.")
]
Backend = Annotated[str | None, typer.Option(help="auto, warp, opencl or reference.")]
Device = Annotated[str | None, typer.Option(help="cpu, cuda:0, or an OpenCL device's name; see `backends`.")]
Precision = Annotated[str | None, typer.Option(help="Precision of the kernels: float32 or float64.")]
Rays = Annotated[str | None, typer.Option(metavar="COUNT", help="Rays over the pupil for the Strehl ratio.")]
Settings = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help='Change a value of the scene: target.distance="1.2 m". Repeatable.'
    ),
]


def load_scene(
    place: str,
    backend: str | None = None,
    device: str | None = None,
    precision: str | None = None,
    rays: str | None = None,
    settings: list[str] | None = None,
) -> "Scene":
    """Load a scene with the changes of the command line; named options such as --device override --set.

    Raises:
        ValueError: A setting without `=`, or a scene that is not valid.
    """
    from aerokernels.scene import Scene

    return Scene.load(place, scene_changes(backend, device, precision, rays, settings))


def scene_changes(
    backend: str | None = None,
    device: str | None = None,
    precision: str | None = None,
    rays: str | None = None,
    settings: list[str] | None = None,
) -> dict[str, str]:
    """Return the changes that the command line makes to a scene, by dotted key.

    Raises:
        ValueError: A setting without `=`.
    """
    changes: dict[str, str] = {}
    for setting in settings or []:
        key, separator, value = setting.partition("=")
        if not (separator and key.strip()):
            raise ValueError(f"--set {setting!r} is not KEY=VALUE: write, say, --set target.distance='1.2 m'")
        changes[key.strip()] = value.strip()
    options = {
        "trace.backend": backend,
        "trace.device": device,
        "trace.precision": precision,
        "strehl.ray_count": rays,
    }
    return changes | {key: value for key, value in options.items() if value is not None}


@contextlib.contextmanager
def naming_scene(scene: str) -> Iterator[None]:
    """Prefix the scene's name to errors that show only during the computation, such as an absent device."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{scene}: {error}") from error
