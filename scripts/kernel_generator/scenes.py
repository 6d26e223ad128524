"""The scenes that a kernel is compiled for, sets of them as bit masks, and the shortest #if for such a set.

A scene is one valid set of compile options of layout.py. A builder of device functions is called once in every scene;
whatever it closes over is then known in each.
"""

import itertools
import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from types import CodeType
from typing import Any, NamedTuple

from aerokernels.tracing.engines.layout import OPTIONS
from aerokernels.tracing.engines.opencl.program import in_c

# What a name is: pairs of a value and the mask of the scenes in which it has that value.
Facet = list[tuple[Any, int]]


class Atom(NamedTuple):
    """A condition on one option or macro: its text, the scenes in which it holds, and how much there is to read."""

    text: str
    mask: int
    cost: int


class Scenes:
    """All valid combinations of some options of layout.py.

    Attributes:
        all: The options of each scene; bit k of a mask stands for all[k].
        full: The mask of all scenes.
        masks: Of macros and options that are conditions, by name.
    """

    def __init__(
        self, options: Mapping[str, Sequence], is_valid: Callable[[dict], bool], macros: Mapping[str, str]
    ) -> None:
        """`macros` are the definitions in C of conditions, and of numbers that depend on conditions, by name."""
        product = itertools.product(*options.values())
        found = (dict(zip(options, values, strict=True)) for values in product)
        self.all: list[dict[str, Any]] = [scene for scene in found if is_valid(scene)]
        self.full = (1 << len(self.all)) - 1
        self.masks: dict[str, int] = {}
        self._atoms: list[Atom] = []
        self._numbers: dict[str, list[int]] = {}  # macros that are numbers, in each scene
        self._conditions: dict[tuple[int, int], str] = {}
        self._holding: dict[str, int] = {}
        self._spaces = [self._space(scene) for scene in self.all]
        for name, values in options.items():
            for value in values:
                mask = self.where(name, value)
                if isinstance(value, str):
                    self._add(f"{in_c(name)} == {in_c(value)}", mask, 2)
                    self._add(f"{in_c(name)} != {in_c(value)}", self.full & ~mask, 2)
                elif len(values) == 2:
                    self._add(in_c(name) if value else f"!{in_c(name)}", mask, 1)
                else:
                    self._add(f"{in_c(name)} == {int(value)}", mask, 2)
        self.masks = {atom.text: atom.mask for atom in self._atoms if atom.text.isidentifier()}
        for name, text in macros.items():
            with suppress(NameError, SyntaxError):  # of options that these scenes do not have
                self._learn(name, text)

    def _space(self, scene: dict[str, Any]) -> dict[str, int]:
        """Return the numbers that the preprocessor has for options and their values."""
        names: dict[str, int] = {}
        for name, value in scene.items():
            choices = OPTIONS[name].choices
            if isinstance(choices, tuple):
                names |= {in_c(choice): number for number, choice in enumerate(choices, start=1)}
                value = choices.index(value) + 1
            names[in_c(name)] = int(value)
        return names

    def _add(self, text: str, mask: int, cost: int) -> None:
        if mask not in (0, self.full):
            self._atoms.append(Atom(text, mask, cost))

    def _learn(self, name: str, text: str) -> None:
        """Learn a macro: a condition, or a number of the form (A ? 1 : B ? 2 : 3)."""
        if "?" in text:
            *parts, last = text.strip("()").split(" : ")
            pairs = [part.split(" ? ") for part in parts]
            whens = [self.mask_of(condition) for condition, _ in pairs]
            values = [*(int(value) for _, value in pairs), int(last)]
            self._numbers[name] = [
                next((value for when, value in zip(whens, values, strict=False) if when >> k & 1), values[-1])
                for k in range(len(self.all))
            ]
            return
        mask = self.mask_of(text)
        self._add(name, mask, 1)
        self._add(f"!{name}", self.full & ~mask, 1)
        self.masks[name] = mask
        for k, space in enumerate(self._spaces):  # macros may use macros
            space[name] = mask >> k & 1

    def where(self, name: str, value: Any) -> int:
        """Return the scenes in which an option has a value."""
        return sum(1 << k for k, scene in enumerate(self.all) if scene[name] == value)

    def mask_of(self, condition: str) -> int:
        """Return the scenes in which a condition in C holds.

        Raises:
            NameError: It has a name that is no option.
            SyntaxError: It is no condition.
        """
        if condition not in self._holding:
            code = _in_python(condition)
            self._holding[condition] = sum(1 << k for k, space in enumerate(self._spaces) if eval(code, {}, space))
        return self._holding[condition]

    def number_macro(self, facet: Facet) -> str | None:
        """Return the macro that has these numbers, if there is one."""
        for name, numbers in self._numbers.items():
            if all(numbers[k] == value for value, mask in facet for k in range(len(self.all)) if mask >> k & 1):
                return name
        return None

    def condition(self, wanted: int, within: int) -> str:
        """Return the shortest condition that, in the scenes `within`, holds in those `wanted` and in no others."""
        wanted &= within
        key = wanted, within
        if key not in self._conditions:
            self._conditions[key] = self._search(wanted, within)
        return self._conditions[key]

    def _search(self, wanted: int, within: int) -> str:
        if wanted in (0, within):
            return "1" if wanted else "0"
        once: dict[int, Atom] = {}  # the shortest atom of each mask
        for text, mask, cost in self._atoms:
            mask &= within
            if mask not in (0, within) and (mask not in once or cost < once[mask].cost):
                once[mask] = Atom(text, mask, cost)
        if wanted in once:
            return once[wanted].text
        below = [atom for atom in once.values() if atom.mask & wanted == wanted]
        above = [atom for atom in once.values() if atom.mask & wanted == atom.mask]
        for count in (2, 3):
            found = []
            for parts in itertools.combinations(below, count):
                mask = within
                for part in parts:
                    mask &= part.mask
                if mask == wanted:
                    found.append((sum(part.cost for part in parts), " && ".join(part.text for part in parts)))
            for parts in itertools.combinations(above, count):
                mask = 0
                for part in parts:
                    mask |= part.mask
                if mask == wanted:
                    found.append((sum(part.cost for part in parts), " || ".join(part.text for part in parts)))
            if found:
                return min(found)[1]
        raise ValueError(f"no condition of up to three options tells the scenes {wanted:x} among {within:x}")


def _in_python(text: str) -> CodeType:
    plain = re.sub(r"!(?!=)", " not ", text.replace("&&", " and ").replace("||", " or "))
    return compile(plain.strip(), "condition", "eval")


def macros_of(text: str) -> dict[str, str]:
    """Return the macros of a header that are conditions or depend on conditions, with their definitions."""
    return dict(re.findall(r"^#define (\w+) (\(.*\))$", text, re.M))
