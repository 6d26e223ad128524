"""Light that leaves the periodic window of a wave on one side and comes back on the other, where it belongs nowhere.

A component of the angular spectrum with the slope t moves by the distance times t. All light starts within the lit part
of the window. If the whole lit part, moved so far, is beyond a side, the component's light has certainly left.
"""

import numpy as np

from aerokernels.inputs.checks import warn_caller

# Share of the light on each side of the lit part; share of light that may leave without a warning.
BESIDE, TOLERATED = 1e-4, 1e-3


class WrappedWaveWarning(UserWarning):
    """Light leaves the window of a wave, and comes back on its other side."""


def wrapped_share(
    amplitude: np.ndarray, pixel: float, wavelength: float, distance: float, ambient_index: float
) -> float:
    """Return the share of the light that certainly leaves the window over a distance [m], by either axis.

    Args:
        amplitude: Complex amplitude over square pixels, shape (rows, columns).
        pixel: Side of a pixel [m].
        wavelength: Vacuum wavelength [m].
        distance: Distance of propagation [m].
        ambient_index: Refractive index of the air.
    """
    from scipy.fft import fft2, fftfreq

    light, spectrum = np.abs(amplitude) ** 2, np.abs(fft2(amplitude)) ** 2
    worst = 0.0
    for axis in (0, 1):
        begun = np.cumsum(light.sum(axis=1 - axis))
        first, last = np.searchsorted(begun, np.array([BESIDE, 1.0 - BESIDE]) * begun[-1])
        count = begun.size
        sine = fftfreq(count, pixel) * wavelength / ambient_index
        slope = sine / np.sqrt(np.maximum(1.0 - sine**2, np.finfo(np.float64).tiny))
        moved = np.where(np.abs(sine) < 1.0, slope * distance / pixel, 0.0)  # the others are evanescent
        left = (first + moved > count - 0.5) | (last + moved < -0.5)
        by_component = spectrum.sum(axis=1 - axis)
        worst = max(worst, float(by_component[left].sum() / by_component.sum()))
    return worst


def warn_of_wrapping(
    amplitude: np.ndarray, pixel: float, wavelength: float, distance: float, ambient_index: float
) -> None:
    """Warn if more than a thousandth of the light leaves the window; the arguments are those of `wrapped_share`."""
    share = wrapped_share(amplitude, pixel, wavelength, distance, ambient_index)
    if share > TOLERATED:
        rows, columns = amplitude.shape
        warn_caller(
            f"over {distance:.4g} m at least {100.0 * share:.2g} % of the light leaves the window of "
            f"{columns * pixel:.4g} m x {rows * pixel:.4g} m, which is periodic, and comes back on its other side: "
            "the amplitude is not that of free space; take a wider window, or a Wave with a margin of zeros",
            WrappedWaveWarning,
        )
