"""Interpolate a simulated echo at the times of a recorded one, and measure by how much the recorded one is late.

The simulation, not the recording, is interpolated, by the quintic spline through its samples: it is smooth and finely
sampled, so that interpolation adds no visible error, while the recorded samples are noisy and stay unchanged. Before
and after the simulated record the voltage is 0, provided that the record ends below a thousandth of its peak.
"""

import numpy as np

from aerokernels.compare import compare_waveforms
from aerokernels.jobs.averages import AverageEcho
from aerokernels.jobs.run_folder import RunFolder

DECAYED = 1e-3  # share of the simulated peak below which the end of the record counts as 0
# Least simulated voltage at the recorded times, as a share of the simulated peak, if the peak is outside these times,
LEAST_PEAK = 0.9
# and if it is inside them but may fall between samples that are far apart.
LEAST_BETWEEN = 0.25


def simulated_on(run: RunFolder, time: np.ndarray) -> np.ndarray:
    """Return the simulated voltage [V] at other times [s]; NaN beyond an end of the record that has not decayed."""
    from scipy.interpolate import make_interp_spline

    spline = make_interp_spline(run.time - run.time[0], run.voltage, k=5)
    inside = (time >= run.time[0]) & (time <= run.time[-1])
    peak = float(np.abs(run.voltage).max())
    before, after = (0.0 if abs(end) <= DECAYED * peak else np.nan for end in (run.voltage[0], run.voltage[-1]))
    volts = np.where(time < run.time[0], before, after)
    volts[inside] = spline(time[inside] - run.time[0])
    return volts


def overlap(recorded: AverageEcho, run: RunFolder, offset: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compare a recording with a simulation where they overlap.

    Returns:
        Which of the recorded samples overlap; their times less the offset [s]; the simulation at these times [V].
    """
    time = recorded.time - offset
    simulated = simulated_on(run, time)
    there, peak_time = np.isfinite(simulated), float(run.time[np.argmax(run.voltage)])
    met = there.any() and time[there][0] <= peak_time <= time[there][-1]  # the peak may fall between coarse samples
    greatest = simulated[there].max() if there.any() else 0.0
    if greatest < (LEAST_BETWEEN if met else LEAST_PEAK) * run.voltage.max():
        raise ValueError(
            f"the simulated echo peaks at {1e9 * peak_time:.3f} ns, the recorded times go from "
            f"{1e9 * time[0]:.3f} to {1e9 * time[-1]:.3f} ns"
            + (
                f" in steps of {1e9 * (time[1] - time[0]):.3f} ns, too wide for its pulse: record with more samples"
                if met
                else ": give the trigger offset, or have it measured (align)"
            )
        )
    return there, time[there], simulated[there]


def measured_offset(recorded: AverageEcho, run: RunFolder) -> float:
    """Measure by how much [s] the recorded mean is later than the simulation: the lag of the greatest correlation.

    The peaks are aligned first, so that the records need not overlap; then the lag is found to a fraction of a sample.
    """
    offset = float(recorded.time[np.argmax(recorded.mean)] - run.time[np.argmax(run.voltage)])
    for _ in range(2):  # the second time near lag 0, where the parabola through three lags is most accurate
        there, time, simulated = overlap(recorded, run, offset)
        offset += compare_waveforms(time, recorded.mean[there], simulated).lag
    return offset
