"""The closed form of eq 8 against quadrature, limits and symmetries."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from aerokernels import plane_target_echo
from aerokernels.lidar import GaussianPulse, fwhm_from_pulse_tau, pulse_tau_from_fwhm, tilted_pulse_tau
from aerokernels.lidar.pulses import SPEED_OF_LIGHT, sum_of_pulses

PAPER = {
    "peak_power": 75.0,
    "receiver_diameter": 0.012,
    "beam_radius": 0.03,
    "distance": 1.5,
    "pulse_tau": 6e-9,
    "reflectivity": 0.3,
}
ARRIVAL = 2.0 * 1.5 / SPEED_OF_LIGHT
angles = st.floats(-1.4, 1.4)
lengths = st.floats(0.01, 1e3)


def quadrature(time, *, limits="beam", tilt=0.0, node_count=80, **setting):
    """Eq 8 as printed, with f_r = reflectivity / pi, by Gauss-Legendre points in x and y."""
    p = {"atmospheric_transmission": 1.0, "system_efficiency": 1.0, "strehl": 1.0, **setting}
    w, distance = p["beam_radius"], p["distance"]
    node, weight = np.polynomial.legendre.leggauss(node_count)
    x, wx = 3.5 * w * node, 3.5 * w * weight
    y, wy = (w * node, w * weight) if limits == "paper" else (x, wx)
    delay = (2.0 * distance + 2.0 * y * math.tan(tilt)) / SPEED_OF_LIGHT
    pulse = np.exp(-(((np.asarray(time)[..., None] - delay) / p["pulse_tau"]) ** 2))
    beam = np.exp(-2.0 * (x[:, None] ** 2 + y**2) / w**2)
    front = p["peak_power"] * p["receiver_diameter"] ** 2 / (2.0 * w**2 * distance**2)
    front *= p["atmospheric_transmission"] ** 2 * p["system_efficiency"] * p["strehl"]
    surface = p["reflectivity"] / math.pi * math.cos(tilt)
    return front * surface * np.einsum("...j,ij,i,j->...", pulse, beam, wx, wy)


@pytest.mark.parametrize("limits", ["beam", "paper"])
@pytest.mark.parametrize("tilt", [0.0, 0.6, -1.2, math.radians(88.0)])
def test_closed_form_is_the_integral(limits, tilt):
    """Set-up: the paper's target, tilts up to 88 deg (depth 0.86 m against a pulse of 0.9 m).

    Formula: eq 8, with y over the whole beam or cut at one radius. Expected: the closed form. Error sources: the tail
    cut at 3.5 radii (3e-12), 80 Gauss points, rounding. Tolerance: 1e-10 of the peak.
    """
    time = ARRIVAL + np.linspace(-4, 4, 33) * tilted_pulse_tau(6e-9, 0.03, tilt)
    exact = plane_target_echo(time, tilt=tilt, limits=limits, **PAPER)
    numeric = quadrature(time, tilt=tilt, limits=limits, **PAPER)
    assert np.abs(exact - numeric).max() < 1e-10 * exact.max()


def test_peak_by_hand():
    """Untilted, in numbers: 75 W x 0.3 x pi 12^2/4 mm2 / (pi 1.5^2 m2) = 3.6e-4 W, at t = 2 R / c."""
    assert plane_target_echo(ARRIVAL, **PAPER) == pytest.approx(3.6e-4, rel=1e-14)
    transmitted = plane_target_echo(ARRIVAL, atmospheric_transmission=0.9, system_efficiency=0.5, strehl=0.8, **PAPER)
    assert transmitted == pytest.approx(3.6e-4 * 0.81 * 0.5 * 0.8, rel=1e-14)


def test_shape_is_kept():
    assert plane_target_echo(ARRIVAL, **PAPER).shape == ()
    for shape in [(0,), (5,), (2, 3)]:
        assert plane_target_echo(np.full(shape, ARRIVAL), limits="paper", **PAPER).shape == shape


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"peak_power": -1.0}, "peak_power"),
        ({"distance": 0.0}, "distance"),
        ({"pulse_tau": math.inf}, "pulse_tau"),
        ({"beam_radius": math.nan}, "beam_radius"),
        ({"receiver_diameter": -0.0}, "receiver_diameter"),
        ({"tilt": 90.0}, "not degrees"),
        ({"reflectivity": 30.0}, "not per cent"),
        ({"strehl": 1.1}, "strehl"),
        ({"system_efficiency": -0.1}, "system_efficiency"),
        ({"atmospheric_transmission": 2.0}, "atmospheric_transmission"),
        ({"limits": "all"}, "choose one of beam, paper"),
    ],
)
def test_bad_values_are_refused_by_name(change, words):
    with pytest.raises(ValueError, match=words):
        plane_target_echo(0.0, **{**PAPER, **change})


def test_bad_kinds_are_refused():
    with pytest.raises(TypeError, match="distance"):
        plane_target_echo(0.0, **{**PAPER, "distance": "1.5 m"})
    with pytest.raises(ValueError, match="first at index 1"):
        plane_target_echo([0.0, math.nan], **PAPER)
    with pytest.raises(TypeError, match="complex"):
        plane_target_echo([1j], **PAPER)


@given(st.floats(1e-12, 1e-3))
def test_pulse_widths_are_each_others_inverse(tau):
    assert pulse_tau_from_fwhm(fwhm_from_pulse_tau(tau)) == pytest.approx(tau, rel=1e-14)
    assert GaussianPulse(tau)(0.5 * fwhm_from_pulse_tau(tau)) == pytest.approx(0.5, rel=1e-12)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_sum_of_pulses_adds_pulses(count, seed):
    """Against the plain sum; what is left out lies below exp(-6^2) = 2e-16 of a pulse."""
    generator = np.random.default_rng(seed)
    delay, peak = generator.uniform(0, 1e-6, count), generator.uniform(0, 2, count)
    time = generator.uniform(-1e-6, 2e-6, (7, 3))
    plain = sum(p * GaussianPulse(6e-9)(time - d) for d, p in zip(delay, peak, strict=True))
    assert np.abs(sum_of_pulses(time, delay, peak, 6e-9) - plain).max() < 1e-14 * peak.sum()
