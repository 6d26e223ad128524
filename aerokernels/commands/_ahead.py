"""Libraries that a job needs at its end, imported while its kernels are built: a build leaves Python free."""

import importlib
import threading
from collections.abc import Iterable
from contextlib import suppress

# What a run's results are written and drawn with. None of them imports what rays are traced with, so that no two
# threads wait for each other's modules.
REPORT = ("matplotlib.figure", "matplotlib.backends.backend_agg", "xarray", "h5netcdf")


def import_ahead(names: Iterable[str]) -> threading.Thread:
    """Begin to import these modules; one that cannot be imported is told where it is used.

    The process waits for the module at hand when it leaves, and takes no further one: a thread that Python ends within
    a library's own code ends the process by SIGABRT.
    """
    alive = threading.main_thread().is_alive

    def bring() -> None:
        for name in names:
            if not alive():
                return
            with suppress(Exception):
                importlib.import_module(name)

    thread = threading.Thread(target=bring, name="imports ahead")
    thread.start()
    return thread
