"""Compute the echo of a tilted plane without flow, in closed form and by quadrature (eq 8 of the paper).

    P(t) = P0 D^2 eta_a^2 eta_s / (2 w^2 R^2) f_r cos(b) SR
           * integral of exp(-2 (x^2 + y^2) / w^2) exp(-((t - 2 (R + y tan b) / c) / tau)^2) dx dy

x and y are normal to the beam, w is the beam's 1/e^2 radius at the target, D the receiver's diameter, b the tilt about
x, and f_r = reflectivity / pi for a Lambertian plane. Over the whole plane the integral is again a Gaussian, of
tau_e^2 = tau^2 + 2 w^2 tan(b)^2 / c^2; limits in y multiply it by error functions.

The light travels at c here; the echo of a scene (`simulate.py`) has the air's index in its optical paths.
"""

import math

import numpy as np

from aerokernels.inputs.arguments import Numbers, checked
from aerokernels.inputs.checks import as_finite_array, check_choice, check_positive, check_share, check_tilt
from aerokernels.lidar.parts import LIMITS
from aerokernels.lidar.pulses import SPEED_OF_LIGHT


@checked
def tilted_pulse_tau(pulse_tau: float, beam_radius: float, tilt: float) -> float:
    """1/e half-width [s] of the echo of a plane of any extent: the pulse's own, broadened by the tilted plane's depth.

    Args:
        pulse_tau: 1/e half-width of the pulse that leaves [s].
        beam_radius: 1/e^2 intensity radius of the beam at the target [m].
        tilt: Angle between the beam and the plane's normal [rad].

    Raises:
        ValueError: Lengths or times that are not positive, a tilt of a right angle or more.
    """
    spread = (
        math.sqrt(2.0) * check_positive(beam_radius, "beam_radius", "m") * math.tan(check_tilt(tilt)) / SPEED_OF_LIGHT
    )
    return math.hypot(check_positive(pulse_tau, "pulse_tau", "s"), spread)


def plane_echo_power(
    peak_power: float,
    receiver_diameter: float,
    distance,
    incidence_cosine,
    reflectance,
    atmospheric_transmission: float = 1.0,
    system_efficiency: float = 1.0,
):
    """Return the peak power [W] of the echo if the whole beam meets a surface at one distance and one incidence.

    P0 f_r cos(incidence) * (pi D^2 / 4) / R^2 * eta_a^2 eta_s: the reflector's radiance times the receiver's solid
    angle. `distance` [m], `incidence_cosine` and `reflectance` f_r [1/sr] may be arrays; nothing is checked here.
    """
    aperture = 0.25 * math.pi * receiver_diameter**2
    through = atmospheric_transmission**2 * system_efficiency
    return peak_power * reflectance * incidence_cosine * aperture / np.square(distance) * through


@checked
def plane_target_echo(
    time: Numbers,
    *,
    peak_power: float,
    receiver_diameter: float,
    beam_radius: float,
    distance: float,
    tilt: float = 0.0,
    pulse_tau: float,
    reflectivity: float,
    atmospheric_transmission: float = 1.0,
    system_efficiency: float = 1.0,
    strehl: float = 1.0,
    limits: str = "beam",
) -> np.ndarray:
    """Return the received power of the echo from a tilted plane without flow (eq 8).

    Args:
        time: Times after the pulse's peak left [s], any shape.
        peak_power: Peak power of the pulse that leaves [W].
        receiver_diameter: Diameter D of the receiver's pupil [m].
        beam_radius: 1/e^2 intensity radius of the parallel beam [m].
        distance: Distance R to the plane along the axis [m].
        tilt: Angle between the axis and the plane's normal, about x [rad].
        pulse_tau: 1/e half-width of the Gaussian pulse, FWHM / (2 sqrt(ln 2)) [s].
        reflectivity: Reflectivity at normal incidence, 0 to 1.
        atmospheric_transmission: Transmission one way, 0 to 1; the echo has its square.
        system_efficiency: Transmission of the optics, 0 to 1.
        strehl: Strehl ratio of the return path, 0 to 1, one for the whole target.
        limits: "beam", the whole beam; "paper", y limited to +-beam_radius, which loses 4.55 % untilted.

    Returns:
        Received power [W], of the shape of `time`.

    Raises:
        ValueError: A length, time or power that is not positive and finite, a fraction outside 0 to 1, a tilt of a
            right angle or more, unknown limits, times that are not finite.
        TypeError: An argument that is not a number.

    Examples:
        >>> import numpy as np
        >>> laser = {"peak_power": 75.0, "beam_radius": 30e-3, "pulse_tau": 6e-9}
        >>> place = {"receiver_diameter": 12e-3, "distance": 1.5, "reflectivity": 0.3}
        >>> power = plane_target_echo(np.arange(0.0, 40e-9, 1e-10), **laser, **place)
        >>> round(1e6 * power.max())  # microwatts
        360
    """
    from scipy.special import erf

    times = as_finite_array(time, "time")
    power = check_positive(peak_power, "peak_power", "W")
    diameter = check_positive(receiver_diameter, "receiver_diameter", "m")
    radius, reach = check_positive(beam_radius, "beam_radius", "m"), check_positive(distance, "distance", "m")
    angle, tau = check_tilt(tilt), check_positive(pulse_tau, "pulse_tau", "s")
    air = check_share(atmospheric_transmission, "atmospheric_transmission")
    optics = check_share(system_efficiency, "system_efficiency")
    ratio = check_share(strehl, "strehl")
    check_choice(limits, "limits", LIMITS)
    reflectance = check_share(reflectivity, "reflectivity") / math.pi
    peak = ratio * plane_echo_power(power, diameter, reach, math.cos(angle), reflectance, air, optics)
    late = times - 2.0 * reach / SPEED_OF_LIGHT
    spread = tilted_pulse_tau(tau, radius, angle)
    echo = peak * (tau / spread) * np.exp(-np.square(late / spread))
    if limits == "paper":  # y limited to +-h = radius, which untilted leaves erf(sqrt 2) = 0.9545
        slope = 2.0 * math.tan(angle) / (SPEED_OF_LIGHT * tau)
        sharpness = math.hypot(math.sqrt(2.0) / radius, slope)
        center = slope * late / (tau * sharpness**2)
        echo = echo * 0.5 * (erf(sharpness * (radius - center)) + erf(sharpness * (radius + center)))
    return np.asarray(echo)
