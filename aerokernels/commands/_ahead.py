"""Libraries that a job needs at its end, imported while its kernels are built: a build leaves Python free."""

import importlib
import threading
from collections.abc import Iterable
from contextlib import suppress

# What a run's results are written and drawn with. None of them imports what rays are traced with, so that no two
# threads wait for each other's modules.
REPORT = ("matplotlib.figure", "matplotlib.backends.backend_agg", "xarray", "h5netcdf")


def import_ahead(names: Iterable[str]) -> threading.Thread:
    """Begin to import these modules; one that cannot be imported is told where it is used."""

    def bring() -> None:
        for name in names:
            with suppress(Exception):
                importlib.import_module(name)

    thread = threading.Thread(target=bring, name="imports ahead", daemon=True)
    thread.start()
    return thread
