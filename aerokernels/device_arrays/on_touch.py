"""Attributes that may hold an array on a device, but read as NumPy arrays."""

from collections.abc import Callable
from typing import Any, TypeVar

from .array import DeviceArray

C = TypeVar("C", bound=type)


class _OnTouch:
    """Descriptor of an array that is copied to the host when first read; the object's own dictionary holds it."""

    def __init__(self, name: str):
        self.name = name

    def __get__(self, instance: Any, owner: Any = None) -> Any:
        if instance is None:
            return None
        try:
            found = instance.__dict__[self.name]
        except KeyError:
            raise AttributeError(self.name) from None
        return found.host if isinstance(found, DeviceArray) else found

    def __set__(self, instance: Any, value: Any) -> None:
        instance.__dict__[self.name] = value


def read_on_touch(*names: str) -> Callable[[C], C]:
    """Decorate a data class: these fields may hold a DeviceArray, which reads as a NumPy array."""

    def decorate(target: C) -> C:
        for name in names:
            setattr(target, name, _OnTouch(name))
        return target

    return decorate
