"""What is known while a function is written: the scenes of the place, its variables, and where they are declared."""

import ast
from typing import TYPE_CHECKING, Any

from .names import Names
from .source import Unsupported, module_of
from .types import Term
from .variables import Block, Use, homes

if TYPE_CHECKING:
    from .translator import Translator


class State:
    """The state of one function.

    Attributes:
        mask: The scenes of the place that is being written.
        here: The block of C of that place.
        types: The variables' types, by name.
        takes_arrays: Whether it takes struct Arrays.
        parts: Names and types of the parts of the tuple that it returns.
        defines: Macros of its numbers.
    """

    def __init__(self, translator: "Translator", names: Names, name: str, is_kernel: bool = False) -> None:
        """Begin a function, which `name` is in C."""
        self.translator, self.names, self.name, self.is_kernel = translator, names, name, is_kernel
        self.scenes, self.source, self.kinds = translator.scenes, names.source, translator.types
        self.module = module_of(names.functions[0][0])
        self.takes_arrays = False
        self.defines: dict[str, str] = {}
        self._uses: dict[str, list[Use]] = {}
        self._homes: dict[str, dict[Block, bool]] = {}
        self._changed: set[tuple[str, Block]] = set()  # variables that are assigned again

    def begin(self) -> None:
        """Begin to write it, with the homes of its variables as the uses in the previous pass have them."""
        self._homes = {name: homes(uses) for name, uses in self._uses.items()}
        self._uses = {}
        self.mask, self.here = self.names.full, ()
        self.types: dict[str, str] = {}
        self._declared: dict[tuple[str, Block], int] = {}
        self._waiting: dict[tuple[str, Block], str] = {}  # variables that are declared before the statement
        self.loops: set[str] = set()

    mask: int
    here: Block
    parts: list[tuple[str, str]]

    @property
    def point(self) -> str:
        """How members of given structs are reached: kernels have the structs, functions pointers to them."""
        return "." if self.is_kernel else "->"

    def fail(self, node: ast.AST, why: str) -> Unsupported:
        """Return the error for a node that has no translation."""
        return self.source.fail(self.name, node, why)

    def expr(self, node: Any) -> Term:
        """Return an expression in C."""
        raise NotImplementedError

    def argue(self, name: str, kind: str) -> None:
        """Take an argument."""
        self.types[name] = kind
        self._declared[name, ()] = self.names.full

    def count_in_loop(self, name: str, block: Block) -> None:
        """Take the variable of a loop."""
        self.types[name], self._declared[name, block] = "int", self.names.full
        self.loops.add(name)

    def use(self, name: str, is_stored: bool = False) -> None:
        """Note a use of a variable."""
        if name not in self.loops:
            self._uses.setdefault(name, []).append(Use(self.here, is_stored, self.mask))

    def change(self, name: str) -> None:
        """Note that a variable is no constant."""
        self._changed.add((name, self._home(name)))

    def waiting(self, block: Block) -> list[str]:
        """Return the declarations that come before the statement that was written last."""
        found = [key for key in self._waiting if key[1] == block]
        return [f"{self._waiting.pop(key)} {key[0]};" for key in found]

    def _home(self, name: str) -> Block:
        if any(each.arg == name for each in self.source.tree.args.args):
            return ()
        fits = [home for home in self._homes.get(name, {}) if self.here[: len(home)] == home]
        return max(fits, key=len) if fits else self.here

    def assign(self, name: str, value: Term, sign: str = "=") -> str:
        """Assign to a variable, and declare it where that is the first time."""
        if sign == "=":
            self.types.setdefault(name, value.type)
        self.use(name, sign == "=")
        home = self._home(name)
        there, at_once = self._declared.get((name, home), 0), self._homes.get(name, {}).get(home, True)
        if sign == "=" and not self.mask & there and home == self.here and at_once:
            self._declared[name, home] = there | self.mask
            self.types[name] = value.type or self.types[name]
            if "[" in self.types[name]:
                return f"{self.types[name].replace('[', f' {name}[')};"
            const = "" if (name, home) in self._changed else "const "
            return f"{const}{self.types[name]} {name} = {value.text};"
        if self.mask & ~there:
            self._declared[name, home] = there | self.names.full
            self._waiting[name, home] = self.types[name]
        self._changed.add((name, home))
        return f"{name} {sign} {value.text};"
