"""The [detector] table of a scene: light to volts, noise, digitiser, range. Defaults as in tables.py.

Noise and digitiser are off by default: the simulated voltage is then the average of many recordings.
"""

from typing import Annotated, Literal

from pydantic import Field, StrictBool, model_validator

from aerokernels.scene.values import (
    Count,
    Current,
    DiodeResponsivity,
    Fraction,
    Frequency,
    Gain,
    Level,
    LightLevel,
    NoiseCurrent,
    OpenShare,
    Resistance,
    Responsivity,
    Table,
    Temperature,
    Voltage,
    Whole,
    absent,
    key,
)

# Detector voltage per watt at the pupil [V/W]. Chosen once, so that the simulated echo of the static scene peaks near
# 1.994 V, the peak that the paper's Tables 3 and 4 imply for its simulation without flow: 1.994 V divided by the static
# scene's simulated peak of 3.58715e-4 W. It is never tuned to a flow.
STATIC_CALIBRATION = 5558.7


class DetectorTable(Table):
    """[detector]: light to volts to range."""

    volts_per_watt: Responsivity = key(
        STATIC_CALIBRATION,
        "Detector voltage per watt at the pupil, 'V/W'. Not in the paper: chosen once so that the static scene's echo "
        "peaks near 1.994 V, the peak that the paper's tables imply for its simulation without flow.",
    )
    bandwidth: Annotated[Frequency | None, absent("unlimited")] = key(
        None,
        '-3 dB bandwidth of the detector and amplifier, or "unlimited" (default): beam.pulse_tau is then that of the '
        "recorded pulse, already broadened by detector and amplifier.",
    )
    response: Literal["bessel", "butterworth", "first-order", "gaussian"] = key(
        "bessel",
        "Low-pass filter of that bandwidth: Bessel (flat delay), Butterworth (flat gain), a single pole, or a Gaussian "
        "without delay.",
    )
    order: Annotated[Count, Field(le=10)] = key(4, "Poles of the Bessel or Butterworth low-pass, 1 to 10.")
    responsivity: DiodeResponsivity = key(
        "0.5 A/W",
        "Primary photocurrent per watt, before multiplication: silicon at 905 nm. Responsivity and gain affect only "
        "the noise; volts_per_watt already contains both and the transimpedance.",
    )
    gain: Gain = key(
        10.0,
        "Multiplication M of the avalanche photodiode, 1 for a PIN diode. The default is low because the echo at 1.5 m "
        "is strong, 0.4 mW.",
    )
    ionisation_ratio: Fraction = key(
        0.02, "k of the excess noise factor F = k M + (1 - k)(2 - 1 / M): electrons in silicon."
    )
    background_power: LightLevel = key(
        "10 nW", "Steady background light on the detector: a lit room through a narrow filter."
    )
    dark_current: Current = key(
        "0.1 nA", "Dark current before multiplication: a small silicon diode at room temperature."
    )
    temperature: Temperature = key("293 K", "Temperature of the transimpedance resistor, for its thermal noise.")
    load_resistance: Resistance | None = key(
        None, "Resistor of the thermal noise; absent: the transimpedance, volts_per_watt / (responsivity x gain)."
    )
    amplifier_noise: NoiseCurrent = key(
        "2 pA/rtHz", "Input noise current density of the amplifier: a typical 100 MHz transimpedance amplifier."
    )
    noise: StrictBool = key(
        False,
        "Whether the recorded voltage has noise. If the bandwidth is unlimited, the noise has a bandwidth of half the "
        "sample rate.",
    )
    seed: Annotated[Whole, Field(ge=0, le=2**63 - 1)] = key(
        0, "Seed of the noise: the same seed gives the same record."
    )
    saturation: Annotated[Voltage | None, absent("unlimited")] = key(
        None, 'Greatest voltage of the amplifier, or "unlimited" (default).'
    )
    sample_rate: Frequency = key(
        "10 GHz", "Sample rate: 100 ps, 60 samples per tau; a threshold crossing between two samples is interpolated."
    )
    bit_count: Annotated[Annotated[Count, Field(le=24)] | None, absent("unlimited")] = key(
        None, 'Bits of the digitiser, 1 to 24, or "unlimited" (default): neither quantised nor clipped.'
    )
    adc_low: Level = key("-0.5 V", "Voltage of the digitiser's lowest code; lower voltages are clipped.")
    adc_high: Level = key("4.5 V", "Voltage of the digitiser's highest code: about twice the static peak.")
    ranging: Literal["leading-edge", "constant-fraction", "centroid", "matched-filter"] = key(
        "leading-edge",
        'How the arrival time is read. "leading-edge": at a fixed level, so that it shifts with the amplitude, as in '
        'the paper\'s results; "constant-fraction": at a fraction of the peak; "centroid": at the centroid; '
        '"matched-filter": at the best fit of the echo without flow. The last three do not shift with the amplitude.',
    )
    threshold: Voltage = key(
        "1 V", "Level of the leading-edge discriminator. Not in the paper: half of the paper's static peak."
    )
    fraction: OpenShare = key(0.5, "Fraction of the peak for constant-fraction ranging.")
    trial_count: Annotated[Whole, Field(ge=0, le=10**6)] = key(
        0, "Number of noisy records that are ranged to find the random error, at least 2; 0: none."
    )

    @model_validator(mode="after")
    def _consistent(self) -> "DetectorTable":
        if not self.adc_low < self.adc_high:
            raise ValueError(
                f"detector.adc_low {self.adc_low:g} V must be below detector.adc_high {self.adc_high:g} V: "
                "swap them, or widen the range"
            )
        if self.trial_count == 1:
            raise ValueError("detector.trial_count 1 gives no random error: write 0 for none, or at least 2")
        return self
