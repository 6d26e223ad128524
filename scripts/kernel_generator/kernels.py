"""The kernels that are generated: how they are built, in which scenes, and into which file."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from aerokernels.tracing.engines.layout import OPTIONS

PLACE = "aerokernels.tracing.engines.warp.kernels"
GRID = ("cubic", "linear", "monotone")
PRECISIONS: dict[str, Sequence] = {"real_is_double": (0, 1)}
SCENE: dict[str, Sequence] = {
    **PRECISIONS,
    "geometry": OPTIONS["geometry"].choices,  # type: ignore[dict-item]
    "interpolation": OPTIONS["interpolation"].choices,  # type: ignore[dict-item]
    "on_mesh": (0, 1),
    "method": OPTIONS["method"].choices,  # type: ignore[dict-item]
    "stop": OPTIONS["stop"].choices,  # type: ignore[dict-item]
    "has_body": (0, 1),
    "measured": (0, 1),
}


class Program(NamedTuple):
    """Kernels of one file.

    Attributes:
        module: Where they are, below PLACE; the file has its name.
        kernels: Their names, each with the builder.
        options: Compile options and their values.
        is_valid: Which combinations there are.
        headers: Headers by hand that it needs.
    """

    module: str
    kernels: Mapping[str, str]
    options: Mapping[str, Sequence]
    is_valid: Callable[[dict], bool] = lambda _: True
    headers: tuple[str, ...] = ()


def is_scene(scene: dict) -> bool:
    """Whether there are such fields: meshes have interpolations of their own, and none fills a volume."""
    is_mesh = scene["interpolation"] not in GRID
    return bool(scene["on_mesh"]) == is_mesh and not (is_mesh and scene["geometry"] == "volume")


PROGRAMS = (Program("trace", {"trace_kernel": "build_kernel"}, SCENE, is_scene),)
