"""Bind a call's arguments to a function's parameters, several times faster than `inspect.Signature.bind`."""

import inspect
from collections.abc import Mapping
from typing import Any

PLAIN = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)


class Binding:
    """The parameters of a function.

    Attributes:
        signature: The function's signature.
    """

    def __init__(self, signature: inspect.Signature):
        """Sort the parameters."""
        self.signature = signature
        parameters = signature.parameters.values()
        self._plain = all(each.kind in PLAIN for each in parameters)
        self._in_order = [each.name for each in parameters if each.kind is PLAIN[0]]
        self._names = [each.name for each in parameters]
        self._known = set(self._names)
        self._needed = {each.name for each in parameters if each.default is inspect.Parameter.empty}
        in_order = all(each.kind is PLAIN[0] for each in parameters if each.name in self._needed)
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
