"""Model the detector chain, from received power to recorded volts, with and without noise.

    power -> APD current with shot noise -> + background, dark and thermal noise -> low-pass -> saturation -> samples
    S = 2 q M^2 F (I_signal + I_background + I_dark) + 4 k T / R + i_n^2 [A^2/Hz],  F = k M + (1 - k) (2 - 1 / M)

S is one-sided and white ahead of the low-pass (R. J. McIntyre, IEEE Trans. Electron Devices 13 (1966)). Noise is
filtered circularly, so that it is stationary from the first sample on.
"""

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import (
    as_finite_array,
    as_waveform,
    check_at_least,
    check_count,
    check_positive,
    check_share,
)
from aerokernels.lidar.detector import GREATEST_ORDER, detect, low_pass_gain, memory_time
from aerokernels.lidar.pulse_curve import PulseCurve
from aerokernels.lidar.pulses import SPEED_OF_LIGHT


@checked
def excess_noise_factor(gain: float, ionisation_ratio: float) -> float:
    """McIntyre's excess noise factor F: 1 without multiplication; equal to the gain for an ionisation ratio of 1.

    Raises:
        ValueError: A gain below 1, or a ratio outside 0 to 1.
    """
    m, k = check_at_least(gain, "gain", 1.0), check_share(ionisation_ratio, "ionisation_ratio")
    return k * m + (1.0 - k) * (2.0 - 1.0 / m)


@checked
@dataclass(frozen=True)
class NoiseSources:
    """A receiver's noise sources.

    Attributes:
        responsivity: Primary photocurrent per watt [A/W].
        gain: Multiplication, 1 for a PIN diode.
        ionisation_ratio: Ratio k of the ionisation coefficients, 0 to 1.
        background_power: Steady light besides the signal [W].
        dark_current: Dark current before multiplication [A].
        temperature: Temperature of the resistor [K].
        load_resistance: The resistor [Ohm].
        amplifier_noise: Input noise current density [A/rtHz].

    Raises:
        ValueError: A number that is negative, not finite or out of range.
    """

    responsivity: float = 0.5
    gain: float = 10.0
    ionisation_ratio: float = 0.02
    background_power: float = 10e-9
    dark_current: float = 0.1e-9
    temperature: float = 293.0
    load_resistance: float = 1e3
    amplifier_noise: float = 2e-12

    def __post_init__(self):
        """Check the numbers."""
        for name, unit in (("responsivity", "A/W"), ("temperature", "K"), ("load_resistance", "Ohm")):
            check_positive(getattr(self, name), name, unit)
        for name in ("background_power", "dark_current", "amplifier_noise"):
            check_at_least(getattr(self, name), name, 0.0)
        excess_noise_factor(self.gain, self.ionisation_ratio)

    @property
    def amperes_per_watt(self) -> float:
        """Multiplied current per watt [A/W]."""
        return self.responsivity * self.gain

    @property
    def thermal_density(self) -> float:
        """One-sided noise density of resistor and amplifier [A^2/Hz]."""
        return 4.0 * 1.380649e-23 * self.temperature / self.load_resistance + self.amplifier_noise**2  # Boltzmann's

    @checked
    def density(self, power: Numbers) -> np.ndarray:
        """Return the one-sided noise density [A^2/Hz] for a received power [W], of the shape of `power`."""
        received = np.maximum(as_finite_array(power, "power"), 0.0) + self.background_power
        primary = self.responsivity * received + self.dark_current
        excess = excess_noise_factor(self.gain, self.ionisation_ratio)
        shot = 2.0 * 1.602176634e-19 * self.gain**2 * excess * primary  # the elementary charge [C]
        return np.asarray(shot + self.thermal_density)


@checked
@dataclass(frozen=True)
class Digitiser:
    """An analogue-to-digital converter.

    Attributes:
        bit_count: Number of bits, 1 to 24.
        low: Voltage of the lowest code [V].
        high: Voltage of the highest code [V].

    Raises:
        ValueError: A number of bits out of range, or a `low` that is not below `high`.
    """

    bit_count: int
    low: float = -0.5
    high: float = 4.5

    def __post_init__(self):
        """Check the number of bits and the range."""
        object.__setattr__(self, "bit_count", check_count(self.bit_count, "bit_count", 1, 24))
        if check_at_least(self.low, "low") >= check_at_least(self.high, "high"):
            raise ValueError(f"the digitiser's low {self.low:g} V must be below its high {self.high:g} V")

    @property
    def step(self) -> float:
        """Voltage between two codes [V]."""
        return (self.high - self.low) / (2**self.bit_count - 1)

    @checked
    def codes(self, voltage: Numbers) -> np.ndarray:
        """Return the nearest codes, 0 to 2^bit_count - 1, of voltages [V], clipped to the digitiser's range."""
        volts = np.clip(as_finite_array(voltage, "voltage"), self.low, self.high)
        return np.rint((volts - self.low) / self.step).astype(np.int64)

    @checked
    def record(self, voltage: Numbers) -> np.ndarray:
        """Return voltages [V] rounded to those of the nearest codes."""
        return self.low + self.step * self.codes(voltage)


@checked
@dataclass(frozen=True)
class DetectorChain:
    """A receiver's electronics.

    Attributes:
        volts_per_watt: Gain at 0 Hz: responsivity x multiplication x transimpedance [V/W].
        sources: The noise sources.
        bandwidth: -3 dB bandwidth of the transimpedance amplifier [Hz]; None: unlimited, and the noise fills the band
            up to half the sample rate.
        response: The amplifier's low-pass: "bessel", "butterworth", "first-order" or "gaussian".
        order: Number of poles of "bessel" and "butterworth".
        saturation: Greatest voltage of the amplifier [V]; None: unlimited.
        digitiser: Quantises the samples; None: no quantisation.

    Raises:
        ValueError: A number that is not positive, an unknown response, an order out of range.
        TypeError: `sources` that are no NoiseSources, or a `digitiser` that is no Digitiser.
    """

    volts_per_watt: float
    sources: NoiseSources = field(default_factory=NoiseSources)
    bandwidth: float | None = None
    response: str = "bessel"
    order: int = 4
    saturation: float | None = None
    digitiser: Digitiser | None = None

    def __post_init__(self):
        """Check the numbers and the kinds of the parts."""
        check_positive(self.volts_per_watt, "volts_per_watt", "V/W")
        object.__setattr__(self, "order", check_count(self.order, "order", 1, GREATEST_ORDER))
        memory_time(1.0 if self.bandwidth is None else self.bandwidth, self.response, self.order)  # checks them
        if not isinstance(self.sources, NoiseSources):
            raise TypeError(f"sources must be a NoiseSources, got {self.sources!r}")
        if not isinstance(self.digitiser, Digitiser | None):
            raise TypeError(f"digitiser must be a Digitiser, got {self.digitiser!r}")
        if self.saturation is not None:
            check_positive(self.saturation, "saturation", "V")

    @property
    def transimpedance(self) -> float:
        """Volts per ampere of multiplied current [Ohm]."""
        return self.volts_per_watt / self.sources.amperes_per_watt

    @checked
    def linear_voltage(self, time: Numbers, power: Numbers) -> np.ndarray:
        """Return the voltage [V] for a power [W] at even times [s], shape (n,), without noise or limits."""
        return detect(
            time,
            power,
            volts_per_watt=self.volts_per_watt,
            bandwidth=self.bandwidth,
            response=self.response,
            order=self.order,
        )

    @checked
    def voltage(self, time: Numbers, power: Numbers) -> np.ndarray:
        """Return the voltage [V] after saturation, without noise or digitiser, shape (n,)."""
        return self._limited(self.linear_voltage(time, power))

    @checked
    def record(self, time: Numbers, power: Numbers, seed: int | np.random.Generator = 0, stride: int = 1) -> np.ndarray:
        """Return the samples [V] of one noisy record, shape (ceil(n / stride),), of a power [W] at even times [s].

        `seed` is that of the noise, or a generator; every `stride`-th time is sampled.
        """
        _, watts, period = as_waveform(time, power, least_count=2)
        stride = check_count(stride, "stride")
        volts = self.linear_voltage(time, power)
        if self.bandwidth is None:  # without a low-pass the noise fills the band of the samples
            volts = volts[::stride] + self.noise(watts[::stride], stride * period, seed)
        else:
            volts = (volts + self.noise(watts, period, seed))[::stride]
        return self.digitise(self._limited(volts))

    @checked
    def noise(self, power: Numbers, period: float, seed: int | np.random.Generator = 0) -> np.ndarray:
        """Return noise [V] after the low-pass for a received power [W] at even steps of `period` [s], shape (n,)."""
        from scipy.fft import irfft, rfft, rfftfreq

        check_positive(period, "period", "s")
        density = self.sources.density(power)
        if density.ndim != 1 or not density.size:
            raise ValueError(f"power must be a list of powers [W], got shape {density.shape}")
        # Samples of period h hold the band up to 1 / (2 h), so the variance of a sample is density / (2 h).
        white = np.sqrt(density / (2.0 * period)) * np.random.default_rng(seed).standard_normal(density.size)
        volts = self.transimpedance * white
        if self.bandwidth is None:
            return volts
        low_pass = (period, self.bandwidth, self.response, self.order)
        return irfft(rfft(volts) * sampled_noise_gain(rfftfreq(volts.size, period), *low_pass), volts.size)

    @checked
    def noise_rms(self, power: float, sample_rate: float) -> float:
        """Standard deviation of a sample [V] under a steady power [W], without the digitiser's quantisation.

        The sample rate [Hz] limits the noise band of a chain of unlimited bandwidth.
        """
        top = 0.5 * check_positive(sample_rate, "sample_rate", "Hz")
        if self.bandwidth is None:
            band = top
        else:  # sampling aliases the noise above half the sample rate
            band = noise_bandwidth(self.bandwidth, self.response, self.order, max(top, 1e3 * self.bandwidth))
        return float(self.transimpedance * np.sqrt(self.sources.density(power) * band))

    @checked
    def clipped(self, voltage: Numbers) -> np.ndarray:
        """Limit voltages [V] to the amplifier's saturation and to the digitiser's range, without quantisation."""
        limited = self._limited(as_finite_array(voltage, "voltage"))
        return limited if self.digitiser is None else np.clip(limited, self.digitiser.low, self.digitiser.high)

    @checked
    def digitise(self, voltage: Numbers) -> np.ndarray:
        """Return the samples [V] as the digitiser records them."""
        volts = as_finite_array(voltage, "voltage")
        return volts if self.digitiser is None else self.digitiser.record(volts)

    @checked
    def cramer_rao_range(self, time: Numbers, power: Numbers) -> float:
        """Return the least standard deviation [m] of an unbiased range (Cramér-Rao), for a power [W] at times [s].

        The low-pass acts on signal and noise alike, so the bound is that of the current I in noise of density S:
        c / 2 / sqrt(integral of (dI/dt)^2 / (S / 2) dt), without saturation and digitiser.
        """
        _, watts, period = as_waveform(time, power)
        slope = self.sources.amperes_per_watt * PulseCurve(watts).slope / period
        information = float(np.sum(np.square(slope) / (0.5 * self.sources.density(watts)))) * period
        if not information > 0.0:
            raise ValueError("the power is constant, so its arrival time is not defined")
        return 0.5 * SPEED_OF_LIGHT / float(np.sqrt(information))

    def _limited(self, voltage: np.ndarray) -> np.ndarray:
        return voltage if self.saturation is None else np.minimum(voltage, self.saturation)


def noise_bandwidth(bandwidth: float, response: str, order: int, top: float) -> float:
    """Return the integral of |gain|^2 of a low-pass up to the frequency `top` [Hz]."""
    from scipy.integrate import quad

    def power_gain(ratio: float) -> float:
        return float(np.abs(low_pass_gain(ratio * bandwidth, bandwidth, response, order)) ** 2)

    # Integrate octave by octave, so that the quadrature does not miss the passband within a wide band.
    edges = [0.0, *(2.0**k for k in range(math.ceil(math.log2(max(top / bandwidth, 1.0))) + 1))]
    edges = [*(edge for edge in edges if edge < top / bandwidth), top / bandwidth]
    return bandwidth * sum(quad(power_gain, low, high)[0] for low, high in pairwise(edges))


def sampled_noise_gain(frequency, period: float, bandwidth: float, response: str, order: int) -> np.ndarray:
    """Return the noise gain of a low-pass followed by sampling every `period` [s], at frequencies [Hz] up to 1 / (2 h).

    It is the root of the sum of |gain|^2 over all frequencies that sampling aliases to this one. For a single pole,
    whose gain falls off slowly, the sum has a closed form.
    """
    rate, low = 1.0 / period, np.asarray(frequency, dtype=np.float64)
    if response == "first-order" or (order == 1 and response != "gaussian"):
        # The sum of 1 / (1 + ((f + k rate) / B)^2) over all k, written so that a wide band does not overflow.
        decay = math.exp(-2.0 * math.pi * bandwidth / rate)
        power = (1.0 - decay**2) / (1.0 + decay**2 - 2.0 * decay * np.cos(2.0 * np.pi * low / rate))
        return np.sqrt(math.pi * bandwidth / rate * power)
    # Aliased bands on either side; with two poles the next holds 1e-3 of the noise even at a rate of 1 / B.
    images = range(-4, 5)
    return np.sqrt(sum(np.abs(low_pass_gain(low + fold * rate, bandwidth, response, order)) ** 2 for fold in images))
