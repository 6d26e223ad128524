"""Classify a call as answered, refused in words, or failed; and check the text of a refusal."""

import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import aerokernels

PACKAGE = str(Path(aerokernels.__file__).parent)
MOST_TEXT = 20_000  # characters; the text may contain names from a file


def attempt(function: Callable, arguments: dict[str, Any]) -> str | None:
    """Return None for an answer, "" for a refusal in words; otherwise what was raised, and where."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.filterwarnings("error", message=".*imaginary part.*")
            function(**arguments)
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        said = isinstance(error, (ValueError, TypeError)) and not isinstance(error, UnicodeError)
        if said and where.filename.startswith(PACKAGE) and (where.line or "").startswith("raise"):
            return ""
        return f"{type(error).__name__}: {str(error)[:120]} ({Path(where.filename).name}:{where.lineno})"
    return None


def check_refusal(fault: Exception, named: object = "", never: str = "") -> bool:
    """Return False, meaning a refusal, if the error's text is one line of limited length that contains `named`.

    Raises:
        AssertionError: The text is not such a line, or contains `never`.
    """
    text = str(fault)
    bad = bool(never) and never in text
    if bad or not text or "\n" in text.strip() or str(named) not in text or len(text) > MOST_TEXT:
        raise AssertionError(f"refused as {text[:300]!r}") from fault
    return False
