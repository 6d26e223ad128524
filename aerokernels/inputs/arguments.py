"""Check the kinds of a public function's or class's arguments before it runs, so that a mistake gets a clear message.

`@checked` reads a function's annotations, and the units of its parameters in its docstring ("[m]"). An argument of
another kind raises a TypeError that names the parameter, what it accepts and what was given, instead of one of NumPy's
messages about casts:

    Disc("6 mm")            radius must be a number of metres, got '6 mm': give 0.006 (in Disc)
    zernike_modes("a", ...) count must be a whole number, got 'a' (in zernike_modes)

Whole numbers (counts, sizes, seeds) may be given as floats: 1e6 arrives as 1000000, and 1.5 raises a ValueError. Other
single numbers arrive as Python's floats, whatever they are: NumPy computes in single precision with its own float32.

Numbers of the right kind that make a computation overflow (1e300) raise a ValueError that names them. The function
itself checks whether a number makes sense, and checks parameters that are objects of a class.

Parameters that many functions share are entries of a TypedDict: `**options: Unpack[TraceOptions]` takes each as a
keyword, which `inspect.signature` shows with its default, `TraceOptions.defaults[name]`.
"""

import functools
import inspect
import math
import re
import traceback
import typing
from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from aerokernels.inputs.kinds import (
    Kinds,
    is_number,
    members_of,
    only_dlpack,
    read_by_numpy,
    refuse_half_precision,
    refuse_masked,
    refuse_shuffled,
    shown,
)
from aerokernels.inputs.kinds import Numbers as Numbers
from aerokernels.process.opened import make_forks_safe

F = TypeVar("F", bound=Callable[..., Any])
# Beyond these, squares and products of four numbers leave float64's range; no physical quantity is near them.
GREAT, SMALL = 1e60, 1e-60
# Values that are no arrays of any library, by their exact type: most arguments.
_PLAIN = frozenset((int, float, str, bool, type(None)))
_PACKAGE = str(Path(__file__).resolve().parents[1])
# Numbers that need more digits than half precision has, beside all that have a unit.
_PRECISE = ("opd", "direction")
_UNIT = re.compile(r"^\s*`{0,2}(\w+)`{0,2}:[^\[\n]*\[([^\]\d,][^\],]*)\]", re.MULTILINE)
# Messages of Python and NumPy for numbers out of range, which name no argument.
_BARE = re.compile(r"cannot convert float (NaN|infinity) to integer|int too large|Maximum allowed (size|dimension)|"
                   r"array is too big|negative dimensions")  # fmt: skip


def checked(target: F) -> F:
    """Return the function, or class, with a check of its arguments before each call; see this module's docstring."""
    if isinstance(target, type):
        own = target.__init__  # type: ignore[misc]
        target.__init__ = _looking(own, target.__name__, lambda: own, target)  # type: ignore[misc]
        return target
    return typing.cast(F, _looking(target, _readable(target), lambda: target, target))


def _readable(function: Any) -> str:
    return function.__qualname__.removesuffix(".__init__").removesuffix(".__call__")


def _looking(function: Callable, name: str, described: Callable, documented: Any) -> Callable:
    takes: dict[str, Kinds] = {}  # parameters that are numbers, texts or booleans
    objects: dict[str, Kinds] = {}  # parameters that are objects of classes
    binding: Binding | None = None

    @functools.wraps(function)
    def call(*given: Any, **named: Any) -> Any:
        nonlocal binding
        if binding is None:
            make_forks_safe()
            for parameter, kinds in _taken(function, documented).items():
                (objects if kinds.has_classes else takes)[parameter] = kinds
            binding = Binding(_signature(described()))
        try:
            arguments = binding.bind(given, named)
        except TypeError:
            if wrong := _unknown_name(binding.signature, named):
                raise TypeError(f"{name} has no argument {wrong}") from None
            return function(*given, **named)  # raises Python's own message for missing or extra arguments
        if arrays := {key: value for key, value in arguments.items() if type(value) not in _PLAIN and key != "self"}:
            if read := read_by_numpy(arrays.values()):
                given = tuple(read.get(id(value), value) for value in given)
                named = {key: read.get(id(value), value) for key, value in named.items()}
                arguments = {key: read.get(id(value), value) for key, value in arguments.items()}
            refuse_shuffled(arrays)
        for parameter, value in arguments.items():
            if parameter in arrays:
                refuse_masked(value, parameter)
            if (taken := takes.get(parameter)) is not None:
                if parameter in arrays and (taken.unit or parameter in _PRECISE):
                    refuse_half_precision(value, parameter)
                if wrong := taken.mistake(value, parameter, name):
                    raise TypeError(wrong)
        plain = {}
        for parameter, value in arguments.items():
            if (known := takes.get(parameter) or objects.get(parameter)) is None:
                continue
            if known.are_numbers and (wrong := _out_of_proportion(value, parameter, name)):
                raise ValueError(wrong)
            if (number := known.plain(value, parameter, name)) is not value:
                plain[parameter] = number
        if plain:
            bound = binding.signature.bind(*given, **named)
            bound.arguments.update(plain)
            given, named, arguments = bound.args, bound.kwargs, arguments | plain
        try:
            return function(*given, **named)
        except (OverflowError, FloatingPointError, ZeroDivisionError) as error:
            raise ValueError(_out_of_range(name, arguments, error)) from error
        except (AttributeError, TypeError, ValueError, IndexError) as error:
            if _in_words(error):
                raise
            # Checked last, because many functions report more about an object than its class.
            for parameter, value in arguments.items():
                if parameter in objects and (wrong := objects[parameter].mistake(value, parameter, name)):
                    raise TypeError(wrong) from error
            for parameter, value in arguments.items():
                if only_dlpack(value):
                    what = f"{parameter} is a {type(value).__name__} that NumPy cannot read"
                    raise TypeError(f"{what}: copy it to the host (in {name})") from error
            if _BARE.search(str(error)):
                raise ValueError(_out_of_range(name, arguments, error)) from error
            raise

    if has_options(function):
        call.__signature__ = _signature(function)  # type: ignore[attr-defined]
    return call


def has_options(function: Callable) -> bool:
    """Whether a function takes the entries of a TypedDict as keywords."""
    return any(_is_shared(kind) for kind in getattr(function, "__annotations__", {}).values())


def _is_shared(annotation: Any) -> bool:
    return typing.get_origin(annotation) is typing.Unpack


def _signature(function: Callable) -> inspect.Signature:
    """The signature of a function, with the entries of a TypedDict in place of `**options: Unpack[...]`."""
    signature = inspect.signature(function)
    parameters: list[inspect.Parameter] = []
    for one in signature.parameters.values():
        if not _is_shared(one.annotation):
            parameters.append(one)
            continue
        (options,) = typing.get_args(one.annotation)
        for name, kind in options.__annotations__.items():
            new = inspect.Parameter(name, one.KEYWORD_ONLY, default=options.defaults[name], annotation=kind)
            parameters.append(new)
    return signature.replace(parameters=parameters)


def _unknown_name(signature: inspect.Signature, named: Iterable[str]) -> str:
    """Return the first named argument that a function does not take, with a suggestion; empty if it takes all."""
    known = [one.name for one in signature.parameters.values() if one.kind is not one.POSITIONAL_ONLY]
    if any(one.kind is one.VAR_KEYWORD for one in signature.parameters.values()):
        return ""
    for one in named:
        if one not in known:
            near = get_close_matches(one, known, 1, 0.5)
            return f"{one!r}: did you mean {near[0]}?" if near else f"{one!r}: it takes {', '.join(known)}"
    return ""


def _out_of_range(name: str, arguments: dict[str, Any], error: Exception) -> str:
    extreme = [f"{key} = {shown(value)}" for key, value in arguments.items() if _is_extreme(value)]
    what = ", ".join(extreme) or "its arguments"
    return f"{name} cannot be computed from {what}: a number is out of all proportion ({error})"


def _is_extreme(value: Any) -> bool:
    if is_number(value) or type(value) is int:
        return bool(value != value or abs(value) > GREAT or 0 < abs(value) < SMALL)
    if isinstance(value, (list, tuple)) and len(value) <= 16:
        return any(_is_extreme(one) for one in value)
    return False


def _out_of_proportion(value: Any, parameter: str, owner: str) -> str:
    """Return a message for a number too large for any computation, or for a seed that is negative."""
    if is_number(value):
        if math.isfinite(value) and abs(float(value)) > GREAT and parameter != "tolerance":  # may be any
            return f"{parameter} = {shown(value)} is out of all proportion (in {owner}): give at most {GREAT:g}"
        if parameter == "seed" and not value >= 0:
            return f"seed must be a whole number that is not negative, got {shown(value)} (in {owner})"
    return ""


def _in_words(error: Exception) -> bool:
    """Return whether a `raise` statement of this package raised the error, and not Python or NumPy."""
    where = traceback.extract_tb(error.__traceback__)[-1]
    return where.filename.startswith(_PACKAGE) and (where.line or "").startswith("raise")


def units_in(text: str) -> dict[str, str]:
    """Return the units of parameters or attributes, by name, from a docstring's lines like `radius: Radius [m]`."""
    return {name: unit for name, unit in _UNIT.findall(text) if len(unit) <= 24 and " of " not in unit}


def _taken(function: Callable, documented: Any) -> dict[str, Kinds]:
    """Return the kinds that each parameter accepts, if all of them are known."""
    shared = [
        typing.get_args(kind)[0] for kind in getattr(function, "__annotations__", {}).values() if _is_shared(kind)
    ]
    units = units_in("\n".join(filter(None, [one.__doc__ for one in (documented, function, *shared)])))
    found = {}
    for name, annotation in _annotations(function, documented).items():
        members = members_of(annotation)
        if name != "return" and members is not None:
            found[name] = Kinds(members, units.get(name, ""))
    return found


def _annotations(function: Callable, documented: Any) -> dict[str, Any]:
    found: dict[str, Any] = dict(getattr(function, "__annotations__", {}))
    names = getattr(inspect.unwrap(function), "__globals__", {})
    if isinstance(documented, type):  # a dataclass's __init__ does not have its module's globals
        names = vars(inspect.getmodule(documented))
    if has_options(function):
        (options,) = typing.get_args(next(filter(_is_shared, found.values())))
        found |= options.__annotations__
    for name, annotation in found.items():
        if isinstance(annotation, str):
            try:
                found[name] = eval(annotation, dict(names))
            except Exception:  # a name for type checkers only
                found[name] = Any
    return found


def seconds(values: np.ndarray) -> np.ndarray:
    """Return dates as float64 seconds since the first of them; spans of time and numbers as float64 seconds [s]."""
    if values.dtype.kind not in "mM":
        return np.asarray(values, dtype=np.float64)
    since = values - values[:1] if values.dtype.kind == "M" else values
    return np.asarray(since / np.timedelta64(1, "s"), dtype=np.float64)


class Binding:
    """The parameters of a function.

    Attributes:
        signature: The function's signature.
    """

    def __init__(self, signature: inspect.Signature):
        """Sort the parameters."""
        self.signature = signature
        parameters = signature.parameters.values()
        self._plain = all(
            each.kind in (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
            for each in parameters
        )
        self._in_order = [each.name for each in parameters if each.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD]
        self._names = [each.name for each in parameters]
        self._known = set(self._names)
        self._needed = {each.name for each in parameters if each.default is inspect.Parameter.empty}
        in_order = all(
            each.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD for each in parameters if each.name in self._needed
        )
        self._least = len(self._needed) if in_order else len(parameters) + 1  # positions that are enough without names

    def bind(self, given: tuple[Any, ...], named: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments by name, in the order of the parameters, without defaults.

        Raises:
            TypeError: They do not fit the parameters.
        """
        if self._plain and len(given) <= len(self._in_order):
            arguments = dict(zip(self._in_order, given, strict=False))
            if not named and len(given) >= self._least:
                return arguments
            count = len(arguments) + len(named)
            arguments.update(named)
            if len(arguments) == count and self._needed <= arguments.keys() <= self._known:
                return {name: arguments[name] for name in self._names if name in arguments}
        return dict(self.signature.bind(*given, **named).arguments)
