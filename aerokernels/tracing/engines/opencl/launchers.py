"""Create kernel objects even if PyOpenCL's own cache is damaged.

PyOpenCL writes a launcher in Python for each kernel and caches it in an SQLite file for all programs of the user. This
package sets arguments itself and needs no launcher, but PyOpenCL makes one with each kernel object, and a damaged file
would end in an error of SQLite or of Python's unmarshalling ("co_varnames is too small") at this and every later start.
"""

import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

from .arguments import lasting
from .devices import import_pyopencl
from .session import Session


def take_kernel(session: Session, program, name: str) -> tuple[Any, list]:
    """Return a kernel of a session's program for the sole use of the caller, and its arguments; see `give_back`."""
    free = session.kernels.setdefault((program, name), [])
    with suppress(IndexError):
        kernel, given = free.pop()
        return kernel, given
    return make_kernel(program, name), []


def give_back(session: Session, program, name: str, kernel, given: list) -> None:
    """Return a kernel that is out of use to the session's free list: to make one takes PyOpenCL half a millisecond.

    Of the arguments `given` to it, those that hold no memory of a device are kept and need not be set again.
    """
    session.kernels[program, name].append((kernel, lasting(given)))


def make_kernel(program, name: str):
    """Create the pyopencl.Kernel with a name; a damaged cache is removed, with a RuntimeWarning, and not used again.

    Raises:
        pyopencl.Error: The program has no such kernel.
    """
    cl = import_pyopencl()
    try:
        return cl.Kernel(program, name)
    except cl.Error:
        raise
    except Exception as error:  # SQLite, pickle and marshal raise various errors for damaged bytes
        removed = _remove_cache()
        cl._PYOPENCL_NO_CACHE = True  # as PYOPENCL_NO_CACHE does; checked whenever a launcher is made
        words = f"PyOpenCL's cache of launchers is damaged ({type(error).__name__}: {error})"
        warnings.warn(
            f"{words}: {removed[0].name + ' is removed' if removed else 'it is not used'}", RuntimeWarning, stacklevel=2
        )
        return cl.Kernel(program, name)


def _remove_cache() -> list[Path]:
    """Remove the cache file; return the files removed."""
    import platformdirs  # PyOpenCL's own dependency, and the folder it uses

    removed = []
    with suppress(OSError):
        for path in Path(platformdirs.user_cache_dir("pytools", "pytools")).glob("*pyopencl-invoker-cache*"):
            path.unlink()
            removed.append(path)
    return removed
