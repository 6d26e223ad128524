"""Provide a base for immutable objects that cache the results computed from them."""

from collections.abc import Callable, Hashable
from dataclasses import fields
from typing import Any

import numpy as np

from .read_only import ReadOnly

# Marks a key without a cached result, since a result may be None.
NOTHING = object()


class Derived(ReadOnly):
    """A base of immutable data classes that cache what later stages compute: bounds, tables, copies on a device.

    Each result is computed once, and lives as long as the object from which it was computed. Copies made by
    `dataclasses.replace` and by pickling start without results.
    """

    def derive(self, key: Hashable, make: Callable[[], Any], most: int | None = None) -> Any:
        """Return the result under this key, computed by `make()` at the first call.

        Args:
            key: Names the result among all of this object's; the first entry of a tuple names the kind.
            make: Computes the result from this object.
            most: Greatest number of results of the kind to cache, the latest; None for all.
        """
        cached: dict[Hashable, Any] = self.__dict__.setdefault("_derived", {})
        found = cached.get(key, NOTHING)
        if found is NOTHING:
            if most is not None:
                kind = key[0] if isinstance(key, tuple) else key
                keys: list[Hashable] = self.__dict__.setdefault("_alike", {}).setdefault(kind, [])
                keys.append(key)
                for _ in range(len(keys) - most):
                    cached.pop(keys.pop(0), None)
            # If two threads compute it at once, the first result is cached; a third may drop it before it is returned.
            found = cached.setdefault(key, make())
        return found

    def held(self, key: Hashable) -> Any:
        """Return the cached result under a key; None if there is none."""
        return self.__dict__.get("_derived", {}).get(key)

    def equals(self, other: Any) -> bool:
        """Return whether another object is of the same class and has equal fields."""
        if self is other or type(self) is not type(other):
            return self is other
        names = [entry.name for entry in fields(self)]  # type: ignore[arg-type]
        return all(_equal(getattr(self, name), getattr(other, name)) for name in names)


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other)
    return bool(one.equals(other) if isinstance(one, Derived) else one == other)
