"""Objects that never change, and hold what others have worked out of them."""

from collections.abc import Callable, Hashable
from dataclasses import fields
from typing import Any

import numpy as np

from .read_only import ReadOnly

# Of what is held under a key that nothing is held under.
NOTHING = object()


class Derived(ReadOnly):
    """A base of immutable data classes whose data is worked on by later stages: bounds, tables, copies on a device.

    Each such result is made once, and lives as long as the object that it was made of and no longer. Copies made by
    `dataclasses.replace` and by pickling begin without any.
    """

    def derive(self, key: Hashable, make: Callable[[], Any], most: int | None = None) -> Any:
        """What `make()` returns, made when it is first asked for under this key.

        Args:
            key: Names the result among all of this object's; where it is a tuple, its first entry names the kind.
            make: Works it out of this object.
            most: How many results of the kind are kept at most, the latest; None for all.
        """
        held: dict[Hashable, Any] = self.__dict__.setdefault("_derived", {})
        found = held.get(key, NOTHING)
        if found is NOTHING:
            if most is not None:
                kind = key[0] if isinstance(key, tuple) else key
                alike: list[Hashable] = self.__dict__.setdefault("_alike", {}).setdefault(kind, [])
                alike.append(key)
                for _ in range(len(alike) - most):
                    held.pop(alike.pop(0), None)
            # Of two threads that make it together one is heard; another one may drop it before it is returned.
            found = held.setdefault(key, make())
        return found

    def held(self, key: Hashable) -> Any:
        """What has been derived under a key; None where nothing has been."""
        return self.__dict__.get("_derived", {}).get(key)

    def equals(self, other: Any) -> bool:
        """Whether another object is of the same kind and has equal fields, so that either may stand for both."""
        if self is other or type(self) is not type(other):
            return self is other
        names = [entry.name for entry in fields(self)]  # type: ignore[arg-type]
        return all(_equal(getattr(self, name), getattr(other, name)) for name in names)


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other)
    return bool(one.equals(other) if isinstance(one, Derived) else one == other)
