"""Texts that others wrote, to be shown: they must not command a terminal, or turn a line round."""

import re

_HIDDEN = re.compile(r"[^\n -~]")


def cut(text: str, most: int = 60) -> str:
    """A text of that many characters at most, with dots in place of the rest."""
    return text if len(text) <= most else f"{text[: most - 3]}..."


def plain(text: str) -> str:
    """A text without control characters, but for line ends and tabs: others by their numbers."""
    return _HIDDEN.sub(lambda found: found[0] if found[0] == "\t" or found[0].isprintable() else _code(found[0]), text)


def _code(character: str) -> str:
    return f"\\x{ord(character):02x}"


def plain_json(text: str) -> str:
    """JSON of the same values without control characters: within its texts they have escapes of their own."""
    return _HIDDEN.sub(lambda found: found[0] if found[0].isprintable() else _units(found[0]), text)


def _units(character: str) -> str:
    code = character.encode("utf-16-be", "surrogatepass")
    return "".join(f"\\u{code[k]:02x}{code[k + 1]:02x}" for k in range(0, len(code), 2))
