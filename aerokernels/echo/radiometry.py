"""Echo of a tilted Lambertian plane without flow, in closed form (eq 8 of the paper).

    P(t) = P0 D^2 eta_a^2 eta_s / (2 w^2 R^2) f_r cos(b) SR
           * integral of exp(-2 (x^2 + y^2) / w^2) exp(-((t - 2 (R + y tan b) / c) / tau)^2) dx dy

x and y are normal to the beam, w is the beam's 1/e^2 radius at the target, D the receiver's diameter, b the tilt about
x, f_r = reflectivity / pi. Over the whole plane the integral is a Gaussian once more:

    P(t) = pi P0 D^2 eta_a^2 eta_s f_r cos(b) SR / (4 R^2) * (tau / tau_e) exp(-((t - 2 R / c) / tau_e)^2)
    tau_e^2 = tau^2 + 2 w^2 tan(b)^2 / c^2

With y cut at +-w, as the paper does in eq 11, a factor [erf(q (w - y0)) + erf(q (w + y0))] / 2 comes to it, where
q^2 = 2 / w^2 + (2 tan(b) / (c tau))^2 and y0 = 2 tan(b) (t - 2 R / c) / (c tau^2 q^2). Untilted it is
erf(sqrt 2) = 0.9545.

The light travels at c: the echo of a scene (`simulate.py`) has the air's index in its optical paths.
"""

import math

import numpy as np

from .checks import as_finite_array, check_choice, check_positive, check_share, check_tilt
from .waveform import SPEED_OF_LIGHT

LIMITS = ("beam", "paper")


def tilted_pulse_tau(pulse_tau: float, beam_radius: float, tilt: float) -> float:
    """1/e half-width [s] of the echo of a plane of any extent: the pulse's own, spread by the tilted plane's depth.

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
    reflectivity: float,
    atmospheric_transmission: float = 1.0,
    system_efficiency: float = 1.0,
):
    """Peak power [W] that returns if the whole beam meets a Lambertian surface at one distance and one incidence.

    P0 (reflectivity / pi) cos(incidence) * (pi D^2 / 4) / R^2 * eta_a^2 eta_s: the reflector's radiance times the
    receiver's solid angle. `distance` [m] and `incidence_cosine` may be arrays; nothing is checked here.
    """
    aperture = 0.25 * math.pi * receiver_diameter**2
    through = atmospheric_transmission**2 * system_efficiency
    return peak_power * reflectivity / math.pi * incidence_cosine * aperture / np.square(distance) * through


def plane_target_echo(
    time,
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
    """Received power of the echo from a tilted Lambertian plane larger than the beam, without flow (eq 8).

    Args:
        time: Times after the pulse's peak left [s], any shape.
        peak_power: Peak power of the pulse that leaves [W].
        receiver_diameter: Diameter D of the receiver's pupil [m].
        beam_radius: 1/e^2 intensity radius of the beam at the target [m].
        distance: Distance R to the plane along the axis [m].
        tilt: Angle between the axis and the plane's normal, about x [rad].
        pulse_tau: 1/e half-width of the pulse, FWHM / (2 sqrt(ln 2)) [s].
        reflectivity: Lambertian reflectivity, 0 to 1.
        atmospheric_transmission: Transmission one way, 0 to 1; it enters squared.
        system_efficiency: Transmission of the optics, 0 to 1.
        strehl: Strehl ratio of the return path, 0 to 1, one for the whole target.
        limits: "beam", the beam's full support; "paper", y cut at +-beam_radius, which loses 4.55 % untilted.

    Returns:
        Received power [W], of the shape of `time`.

    Raises:
        ValueError: A length, time or power that is not positive and finite, a share outside 0 to 1, a tilt of a right
            angle or more, unknown limits, times that are not finite.
        TypeError: An argument that is not a number.
    """
    times = as_finite_array(time, "time")
    power, diameter = (
        check_positive(peak_power, "peak_power", "W"),
        check_positive(receiver_diameter, "receiver_diameter", "m"),
    )
    radius, reach = check_positive(beam_radius, "beam_radius", "m"), check_positive(distance, "distance", "m")
    angle, tau = check_tilt(tilt), check_positive(pulse_tau, "pulse_tau", "s")
    air = check_share(atmospheric_transmission, "atmospheric_transmission")
    optics = check_share(system_efficiency, "system_efficiency")
    ratio = check_share(strehl, "strehl")
    check_choice(limits, "limits", LIMITS)
    peak = plane_echo_power(
        power, diameter, reach, math.cos(angle), check_share(reflectivity, "reflectivity"), air, optics
    )
    late = times - 2.0 * reach / SPEED_OF_LIGHT
    spread = tilted_pulse_tau(tau, radius, angle)
    echo = ratio * peak * (tau / spread) * np.exp(-np.square(late / spread))
    return np.asarray(echo if limits == "beam" else echo * _share_within_radius(late, radius, angle, tau))


def _share_within_radius(late: np.ndarray, radius: float, tilt: float, tau: float) -> np.ndarray:
    """Share of the integrand of eq 8 at |y| < radius, for each time after the axis' echo [s]."""
    from scipy.special import erf

    slope = 2.0 * math.tan(tilt) / (SPEED_OF_LIGHT * tau)
    sharpness = math.hypot(math.sqrt(2.0) / radius, slope)
    center = slope * late / (tau * sharpness**2)
    return 0.5 * (erf(sharpness * (radius - center)) + erf(sharpness * (radius + center)))
