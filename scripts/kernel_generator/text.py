"""Layout of C: comments, blocks, and statements broken at the width of a line."""

import re
import textwrap

WIDTH = 120
_DECLARED = re.compile(r"((?:const )?\w+) (\w+ = .*);$")
_SIGN = re.compile(r" (&&|\|\||\+|-|\?|:) ")


def comment(text: str) -> list[str]:
    """Return the first paragraph of a docstring as a comment."""
    first = " ".join(text.split("\n\n")[0].split())
    return [f"// {line}" for line in textwrap.wrap(first, WIDTH - 3)] if first else []


def definition(name: str, value: str) -> list[str]:
    """Define a macro."""
    *rows, last = textwrap.wrap(f"#define {name} {value}", WIDTH - 2, subsequent_indent="    ", break_long_words=False)
    return [*(f"{row} \\" for row in rows), last]


def indented(lines: list[str]) -> list[str]:
    """Indent the lines of a block; directives begin at the margin."""
    return [line if not line or is_directive(line) else f"    {line}" for line in lines]


def is_directive(line: str) -> bool:
    """Whether a line is an #if or the like."""
    return line.startswith("#") and not line.startswith("#pragma")


def joined(lines: list[str]) -> list[str]:
    """Join neighbouring declarations of the same type."""
    out: list[str] = []
    for line in lines:
        found, before = _DECLARED.match(line), _DECLARED.match(out[-1]) if out else None
        if found and before and found[1] == before[1] and len(out[-1]) + len(found[2]) < WIDTH - 40:
            out[-1] = f"{out[-1][:-1]}, {found[2]};"
        else:
            out.append(line)
    return out


def filled(parts: list[str], indent: int) -> list[str]:
    """Return the parts of a list on as few lines as they fill, or one a line if that takes more than three."""
    lines, line = [], ""
    for part in parts:
        if line and len(line) + len(part) + 2 + indent > WIDTH - 1:
            lines.append(line + ",")
            line = part
        else:
            line = f"{line}, {part}" if line else part
    lines.append(line)
    if len(lines) > 3:
        lines = [f"{part}," for part in parts[:-1]] + [parts[-1]]
    return [" " * indent + each for each in lines]


def wrapped(line: str) -> list[str]:
    """Break a long statement: the arguments of its longest call, or before the operators of its outermost sum."""
    if len(line) <= WIDTH or line.lstrip().startswith(("#", "//")):
        return [line]
    code, _, note = line.partition("  // ")
    indent = len(code) - len(code.lstrip())
    if note:
        return [f"{' ' * indent}// {note}", *wrapped(code)]
    groups, signs = _structure(code)
    outer = min((depth for depth, _ in signs), default=0)
    calls = [(last - first, first, last) for first, last in groups if "," in code[first:last]]
    size, first, last = max(calls, default=(0, 0, 0))
    if size > 20 and (not signs or outer > 0 or size > 0.6 * len(code)):
        *lines, end = filled(_arguments(code[first + 1 : last]), indent + 4)
        return [code[: first + 1], *(row for each in lines for row in wrapped(each)), *wrapped(end + code[last:])]
    fits = [at for depth, at in signs if depth == outer and at <= WIDTH]
    if not fits:
        return [line]
    rest = code[fits[-1] :].strip()
    continued = bool(re.match(r"(&&|\|\||\+|-|\?|:) ", code.lstrip()))
    return [code[: fits[-1]], *wrapped(f"{' ' * (indent if continued else indent + 4)}{rest}")]


def _structure(code: str) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Return where brackets open and close, and the depth and place of binary operators."""
    opened: list[int] = []
    groups, signs = [], []
    for k, letter in enumerate(code):
        if letter in "([{":
            opened.append(k)
        elif letter in ")]}" and opened:
            groups.append((opened.pop(), k))
        elif letter == " " and code[:k].strip() and _SIGN.match(code, k):
            signs.append((len(opened), k))
    return groups, signs


def _arguments(text: str) -> list[str]:
    """Split at the commas outside brackets."""
    parts, start, depth = [], 0, 0
    for k, letter in enumerate(text):
        depth += (letter in "([{") - (letter in ")]}")
        if depth == 0 and letter == ",":
            parts.append(text[start:k].strip())
            start = k + 1
    return [*parts, text[start:].strip()]
