"""Call a reader by the name of its module, in this process or in a child process."""

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

from aerokernels.process.foreign_files import FileFault

from ...process.fragile import in_child as call_in_child
from .dataset import DAMAGED, Dataset, ReadError

Reader = Callable[[Path, Any, dict[str, Any]], Dataset]


def read_here(module: str, path: Path, time, options: dict[str, Any]) -> Dataset:
    """Call a reader in this process; errors that a damaged file causes become a ReadError."""
    reader: Reader = import_module(f".readers.{module}", __package__).read
    try:
        return reader(path, time, options)
    except ReadError:
        raise
    except FileFault as fault:
        raise ReadError.said(str(fault)) from None
    except MemoryError:
        raise ReadError(path, "it announces more data than fits in memory", DAMAGED) from None
    except Exception as fault:  # libraries raise any error for a damaged file, such as TokenError for a NumPy header
        what = f"it cannot be read ({type(fault).__name__}: {fault})"
        raise ReadError(path, what, DAMAGED) from fault


def in_child(module: str, path: Path, time, options: dict[str, Any]) -> Dataset:
    """Call `read_here` in a child process; raise ReadError if the child process ends early."""
    try:
        found = call_in_child(path, f"{read_here.__module__}:{read_here.__name__}", module, path, time, options)
    except FileFault as fault:
        raise ReadError.said(str(fault)) from fault
    assert isinstance(found, Dataset)
    return found
