"""Calling a reader by the name of its module, in whatever process."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from .dataset import Dataset, ReadError

Reader = Callable[[Path, Any, dict[str, Any]], Dataset]


def read_here(module: str, path: Path, time, options: dict[str, Any]) -> Dataset:
    """Call a reader in this process; what a damaged file makes it raise becomes a ReadError."""
    reader: Reader = import_module(f".{module}", __package__).read
    try:
        return reader(path, time, options)
    except ReadError:
        raise
    except (
        ArithmeticError,
        AssertionError,
        EOFError,
        LookupError,
        OSError,
        RuntimeError,
        TypeError,
        ValueError,
    ) as fault:
        what = f"it cannot be read ({type(fault).__name__}: {fault})"
        raise ReadError(path, what, "the file is damaged: write it again") from fault
    except MemoryError:
        raise ReadError(
            path, "it announces more data than the memory takes", "the file is damaged: write it again"
        ) from None
