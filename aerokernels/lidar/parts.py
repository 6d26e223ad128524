"""The parts of a laser rangefinder's path: laser, target, receiver, detector, with a scene's defaults.

The optical axis is z. The receiver's pupil faces +z; its plane is also that in which the beam leaves the laser.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import check_choice, check_count, check_positive, check_share, check_tilt
from aerokernels.inputs.kinds import as_whole
from aerokernels.lidar.chain import DetectorChain, Digitiser, NoiseSources
from aerokernels.lidar.pulses import GaussianPulse, HeliosPulse, PulseShape, SampledPulse, as_pulse
from aerokernels.pupils import Disc, Pupil
from aerokernels.scene import STATIC_CALIBRATION, Scene
from aerokernels.scene.echo_tables import TiltedRectangle
from aerokernels.tracing import Plane

LIMITS = ("beam", "paper")
RETURN_FACTORS = ("strehl", "bucket", "none")
RANGING_METHODS: tuple[str, ...] = ("leading-edge", "constant-fraction", "centroid", "matched-filter")
EVERY = "every"


@checked
@dataclass(frozen=True)
class Reflector:
    """A surface's reflectance, modified Phong: f_r = rho [(1 - s) / pi + s (n + 2) / (2 pi) cos(alpha)^n].

    alpha is the angle between the mirror direction of the incident light and the direction to the receiver; without a
    lobe the surface is Lambertian. The lobe creates no light (E. Lafortune, Y. Willems, K. U. Leuven CW197, 1994).

    Attributes:
        reflectivity: Fraction rho of the light reflected at normal incidence, 0 to 1.
        specular_share: Fraction s of the reflected light in the lobe, 0 to 1.
        specular_exponent: The lobe's exponent n, positive.

    Raises:
        ValueError: A number out of range.
    """

    reflectivity: float = 0.3
    specular_share: float = 0.0
    specular_exponent: float = 20.0

    def __post_init__(self):
        """Check the numbers."""
        check_share(self.reflectivity, "reflectivity")
        check_share(self.specular_share, "specular_share")
        check_positive(self.specular_exponent, "specular_exponent")

    @checked
    def reflectance(self, lobe_cosine: Numbers) -> np.ndarray:
        """Return f_r [1/sr], of the shape of `lobe_cosine`, the cosine of alpha."""
        lobe = np.maximum(np.asarray(lobe_cosine, dtype=np.float64), 0.0) ** self.specular_exponent
        diffuse = (1.0 - self.specular_share) / math.pi
        peak = self.specular_share * (self.specular_exponent + 2.0) / (2.0 * math.pi)
        return np.asarray(self.reflectivity * (diffuse + peak * lobe))


@checked
@dataclass(frozen=True)
class Laser:
    """A pulsed laser, whose beam leaves the exit aperture parallel to the axis or widens on its way to the target.

    Attributes:
        peak_power: Peak power of the pulse [W].
        pulse: Shape of the pulse in time; a number is the 1/e half-width of a Gaussian pulse, FWHM / 1.665 [s].
        wavelength: Vacuum wavelength [m].
        exit_radius: 1/e^2 intensity radius of the beam at the aperture [m].
        radius: 1/e^2 intensity radius at the target, on a plane normal to the axis [m].
        ray_count: Number of target points over which the echo is summed, one emitted ray each.

    Raises:
        ValueError: A number that is not positive.
    """

    peak_power: float = 75.0
    pulse: PulseShape | float = 6e-9
    wavelength: float = 905e-9
    exit_radius: float = 2e-3
    radius: float = 30e-3
    ray_count: int = 512

    def __post_init__(self):
        """Check the numbers and the pulse."""
        check_positive(self.peak_power, "peak_power", "W")
        for name in ("wavelength", "exit_radius", "radius"):
            check_positive(getattr(self, name), name, "m")
        object.__setattr__(self, "ray_count", check_count(self.ray_count, "ray_count", 1))
        as_pulse(self.pulse)  # raises for anything else

    @property
    def shape(self) -> PulseShape:
        """The pulse's shape in time."""
        return as_pulse(self.pulse)


@checked
@dataclass(frozen=True)
class Target(TiltedRectangle):
    """A flat rectangular reflector on the axis.

    Attributes:
        distance: Distance from the plane of the receiver's pupil to the target's centre, along the axis [m].
        tilt: Rotation of the target about `tilt_axis` through its centre [rad].
        tilt_axis: Axis of that rotation (x, y, z), right-handed; about x a positive tilt moves the half y > 0 away.
        reflector: How its surface reflects.
        width: Extent in x, before the tilt [m].
        height: Extent in y, before the tilt [m].
        limits: "beam": the echo is summed over the part of the beam that meets the reflector; "paper": eq 11, over the
            beam within one beam radius on either side in y, whatever the reflector's size.
        transmission: Transmission one way of the air to it, 0 to 1.

    Raises:
        ValueError: A length that is not positive, a tilt of a right angle or more, an axis without length, or limits
            that are not known.
    """

    distance: float = 1.5
    tilt: float = 0.0
    tilt_axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    reflector: Reflector = field(default_factory=Reflector)
    width: float = 120e-3
    height: float = 90e-3
    limits: str = "beam"
    transmission: float = 1.0

    def __post_init__(self):
        """Check the numbers."""
        for name in ("distance", "width", "height"):
            check_positive(getattr(self, name), name, "m")
        check_tilt(self.tilt)
        if len(self.tilt_axis) != 3 or not np.all(np.isfinite(self.tilt_axis)) or not any(self.tilt_axis):
            raise ValueError(f"tilt_axis must be three finite numbers, not all zero, got {self.tilt_axis!r}")
        if not isinstance(self.reflector, Reflector):
            raise TypeError(f"reflector must be a Reflector, got {self.reflector!r}")
        check_choice(self.limits, "limits", LIMITS)
        check_share(self.transmission, "transmission")


@checked
@dataclass(frozen=True)
class Receiver:
    """The pupil that collects the echo, and how the flow's effect on the returning light is computed.

    Attributes:
        pupil: The pupil [m], on the axis and facing +z; the beam leaves in its plane.
        ray_count: Rays over the pupil for each target point.
        return_factor: Factor by which the flow reduces the returning light. "strehl": the Strehl ratio; "bucket": the
            fraction of the pupil that the light reaches, for a detector larger than the spot; "none": 1.
        strehl_node_count: Odd number of points along a side of the target at which the factor is computed; it is
            interpolated between them. "every": at each target point.
        efficiency: Fraction of the light at the pupil that reaches the detector, 0 to 1.

    Raises:
        ValueError: A pupil off the axis or turned from +z, a number out of range, an unknown factor.
    """

    pupil: Pupil = field(default_factory=lambda: Disc(6e-3, (0.0, 0.0, -8e-3)))
    ray_count: int = 256
    return_factor: str = "strehl"
    strehl_node_count: int | str = 9
    efficiency: float = 1.0

    def __post_init__(self):
        """Check the pupil and the numbers."""
        if not isinstance(self.pupil, Pupil):
            raise TypeError(f"pupil must be a pupil such as Disc(6e-3), got {self.pupil!r}")
        if np.any(self.pupil.center[:2]) or self.pupil.normal[2] < 1.0 - 1e-12:
            raise ValueError(
                f"the receiver's pupil must be on the axis and face +z, got one at {self.pupil.center.tolist()} m "
                f"that faces {self.pupil.normal.tolist()}: give x = y = 0 and the normal (0, 0, 1)"
            )
        object.__setattr__(self, "ray_count", check_count(self.ray_count, "ray_count", 1))
        check_choice(self.return_factor, "return_factor", RETURN_FACTORS)
        count = self.strehl_node_count
        if count != EVERY and ((whole := as_whole(count)) is None or whole < 3 or whole % 2 == 0):
            raise ValueError(f"strehl_node_count must be odd and at least 3, or {EVERY!r}, got {count!r}")
        check_share(self.efficiency, "efficiency")

    @property
    def aperture_z(self) -> float:
        """Place of the pupil's plane on the axis [m]."""
        return float(self.pupil.center[2])

    @property
    def equal_diameter(self) -> float:
        """Diameter of the disc that has the pupil's area and so collects the same light [m]."""
        if type(self.pupil) is Disc:
            return 2.0 * self.pupil.radius
        return math.sqrt(4.0 * self.pupil.area / math.pi)


@checked
@dataclass(frozen=True)
class Detector:
    """The receiver's electronics, from light to volts to range.

    Attributes:
        chain: Photodiode, amplifier and digitiser.
        sample_rate: Sample rate [Hz].
        noise: Whether the recorded voltage has noise.
        seed: Seed of the noise.
        ranging: How a range is read, one of RANGING_METHODS; see `estimate_range`.
        threshold: Level of the leading-edge discriminator [V].
        fraction: Fraction of the peak for "constant-fraction", between 0 and 1.
        trial_count: Number of noisy records that are ranged to find the random error, at least 2; 0: none.

    Raises:
        ValueError: A number out of range, or an unknown method.
    """

    chain: DetectorChain = field(default_factory=lambda: DetectorChain(STATIC_CALIBRATION))
    sample_rate: float = 10e9
    noise: bool = False
    seed: int = 0
    ranging: str = "leading-edge"
    threshold: float = 1.0
    fraction: float = 0.5
    trial_count: int = 0

    def __post_init__(self):
        """Check the numbers."""
        if not isinstance(self.chain, DetectorChain):
            raise TypeError(f"chain must be a DetectorChain, got {self.chain!r}")
        check_positive(self.sample_rate, "sample_rate", "Hz")
        check_choice(self.ranging, "ranging", RANGING_METHODS)
        check_positive(self.threshold, "threshold", "V")
        if not 0.0 < check_share(self.fraction, "fraction") < 1.0:
            raise ValueError(f"fraction must lie between 0 and 1, both excluded, got {self.fraction!r}")
        if check_count(self.trial_count, "trial_count", 0) == 1:
            raise ValueError("trial_count 1 gives no random error: take 0 for none, or at least 2")


@dataclass(frozen=True, eq=False)
class Setup:
    """A laser, its target, a receiver and its detector, and the options of `trace` for the rays between them."""

    laser: Laser
    target: Target
    receiver: Receiver
    detector: Detector
    options: Mapping[str, Any]

    @classmethod
    def of_scene(cls, scene: Scene) -> "Setup":
        """Return the parts that a scene describes."""
        beam, target, receiver, detector = scene.beam, scene.target, scene.receiver, scene.detector
        pulse: PulseShape = GaussianPulse(beam.pulse_tau)
        if beam.pulse == "helios":
            pulse = HeliosPulse(beam.pulse_tau)
        elif beam.pulse == "sampled":
            pulse = SampledPulse(beam.pulse_samples, beam.pulse_sample_period)
        share = target.specular_share if target.reflector == "phong" else 0.0
        transimpedance = detector.volts_per_watt / (detector.responsivity * detector.gain)
        sources = _like(NoiseSources, detector, load_resistance=detector.load_resistance or transimpedance)
        bits = detector.bit_count
        digitiser = None if bits is None else Digitiser(bits, detector.adc_low, detector.adc_high)
        reflector = _like(Reflector, target, specular_share=share)
        return cls(
            _like(Laser, beam, pulse=pulse, wavelength=scene.flow.wavelength),
            _like(Target, target, reflector=reflector, transmission=scene.atmosphere.transmission),
            _like(Receiver, receiver),
            _like(Detector, detector, chain=_like(DetectorChain, detector, sources=sources, digitiser=digitiser)),
            trace_options(scene),
        )

    @cached_property
    def plane(self) -> Plane:
        """The target's plane; its normal is the optical axis turned by the target's tilt."""
        return Plane(np.array([0.0, 0.0, self.receiver.aperture_z + self.target.distance]), self.target.normal)


def _like(kind: type, table: Any, **others: Any) -> Any:
    """Return a part with the values of a scene's table, whose keys have the names of its fields, and others."""
    return kind(**({one.name: getattr(table, one.name) for one in fields(kind) if one.name not in others} | others))


def trace_options(scene: Scene) -> dict:
    """Return the options of `trace` that a scene's [trace] and [flow] tables set."""
    names = ("method", "tolerance", "step", "backend", "device", "precision", "max_steps")
    return {"wavelength": scene.flow.wavelength} | {name: getattr(scene.trace, name) for name in names}
