"""The kinds of value that a parameter accepts: numbers, whole numbers, texts, arrays, tuples, functions and objects."""

import functools
import math
import types
import typing
from collections.abc import Callable, Iterable, Iterator, Sequence
from numbers import Real
from typing import TYPE_CHECKING, Any, SupportsFloat, Union

import numpy as np
from numpy.typing import ArrayLike

if TYPE_CHECKING:
    Numbers = ArrayLike
else:

    class Numbers:
        """Annotation of a parameter: real numbers in an array of any shape, or anything NumPy converts to one."""


_GREAT = 10**308  # greater whole numbers are no float64; Python would compute a power at each use


class Kinds:
    """The kinds of value that a parameter accepts; an annotation that is not known here accepts everything."""

    def __init__(self, members: Iterable[Any], unit: str):
        """Keep the members of an annotation, and the unit of the parameter."""
        self.members = tuple(members)
        self.unit = "" if Callable in self.members else unit  # that of a function's description is its argument's
        self.are_numbers = float in self.members or int in self.members
        # Whether it accepts objects of classes, or tuples.
        classes = {one for one in self.members if isinstance(one, (type, tuple))} - {*_NOUNS, float, int}
        self.has_classes = bool(classes)
        self.are_arrays = np.ndarray in self.members and not classes
        # Types of values that are accepted as they are.
        self.plain_types = {str, bool, type(None), float, int}.intersection(self.members)
        if float in self.members:
            self.plain_types.add(int)

    def plain(self, value: Any, parameter: str, owner: str) -> Any:
        """Return the value; a single number as Python's float or, where only whole ones make sense, as its int.

        What is computed from one of NumPy's float32 alone would be in single precision. Raises a ValueError for a float
        that is not whole.
        """
        if type(value) is int or (type(value) is float and float in self.members):
            return value
        if self.are_numbers and is_number(value):
            return float(value) if float in self.members else _whole(value, parameter, owner)
        for kind in self.members:
            if isinstance(kind, tuple) and int in kind and _takes(kind, value) and any(map(_is_float, value)):
                return tuple(_whole(one, parameter, owner) for one in value)
        return value

    def mistake(self, value: Any, parameter: str, owner: str) -> str:
        """Return a message for a value that none of the kinds accepts; empty for an accepted one."""
        for kind in self.members:
            if _takes(kind, value):
                return ""
        wanted = " or ".join(dict.fromkeys(_described(kind, self.unit) for kind in self.members))
        remedy = _remedy(value, self.members) or _made_from(value, parameter)
        given = f"{shown(value)}{remedy}"
        if np.ndarray in self.members and array_kind(value) == "c":
            given += ", which is complex"
        return f"{parameter} must be {wanted}, got {given} (in {owner})"


@functools.cache
def kinds_of(annotation: Any, unit: str) -> Kinds | None:
    """Return the kinds that a parameter of an annotation and a unit accepts; None if one of them is not known here."""
    members = _members_of(annotation)
    return None if members is None else Kinds(members, unit)


def _members_of(annotation: Any) -> list[Any] | None:
    """Return the kinds of an annotation, a union as its members; None if one of them is not known here."""
    if annotation in (Numbers, ArrayLike):
        return [np.ndarray]
    origin = typing.get_origin(annotation)
    if origin in (Union, types.UnionType):
        parts = [_members_of(part) for part in typing.get_args(annotation)]
        return None if None in parts else [kind for part in parts for kind in part or ()]
    if origin is tuple:
        parts_of = typing.get_args(annotation)
        return [parts_of] if parts_of and {float, int}.issuperset(parts_of) else None
    if origin is Callable:
        return [Callable]
    if annotation in (None, type(None)):
        return [type(None)]
    if annotation is SupportsFloat or annotation is np.ndarray:
        return [float if annotation is SupportsFloat else np.ndarray]
    if annotation is Any or origin is not None or not isinstance(annotation, type):
        return None
    return None if getattr(annotation, "_is_protocol", False) else [annotation]


def _takes(kind: Any, value: Any) -> bool:
    if kind in (float, int):
        return is_number(value)  # 1e4 may be a count
    if kind is bool:
        return isinstance(value, (bool, np.bool_)) or (type(value) is int and value in (0, 1))
    if kind is np.ndarray:
        return are_numbers(value)
    if isinstance(kind, tuple):
        sized = isinstance(value, (tuple, list)) or (isinstance(value, np.ndarray) and value.ndim == 1)
        return sized and len(value) == len(kind) and all(is_number(one) for one in value)
    if kind is Callable:
        return callable(value)
    return value is None if kind is type(None) else isinstance(value, kind)


def is_number(value: Any) -> bool:
    """Return whether a value is one real number, but not True or False."""
    if isinstance(value, (bool, np.bool_)):
        return False
    if type(value) is int:
        return abs(value) < _GREAT
    if isinstance(value, Real):
        return True
    return getattr(value, "shape", None) == () and getattr(getattr(value, "dtype", None), "kind", "") in "iuf"


def _is_float(value: Any) -> bool:
    return is_number(value) and not isinstance(value, (int, np.integer))


def are_numbers(value: Any) -> bool:
    """Return whether NumPy converts a value to an array of real numbers."""
    if getattr(getattr(value, "dtype", None), "kind", None) is None:
        if hasattr(value, "__dlpack__"):  # an array of another library or device: the function that uses it checks it
            return True
        if isinstance(value, (str, bytes, dict, set, type)) or callable(value):
            return False
    return array_kind(value) in tuple("iufb")


def array_kind(value: Any) -> str:
    """Return the kind of number of an array, as NumPy abbreviates it; empty where NumPy makes none of the value."""
    kind = getattr(getattr(value, "dtype", None), "kind", None)
    try:
        return np.asarray(value).dtype.kind if kind is None else str(kind)
    except (ValueError, TypeError, OverflowError):  # rows of different lengths, among others
        return ""


def as_whole(value: Any) -> int | None:
    """Return a whole number, which may be given as a float such as 1e6; None for any other value, and for True."""
    if not is_number(value) or not (isinstance(value, (int, np.integer)) or float(value).is_integer()):
        return None
    return int(value)


def _whole(value: Any, parameter: str, owner: str) -> int:
    if (number := as_whole(value)) is None:
        raise ValueError(f"{parameter} must be a whole number, got {shown(value)} (in {owner})")
    return number


_WORDS = {"m": "metres", "rad": "radians", "s": "seconds", "K": "kelvins", "Pa": "pascals", "W": "watts"}
_NOUNS = {str: "a text", bool: "True or False", type(None): "None", np.ndarray: "real numbers", Callable: "a function"}


# What makes the wanted object of a given one: by parameter and the given object's class; {0} is the value.
_SWAPPED = "the field comes first, then the pupil or the rays"
_NUMBER, _ARRAY, _FIELD, _FLOW = ("float", "int"), ("ndarray", "list", "tuple"), "IndexField", "DensityField"
_MADE_FROM = (
    ("field", (_FLOW,), "call .index_field(wavelength) of it"),
    ("field", ("Series",), "take one snapshot, series[0].index_field(wavelength)"),
    ("field", ("Scene",), "call .density_field().index_field(wavelength) of it"),
    ("field", ("Pupil", "RayBundle"), _SWAPPED),
    ("field", ("str", "Path"), "flow.shipped({0}) or flow.read({0}), then .index_field(wavelength), makes one"),
    ("field", _ARRAY, "IndexField.from_samples(contrast, origin=..., spacing=..., geometry=...) makes one"),
    ("pupil", _NUMBER, "write Disc(radius={0}), in meters"),
    ("pupil", (_FIELD, _FLOW), _SWAPPED),
    ("pupil", ("RayBundle",), "give the pupil itself, and the number of rays as ray_count"),
    ("pupil", _ARRAY, "Mask(weights, pixel) makes a pupil of an array, Disc(radius=...) a disc"),
    ("pupil", (), "Disc(radius=6e-3) makes one"),
    ("rays", ("Pupil",), "RayBundle.collimated(pupil, 10_000) makes rays of it"),
    ("rays", _NUMBER, "RayBundle.collimated(pupil, {0}) makes so many"),
    ("rays", (_FIELD, _FLOW), _SWAPPED),
    ("rays", _ARRAY, "RayBundle(position, direction) makes them of two arrays of shape (ray_count, 3)"),
    ("ray_count", ("Pupil",), "the pupil comes first, then the number of rays"),
    ("scene", (_FIELD, _FLOW), 'give a scene, such as "wind-tunnel-mach3", and this as field=...'),
    ("scene", ("str", "Path"), "Scene.load({0}) makes one"),
    ("series", (_FIELD, _FLOW), "it is one field in time; flow.open_series(pattern) opens its snapshots"),
    ("series", ("str", "Path"), "flow.open_series({0}) opens one"),
    ("series", (), "flow.open_series opens one"),
    ("contrast", ("str", "Path"), "np.load({0}) reads an array"),
    ("density", ("str", "Path"), "np.load({0}) reads an array"),
    ("until", _NUMBER, "write Plane((0, 0, {0}), (0, 0, 1)) or ArcLength({0}), in meters"),
    ("until", _ARRAY, "write Plane(point, normal)"),
)  # fmt: skip


def wrong_kind(value: Any, name: str, wanted: str) -> TypeError:
    """Return the error for an object of a wrong class; its message says how to make the wanted one."""
    return TypeError(f"{name} must be {wanted}, got {type(value).__name__}{_made_from(value, name)}")


def _made_from(value: Any, name: str) -> str:
    """Return what makes the object that a parameter needs of a value, after a colon; empty where that is not known."""
    classes = {one.__name__ for one in type(value).__mro__}
    for parameter, kinds, remedy in _MADE_FROM:
        if parameter == name and (not kinds or classes & set(kinds)):
            return f": {remedy.format(shown(value))}"
    return ""


def _described(kind: Any, unit: str) -> str:
    of_unit = f" of {_WORDS.get(unit, unit)}" if unit else ""
    if kind is float:
        return f"a number{of_unit}"
    if kind is int:
        return "a whole number"
    if kind is np.ndarray:
        return f"an array of real numbers{of_unit}"
    if isinstance(kind, tuple):
        return f"{len(kind)} {'whole ' if int in kind else ''}numbers{of_unit}"
    return _NOUNS.get(kind) or f"{'an' if kind.__name__[0] in 'AEIOU' else 'a'} {kind.__name__}"


def shown(value: Any) -> str:
    """Return a value for a message: shortened, on one line, without ever raising."""
    if isinstance(value, type):
        return f"the class {value.__name__}"
    if isinstance(value, np.ndarray):
        return f"dtype {value.dtype} of shape {value.shape}"
    if isinstance(value, int) and abs(value) >= 10**30:
        return f"a whole number of {int(math.log10(abs(value))) + 1} digits"
    try:
        text = repr(value)
        text = f"a {type(value).__name__}" if "\n" in text else text
    except Exception:
        text = f"a {type(value).__name__}"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _remedy(value: Any, members: Sequence[Any]) -> str:
    """Return the SI number for a text with a unit, given where a number is needed, as a suggestion."""
    if not (isinstance(value, str) and {float, int, np.ndarray} & set(members)):
        return ""
    from .units import DIMENSIONS, quantity

    for dimension in DIMENSIONS:
        try:
            return f": give {quantity(value, dimension):.9g}"
        except ValueError:
            continue
    return ""


def only_dlpack(value: Any) -> bool:
    """Return whether a value is an array of another library that `numpy.asarray` does not read."""
    if isinstance(value, type) or not hasattr(value, "__dlpack__"):
        return False
    return not (hasattr(value, "__array__") or hasattr(value, "__array_interface__"))


def on_host(value: Any) -> Any:
    """Return a NumPy array, without a copy, of an array in the computer's memory that is known by DLPack alone.

    Other values, and those on a device, are left to the functions that accept them.
    """
    in_memory = 1  # DLPack's number of the computer's own memory
    return np.from_dlpack(value) if only_dlpack(value) and int(value.__dlpack_device__()[0]) == in_memory else value


def refuse_masked(value: Any, name: str) -> None:
    """Raise a ValueError for an array with masked numbers: NumPy would compute with the values under the mask."""
    for part in _parts(value) if isinstance(value, (list, tuple)) else (value,):
        if isinstance(part, np.ma.MaskedArray) and np.ma.is_masked(part):
            count, within = int(np.ma.count_masked(part)), "" if part is value else "an entry of "
            raise ValueError(
                f"{count} of the {part.size} numbers of {within}{name} are masked, so they are not known: fill them "
                f"in, or leave them out ({name}.filled(value), {name}.compressed())"
            )


def refuse_half_precision(value: Any, name: str) -> None:
    """Raise a ValueError for an array of half precision, in which an OPD of nanometres has one digit or none."""
    for part in _parts(value):
        kind = str(getattr(part, "dtype", ""))
        if kind.endswith("float16"):
            within = "" if part is value else "an entry of "
            raise ValueError(f"{within}{name} is {kind}, which has three digits at most: give float32 or float64")


def _parts(value: Any) -> Iterator[Any]:
    """Yield a value, or the entries of a list or tuple and of those within it, without plain numbers."""
    if isinstance(value, (list, tuple)):
        for entry in value:
            if type(entry) not in (float, int, str):
                yield from _parts(entry)
    else:
        yield value
