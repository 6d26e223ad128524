"""Whether a call answers, refuses in words, or fails in words that are not ours; and what a refusal has to say."""

import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

PACKAGE = str(Path(__file__).resolve().parents[1])
MOST_TOLD = 20_000  # characters: names of a file may be in it


def attempt(function: Callable, arguments: dict[str, Any]) -> str | None:
    """None: it answered; "": it refused in words; otherwise what was raised, and where."""
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


def told(fault: Exception, named: object = "", never: str = "") -> bool:
    """False, which stands for a refusal, where an error is told in one line of some length that names this.

    Raises:
        AssertionError: It is not, or says what no refusal may.
    """
    text = str(fault)
    bad = bool(never) and never in text
    if bad or not text or "\n" in text.strip() or str(named) not in text or len(text) > MOST_TOLD:
        raise AssertionError(f"told as {text[:300]!r}") from fault
    return False
