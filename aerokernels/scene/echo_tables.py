"""The tables of a scene that describe the laser's path: beam, target, receiver, the air between, detector."""

import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, StrictBool, model_validator

from aerokernels.pupils import Annulus, Disc, Pupil, Rectangle
from aerokernels.scene import values as si
from aerokernels.scene.values import Table, absent, key

LEAST_PULSE_SAMPLES = 4


def _axis(value: Any) -> tuple[float, float, float]:
    if (
        not isinstance(value, (list, tuple))
        or len(value) != 3
        or any(isinstance(part, bool) or not isinstance(part, (int, float)) for part in value)
        or not all(map(math.isfinite, value))
        or not any(value)
    ):
        raise ValueError("give three finite numbers (x, y, z), not all zero, such as [1, 0, 0]")
    return (float(value[0]), float(value[1]), float(value[2]))


def _pulse_samples(value: Any) -> tuple[float, ...]:
    if not isinstance(value, (list, tuple)) or any(
        isinstance(part, bool) or not isinstance(part, (int, float)) for part in value
    ):
        raise ValueError("give a list of numbers, such as [0, 0.4, 1, 0.3, 0]")
    if not all(math.isfinite(part) and part >= 0.0 for part in value):
        raise ValueError(
            "a sample of the pulse is negative or not finite: subtract the record's offset, and cut off its noise"
        )
    if value and not 1e-12 <= max(value) <= 1e12:
        raise ValueError("the pulse's greatest sample must be from 1e-12 to 1e12: 1, say")
    return tuple(map(float, value))


def _node_count(value: Any) -> Any:
    if value == "every":
        return value
    whole = isinstance(value, (int, float)) and not isinstance(value, bool) and value in range(3, 1000, 2)
    if not whole:
        raise ValueError("give an odd whole number from 3 to 999, or 'every'")
    return int(value)


class TiltedRectangle:
    """Geometry of a rectangle of `width` and `height` [m], turned by `tilt` [rad] about `tilt_axis`, of any length."""

    @property
    def orientation(self: Any) -> np.ndarray:
        """Unit vectors as columns: along its width, along its height, its normal; shape (3, 3)."""
        axis = np.array(self.tilt_axis) / np.abs(self.tilt_axis).max()
        x, y, z = axis / np.linalg.norm(axis)
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return np.eye(3) + math.sin(self.tilt) * cross + (1.0 - math.cos(self.tilt)) * cross @ cross

    @property
    def normal(self) -> np.ndarray:
        """Its normal, a unit vector, shape (3,)."""
        return self.orientation[:, 2]

    @property
    def corners(self: Any) -> np.ndarray:
        """Its corners in cyclic order, relative to its centre [m], shape (4, 3)."""
        side = 0.5 * np.array([[-self.width, -self.height, 0.0], [self.width, -self.height, 0.0]])
        return np.concatenate([side, -side]) @ self.orientation.T


class BeamTable(Table):
    """[beam]: the laser pulse."""

    peak_power: si.Power = key("75 W", "Peak power of the pulse. The paper's laser diode.")
    exit_radius: si.Length = key(
        "2 mm",
        "1/e^2 radius of the beam at the aperture. Not in the paper: a laser diode's collimating lens is a "
        "few millimeters wide.",
    )
    radius: si.Length = key(
        "30 mm",
        "1/e^2 radius at the target, on a plane normal to the axis. Not in the paper, which cut the reflector"
        " to the spot: at 30 mm the 120 mm x 90 mm reflector holds 99.7 % of the light.",
    )
    pulse: Literal["gaussian", "helios", "sampled"] = key(
        "gaussian",
        'Shape in time: "gaussian", exp(-t^2 / tau^2), as in the paper; "helios", (t / tau)^2 exp(-t / tau), a steep '
        'rise with a long tail; "sampled", the curve through pulse_samples.',
    )
    pulse_tau: si.Time = key(
        "6 ns",
        "tau of the pulse; the width at half height is 1.665 tau for a Gaussian, 10 ns, and 3.395 tau for "
        '"helios". Not in the paper.',
    )
    pulse_samples: Annotated[tuple[float, ...], BeforeValidator(_pulse_samples)] = key(
        (), 'Relative power at equal time steps, for pulse "sampled"; the peak is at t = 0 and has peak_power.'
    )
    pulse_sample_period: si.Time = key("1 ns", "Time between two of pulse_samples.")
    ray_count: si.PointCount = key(
        512, "Number of target points in the sum of the echo (eq 10), one emitted ray each; more where rays are lost."
    )

    @model_validator(mode="after")
    def _samples_go_with_the_shape(self) -> "BeamTable":
        count = len(self.pulse_samples)
        if self.pulse == "sampled" and count < LEAST_PULSE_SAMPLES:
            raise ValueError(
                f"beam.pulse 'sampled' needs at least {LEAST_PULSE_SAMPLES} beam.pulse_samples, got {count}: add them, "
                "such as pulse_samples = [0, 0.4, 1, 0.3, 0]"
            )
        if self.pulse == "sampled" and (top := int(np.argmax(self.pulse_samples))) in (0, count - 1):
            raise ValueError(
                f"beam.pulse_samples: the greatest sample is the {'last' if top else 'first'} one: "
                "give samples from before the pulse's peak to after it"
            )
        if self.pulse != "sampled" and count:
            raise ValueError(
                f'beam.pulse_samples are given, but beam.pulse is {self.pulse!r}: write pulse = "sampled", or drop them'
            )
        return self


class TargetTable(Table, TiltedRectangle):
    """[target]: a flat rectangular reflector."""

    distance: si.Length = key(
        "1.5 m", "Distance from the plane of the receiver's pupil to the target's centre, along the axis. The paper's."
    )
    tilt: si.Tilt = key(
        "0 deg",
        "Rotation of the target about tilt_axis through its centre, below 90 deg. Not in the paper: it faces the "
        "laser.",
    )
    tilt_axis: Annotated[tuple[float, float, float], BeforeValidator(_axis)] = key(
        (1.0, 0.0, 0.0),
        "Axis of that rotation (x, y, z), right-handed; its length does not matter. About x, the default, a positive "
        "tilt moves the upper half (y > 0) away.",
    )
    reflector: Literal["lambertian", "phong"] = key(
        "lambertian",
        '"lambertian": diffuse, f_r = reflectivity / pi, as in the paper; "phong": a share of the light goes into a '
        "lobe around the mirror direction.",
    )
    reflectivity: si.Share = key(0.3, "Share of the light that is reflected, at normal incidence. The paper's.")
    specular_share: si.Fraction = key(
        0.5, 'Share of the reflected light that goes into the lobe, for reflector "phong". Half: a semi-gloss paint.'
    )
    specular_exponent: si.Number = key(
        20.0,
        'Exponent n of the lobe cos(angle to the mirror direction)^n, for reflector "phong"; 20: 15 deg to half '
        "its height.",
    )
    width: si.Length = key("120 mm", "Extent in x, before the tilt. The paper's.")
    height: si.Length = key("90 mm", "Extent in y, before the tilt: along the tilted surface. The paper's.")
    limits: Literal["beam", "paper"] = key(
        "beam",
        'Area of the sum of eq 10. "beam": the part of the beam that hits the reflector; "paper": eq 11, the beam '
        "within one beam radius on either side in y, independent of the reflector's size.",
    )


class ReceiverTable(Table):
    """[receiver]: the pupil that collects the echo."""

    diameter: si.Length = key(
        "12 mm", "Diameter of the pupil. Not in the paper: the widest that fits behind a dome of 16 mm."
    )
    shape: Literal["disc", "annulus", "rectangle"] = key(
        "disc",
        'Shape of the pupil. "disc"; "annulus", with a central obstruction of receiver.inner_diameter; "rectangle", '
        "receiver.diameter wide and receiver.height high.",
    )
    inner_diameter: si.Length | None = key(None, 'Diameter of the central obstruction, for shape "annulus".')
    height: si.Length | None = key(None, 'Extent of the pupil in y, for shape "rectangle"; absent: a square.')
    ray_count: si.PointCount = key(256, "Rays over the pupil for each target point, for its Strehl ratio.")
    return_factor: Literal["strehl", "bucket", "none"] = key(
        "strehl",
        'Factor by which the flow reduces the returning light. "strehl": the Strehl ratio, the relative peak intensity '
        'of the focus, as in the paper; "bucket": the share of the pupil that the light reaches, for a detector larger '
        'than the spot; "none": 1.',
    )
    strehl_node_count: Annotated[int | Literal["every"], BeforeValidator(_node_count)] = key(
        9,
        "Odd number of points along a side of the target at which return_factor is computed; it is interpolated "
        'between them. "every": at each of the beam.ray_count target points.',
    )
    efficiency: si.Share = key(
        1.0,
        "Share of the light at the pupil that reaches the detector; 1 by default, since the detector's calibration "
        "already contains it.",
    )
    aperture_z: si.Coordinate = key(
        "-8 mm",
        "Place of the pupil's plane on the axis. The nose tip is at 0 and the dome's radius is 8 mm, so the default is "
        "the dome's centre, behind its surface: the flow begins where the rays cross that surface.",
    )

    @model_validator(mode="after")
    def _shape_fits_the_rest(self) -> "ReceiverTable":
        if (self.shape == "annulus") != (self.inner_diameter is not None):
            raise ValueError(
                f"receiver.shape {self.shape!r} and receiver.inner_diameter {self.inner_diameter!r} do not go "
                'together: shape = "annulus" needs inner_diameter, and no other shape takes it'
            )
        if self.inner_diameter is not None and self.inner_diameter >= self.diameter:
            raise ValueError(
                f"receiver.inner_diameter, {self.inner_diameter:g} m, must be below receiver.diameter, "
                f"{self.diameter:g} m"
            )
        if self.height is not None and self.shape != "rectangle":
            raise ValueError(f'receiver.height belongs to shape = "rectangle", not to {self.shape!r}')
        return self

    @property
    def pupil(self) -> Pupil:
        """The pupil at `aperture_z`, facing forward (+z)."""
        center = np.array([0.0, 0.0, self.aperture_z])
        if self.shape == "annulus":
            assert self.inner_diameter is not None
            return Annulus(0.5 * self.diameter, 0.5 * self.inner_diameter, center)
        if self.shape == "rectangle":
            return Rectangle(self.diameter, self.diameter if self.height is None else self.height, center)
        return Disc(0.5 * self.diameter, center)


class AtmosphereTable(Table):
    """[atmosphere]: the air between model and target, apart from its index."""

    transmission: si.Share = key(1.0, "One-way transmission. Over 1.5 m of clear air nothing is lost.")


# Detector voltage per watt at the pupil [V/W]. Chosen once, so that the simulated echo of the static scene peaks near
# 1.994 V, the peak that the paper's Tables 3 and 4 imply for its simulation without flow: 1.994 V divided by the static
# scene's simulated peak of 3.58715e-4 W. It is never tuned to a flow.
STATIC_CALIBRATION = 5558.7


class DetectorTable(Table):
    """[detector]: light to volts to range."""

    volts_per_watt: si.Responsivity = key(
        STATIC_CALIBRATION,
        "Detector voltage per watt at the pupil, 'V/W'. Not in the paper: chosen once so that the static scene's echo "
        "peaks near 1.994 V, the peak that the paper's tables imply for its simulation without flow.",
    )
    bandwidth: Annotated[si.Frequency | None, absent("unlimited")] = key(
        None,
        '-3 dB bandwidth of the detector and amplifier, or "unlimited" (default): beam.pulse_tau is then that of the '
        "recorded pulse, already broadened by detector and amplifier.",
    )
    response: Literal["bessel", "butterworth", "first-order", "gaussian"] = key(
        "bessel",
        "Low-pass filter of that bandwidth: Bessel (flat delay), Butterworth (flat gain), a single pole, or a Gaussian "
        "without delay.",
    )
    order: Annotated[si.Count, Field(le=10)] = key(4, "Poles of the Bessel or Butterworth low-pass, 1 to 10.")
    responsivity: si.DiodeResponsivity = key(
        "0.5 A/W",
        "Primary photocurrent per watt, before multiplication: silicon at 905 nm. Responsivity and gain affect only "
        "the noise; volts_per_watt already contains both and the transimpedance.",
    )
    gain: si.Gain = key(
        10.0,
        "Multiplication M of the avalanche photodiode, 1 for a PIN diode. The default is low because the echo at 1.5 m "
        "is strong, 0.4 mW.",
    )
    ionisation_ratio: si.Fraction = key(
        0.02, "k of the excess noise factor F = k M + (1 - k)(2 - 1 / M): electrons in silicon."
    )
    background_power: si.LightLevel = key(
        "10 nW", "Steady background light on the detector: a lit room through a narrow filter."
    )
    dark_current: si.Current = key(
        "0.1 nA", "Dark current before multiplication: a small silicon diode at room temperature."
    )
    temperature: si.Temperature = key("293 K", "Temperature of the transimpedance resistor, for its thermal noise.")
    load_resistance: si.Resistance | None = key(
        None, "Resistor of the thermal noise; absent: the transimpedance, volts_per_watt / (responsivity x gain)."
    )
    amplifier_noise: si.NoiseCurrent = key(
        "2 pA/rtHz", "Input noise current density of the amplifier: a typical 100 MHz transimpedance amplifier."
    )
    noise: StrictBool = key(
        False,
        "Whether the recorded voltage has noise. If the bandwidth is unlimited, the noise has a bandwidth of half the "
        "sample rate.",
    )
    seed: Annotated[si.Whole, Field(ge=0, le=2**63 - 1)] = key(
        0, "Seed of the noise: the same seed gives the same record."
    )
    saturation: Annotated[si.Voltage | None, absent("unlimited")] = key(
        None, 'Greatest voltage of the amplifier, or "unlimited" (default).'
    )
    sample_rate: si.Frequency = key(
        "10 GHz", "Sample rate: 100 ps, 60 samples per tau; a threshold crossing between two samples is interpolated."
    )
    bit_count: Annotated[Annotated[si.Count, Field(le=24)] | None, absent("unlimited")] = key(
        None, 'Bits of the digitiser, 1 to 24, or "unlimited" (default): neither quantised nor clipped.'
    )
    adc_low: si.Level = key("-0.5 V", "Voltage of the digitiser's lowest code; lower voltages are clipped.")
    adc_high: si.Level = key("4.5 V", "Voltage of the digitiser's highest code: about twice the static peak.")
    ranging: Literal["leading-edge", "constant-fraction", "centroid", "matched-filter"] = key(
        "leading-edge",
        'How the arrival time is read. "leading-edge": at a fixed level, so that it shifts with the amplitude, as in '
        'the paper\'s results; "constant-fraction": at a fraction of the peak; "centroid": at the centroid; '
        '"matched-filter": at the best fit of the echo without flow. The last three do not shift with the amplitude.',
    )
    threshold: si.Voltage = key(
        "1 V", "Level of the leading-edge discriminator. Not in the paper: half of the paper's static peak."
    )
    fraction: si.OpenShare = key(0.5, "Fraction of the peak for constant-fraction ranging.")
    trial_count: Annotated[si.Whole, Field(ge=0, le=10**6)] = key(
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
