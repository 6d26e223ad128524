"""What is known while a function is written: the scenes of the place, its variables, and where they are declared."""

import ast
import re
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

import warp as wp

from .scenes import Facet
from .source import Names, Unsupported, is_static, module_of, parts_of
from .types import ATOM, CHOICE, UNARY, Term, base, width

if TYPE_CHECKING:
    from .translator import Translator

# A block of C: the ifs and loops around it, each with the number of its branch.
Block = tuple[tuple[int, int], ...]
COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!="}


class Use(NamedTuple):
    """A use of a variable: the block, whether it is assigned there, and the scenes."""

    block: Block
    is_stored: bool
    mask: int


def homes(uses: list[Use]) -> dict[Block, bool]:
    """Return the blocks that declare a variable, each with whether its first assignment there does so.

    Later blocks that begin with an assignment declare it again if nothing behind them uses what they assign.
    """
    shared = shared_block([use.block for use in uses])
    runs: list[tuple[Block, list[Use]]] = []  # neighbouring uses in the same block below
    for use in uses:
        child = use.block[: len(shared) + 1]
        if runs and runs[-1][0] == child:
            runs[-1][1].append(use)
        else:
            runs.append((child, [use]))
    found: dict[Block, bool] = {}
    while runs and len(runs[-1][0]) > len(shared):
        last = runs[-1][1]
        inner, own = homes(last), shared_block([use.block for use in last])
        if not (last[0].is_stored and last[0].block == own and inner.get(own)):
            break
        found |= inner
        runs.pop()
    rest = [use for _, run in runs for use in run]
    if not rest:
        return found
    if found and shared_block([use.block for use in rest]) != shared:
        return {**found, **homes(rest)}
    declared, at_once = 0, True
    for block, is_stored, mask in rest:
        if mask & ~declared:
            at_once = at_once and is_stored and block == shared and not mask & declared
            declared |= mask
    return {**found, shared: at_once}


def shared_block(blocks: list[Block]) -> Block:
    """Return the innermost block that has all of them."""
    least = min(blocks, key=len)
    for k, part in enumerate(least):
        if any(block[k] != part for block in blocks):
            return least[:k]
    return least


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
            if value.type.endswith("]"):
                kind, size = value.type.split("[")
                return f"{kind} {name}[{size};"
            const = "" if (name, home) in self._changed else "const "
            return f"{const}{self.types[name]} {name} = {value.text};"
        if self.mask & ~there:
            self._declared[name, home] = there | self.names.full
            self._waiting[name, home] = self.types[name]
        self._changed.add((name, home))
        return f"{name} {sign} {value.text};"

    def condition(self, wanted: int, within: int, test: ast.AST) -> str:
        """Return a condition for #if: as the source has it, if that says it, else the shortest."""
        known = [part for part in parts_of(test) if self.names.truth(part, within) is not None]
        text = " && ".join(filter(None, (self._as_written(part) for part in known)))
        with suppress(NameError, SyntaxError):  # a name that is no option
            if text and self.scenes.mask_of(text) & within == wanted:
                return text
        return self.scenes.condition(wanted, within)

    def _as_written(self, node: Any) -> str:
        """Return a comparison of an option, or a macro, in C; "" for anything else."""
        if isinstance(node, ast.Call):
            return self._as_written(node.args[0]) if is_static(node) else ""
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            inner = self._as_written(node.operand)
            return f"!{inner}" if inner.isidentifier() else ""
        if isinstance(node, ast.BoolOp):
            parts = [self._as_written(each) for each in node.values]
            sign = " && " if isinstance(node.op, ast.And) else " || "
            return sign.join(parts) if all(parts) and not any("|" in each for each in parts) else ""
        if isinstance(node, ast.Name):
            return node.id.upper() if node.id.upper() in self.scenes.masks else ""
        if isinstance(node, ast.Compare) and len(node.ops) == 1 and isinstance(node.left, ast.Name):
            right = node.comparators[0]
            if isinstance(right, ast.Constant) and isinstance(right.value, str):
                sign = COMPARISONS[type(node.ops[0])]
                return f"{node.left.id.upper()} {sign} {right.value.upper().replace('-', '_')}"
        return ""

    def number(self, value: Any, kind: str | None = None) -> Term:
        """Return a number, as type `kind`: real, double, float, or what it is."""
        if isinstance(value, bool):
            return Term(str(int(value)), "int")
        if isinstance(value, wp.uint32):
            return Term(f"{value.value:#x}u", "uint")
        if hasattr(value, "value"):  # of Warp's scalar types
            return self.number(value.value, kind)
        if isinstance(value, int) and kind is None:
            return Term(str(value), "int", ATOM if value >= 0 else UNARY)
        value = float(value)
        if value != value or value == float("inf"):
            return Term("NAN" if value != value else "INFINITY", kind or "float")
        text = repr(value)
        if kind in ("real", "float"):
            return Term(f"R({text})" if kind == "real" else f"{text}f", kind)
        return Term(text, kind or "double", ATOM if value >= 0 else UNARY)

    def constant(self, node: Any, kind: str | None = None) -> Term | None:
        """Return an expression that is known in each scene, if it is one."""
        facet = self.names.values(node, self.mask)
        if not facet or not all(isinstance(value, (bool, int, float)) or hasattr(value, "value") for value, _ in facet):
            return None
        if all(isinstance(value, bool) for value, _ in facet):
            text = self.condition(sum(where for value, where in facet if value), self.mask, node)
            return Term(text, "int", ATOM if text.isidentifier() or text.isdigit() else CHOICE)
        inner = node
        while isinstance(inner, ast.Call) and len(inner.args) == 1:
            inner = inner.args[0]
        name = inner.id if isinstance(inner, ast.Name) else inner.attr if isinstance(inner, ast.Attribute) else ""
        if name and not any(hasattr(value, "value") for value, _ in facet):
            found = self._macro(name, facet, kind)
            if found is not None:
                return found
        plain = name.strip("_") if isinstance(inner, ast.Name) else ""
        return self._alike(facet, kind, plain) if len(facet) == 1 else self._varied(facet, kind, plain)

    def _macro(self, name: str, facet: Facet, kind: str | None) -> Term | None:
        """Return the macro of a number: of its own name, or the only number of the tableau with its value."""
        want: list[Any] = []
        for mask in self.translator.precisions:
            found = {value for value, where in facet if where & mask}
            if len(found) > 1:
                return None
            want.append(found.pop() if found else None)
        plain = re.sub(r"^_+|_+$", "", name).upper()
        macros = self.translator.macros
        fits = [macro for macro, known in macros.items() if all(map(_is_same, want, known.values))]
        named = [each for each in fits if each == plain or each.endswith(f"_{plain}")]
        of_tableau = [each for each in fits if each.startswith("RKN_")]
        is_number = any(isinstance(each, float) for each in want)
        if len(named) == 1:
            chosen = named[0]
        elif len(of_tableau) == 1 and is_number:
            chosen = of_tableau[0]
        else:
            return None
        is_real = macros[chosen].is_real
        if is_real and kind not in ("real", None):
            return None  # rounded to the kernel's precision
        if not is_real and kind == "real" and is_number:
            return Term(f"(real){chosen}", "real", UNARY)
        return Term(chosen, kind or ("real" if is_real else "double" if is_number else "int"))

    def _alike(self, facet: Facet, kind: str | None, name: str) -> Term:
        """Write a number that is the same in all scenes."""
        found = self.number(facet[0][0], kind)
        if name.isupper() and found.type in ("double", "real", "int") and kind != "float":
            if name not in self.translator.taken and self._define(name, found.text):
                return Term(name, found.type)
        if name and name != "int" and found.type == "int":
            return Term(f"{found.text} /* {name.lower()} */", found.type, found.rank)
        return found

    def _varied(self, facet: Facet, kind: str | None, name: str) -> Term:
        """Write a number that differs between scenes."""
        whole = self.scenes.number_macro(facet)
        if whole is not None:
            return Term(whole, "int")
        if name:
            macro = f"{self.name}_{name}".upper() if name.upper() in self.translator.taken else name.upper()
            if self._define(macro, self._choice(facet, None)):
                return Term(macro, "int")
        return Term(self._choice(facet, kind), kind or "int")

    def _define(self, name: str, text: str) -> bool:
        """Define a macro in the function's module; False if it is another number there."""
        known = self.translator.defined.setdefault(self.module, {})
        if known.setdefault(name, text) != text:
            return False
        self.defines[name] = text
        return True

    def _choice(self, facet: Facet, kind: str | None) -> str:
        """Write the numbers of scenes with ?:, the most frequent last."""
        facet = sorted(facet, key=lambda each: -each[1].bit_count())
        left, text = (self.names.full if kind is None else self.mask) & sum(where for _, where in facet), ""
        for value, where in facet[1:]:
            text += f"{self.scenes.condition(where & left, left)} ? {self.number(value, kind).text} : "
            left &= ~where
        return f"({text}{self.number(facet[0][0], kind).text})"

    def vector_constant(self, facet: Facet) -> Term:
        """Write a vector that is known in each scene."""
        kind = self.kinds.of([(type(value), where) for value, where in facet])
        is_whole, parts = base(kind) == "int", []
        for k in range(width(kind)):
            each: dict[Any, int] = {}
            for value, where in facet:
                number = int(value[k]) if is_whole else float(value[k])
                each[number] = each.get(number, 0) | where
            known = list(each.items())
            scalar = None if is_whole else base(kind)
            parts.append(self.number(known[0][0], scalar).text if len(known) == 1 else self._choice(known, scalar))
        return Term(f"({kind})({', '.join(parts)})", kind, UNARY)


def _is_same(one: Any, two: Any) -> bool:
    return one is None or (one == two and isinstance(one, int) == isinstance(two, int))
