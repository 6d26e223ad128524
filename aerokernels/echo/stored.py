"""Read the simulated echo from the result.nc of a run."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from aerokernels.files.netcdf_reading import errors_naming

if TYPE_CHECKING:
    import xarray

LEAST_SAMPLES = 2


def echo_of_result(path: Path, result: "xarray.Dataset") -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] and voltages [V] of the echo in a result, both of shape (n,).

    Args:
        path: The result's file, for messages.
        result: The dataset, with times as numbers.

    Raises:
        ValueError: The dataset has no echo, or one that is not finite or whose times do not increase; the message names
            the file.
    """
    if not {"time", "echo_voltage"} <= set(result.variables) or not (
        result["echo_voltage"].dims == result["time"].dims == result["time"].dims[:1] != ()
    ):
        raise ValueError(f"result {path}: holds no 'echo_voltage' over 'time'; give the result.nc of a run")
    with errors_naming(path):
        time, voltage = (result[name].values for name in ("time", "echo_voltage"))
    if not (time.dtype.kind in "iuf" and voltage.dtype.kind in "iuf" and time.size >= LEAST_SAMPLES):
        raise ValueError(f"result {path}: its 'time' and 'echo_voltage' are no rows of numbers; run it again")
    time, voltage = time.astype(np.float64), voltage.astype(np.float64)
    with np.errstate(invalid="ignore"):
        increasing = bool((np.diff(time) > 0.0).all())
    if not (increasing and np.isfinite(time).all() and np.isfinite(voltage).all()):
        raise ValueError(f"result {path}: its echo is not finite at times that increase; run it again")
    return time, voltage
