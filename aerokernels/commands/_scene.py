"""Options that all commands on a scene share, and how they change the scene."""

import contextlib
import re
from collections.abc import Iterator, Sequence
from typing import Annotated

import typer

SceneName = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="A TOML file, the summary.json of a run, the name of a shipped scene, or - for standard input.",
    ),
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


def scene_changes(
    backend: str | None, device: str | None, precision: str | None, rays: str | None, settings: list[str] | None
) -> dict[str, str]:
    """Return the changes that the command line makes to a scene, by dotted key; --device and others override --set."""
    changes: dict[str, str] = {}
    for setting in settings or []:
        key, separator, value = setting.partition("=")
        if not (separator and key.strip()):
            raise ValueError(f"--set {setting!r} is not KEY=VALUE: write, say, --set target.distance='1.2 m'")
        changes[key.strip()] = value.strip()
    trace = {"trace.backend": backend, "trace.device": device, "trace.precision": precision}
    options = {**trace, "strehl.ray_count": rays}
    return changes | {key: value for key, value in options.items() if value is not None}


@contextlib.contextmanager
def naming_scene(scene: str) -> Iterator[None]:
    """Prefix the scene's name to errors that show only during the computation, such as an absent device."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{scene}: {error}") from error


_SPAN = re.compile(r"(.+):(.+):(\d+)")


def parse_vary(options: Sequence[str]) -> dict[str, list]:
    """Parse the command line's --vary options into a list of values for each key.

    A value may be written as in a scene file ("10 deg", 0.3, '["piston", "tilt"]'). LOW:HIGH:COUNT means COUNT values
    of a quantity, evenly spaced from LOW to HIGH.
    """
    from aerokernels.scene.scene import key_dimension

    result: dict[str, list] = {}
    for option in options:
        key, separator, text = option.partition("=")
        key = key.strip()
        if not (separator and key and text.strip()):
            raise ValueError(
                f"--vary {option!r} is not KEY=V1,V2,...: write, say, --vary target.tilt='0 deg,10 deg,20 deg'"
            )
        if key in result:
            raise ValueError(f"--vary {key} is given twice: write all its values in one, {key}=V1,V2,...")
        span = _SPAN.fullmatch(text.strip())
        if span and key_dimension(key) is not None:
            result[key] = _spaced(key, text, *span.groups())
        else:
            result[key] = [part.strip() for part in split_at_commas(text)]
    return result


def split_at_commas(text: str) -> list[str]:
    """Split a text at the commas that are outside brackets and quotes."""
    parts, depth, quote = [""], 0, ""
    for letter in text:
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter in "[{":
            depth += 1
        elif letter in "]}":
            depth -= 1
        if letter == "," and depth == 0 and not quote:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def _spaced(key: str, text: str, low: str, high: str, count: str) -> list[float]:
    from aerokernels.scene.scene import key_value

    first, last, number = key_value(key, low), key_value(key, high), int(count)
    if not isinstance(first, float) or not isinstance(last, float) or number < 2 or first == last:
        raise ValueError(
            f"--vary {key}={text}: write LOW:HIGH:COUNT with two quantities and at least 2 values, such as "
            "target.tilt='0 deg:30 deg:7'"
        )
    return [first + (last - first) * k / (number - 1) for k in range(number - 1)] + [last]
