"""Compute the noise of an avalanche photodiode and its transimpedance amplifier.

One-sided spectral density of the noise current after multiplication, white up to the amplifier's bandwidth:

    S = 2 q M^2 F (I_signal + I_background + I_dark) + 4 k T / R + i_n^2        [A^2/Hz]
    F = k M + (1 - k) (2 - 1 / M)

I: primary currents, responsivity times power; M: multiplication; F: excess noise factor for electron injection (k: the
ratio of the ionisation coefficients); R: the resistor that converts the current to volts; i_n: the amplifier's input
noise.

R. J. McIntyre, Multiplication noise in uniform avalanche diodes, IEEE Trans. Electron Devices 13 (1966).
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..inputs.arguments import Numbers, checked
from ..inputs.checks import as_finite_array, check_at_least, check_positive, check_share
from .detector import low_pass_gain

if TYPE_CHECKING:
    from ..scene import Scene

ELEMENTARY_CHARGE = 1.602176634e-19  # [C], exact
BOLTZMANN_CONSTANT = 1.380649e-23  # [J/K], exact
FOLDS = 4  # aliased bands on either side; with two poles the next holds 1e-3 of the noise even at a rate of 1 / B


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
        return 4.0 * BOLTZMANN_CONSTANT * self.temperature / self.load_resistance + self.amplifier_noise**2

    @checked
    def density(self, power: Numbers) -> np.ndarray:
        """Return the one-sided noise density [A^2/Hz] for a received power [W], of the shape of `power`."""
        received = np.maximum(as_finite_array(power, "power"), 0.0) + self.background_power
        primary = self.responsivity * received + self.dark_current
        excess = excess_noise_factor(self.gain, self.ionisation_ratio)
        shot = 2.0 * ELEMENTARY_CHARGE * self.gain**2 * excess * primary
        return np.asarray(shot + self.thermal_density)


def noise_sources_of(scene: "Scene") -> NoiseSources:
    """Return the noise sources of a scene; without `load_resistance` the resistor is the transimpedance."""
    table = scene.detector
    transimpedance = table.volts_per_watt / (table.responsivity * table.gain)
    return NoiseSources(
        responsivity=table.responsivity,
        gain=table.gain,
        ionisation_ratio=table.ionisation_ratio,
        background_power=table.background_power,
        dark_current=table.dark_current,
        temperature=table.temperature,
        load_resistance=transimpedance if table.load_resistance is None else table.load_resistance,
        amplifier_noise=table.amplifier_noise,
    )


def white_noise(density: np.ndarray, period: float, generator: np.random.Generator) -> np.ndarray:
    """Return white noise [A] of a one-sided density [A^2/Hz] that may change along the record, shape (n,).

    Samples of period h hold the band up to 1 / (2 h), so the variance of a sample is density / (2 h).
    """
    return np.sqrt(density / (2.0 * period)) * generator.standard_normal(density.size)


def noise_bandwidth(bandwidth: float, response: str, order: int, top: float) -> float:
    """Noise bandwidth [Hz] of a low-pass up to the frequency `top` [Hz]: the integral of |gain|^2."""
    from scipy.integrate import quad

    def power_gain(ratio: float) -> float:
        return float(np.abs(low_pass_gain(ratio * bandwidth, bandwidth, response, order)) ** 2)

    # Integrate octave by octave, so that the quadrature does not miss the passband within a wide band.
    edges = [0.0, *(2.0**k for k in range(math.ceil(math.log2(max(top / bandwidth, 1.0))) + 1))]
    edges = [*(edge for edge in edges if edge < top / bandwidth), top / bandwidth]
    return bandwidth * sum(quad(power_gain, low, high)[0] for low, high in pairwise(edges))


def sampled_noise_gain(frequency, period: float, bandwidth: float, response: str, order: int) -> np.ndarray:
    """Return the noise gain of a low-pass followed by sampling, which aliases noise above half the sample rate.

    Args:
        frequency: Frequencies up to half the sample rate [Hz], any shape.
        period: Sample period [s].
        bandwidth: -3 dB bandwidth of the low-pass [Hz].
        response: As for `low_pass_gain`.
        order: As for `low_pass_gain`.

    Returns:
        The square root of the sum of |gain|^2 over all frequencies that sampling aliases to `frequency`, of the shape
        of `frequency`. For a single pole, whose gain falls off slowly, the sum has a closed form.
    """
    rate, low = 1.0 / period, np.asarray(frequency, dtype=np.float64)
    if response == "first-order" or (order == 1 and response != "gaussian"):
        # The sum of 1 / (1 + ((f + k rate) / B)^2) over all k, written so that a wide band does not overflow.
        decay = math.exp(-2.0 * math.pi * bandwidth / rate)
        power = (1.0 - decay**2) / (1.0 + decay**2 - 2.0 * decay * np.cos(2.0 * np.pi * low / rate))
        return np.sqrt(math.pi * bandwidth / rate * power)
    images = range(-FOLDS, FOLDS + 1)
    return np.sqrt(sum(np.abs(low_pass_gain(low + fold * rate, bandwidth, response, order)) ** 2 for fold in images))
