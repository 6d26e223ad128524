"""Expressions: names, members, components, operators, and calls of device functions, types and Warp's functions."""

import ast
from collections.abc import Callable
from typing import Any

from .scenes import Facet
from .source import is_device_function, is_static
from .state import COMPARISONS, State
from .types import AND, ATOM, CHOICE, GIVEN, OR, PICKS, POINTERS, POSTFIX, PRODUCT, UNARY, Term, base, width

AXES = "xyzw"
OPERATORS: dict[type, tuple[str, int]] = {
    ast.Add: ("+", 12),
    ast.Sub: ("-", 12),
    ast.Mult: ("*", PRODUCT),
    ast.Div: ("/", PRODUCT),
    ast.FloorDiv: ("/", PRODUCT),  # C truncates, Warp floors: for numbers that are not negative
    ast.Mod: ("%", PRODUCT),
    ast.BitAnd: ("&", 8),
    ast.BitOr: ("|", 6),
    ast.BitXor: ("^", 7),
    ast.LShift: ("<<", 11),
    ast.RShift: (">>", 11),
}
BITS = (6, 7, 8, 11)  # written with brackets, as compilers ask
SIGNS = {ast.USub: "-", ast.Not: "!", ast.UAdd: "+", ast.Invert: "~"}


# What Warp's functions are in C, by the type of their widest argument; names of OpenCL stay.
NAMED: dict[str, dict[str, str]] = {
    "max": {"real": "greater", "double": "greater64", "int": "max", "real3": "max", "double3": "max"},
    "min": {"real": "lesser", "double": "lesser64", "int": "min", "real3": "min", "double3": "min"},
    "clamp": {"real": "bounded", "double": "bounded64", "int": "clamp"},
    "dot": {"real2": "dot2", "real3": "dot3", "real4": "dot4", "double2": "dot2_64", "double3": "dot3_64"},
    "length": {"real2": "norm2", "real3": "norm3", "double2": "norm2_64", "double3": "norm3_64"},
    "normalize": {"double3": "normalized64"},
}
OF_VECTOR = {"max": {"real3": "greatest", "double3": "greatest64"}}  # with one argument
SCALARS = ("dot", "length")
SAME = ("sqrt", "floor", "cross", "sin", "cos")
OPERATIONS = {"cw_mul": ast.Mult, "cw_div": ast.Div}
# What a native function of Warp is in C, with the arguments' texts, and its type; "" for what the first array holds.
NATIVES = {"entry": ("{0}[{1}]", ""), "in_patch": ("in_patch({0}, {1}, {2}, {3})", "channels")}


class Expressions(State):
    """Writes expressions.

    Attributes:
        result: The parts of the tuple that the last call gives, and the struct's name.
        hint: The names to which the caller assigns the parts.
    """

    result: tuple[list[tuple[str, str]], str] = ([], "")
    hint: list[str | None] | None = None

    def expr(self, node: Any) -> Term:
        """Return an expression in C."""
        write = getattr(self, f"_of_{type(node).__name__}", None)
        if write is None:
            raise self.fail(node, "no such expression")
        term: Term = write(node)
        return term

    def _of_Constant(self, node: Any) -> Term:
        return self.number(node.value)

    def _of_Name(self, node: Any) -> Term:
        if node.id in self.types:
            self.use(node.id)
            return Term(node.id, self.types[node.id])
        found = self.constant(node)
        if found is not None:
            return found
        facet = self.names.values(node, self.mask)
        if facet and hasattr(facet[0][0], "_length_"):
            return self.vector_constant(facet)
        raise self.fail(node, "unknown name")

    def _of_Attribute(self, node: Any) -> Term:
        owner = self.expr(node.value)
        if node.attr not in self.kinds.members.get(owner.type, {}):
            raise self.fail(node, f"no such member of {owner.type}")
        kind = self.kinds.members[owner.type][node.attr].kind.replace("bool", "int")
        given = f"{owner.text}{self.point}{node.attr}"
        if kind.endswith("*"):
            if owner.type in GIVEN:
                self.takes_arrays = True
                given = f"arrays{self.point}{node.attr}"
            return Term(given, f"*{kind.rstrip('*')}", POSTFIX)
        if owner.type not in GIVEN:
            return Term(f"{owner.text}.{node.attr}", kind, POSTFIX)
        if width(kind) == 1:
            return Term(given, kind, POSTFIX)
        if kind in ("real3", "double3"):
            return Term(f"{'VECTOR' if kind == 'real3' else 'VECTOR64'}({given})", kind)
        return Term(f"({kind})({', '.join(f'{given}[{k}]' for k in range(width(kind)))})", kind, UNARY)

    def _of_Subscript(self, node: Any) -> Term:
        if isinstance(node.value, ast.Attribute):  # of a vector in a given struct, which is an array in C
            owner = self.expr(node.value.value)
            member = self.kinds.members[owner.type][node.value.attr] if owner.type in GIVEN else None
            if member is not None and not member.kind.endswith("*"):
                at = self.expr(node.slice).text
                return Term(f"{owner.text}{self.point}{member.name}[{at}]", base(member.kind), POSTFIX)
        owner = self.expr(node.value)
        if owner.type in self.kinds.parts:
            name, kind = self.kinds.parts[owner.type][node.slice.value]
            return Term(f"{owner.text}.{name}", kind, POSTFIX)
        if owner.type.startswith("*"):
            kind, at = owner.type[1:], self.expr(node.slice).text
            text = f"vload{width(kind)}({at}, {owner.text})" if width(kind) > 1 else f"{owner.text}[{at}]"
            return Term(text, kind, POSTFIX)
        return self.component(owner, node.slice)

    def component(self, owner: Term, node: Any, is_stored: bool = False) -> Term:
        """Write a number of a vector."""
        kind = base(owner.type)
        known = self.names.values(node, self.mask)
        if owner.type == "channels":
            return Term(f"CHANNEL({owner.text}, {self.expr(node).text})", "real", POSTFIX)
        if owner.type.endswith("]"):
            return Term(f"{owner.text}[{self.expr(node).text}]", owner.type.split("[")[0], POSTFIX)
        if len(known) == 1:
            k = int(known[0][0])
            name = AXES[k] if width(owner.type) <= 4 else f"s{k:x}"
            return Term(f"{owner.within(POSTFIX)}.{name}", kind, POSTFIX)
        at = self.expr(node).text
        if is_stored or width(owner.type) > 4:
            return Term(f"(({kind} *)&{owner.text})[{at}]", kind, POSTFIX)
        if owner.type not in PICKS:
            raise self.fail(node, f"component of {owner.type}")
        return Term(f"{PICKS[owner.type]}({owner.text}, {at})", kind)

    def _of_UnaryOp(self, node: Any) -> Term:
        known = self.constant(node)
        if known is not None:
            return known
        value, sign = self.expr(node.operand), SIGNS[type(node.op)]
        return Term(f"{sign}{value.within(UNARY)}", "int" if sign == "!" else value.type, UNARY)

    def _of_BoolOp(self, node: Any) -> Term:
        known = self.constant(node) if any(map(is_static, ast.walk(node))) else None
        if known is not None:
            return known
        conjunction = isinstance(node.op, ast.And)
        rank, sign = (AND, " && ") if conjunction else (OR, " || ")
        neutral, decisive = (self.mask, 0) if conjunction else (0, self.mask)
        parts = []
        for each in node.values:
            truth = self.names.truth(each, self.mask)
            if truth == decisive:
                return Term("0" if conjunction else "1", "int")
            if truth != neutral:
                parts.append(self.expr(each).within(rank + (1 if conjunction else 2)))
        return Term(sign.join(parts), "int", rank if len(parts) > 1 else CHOICE)

    def _of_Compare(self, node: Any) -> Term:
        texts, left, rank = [], node.left, 0
        for op, right in zip(node.ops, node.comparators, strict=True):
            if type(op) not in COMPARISONS:
                raise self.fail(node, "no such comparison")
            rank = 9 if isinstance(op, (ast.Eq, ast.NotEq)) else 10
            one, two = self.expr(left).within(rank + 1), self.expr(right).within(rank + 1)
            texts.append(f"{one} {COMPARISONS[type(op)]} {two}")
            left = right
        return Term(" && ".join(texts), "int", AND if len(texts) > 1 else rank)

    def _of_BinOp(self, node: Any) -> Term:
        if type(node.op) not in OPERATORS:
            raise self.fail(node, "no such operator")
        left, right = self.expr(node.left), self.expr(node.right)
        sign, rank = OPERATORS[type(node.op)]
        kind = left.type if width(left.type) >= width(right.type) else right.type
        one = left.within(ATOM - 1 if rank in BITS else rank)
        two = right.within(ATOM - 1 if rank in BITS else rank + 1)
        return Term(f"{one} {sign} {two}", kind, rank)

    def _of_IfExp(self, node: Any) -> Term:
        truth = self.names.truth(node.test, self.mask)
        if truth is not None and truth in (0, self.mask):
            return self.expr(node.body if truth else node.orelse)
        body, other = self.expr(node.body), self.expr(node.orelse)
        text = f"{self.expr(node.test).within(OR)} ? {body.within(OR)} : {other.within(CHOICE)}"
        return Term(text, body.type, CHOICE)

    def _of_Call(self, node: Any) -> Term:
        called = ast.unparse(node.func)
        if is_static(node):
            found = self.constant(node)
            if found is None:
                raise self.fail(node, "no number or condition")
            return found
        if called == "wp.tid":
            return Term("(int)get_global_id(0)", "int", UNARY)
        if called in ("int", "bool"):
            return self._whole(node, called)
        if called.startswith("wp."):
            found = self._warp(called[3:], node)
            if found is not None:
                return found
        facet = self.names.values(node.func, self.mask)
        if not facet:
            raise self.fail(node, "unknown function")
        if all(is_device_function(value) for value, _ in facet):
            return self._device_function(node, facet)
        try:
            return self._made(node, self.kinds.of(facet))
        except TypeError as error:
            raise self.fail(node, str(error)) from error

    def _whole(self, node: Any, called: str) -> Term:
        """Write int() or bool()."""
        if self.source.is_known(node):
            found = self.constant(node.args[0] if called == "int" else node)
            if found is not None:
                return found
        inner = node.args[0]
        if called == "int" and isinstance(inner, ast.Call) and ast.unparse(inner.func) == "wp.floor":
            value = self.expr(inner.args[0])
            return Term(f"{'floor64' if value.type == 'double' else 'floor_of'}({value.text})", "int")
        value = self.expr(inner)
        return value if value.type == "int" else Term(f"(int){value.within(UNARY)}", "int", UNARY)

    def _warp(self, name: str, node: Any) -> Term | None:
        """Write one of Warp's own functions; None for others, such as types."""
        if name in OPERATIONS:
            return self.expr(ast.BinOp(node.args[0], OPERATIONS[name](), node.args[1]))
        if name == "where":
            return self.expr(ast.IfExp(*node.args))
        if name not in (*NAMED, *SAME, "abs", "isfinite"):
            return None
        values = [self.expr(each) for each in node.args]
        texts = ", ".join(value.text for value in values)
        kind = max((value.type for value in values), key=width)
        if name == "isfinite":
            return Term(f"isfinite({texts})", "int")
        if name == "abs":
            return Term(f"{'abs' if base(kind) == 'int' else 'fabs'}({texts})", kind)
        if name in SAME:
            return Term(f"{name}({texts})", kind)
        names = OF_VECTOR.get(name, {}) if len(values) == 1 and name in OF_VECTOR else NAMED[name]
        if kind not in names:
            raise self.fail(node, f"no {name} of {kind}")
        return Term(f"{names[kind]}({texts})", base(kind) if name in SCALARS or names in OF_VECTOR.values() else kind)

    def _made(self, node: Any, kind: str) -> Term:
        """Write a number, vector or struct of a type."""
        if kind in self.kinds.members:
            return Term(f"({kind}){{{', '.join(self.expr(each).text for each in node.args) or '0'}}}", kind, UNARY)
        if kind.endswith("]"):
            return Term("", kind)
        if width(kind) == 1:
            return self._scalar(node.args[0], kind)
        if not node.args:
            return Term(f"({kind})({'R(0.0)' if base(kind) == 'real' else '0'})", kind, UNARY)
        short = self._components(node.args)
        if short is not None:
            source, first, is_cast = short
            name = source.within(POSTFIX)
            if width(source.type) != width(kind) or first:
                name += "." + AXES[first : first + width(kind)]
            is_same = not is_cast and base(source.type) == base(kind)
            return Term(name if is_same else f"convert_{kind}({name})", kind, POSTFIX)
        parts = [self.expr(each).text for each in node.args]
        is_one = len(set(parts)) == 1 and parts[0][0] in "0R"
        return Term(f"({kind})({parts[0] if is_one else ', '.join(parts)})", kind, UNARY)

    def _scalar(self, argument: Any, kind: str) -> Term:
        known = self.constant(argument, kind) if kind in ("real", "double", "float") else None
        if known is not None:
            return known._replace(type=kind)
        if kind == "uint" and isinstance(argument, ast.Constant):
            return Term(f"{argument.value:#x}u" if argument.value > 9 else f"{argument.value}u", kind)
        value = self.expr(argument)
        return value if value.type == kind else Term(f"({kind}){value.within(UNARY)}", kind, UNARY)

    def _components(self, arguments: list) -> tuple[Term, int, bool] | None:
        """Recognise the components of one vector in order: the vector, the first, and whether each is converted."""
        owners: dict[str, ast.expr] = {}
        numbers: list[Any] = []
        casts: set[str] = set()
        for each in arguments:
            is_cast = isinstance(each, ast.Call) and len(each.args) == 1 and self.source.is_known(each.func)
            inner = each.args[0] if is_cast else each
            if not (isinstance(inner, ast.Subscript) and isinstance(inner.slice, ast.Constant)):
                return None
            if not isinstance(inner.value, (ast.Name, ast.Attribute)):
                return None
            owners[ast.unparse(inner.value)] = inner.value
            numbers.append(inner.slice.value)
            casts.add(ast.unparse(each.func) if is_cast else "")
        first, count = numbers[0], len(numbers)
        if len(owners) != 1 or len(casts) != 1 or count < 2 or numbers != list(range(first, first + count)):
            return None
        value = self.expr(next(iter(owners.values())))
        if value.type.startswith("*") or not 2 <= width(value.type) <= 4:
            return None
        return value, first, bool(casts.pop())

    def _device_function(self, node: Any, facet: Facet) -> Term:
        """Write a call of a device function, and first the function."""
        if facet[0][0].func is None:
            raise self.fail(node, "unknown function of Warp")
        name = facet[0][0].func.__name__
        if getattr(facet[0][0], "native_snippet", None):
            if name not in NATIVES:
                raise self.fail(node, "native function")
            values = [self.expr(each) for each in node.args]
            text, kind = NATIVES[name]
            return Term(text.format(*(value.text for value in values)), kind or values[0].type[1:], POSTFIX)
        if name == "advance":
            return self._advance(node)
        groups: dict[Any, list[tuple[Callable, int]]] = {}
        for value, where in facet:
            groups.setdefault(value.func.__code__, []).append((value.func, where))
        is_generic = any(each is Any for each in facet[0][0].func.__annotations__.values())
        kinds = tuple(self.expr(each).type for each in node.args) if is_generic else ()
        hint, self.hint = self.hint, None
        written = [self.translator.emit(group, kinds, hint, len(groups) > 1) for group in groups.values()]
        first = written[0]
        if any(each[:3] != first[:3] for each in written):
            raise self.fail(node, f"functions {', '.join(sorted({each.name for each in written}))} have other results")
        self.translator.use_module(self.module, [group[0][0] for group in groups.values()])
        parts = [self._passed(each) for each in node.args]
        if any(each.takes_arrays for each in written):
            pairs = zip(groups, written, strict=True)
            self.translator.with_arrays |= {code for code, each in pairs if not each.takes_arrays}
            parts.insert(1, "&arrays" if self.is_kernel else "arrays")
            self.takes_arrays = True
        self.result = first.parts, first.type
        return Term(f"{first.name}({', '.join(parts)})", first.type, POSTFIX)

    def _passed(self, node: Any) -> str:
        value = self.expr(node)
        return f"&{value.text}" if self.is_kernel and value.type in POINTERS else value.text

    def _advance(self, node: Any) -> Term:
        """Write Kahan's sum, which changes its first two arguments in C."""
        total, carry, term = (self.expr(each) for each in node.args)
        self.change(total.text)
        self.change(carry.text)
        return Term(f"advance{width(total.type)}(&{total.text}, &{carry.text}, {term.text})", "advance")
