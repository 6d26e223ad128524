"""Results of functions, cached on one of their arguments under a key of all others: `@cached_on("field")`."""

from collections.abc import Callable, Hashable, Iterable
from dataclasses import fields, is_dataclass
from hashlib import blake2b
from inspect import signature
from types import FunctionType
from typing import Any, Generic, ParamSpec, TypeVar
from weakref import ref

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

NOTHING = object()  # marks a key without a result, since a result may be None


class Cached(Generic[P, R]):
    """What `cached_on` makes of a function, which is its `function`."""

    def __init__(self, function: Callable[P, R], owner: str, most: int):
        """Take the function, the name of its parameter that owns the results, and how many of them to cache."""
        self.function, self.most = function, most
        self.place = list(signature(function).parameters).index(owner)
        self.__doc__ = function.__doc__

    def __call__(self, *arguments: P.args, **named: P.kwargs) -> R:
        """Return the result for these arguments; the owner is given by position."""
        results = arguments[self.place].__dict__.setdefault("_derived", {}).setdefault(self.function, {})
        key = len(named), *keys_of((*arguments[: self.place], *arguments[self.place + 1 :], *named, *named.values()))
        cached = results.get(key, NOTHING)
        return _keep(results, key, self.function(*arguments, **named), self.most) if cached is NOTHING else cached

    def keep(self, result: R, owner: Any) -> None:
        """Let this be the result for an owner and no other arguments, unless there is one."""
        _keep(owner.__dict__.setdefault("_derived", {}).setdefault(self.function, {}), (0,), result, self.most)


def cached_on(owner: str, most: int = 1) -> Callable[[Callable[P, R]], Cached[P, R]]:
    """Return a decorator of functions that caches their latest results on one of their arguments, with which they die.

    The key of a result is made of all other arguments by `keys_of`, so that no call finds the result of another one.
    Threads may call the function: two may compute one result, of which the first is taken by both. `owner` is the name
    of the parameter that owns the results, an object that never changes; `most` of them are cached.
    """
    return lambda function: Cached(function, owner, most)


def key_of(value: Any) -> Hashable:
    """Return what identifies a value by `keys_of`."""
    return keys_of((value,))[0]


def keys_of(values: Iterable[Any]) -> tuple[Hashable, ...]:
    """Return what identifies arguments: type and content, or weakly an object itself where that never changes.

    A TypeError refuses an object that may change, and a function that hides what it depends on.
    """
    keys: list[Hashable] = []
    for value in values:
        kind, key = type(value), value
        if value is None or kind is str:
            pass
        elif kind in (bool, int, bytes, frozenset):
            key = kind, value
        elif kind is float:
            key = kind, value.hex()  # 0.0 and -0.0 are equal
        elif isinstance(value, (tuple, list)):
            key = kind, *keys_of(value)
        elif isinstance(value, (np.ndarray, np.generic)):
            content = value.tobytes()
            key = value.dtype.str, value.shape, content if len(content) <= 256 else blake2b(content).digest()
        elif isinstance(value, slice):  # cannot be hashed
            key = kind, value.start, value.stop, value.step
        elif hasattr(kind, "key"):
            key = kind, value.key
        elif isinstance(value, dict):
            key = kind, *value, *keys_of(value.values())
        elif is_dataclass(kind) and kind.__eq__ is not object.__eq__:
            key = kind, *keys_of([getattr(value, name) for name in kind.__dataclass_fields__])
        elif isinstance(value, ReadOnly):
            key = ref(value)
        elif not (isinstance(value, (type, np.dtype)) or (isinstance(value, FunctionType) and not value.__closure__)):
            raise TypeError(f"{kind.__name__} is no argument of a cached function: pass what the result depends on")
        keys.append(key)
    return tuple(keys)


class ReadOnly:
    """A data class whose arrays are read-only, also after pickling and copying.

    A pickle contains the fields only; cached results are computed again when needed.
    """

    def set_fields(self, **values: Any) -> None:
        """Set fields in `__post_init__`; arrays become read-only."""
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
            object.__setattr__(self, name, value)

    def __getstate__(self) -> dict:
        """Return the fields by name."""
        return {entry.name: getattr(self, entry.name) for entry in fields(self)}  # type: ignore[arg-type]

    def __setstate__(self, state: dict) -> None:
        """Set the fields; arrays are made read-only again, because NumPy does not pickle that flag."""
        self.set_fields(**state)


class Derived(ReadOnly):
    """A base of immutable data classes that cache what later stages compute: bounds, tables, copies on a device.

    Each result lives as long as the object from which it was computed. Copies made by `dataclasses.replace` and by
    pickling start without results.
    """

    def derive(self, key: Hashable, make: Callable[[], Any], most: int | None = None) -> Any:
        """Return the result under a key, computed by `make()` at the first call; `cached_on` makes keys by itself.

        The first entry of a tuple names the kind of result, of which `most` are cached, all if None.
        """
        results = _results(self, key[0] if isinstance(key, tuple) else key)
        cached = results.get(key, NOTHING)
        return _keep(results, key, make(), most) if cached is NOTHING else cached

    def held(self, key: Hashable) -> Any:
        """Return the cached result under a key; None if there is none."""
        return _results(self, key[0] if isinstance(key, tuple) else key).get(key)

    def equals(self, other: Any) -> bool:
        """Return whether another object is of the same class and has equal fields."""
        if self is other or type(self) is not type(other):
            return self is other
        names = [entry.name for entry in fields(self)]  # type: ignore[arg-type]
        return all(_equal(getattr(self, name), getattr(other, name)) for name in names)


def _results(owner: Any, kind: Hashable) -> dict[Hashable, Any]:
    """The results of one kind that are cached on an object, by key."""
    results: dict[Hashable, Any] = owner.__dict__.setdefault("_derived", {}).setdefault(kind, {})
    return results


def _keep(results: dict[Hashable, Any], key: Hashable, result: Any, most: int | None) -> Any:
    """Cache a result, unless there is one under its key, and return what is cached; drop the oldest above `most`."""
    kept = results.setdefault(key, result)
    for old in list(results)[: 0 if most is None else max(0, len(results) - most)]:
        results.pop(old, None)  # another thread may have dropped it
    return kept


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other)
    return bool(one.equals(other) if isinstance(one, Derived) else one == other)
