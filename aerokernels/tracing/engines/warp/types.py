"""Make the data types of the Warp kernels, one set per precision, from the structs and kinds of layout.py."""

from types import SimpleNamespace

import warp as wp

from ..layout import STRUCTS, Value

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


def type_of(value: Value, kinds: dict):
    """Return Warp's type of a struct's member or a kernel's argument."""
    indices = value.parts[2]
    kind = kinds[value.kind.rstrip("*")]
    return wp.array(dtype=kind, ndim=indices) if indices else kind


def _types(real: type, shared: dict) -> SimpleNamespace:
    """Make the types of one precision; structs without `real` members are taken from the other precision, `shared`."""
    vectors = {f"real{size}": wp.types.vector(size, real) for size in (2, 3, 4)}
    kinds = {**PLAIN, "real": real, **vectors}
    for name, members in STRUCTS.items():
        if name in shared and not any(member.parts[0] == "real" for member in members):
            kinds[name] = shared[name]
            continue
        annotations = {member.name: type_of(member, kinds) for member in members}
        kinds[name] = wp.struct(type(name, (), {"__annotations__": annotations, "__module__": __name__}))
    structs = {name: kinds[name] for name in STRUCTS}
    vectors = {name.replace("real", "vec"): kind for name, kind in vectors.items()}
    return SimpleNamespace(real=real, kinds=kinds, **vectors, **structs)


_DOUBLE = _types(wp.float64, {})
TYPES = {"float64": _DOUBLE, "float32": _types(wp.float32, _DOUBLE.kinds)}


def types(precision: str) -> SimpleNamespace:
    """Return the scalar, vector and struct types of one precision, "float32" or "float64"."""
    return TYPES[precision]
