"""From received power to sampled volts: responsivity, bandwidth, sampling. No noise yet.

The receiver's electronics are a low-pass of unit gain at 0 Hz and -3 dB at `bandwidth`:

    "first-order"   1 / (1 + i f / B)
    "gaussian"      exp(-(ln 2 / 2) (f / B)^2), no delay (not causal; the limit of many equal stages)
    "bessel"        fourth-order Bessel, flat group delay

It is applied by its exact transfer function in the frequency domain, on a record padded until nothing wraps around.
First-order and Bessel delay the pulse; a rangefinder is calibrated for that, and so is `simulate.echo`.
"""

import math

import numpy as np

from .checks import as_waveform, check_choice, check_positive

RESPONSES = ("first-order", "gaussian", "bessel")
BESSEL_ORDER = 4
# A first-order stage forgets by exp(-2 pi B t): 1e-16 after 6 / B.
_MEMORY = 6.0


def low_pass_gain(frequency, bandwidth: float, response: str = "bessel") -> np.ndarray:
    """Complex gain at the frequencies given.

    Args:
        frequency: Frequencies [Hz], any shape.
        bandwidth: Frequency at which the power gain is one half [Hz].
        response: "first-order", "gaussian" or "bessel".

    Returns:
        Gain, complex, of the shape of `frequency`.

    Raises:
        ValueError: A bandwidth that is not positive, or an unknown response.
    """
    ratio = np.asarray(frequency, dtype=np.float64) / check_positive(bandwidth, "bandwidth", "Hz")
    check_choice(response, "response", RESPONSES)
    if response == "first-order":
        return 1.0 / (1.0 + 1j * ratio)
    if response == "gaussian":
        return np.exp(-0.5 * math.log(2.0) * np.square(ratio)).astype(np.complex128)
    from scipy import signal

    numerator, denominator = signal.bessel(BESSEL_ORDER, 1.0, analog=True, norm="mag")
    return np.asarray(signal.freqs(numerator, denominator, worN=ratio.ravel())[1]).reshape(ratio.shape)


def detect(
    time, power, *, volts_per_watt: float, bandwidth: float | None = None, response: str = "bessel"
) -> np.ndarray:
    """Voltage that the receiver makes of the power on its pupil.

    Args:
        time: Sample times [s], shape (n,), in even steps short enough for the pulse (a tenth of its width will do).
        power: Received power [W], shape (n,); taken to be nothing before and after the record.
        volts_per_watt: Responsivity times gain [V/W].
        bandwidth: -3 dB bandwidth [Hz]; None for electronics that follow at once.
        response: Kind of low-pass: "first-order", "gaussian" or "bessel".

    Returns:
        Voltage [V], shape (n,).

    Raises:
        ValueError: Uneven times, shapes that disagree, numbers that are not positive, an unknown response.
    """
    _, watts, period = as_waveform(time, power, least_count=2)
    gain = check_positive(volts_per_watt, "volts_per_watt", "V/W")
    if bandwidth is None:
        return gain * watts
    count = watts.size + math.ceil(_MEMORY / (check_positive(bandwidth, "bandwidth", "Hz") * period))
    from scipy.fft import irfft, next_fast_len, rfft, rfftfreq

    count = next_fast_len(2 * count, real=True)
    spectrum = rfft(gain * watts, count) * low_pass_gain(rfftfreq(count, period), bandwidth, response)
    return irfft(spectrum, count)[: watts.size]


def sample_times(start: float, stop: float, sample_rate: float) -> np.ndarray:
    """Times k / sample_rate [s] that cover start to stop [s], shape (n,): the digitiser's clock runs from t = 0.

    Raises:
        ValueError: A sample rate that is not positive, or a stop that is not after the start.
    """
    rate = check_positive(sample_rate, "sample_rate", "Hz")
    if not stop > start:
        raise ValueError(f"a record must end after it starts, got {start!r} s to {stop!r} s")
    return np.arange(math.floor(start * rate), math.ceil(stop * rate) + 1) / rate
