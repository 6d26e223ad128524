"""Import the libraries that write a job's results in a thread, while its kernels are compiled."""

import importlib
import threading
from collections.abc import Iterable
from contextlib import suppress

# Libraries that write and draw a run's results. None of them imports a module that the tracer imports: two threads
# that import each other's modules would wait for each other.
REPORT = ("matplotlib.figure", "matplotlib.backends.backend_agg", "xarray", "h5netcdf")


def import_ahead(names: Iterable[str]) -> threading.Thread:
    """Start a thread that imports modules; the error of one that cannot be imported shows where it is used.

    At exit the process waits for the current module and imports no further one: a thread that Python ends inside a
    library's code ends the process by SIGABRT.
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
