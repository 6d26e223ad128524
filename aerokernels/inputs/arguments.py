"""Check the kinds of a public function's or class's arguments before it runs, so that a mistake gets a clear message.

`@checked` reads a function's annotations, and the units of its parameters in its docstring ("[m]"). Whole numbers may
be given as floats: 1e6 arrives as 1000000; other single numbers arrive as Python's floats, whatever they are: NumPy
computes in single precision with its own float32. Parameters that are objects of a class are checked by the function,
as is whether a number makes sense; those that many functions share are entries of a TypedDict, `**options:
Unpack[TraceOptions]`, which `inspect.signature` shows as keywords with the defaults `TraceOptions.defaults[name]`.
"""

import dis
import functools
import inspect
import math
import re
import typing
from collections.abc import Callable, Iterable
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from aerokernels.inputs.kinds import (
    Kinds,
    is_number,
    kinds_of,
    on_host,
    only_dlpack,
    refuse_half_precision,
    refuse_masked,
    shown,
)
from aerokernels.inputs.kinds import Numbers as Numbers  # public functions take both names from here
from aerokernels.process.forks import make_forks_safe

F = TypeVar("F", bound=Callable[..., Any])
# Beyond these, squares and products of four numbers leave float64's range; no physical quantity is near them.
GREAT, SMALL = 1e60, 1e-60
_PACKAGE = str(Path(__file__).resolve().parents[1])
_UNIT = re.compile(r"^\s*`{0,2}(\w+)`{0,2}:[^\[\n]*\[([^\]\d,][^\],]*)\]", re.MULTILINE)
_LISTS, _EXACT = (list, tuple), "fdbhilqBHILQ?"  # types of sequences, and of arrays of single precision or more
# Messages of Python and NumPy for numbers out of range, which name no argument.
_BARE = re.compile(r"cannot convert float (NaN|infinity) to integer|int too large|Maximum allowed (size|dimension)|"
                   r"array is too big|negative dimensions")  # fmt: skip


def checked(target: F) -> F:
    """Return the function, or class, with a check of its arguments before each call; see this module's docstring."""
    owner = target if isinstance(target, type) else None
    function = target if owner is None else owner.__init__  # type: ignore[misc]
    name = target.__qualname__.removesuffix(".__init__").removesuffix(".__call__") if owner is None else owner.__name__
    taken: dict[str, Kinds | None] = {}
    signature: inspect.Signature | None = None
    options = _options(function) if function.__code__.co_flags & inspect.CO_VARKEYWORDS else None

    @functools.wraps(function)
    def call(*given: Any, **named: Any) -> Any:
        nonlocal signature
        if signature is None:
            make_forks_safe()
            signature = _signature(function, options)
            taken.update(dict.fromkeys(signature.parameters), **_taken(function, target, options))
        try:
            if options is not None and not taken.keys() >= named.keys():
                signature.bind(*given, **named)
            changed = {}
            for parameter, value in (*zip(taken, given, strict=False), *named.items()):
                kinds, kind = taken.get(parameter), type(value)
                if kind is float or kind is int:
                    is_plain = kinds is None or (kind in kinds.plain_types and abs(value) <= GREAT)
                    is_plain = is_plain and parameter != "seed"
                elif kind is np.ndarray:
                    is_plain = kinds is None or (kinds.are_arrays and value.ndim and value.dtype.char in _EXACT)
                elif kinds is None:
                    is_plain = parameter == "self" or not (isinstance(value, _LISTS) or hasattr(value, "__dlpack__"))
                else:
                    is_plain = kind in kinds.plain_types
                if not is_plain and (accepted := _accepted(value, parameter, kinds, name)) is not value:
                    changed[parameter] = accepted
            if changed:
                given = tuple(changed.pop(parameter, value) for parameter, value in zip(taken, given, strict=False))
                named |= changed
            return function(*given, **named)
        except (ArithmeticError, AttributeError, TypeError, ValueError, IndexError) as error:
            try:
                arguments = signature.bind(*given, **named).arguments
            except TypeError:
                text = _documents(function, target, options)
                raise TypeError(_wrong_arguments(name, signature, given, named, text)) from None
            if _is_ours(error):
                raise
            # Objects are checked last, because many functions report more about an object than its class.
            for parameter, value in arguments.items():
                if (kinds := taken.get(parameter)) is not None and (wrong := kinds.mistake(value, parameter, name)):
                    raise TypeError(wrong) from error
                if only_dlpack(value):
                    what = f"{parameter} is a {type(value).__name__} that NumPy cannot read"
                    raise TypeError(f"{what}: copy it to the host (in {name})") from error
            if isinstance(error, ArithmeticError) or _BARE.search(str(error)):
                raise ValueError(_out_of_range(name, arguments, error)) from error
            raise

    if options is not None:
        call.__signature__ = _signature(function, options)  # type: ignore[attr-defined]
    if owner is None:
        return typing.cast(F, call)
    owner.__init__ = call  # type: ignore[misc]
    return target


def _options(function: Callable) -> Any:
    """Return the TypedDict whose entries a function takes as keywords, `**options: Unpack[...]`; None without one."""
    kinds: Iterable[Any] = function.__annotations__.values()
    return next((typing.get_args(kind)[0] for kind in kinds if typing.get_origin(kind) is typing.Unpack), None)


def _signature(function: Callable, options: Any) -> inspect.Signature:
    """Return the signature of a function, with the entries of a TypedDict in place of `**options`."""
    signature = inspect.signature(function)
    if options is None:
        return signature
    parameters = [one for one in signature.parameters.values() if one.kind is not one.VAR_KEYWORD]
    for name, kind in options.__annotations__.items():
        default = options.defaults[name]
        parameters.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind))
    return signature.replace(parameters=parameters)


def _accepted(value: Any, parameter: str, taken: Kinds | None, name: str) -> Any:
    """Return an argument as the function gets it; raises TypeError or ValueError with a message for a wrong one."""
    is_plain = type(value) in (int, float, str, bool, type(None))  # of no library of arrays, as most arguments
    if not is_plain and type(value) is not np.ndarray:
        value = on_host(value)
        refuse_masked(value, parameter)
    if taken is None:
        return value
    if not taken.has_classes:
        # Numbers that need more digits than half precision has.
        if not is_plain and (taken.unit or parameter in ("opd", "direction")):
            refuse_half_precision(value, parameter)
        if wrong := taken.mistake(value, parameter, name):
            raise TypeError(wrong)
    if taken.are_numbers and (wrong := _out_of_proportion(value, parameter, name)):
        raise ValueError(wrong)
    return taken.plain(value, parameter, name)


def _wrong_arguments(
    name: str, signature: inspect.Signature, given: Iterable[Any], named: dict[str, Any], text: str
) -> str:
    """Return a message for arguments that do not fit a signature: unknown, given twice, too many or missing."""
    taken = [one for one in signature.parameters.values() if one.name != "self"]
    known = [one.name for one in taken if one.kind is not one.POSITIONAL_ONLY]
    if not any(one.kind is one.VAR_KEYWORD for one in taken):
        for one in named:
            if one not in known:
                return f"{name} has no argument {one!r}: {_suggested(one, known)}"
    try:
        bound = signature.bind_partial(*given, **named)
    except TypeError as fault:  # too many, or one given twice
        first = ", ".join(one.name for one in taken if one.kind in (one.POSITIONAL_ONLY, one.POSITIONAL_OR_KEYWORD))
        return f"{name}: {fault}: in order it takes {first or 'nothing'}; give all others by name, name=value"
    absent = [one for one in taken if one.default is one.empty and one.name not in bound.arguments]
    needed = [one for one in absent if one.kind not in (one.VAR_POSITIONAL, one.VAR_KEYWORD)]
    return f"{name} needs {', and '.join(_about(one.name, text if len(needed) < 4 else '') for one in needed)}"


# What users write, as in other packages, for arguments of this one.
_MEANT = {
    "ray_count": "rays n n_rays num_rays samples",
    "wavelength": "wl lam lambda_",
    "pixel_count": "pixels npix resolution size",
    "tolerance": "tol",
    "spacing": "dx pitch",
    "precision": "dtype",
    "device": "gpu",
    "density": "rho",
    "center": "position",
    "normal": "axis",
}


def _suggested(name: str, known: list[str]) -> str:
    """Return what to write in place of the name of an argument that a function does not take."""
    if name == "diameter" and "radius" in known:
        return "give radius, half of it"
    near = [one for one in known if name in _MEANT.get(one, "").split()] or get_close_matches(name, known, 1, 0.65)
    if near:
        return f"did you mean {near[0]}?"
    of_scene = "; Scene.load(name, {'strehl.ray_count': 1e5}) changes the scene itself" if "scene" in known else ""
    return f"it takes {', '.join(known)}{of_scene}"


_EXAMPLES = {
    "field": 'flow.shipped("mach3").index_field(905e-9)', "pupil": "Disc(radius=6e-3)", "wavelength": "905e-9",
    "rays": "RayBundle.collimated(pupil, 10_000)", "normal": "(0, 0, 1)", "direction": "(0, 0, 1)", "radius": "6e-3",
    "point": "(0, 0, 10e-3)", "scene": '"wind-tunnel-mach3"', "spacing": "(1e-3, 1e-3, 1e-3)", "origin": "(0, 0, 0)",
    "geometry": '"volume"', "ambient_density": "1.225",
}  # fmt: skip


def _about(name: str, text: str) -> str:
    """Return a parameter's name with an example, or with the first sentence about it in a docstring."""
    if name in _EXAMPLES:
        return f"{name}, such as {name}={_EXAMPLES[name]}"
    end = r"(?:[.;](?:\s|$)|\n\s*\n|\Z)"
    found = re.search(rf"^\s*`{{0,2}}{name}`{{0,2}}:\s+(.+?){end}", text, re.MULTILINE | re.DOTALL)
    return f"{name} ({' '.join(found[1].split())})" if found else name


def _out_of_range(name: str, arguments: dict[str, Any], error: Exception) -> str:
    numbers = {key: value for key, value in arguments.items() if is_number(value) or type(value) is int}
    extreme = [
        f"{key} = {shown(value)}"
        for key, value in numbers.items()
        if value != value or abs(value) > GREAT or 0 < abs(value) < SMALL
    ]
    what = ", ".join(extreme) or "its arguments"
    return f"{name} cannot be computed from {what}: a number is out of all proportion ({error})"


def _out_of_proportion(value: Any, parameter: str, owner: str) -> str:
    """Return a message for a number too large for any computation, or for a seed that is negative."""
    if is_number(value):
        if math.isfinite(value) and abs(float(value)) > GREAT and parameter != "tolerance":  # may be any
            return f"{parameter} = {shown(value)} is out of all proportion (in {owner}): give at most {GREAT:g}"
        if parameter == "seed" and not value >= 0:
            return f"seed must be a whole number that is not negative, got {shown(value)} (in {owner})"
    return ""


def _is_ours(error: Exception) -> bool:
    """Return whether a `raise` statement of this package raised the error, and not Python or NumPy."""
    last = error.__traceback__
    while last is not None and last.tb_next is not None:
        last = last.tb_next
    if last is None:
        return False
    code = last.tb_frame.f_code
    return code.co_filename.startswith(_PACKAGE) and code.co_code[last.tb_lasti] == dis.opmap["RAISE_VARARGS"]


def units_in(text: str) -> dict[str, str]:
    """Return the units of parameters or attributes, by name, from a docstring's lines like `radius: Radius [m]`."""
    return {name: unit for name, unit in _UNIT.findall(text) if len(unit) <= 24 and " of " not in unit}


def _documents(*described: Any) -> str:
    """Return the docstrings of functions and classes; None has none."""
    return "\n".join([one.__doc__ or "" for one in described if one is not None])


def _taken(function: Callable, documented: Any, options: Any) -> dict[str, Kinds]:
    """Return the kinds that each parameter accepts, if all of them are known."""
    units = units_in(_documents(documented, function, options))
    annotations: dict[str, Any] = {
        **getattr(function, "__annotations__", {}),
        **getattr(options, "__annotations__", {}),
    }
    # A dataclass's __init__ does not have its module's globals.
    described = inspect.getmodule(documented) if isinstance(documented, type) else inspect.unwrap(function)
    names = getattr(described, "__globals__", vars(described))
    found = {}
    for name, annotation in annotations.items():
        if isinstance(annotation, str):
            try:
                annotation = eval(annotation, dict(names))
            except Exception:  # a name for type checkers only
                continue
        if name != "return" and (kinds := kinds_of(annotation, units.get(name, ""))) is not None:
            found[name] = kinds
    return found


def seconds(values: np.ndarray) -> np.ndarray:
    """Return dates as float64 seconds since the first of them; spans of time and numbers as float64 seconds [s]."""
    if values.dtype.kind not in "mM":
        return np.asarray(values, dtype=np.float64)
    since = values - values[:1] if values.dtype.kind == "M" else values
    return np.asarray(since / np.timedelta64(1, "s"), dtype=np.float64)
