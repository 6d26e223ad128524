"""Make foreign text safe to show: it must not control a terminal, or reverse the direction of a line."""

import re

_HIDDEN = re.compile(r"[^\n -~]")


def cut(text: str, most: int = 60) -> str:
    """Return a text of at most that many characters, with dots in place of the rest."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def plain(text: str) -> str:
    """Return a text with control characters, except line ends and tabs, replaced by their codes."""
    return _HIDDEN.sub(lambda at: at[0] if at[0] == "\t" or at[0].isprintable() else f"\\x{ord(at[0]):02x}", text)


def plain_json(text: str) -> str:
    """Return JSON of the same values with control characters escaped."""
    return _HIDDEN.sub(lambda at: at[0] if at[0].isprintable() else _units(at[0]), text)


def _units(character: str) -> str:
    code = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{code[k]:02x}{code[k + 1]:02x}" for k in range(0, len(code), 2))
