"""Errors that name their file, and errors of a library on one line, for another message or for a table."""


class FileFault(ValueError):
    """A file that cannot be used; the message names it, so that callers add nothing."""


def fault_text(fault: BaseException, most: int | None = 200) -> str:
    """Return the class and the message of an error on one line; `most` characters of the message, None for all."""
    return " ".join(f"{type(fault).__name__}: {str(fault)[:most]}".split())
