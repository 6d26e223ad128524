"""What kernels reach: collects in which scenes each device function is called, and writes each once."""

import ast
from collections.abc import Callable
from types import CodeType
from typing import Any, NamedTuple

from .function import Function, Written
from .scenes import Scenes
from .source import Names, Source, is_device_function, module_of
from .types import Types


class Macro(NamedTuple):
    """A macro of the headers that are made from Python: its value in both precisions, and whether it is rounded."""

    values: tuple[float | None, float | None]
    is_real: bool


class Translator:
    """Translates kernels and all that they call.

    Attributes:
        scenes: The scenes of the kernels.
        precisions: The scenes of float32 and of float64.
        macros: The macros that numbers may be.
        taken: Names that functions must not define.
        types: Types in C.
        texts: What is written, by module, in order: pairs of scenes and text.
        places: The full name of each module.
        uses: The modules that each module uses.
        defined: Macros of numbers, by module.
        with_arrays: Functions that take struct Arrays because another of their name does.
    """

    def __init__(
        self, scenes: Scenes, macros: dict[str, Macro], taken: set[str], with_arrays: frozenset = frozenset()
    ) -> None:
        """Begin; `with_arrays` are the functions that an earlier translator found."""
        self.scenes, self.macros, self.taken, self.types = scenes, macros, taken, Types()
        self.precisions = scenes.where("real_is_double", 0), scenes.where("real_is_double", 1)
        self.texts: dict[str, list[tuple[int, str]]] = {}
        self.places: dict[str, str] = {}
        self.uses: dict[str, set[str]] = {}
        self.defined: dict[str, dict[str, str]] = {}
        self.with_arrays: set[CodeType] = set(with_arrays)
        self._made: dict[CodeType, dict[Callable, int]] = {}  # the functions of each code, and their scenes
        self._sources: dict[CodeType, Source] = {}
        self._written: dict[Any, Written] = {}
        self._names: dict[str, list[tuple[CodeType, int]]] = {}

    def source_of(self, function: Callable) -> Source:
        """Return the text of a function."""
        code = function.__code__
        if code not in self._sources:
            self._sources[code] = Source(function)
        return self._sources[code]

    def kernel(self, name: str, made: dict[Callable, int]) -> None:
        """Write a kernel, made in all scenes, with all that it calls."""
        self._reach(list(made.items()))
        for group in _by_code(list(made.items())).values():
            names = Names(self.source_of(group[0][0]), group)
            function = Function(self, names, name, is_kernel=True)
            self._write(function)

    def _reach(self, functions: list[tuple[Callable, int]]) -> None:
        """Collect what functions call: pairs of a Python function and its scenes."""
        for code, group in _by_code(functions).items():
            known, new = self._made.setdefault(code, {}), []
            for function, mask in group:
                fresh = mask & ~known.get(function, 0)
                if fresh:
                    known[function] = known.get(function, 0) | fresh
                    new.append((function, fresh))
            if new:
                names = Names(self.source_of(new[0][0]), new)
                self._walk(names, names.source.body, names.full)

    def _walk(self, names: Names, nodes: list, mask: int) -> None:
        for node in (part for each in nodes for part in names.source.branches_and_calls(each)):
            if isinstance(node, ast.If):
                yes, _ = names.split(node.test, mask)
                no = mask & ~names.surely(node.test, mask)
                self._walk(names, [node.test, *node.body] if yes else [], yes)
                self._walk(names, node.orelse if no else [], no)
                continue
            for value, where in names.values(node.func, mask):
                if is_device_function(value) and value.func is not None and not _is_by_hand(value):
                    self._reach([(value.func, where)])

    def emit(
        self,
        functions: list[tuple[Callable, int]],
        generic: tuple[str, ...] = (),
        wished: list[str | None] | None = None,
        is_one_of_several: bool = False,
    ) -> Written:
        """Write a function, and first all that it calls.

        Args:
            functions: Python's functions of one code, with their scenes.
            generic: The arguments' types, if it takes any.
            wished: Names for the parts of what it returns.
            is_one_of_several: Whether other functions stand for it in other scenes.
        """
        first = functions[0][0]
        code = first.__code__
        if (code, generic) not in self._written:
            names = Names(self.source_of(first), list(self._made[code].items()))
            name = "_".join([self._name_of(first, names.full), *generic])
            function = Function(self, names, name)
            function.generic, function.wished, function.is_one_of_several = generic, wished, is_one_of_several
            self._written[code, generic] = self._write(function)
        return self._written[code, generic]

    def _write(self, function: Function) -> Written:
        written, text = function.whole()
        self.texts.setdefault(function.module, []).append((function.names.full, text))
        self.places[function.module] = function.names.functions[0][0].__module__
        return written

    def use_module(self, module: str, functions: list[Callable]) -> None:
        """Note that a module calls functions of others."""
        self.uses.setdefault(module, set()).update({module_of(function) for function in functions} - {module})

    def _name_of(self, function: Callable, mask: int) -> str:
        """Return a function's name; one of the same name in the same scene gets its module's name, too."""
        code = function.__code__
        name = function.__name__
        others = self._names.setdefault(name, [])
        is_clash = any(other is not code and mask & where for other, where in others)
        others.append((code, mask))
        return f"{name}_in_{module_of(function)}" if is_clash else name


def _by_code(functions: list[tuple[Callable, int]]) -> dict[CodeType, list[tuple[Callable, int]]]:
    found: dict[CodeType, list[tuple[Callable, int]]] = {}
    for function, mask in functions:
        found.setdefault(function.__code__, []).append((function, mask))
    return found


def _is_by_hand(function: Any) -> bool:
    return bool(getattr(function, "native_snippet", None)) or function.func.__name__ == "advance"
