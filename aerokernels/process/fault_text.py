"""Describe an error of a library on one line, for the message of another error or for a table."""


def fault_text(fault: BaseException, most: int | None = 200) -> str:
    """Return the class and the message of an error on one line; `most` characters of the message, None for all."""
    return " ".join(f"{type(fault).__name__}: {str(fault)[:most]}".split())
