"""A simulated echo on the times of a recorded one, and the time by which the recorded one is late.

The simulation is drawn on the recorded time axis, by the quintic spline through its samples: it is smooth, free of
noise and sampled finely, so that this costs nothing, while recorded samples, which are none of these, stay as they are.
Before and after the simulated record its voltage is 0, where it ends below a thousandth of its peak.
"""

import numpy as np

from aerokernels.compare import compare_waveforms
from aerokernels.jobs.averages import AverageEcho
from aerokernels.jobs.run_folder import RunFolder

DECAYED = 1e-3  # of the simulated peak
# Of the simulated peak, that must lie within the recorded times where the peak itself does not.
LEAST_PEAK = 0.9
# And where it does, between samples far apart.
LEAST_BETWEEN = 0.25


def simulated_on(run: RunFolder, time: np.ndarray) -> np.ndarray:
    """The simulated voltage [V] at other times [s]; NaN outside the simulated record where it ends above 0."""
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(run.time - run.time[0], run.voltage, k=5)
    inside = (time >= run.time[0]) & (time <= run.time[-1])
    peak = float(np.abs(run.voltage).max())
    before, after = (0.0 if abs(end) <= DECAYED * peak else np.nan for end in (run.voltage[0], run.voltage[-1]))
    volts = np.where(time < run.time[0], before, after)
    volts[inside] = spline(time[inside] - run.time[0])
    return volts


def overlap(
    recorded: AverageEcho, run: RunFolder, offset: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Times [s], recorded mean, spread and simulation [V] where both are known."""
    time = recorded.time - offset
    simulated = simulated_on(run, time)
    there, peak_time = np.isfinite(simulated), float(run.time[np.argmax(run.voltage)])
    met = there.any() and time[there][0] <= peak_time <= time[there][-1]  # between coarse samples, it may be
    greatest = simulated[there].max() if there.any() else 0.0
    if greatest < (LEAST_BETWEEN if met else LEAST_PEAK) * run.voltage.max():
        raise ValueError(
            f"the simulated echo peaks at {1e9 * peak_time:.3f} ns, the recorded times go from "
            f"{1e9 * time[0]:.3f} to {1e9 * time[-1]:.3f} ns"
            + (
                f" in steps of {1e9 * (time[1] - time[0]):.3f} ns, too wide for its pulse: record with more samples"
                if met
                else ": give the trigger offset, or align"
            )
        )
    return time[there], recorded.mean[there], recorded.spread[there], simulated[there]


def measured_offset(recorded: AverageEcho, run: RunFolder) -> float:
    """The time [s] by which the recorded mean is later than the simulation: the lag of the greatest correlation.

    The peaks are laid on each other first, so that the records need not overlap; then the lag is found between samples.
    """
    offset = float(recorded.time[np.argmax(recorded.mean)] - run.time[np.argmax(run.voltage)])
    time, mean, _, simulated = overlap(recorded, run, offset)
    lag = compare_waveforms(time, mean, simulated).lag
    # Once more about the place found: the parabola through three lags is best where the lag is small.
    time, mean, _, simulated = overlap(recorded, run, offset + lag)
    return offset + lag + compare_waveforms(time, mean, simulated).lag
