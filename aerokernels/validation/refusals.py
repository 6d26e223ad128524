"""Whether a call answers, refuses in words, or fails in words that are not ours."""

import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

PACKAGE = str(Path(__file__).resolve().parents[1])


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
