"""Sphinx: docstrings are prose with Google's sections and formulas as plain text; here they become reStructuredText.

Characters that mean something to reStructuredText and nothing in a formula (`|a|^2`, `2 * x`, `w_`) are escaped outside
backticks. Indented paragraphs, which hold formulas and tables, become literal blocks.
"""

import re
from typing import Any

_CODE = re.compile(r"(``.*?``|`[^`]*`)")
_SPECIAL = re.compile(r"([*|\\])|(?<=\w)(_)(?=\W|$)")


def readable(lines: list[str]) -> list[str]:
    """The lines of a docstring as reStructuredText, but for Google's sections."""
    out: list[str] = []
    block = None  # the indent of the paragraph under which a literal block stands
    for number, line in enumerate(lines):
        indent = len(line) - len(line.lstrip())
        if block is not None and line.strip() and indent <= block:
            block = None
        if block is not None or line.lstrip().startswith(">>>"):
            out.append(line)
            continue
        marked = line.rstrip().endswith("::")
        out.append(_escaped(line))
        if line.strip() and (marked or _indented_follows(lines, number, indent)):
            block = indent
            if not marked:
                out[-1] = out[-1].rstrip()
                out[-1:] = [out[-1] + ":"] if out[-1].endswith(":") else [out[-1], "", " " * indent + "::"]
    return out


def _indented_follows(lines: list[str], number: int, indent: int) -> bool:
    """Whether a blank line and then a deeper paragraph come after this line."""
    if number + 2 >= len(lines) or lines[number + 1].strip():
        return False
    after = lines[number + 2]
    return bool(after.strip()) and len(after) - len(after.lstrip()) > indent and not after.lstrip().startswith(">>>")


def _escaped(line: str) -> str:
    parts = _CODE.split(line)
    return "".join(
        part if number % 2 else _SPECIAL.sub(lambda match: "\\" + match.group(0), part)
        for number, part in enumerate(parts)
    )


def _process(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    lines[:] = readable(lines)


def setup(app: Any) -> dict[str, bool]:
    """Before napoleon, which makes reStructuredText of the sections."""
    app.connect("autodoc-process-docstring", _process, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
