"""Warp's devices, the types of its kernels, one set for each precision, and a cache of their functions and kernels."""

import functools
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import warp as wp

from ....process.opened import OPENED, Opened
from ....process.quiet_warp import start_warp
from ..info import NO_CUDA, BackendInfo, warp_processor
from ..layout import STRUCTS, Value, parts_of

PLAIN = {
    "bool": wp.bool,
    "int": wp.int32,
    "int2": wp.vec2i,
    "int3": wp.vec3i,
    "uint": wp.uint32,
    "double": wp.float64,
    "double2": wp.vec2d,
    "double3": wp.vec3d,
    "double4": wp.vec4d,
}


def _type_of(value: Value, kinds: dict):
    """Return Warp's type of a struct's member."""
    indices = parts_of(value.kind)[2]
    kind = kinds[value.kind.rstrip("*")]
    return wp.array(dtype=kind, ndim=indices) if indices else kind


def _types(real: type, shared: dict) -> SimpleNamespace:
    """Make the types of one precision; structs without `real` members are taken from the other precision, `shared`."""
    vectors = {f"real{size}": wp.types.vector(size, real) for size in (2, 3, 4)}
    kinds = {**PLAIN, "real": real, **vectors}
    for name, members in STRUCTS.items():
        if name in shared and not any(parts_of(member.kind)[0] == "real" for member in members):
            kinds[name] = shared[name]
            continue
        annotations = {member.name: _type_of(member, kinds) for member in members}
        kinds[name] = wp.struct(type(name, (), {"__annotations__": annotations, "__module__": __name__}))
    structs = {name: kinds[name] for name in STRUCTS}
    vectors = {name.replace("real", "vec"): kind for name, kind in vectors.items()}
    return SimpleNamespace(real=real, kinds=kinds, **vectors, **structs)


_DOUBLE = _types(wp.float64, {})
# The scalar, vector and struct types of each precision.
TYPES = {"float64": _DOUBLE, "float32": _types(wp.float32, _DOUBLE.kinds)}


@dataclass(frozen=True)
class Scene:
    """The options of layout.py for which kernels are built; None where kernels do not depend on them."""

    precision: str
    geometry: str | None = None
    interpolation: str | None = None
    on_mesh: bool | None = None
    method: str | None = None
    stop: str | None = None
    has_body: bool | None = None
    measured: bool | None = None
    cubes: bool | None = None
    channels: int | None = None

    @property
    def types(self) -> SimpleNamespace:
        """The types of its precision."""
        return TYPES[self.precision]


def built_once(*options: str) -> Callable[[Callable[[Scene], Any]], Callable[[Scene], Any]]:
    """Decorate a builder, `build(scene)`, which sees only these options besides the precision; results are cached.

    Raises:
        TypeError: At a call with a scene that lacks one of the options.
    """

    def decorate(build: Callable[[Scene], Any]) -> Callable[[Scene], Any]:
        @functools.wraps(build)
        def built(scene: Scene) -> Any:
            seen = {name: getattr(scene, name) for name in options}
            if None in seen.values():
                raise TypeError(f"{build.__name__} needs {', '.join(options)}, got {seen}")
            reduced = Scene(scene.precision, **seen)
            return OPENED.once("Warp functions", Opened).once((build, reduced), lambda: build(reduced))

        return built

    return decorate


def list_devices(memory: bool = False) -> list[BackendInfo]:
    """Return Warp's devices, CUDA devices first; with `memory`, including the memory of each."""
    start_warp()
    version, found = wp.__version__, []
    for device in wp.get_devices():
        if device.is_cuda:
            size, reason = device.total_memory if memory else None, "a GPU is preferred"
            found.append(BackendInfo("warp", device.alias, device.name, version, True, True, size, reason))
        else:
            reason = "a GPU is preferred" if wp.is_cuda_available() else NO_CUDA
            found.append(warp_processor(version, reason, memory))
    return sorted(found, key=lambda info: info.device == "cpu")
