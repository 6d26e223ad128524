"""Model the detector chain, from received power to recorded volts, with and without noise.

    power -> APD current, with its shot noise -> + background, dark and thermal noise -> transimpedance low-pass
          -> saturation of the amplifier -> sampling -> digitiser

The power is given at times that resolve the pulse and the low-pass. Every `stride`-th of these times is a sample. The
noise is white ahead of the low-pass, which shapes its spectrum. The noise is filtered circularly (the end of the record
precedes its beginning), so that it is stationary from the first sample on.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import as_finite_array, as_waveform, check_choice, check_count, check_positive
from .detector import GREATEST_ORDER, RESPONSES, detect, memory_time
from .digitiser import Digitiser, digitiser_of
from .noise import NoiseSources, noise_bandwidth, noise_sources_of, sampled_noise_gain, white_noise
from .pulse_curve import PulseCurve
from .waveform import SPEED_OF_LIGHT

if TYPE_CHECKING:
    from ..scene import Scene


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
        check_choice(self.response, "response", RESPONSES)
        object.__setattr__(self, "order", check_count(self.order, "order", 1, GREATEST_ORDER))
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
        """Simulate one noisy record.

        Args:
            time: Times [s], shape (n,), in even steps.
            power: Received power [W], shape (n,).
            seed: Seed of the noise, or the generator to use.
            stride: Number of given times per sample.

        Returns:
            Samples [V], shape (ceil(n / stride),).

        Raises:
            ValueError: Uneven times, shapes that disagree, a stride that is not a positive whole number.
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
        """Return noise [V] after the low-pass for a received power [W] at even steps of `period` [s], shape (n,).

        Raises:
            ValueError: Powers that are not finite or have no or several axes, or a period that is not positive.
        """
        from scipy.fft import irfft, rfft, rfftfreq

        check_positive(period, "period", "s")
        density = self.sources.density(power)
        if density.ndim != 1 or not density.size:
            raise ValueError(f"power must be a list of powers [W], got shape {density.shape}")
        current = white_noise(density, period, np.random.default_rng(seed))
        volts = self.transimpedance * current
        if self.bandwidth is None:
            return volts
        low_pass = (period, self.bandwidth, self.response, self.order)
        return irfft(rfft(volts) * sampled_noise_gain(rfftfreq(volts.size, period), *low_pass), volts.size)

    @checked
    def noise_rms(self, power: float, sample_rate: float) -> float:
        """Standard deviation of a sample [V] under a steady power [W], without the digitiser's quantisation.

        Args:
            power: Received power [W]; 0 gives the noise between echoes.
            sample_rate: Rate of the samples [Hz]; it limits the noise band of a chain of unlimited bandwidth.
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

        The noise is white ahead of the low-pass, and the low-pass acts on signal and noise alike. The bound is
        therefore that of the current I in noise of density S: c / 2 / sqrt(integral of (dI/dt)^2 / (S / 2) dt).
        Saturation, the digitiser, and the information in the level of the shot noise are neglected.

        Raises:
            ValueError: Uneven times, shapes that disagree, a power that is constant.
        """
        _, watts, period = as_waveform(time, power)
        slope = self.sources.amperes_per_watt * PulseCurve(watts).slope / period
        information = float(np.sum(np.square(slope) / (0.5 * self.sources.density(watts)))) * period
        if not information > 0.0:
            raise ValueError("the power is constant, so its arrival time is not defined")
        return 0.5 * SPEED_OF_LIGHT / float(np.sqrt(information))

    def _limited(self, voltage: np.ndarray) -> np.ndarray:
        return voltage if self.saturation is None else np.minimum(voltage, self.saturation)


def chain_of(scene: "Scene") -> DetectorChain:
    """Return the detector chain of a scene."""
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
