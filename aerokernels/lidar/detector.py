"""Convert received power to volts without noise: responsivity and a low-pass of -3 dB at the bandwidth B.

"first-order" is 1 / (1 + i f / B), "gaussian" exp(-(ln 2 / 2) (f / B)^2), without delay (the limit of many stages);
"bessel" and "butterworth" are their sections. The exact transfer function is applied in the frequency domain, to a
record padded until nothing wraps around: a digital filter would distort the response at a low sample rate.
"""

import math

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import as_waveform, check_choice, check_count, check_positive
from aerokernels.process.opened import OPENED

RESPONSES = ("first-order", "gaussian", "bessel", "butterworth")
GREATEST_ORDER = 10


def _poles(response: str, order: int) -> np.ndarray:
    """Poles of the analogue filter [2 pi x bandwidth]; computed here, because scipy.signal takes a second to import."""
    if response == "first-order":
        return np.array([-1.0])
    if response == "butterworth":
        return np.exp(0.5j * np.pi * (2.0 * np.arange(order) + order + 1.0) / order)
    poles: np.ndarray = OPENED.once(("low-pass", order), lambda: _bessel_poles(order))
    return poles


def _bessel_poles(order: int) -> np.ndarray:
    """Roots of the reverse Bessel polynomial, sum of (2n - k)! / (2^(n - k) k! (n - k)!) s^k, scaled to -3 dB at 1."""
    degrees = [(order - k, k) for k in range(order, -1, -1)]
    poles = np.roots([math.factorial(order + j) / (2**j * math.factorial(k) * math.factorial(j)) for j, k in degrees])
    low, high = 0.0, 2.0 * order
    while low < (middle := 0.5 * (low + high)) < high:
        above = abs(np.prod(poles / (1j * middle - poles))) > math.sqrt(0.5)
        low, high = (middle, high) if above else (low, middle)
    return poles / middle


def low_pass_gain(frequency, bandwidth: float, response: str = "bessel", order: int = 4) -> np.ndarray:
    """Return the complex gain of a low-pass of -3 dB at `bandwidth` [Hz], of the shape of `frequency` [Hz]."""
    ratio = np.asarray(frequency, dtype=np.float64) / bandwidth
    if response == "gaussian":
        return np.exp(-0.5 * math.log(2.0) * np.square(ratio)).astype(np.complex128)
    return np.asarray(np.prod([-pole / (1j * ratio - pole) for pole in _poles(response, order)], axis=0))


def memory_time(bandwidth: float, response: str = "bessel", order: int = 4) -> float:
    """Return the time [s] after which the low-pass's response to a pulse has decayed, after checking the arguments."""
    check_choice(response, "response", RESPONSES)
    order = check_count(order, "order", 1, GREATEST_ORDER)
    # The Gaussian's impulse response is 1e-16 of its peak after 1.6 / B.
    slowest = 4.0 if response == "gaussian" else float(-_poles(response, order).real.max())
    # Decay of the slowest pole's response by the end of the padding.
    return -math.log(1e-16) / (2.0 * math.pi * slowest * check_positive(bandwidth, "bandwidth", "Hz"))


@checked
def detect(
    time: Numbers,
    power: Numbers,
    *,
    volts_per_watt: float,
    bandwidth: float | None = None,
    response: str = "bessel",
    order: int = 4,
) -> np.ndarray:
    """Return the receiver's voltage for the power on its pupil.

    Args:
        time: Sample times [s], shape (n,), in even steps short enough for the pulse (a tenth of its width will do).
        power: Received power [W], shape (n,); assumed to be 0 before and after the record.
        volts_per_watt: Responsivity times gain [V/W].
        bandwidth: -3 dB bandwidth [Hz]; None: electronics without delay or low-pass.
        response: Kind of low-pass: "first-order", "gaussian", "bessel" or "butterworth".
        order: Number of poles of "bessel" and "butterworth", 1 to 10.

    Returns:
        Voltage [V], shape (n,).

    Raises:
        ValueError: Uneven times, shapes that disagree, numbers that are not positive, an unknown response.
    """
    from scipy.fft import irfft, rfft, rfftfreq

    _, watts, period = as_waveform(time, power, least_count=2)
    gain = check_positive(volts_per_watt, "volts_per_watt", "V/W")
    if bandwidth is None:
        return gain * watts
    memory = memory_time(bandwidth, response, order) / period
    # Greatest number of samples of padding: a gigabyte.
    if not memory <= 1 << 27:
        raise ValueError(
            f"a low-pass of {bandwidth:g} Hz takes {memory:.3g} sample periods of {period:g} s to decay: "
            "check the bandwidth (Hz) and the times (s)"
        )
    padding = math.ceil(memory)
    padded = np.concatenate([gain * watts, np.zeros(padding)])
    low_pass = low_pass_gain(rfftfreq(padded.size, period), bandwidth, response, order)
    return irfft(rfft(padded) * low_pass, padded.size)[: watts.size]
