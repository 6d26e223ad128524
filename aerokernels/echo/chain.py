"""The detector chain: light to recorded volts, with and without noise.

    power -> APD current, with its shot noise -> + background, dark and thermal noise -> transimpedance low-pass
          -> amplifier's saturation -> sampling -> digitiser

Power is given at times that resolve the pulse and the low-pass; every `stride`-th of them is a sample. The noise is
white before the low-pass, which shapes it. It is filtered circularly, the end of the record preceding its beginning, so
that it is stationary from the first sample on.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..inputs.checks import as_waveform, check_choice, check_count, check_positive
from .detector import RESPONSES, check_order, detect, memory_time
from .digitiser import Digitiser, digitiser_of
from .noise import NoiseSources, noise_bandwidth, noise_sources_of, sampled_noise_gain, white_noise
from .pulse_curve import PulseCurve
from .waveform import SPEED_OF_LIGHT

if TYPE_CHECKING:
    from ..scene import Scene


@dataclass(frozen=True)
class DetectorChain:
    """A receiver's electronics.

    Attributes:
        volts_per_watt: Volts for a watt at 0 Hz: responsivity x gain x transimpedance [V/W].
        sources: Its noise.
        bandwidth: -3 dB bandwidth of the transimpedance amplifier [Hz]; None: unlimited, and the noise fills the band
            up to half the sample rate.
        response: Its low-pass: "bessel", "butterworth", "first-order" or "gaussian".
        order: Number of poles of the first two.
        saturation: Greatest voltage of the amplifier [V]; None: unlimited.
        digitiser: Quantises the samples; None: no quantisation.

    Raises:
        ValueError: A number that is not positive, an unknown response, an order out of range.
        TypeError: Sources or a digitiser of another kind.
    """

    volts_per_watt: float
    sources: NoiseSources = field(default_factory=NoiseSources)
    bandwidth: float | None = None
    response: str = "bessel"
    order: int = 4
    saturation: float | None = None
    digitiser: Digitiser | None = None

    def __post_init__(self):
        """Check."""
        check_positive(self.volts_per_watt, "volts_per_watt", "V/W")
        check_choice(self.response, "response", RESPONSES)
        check_order(self.order)
        for name, part, kind in (
            ("sources", self.sources, NoiseSources),
            ("digitiser", self.digitiser or Digitiser(1), Digitiser),
        ):
            if not isinstance(part, kind):
                raise TypeError(f"{name} must be a {kind.__name__}, got {part!r}")
        if self.bandwidth is not None:
            memory_time(self.bandwidth, self.response, self.order)
        if self.saturation is not None:
            check_positive(self.saturation, "saturation", "V")

    @property
    def transimpedance(self) -> float:
        """Volts for an ampere behind the multiplication [Ohm]."""
        return self.volts_per_watt / self.sources.amperes_per_watt

    def linear_voltage(self, time, power) -> np.ndarray:
        """Voltage [V] of a power [W] at even times [s], shape (n,), without noise, limits or digitiser."""
        return detect(
            time,
            power,
            volts_per_watt=self.volts_per_watt,
            bandwidth=self.bandwidth,
            response=self.response,
            order=self.order,
        )

    def voltage(self, time, power) -> np.ndarray:
        """Voltage [V] behind the amplifier's saturation, without noise: the mean of many records, shape (n,)."""
        return self._limited(self.linear_voltage(time, power))

    def record(self, time, power, seed: int | np.random.Generator = 0, stride: int = 1) -> np.ndarray:
        """One noisy record.

        Args:
            time: Times [s], shape (n,), in even steps.
            power: Received power [W], shape (n,).
            seed: Seed of the noise, or a generator to take it from.
            stride: Number of given times from one sample to the next.

        Returns:
            Samples [V], shape (ceil(n / stride),).

        Raises:
            ValueError: Uneven times, shapes that disagree, a stride that is no positive whole number.
        """
        _, watts, period = as_waveform(time, power, least_count=2)
        check_count(stride, "stride", 1)
        volts = self.linear_voltage(time, power)
        if self.bandwidth is None:  # no low-pass bounds the noise: it fills the band of the samples
            volts = volts[::stride] + self.noise(watts[::stride], stride * period, seed)
        else:
            volts = (volts + self.noise(watts, period, seed))[::stride]
        return self.digitise(self._limited(volts))

    def noise(self, power: np.ndarray, period: float, seed: int | np.random.Generator = 0) -> np.ndarray:
        """Noise [V] behind the low-pass while a power [W] is received at even steps of `period` [s], shape (n,)."""
        from scipy.fft import irfft, rfft, rfftfreq

        current = white_noise(self.sources.density(power), period, np.random.default_rng(seed))
        volts = self.transimpedance * current
        if self.bandwidth is None:
            return volts
        low_pass = (period, self.bandwidth, self.response, self.order)
        return irfft(rfft(volts) * sampled_noise_gain(rfftfreq(volts.size, period), *low_pass), volts.size)

    def noise_rms(self, power: float, sample_rate: float) -> float:
        """Standard deviation of a sample [V] under a steady power [W], the digitiser's left out.

        Args:
            power: Received power [W], 0 for the noise between echoes.
            sample_rate: Rate of the samples [Hz]; it bounds the noise of a chain of unlimited bandwidth.
        """
        top = 0.5 * check_positive(sample_rate, "sample_rate", "Hz")
        if self.bandwidth is None:
            band = top
        else:  # the amplifier's noise beyond half the sample rate is folded back into the samples
            band = noise_bandwidth(self.bandwidth, self.response, self.order, max(top, 1e3 * self.bandwidth))
        return float(self.transimpedance * np.sqrt(self.sources.density(power) * band))

    def digitise(self, voltage: np.ndarray) -> np.ndarray:
        """Samples as the digitiser records them [V]."""
        return voltage if self.digitiser is None else self.digitiser.record(voltage)

    def cramer_rao_range(self, time, power) -> float:
        """Least standard deviation of an unbiased range [m] from a record of this power [W] at fine times [s].

        The noise is white before the low-pass, and the low-pass changes signal and noise alike, so the bound is that of
        the current I in its noise of density S: c / 2 / sqrt(integral of (dI/dt)^2 / (S / 2) dt). Saturation, the
        digitiser, and the information in the level of the shot noise are neglected.

        Raises:
            ValueError: Uneven times, shapes that disagree, a power without a slope.
        """
        _, watts, period = as_waveform(time, power)
        slope = self.sources.amperes_per_watt * PulseCurve(watts).slope / period
        information = float(np.sum(np.square(slope) / (0.5 * self.sources.density(watts)))) * period
        if not information > 0.0:
            raise ValueError("the power has no slope anywhere, so its arrival time cannot be told: is it a flat line?")
        return 0.5 * SPEED_OF_LIGHT / float(np.sqrt(information))

    def _limited(self, voltage: np.ndarray) -> np.ndarray:
        return voltage if self.saturation is None else np.minimum(voltage, self.saturation)


def chain_of(scene: "Scene") -> DetectorChain:
    """A scene's detector chain."""
    table = scene.detector
    return DetectorChain(
        volts_per_watt=table.volts_per_watt,
        sources=noise_sources_of(scene),
        bandwidth=table.bandwidth,
        response=table.response,
        order=table.order,
        saturation=table.saturation,
        digitiser=digitiser_of(scene),
    )
