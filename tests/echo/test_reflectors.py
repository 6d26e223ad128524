"""Reflectance: energy, reciprocity, the mirror direction."""

import math

import numpy as np
import pytest

from aerokernels import echo, plane_target_echo
from aerokernels.lidar import Reflector
from aerokernels.medium import IndexField
from aerokernels.scene import Scene


def reflected_share(surface, incidence, node_count=160):
    """Integral of f_r cos over the hemisphere, Gauss points in cos(polar) and equal steps in azimuth."""
    node, weight = np.polynomial.legendre.leggauss(node_count)
    cosine, weight = 0.5 * (node + 1.0), 0.5 * weight
    azimuth = 2.0 * np.pi * (np.arange(node_count) + 0.5) / node_count
    sine = np.sqrt(1.0 - cosine**2)
    mirror = np.array([math.sin(incidence), 0.0, math.cos(incidence)])
    along = np.outer(sine, np.cos(azimuth)) * mirror[0] + cosine[:, None] * mirror[2]
    return float(weight @ (surface.reflectance(along) * cosine[:, None]).mean(axis=1)) * 2.0 * np.pi


@pytest.mark.parametrize(("share", "exponent"), [(0.0, 1.0), (0.5, 20.0), (1.0, 1.0), (1.0, 300.0)])
def test_at_normal_incidence_the_reflectivity_returns(share, exponent):
    """Integral of f_r cos over the hemisphere = reflectivity. Error: 160 Gauss points hold cos^301; 1e-9."""
    assert reflected_share(Reflector(0.3, share, exponent), 0.0) == pytest.approx(0.3, rel=1e-9)


@pytest.mark.parametrize("incidence", [0.3, 0.9, 1.5])
@pytest.mark.parametrize("exponent", [1.0, 20.0])
def test_at_no_incidence_more(incidence, exponent):
    for share in (0.2, 1.0):
        assert reflected_share(Reflector(0.9, share, exponent), incidence) <= 0.9 * (1.0 + 1e-4)


@pytest.mark.parametrize("tilt", [0.0, 0.2, 1.0])
def test_echo_of_a_phong_plane_is_the_closed_form(tilt):
    """Set-up: a parallel beam of 30 mm on a plane 1 km away, no flow.

    Expected: eq 8 with f_r at 2 tilt. Error sources: the receiver is seen from the beam's edge 3e-5 rad off the axis,
    n tan(2 tilt) x 3e-5 either way and so 1e-8 in the sum; 1/R^2 over the depth, 1e-6 as for Lambert. Tolerance 1e-5.
    """
    setting = {"target.distance": 1000.0, "target.width": 3.0, "target.height": 3.0, "beam.exit_radius": 0.03}
    setting |= {"target.tilt": tilt, "target.reflector": "phong", "target.specular_share": 0.7}
    setting |= {"target.specular_exponent": 12, "detector.threshold": 1e-9}
    still = IndexField.from_samples(np.zeros((9, 9)), origin=(0.0, 0.0), spacing=(0.1, 0.01), geometry="axisymmetric")
    found = echo(Scene.load("wind-tunnel-static", setting), field=still)
    place = {"peak_power": 75.0, "receiver_diameter": 0.012, "beam_radius": 0.03, "distance": 1000.0, "tilt": tilt}
    lambertian = plane_target_echo(found.time, **place, pulse_tau=6e-9, reflectivity=1.0)
    lobe = 0.7 * 14.0 / 2.0 * max(math.cos(2.0 * tilt), 0.0) ** 12
    expected = 0.3 * (0.3 + lobe) * lambertian
    assert np.abs(found.power - expected).max() < 1e-5 * expected.max()


def test_a_reflector_is_lambertian_unless_it_is_asked_for_a_lobe():
    assert Reflector(0.3).reflectance([1.0, 0.2, -0.5]) == pytest.approx([0.3 / math.pi] * 3, rel=1e-15)


def test_bad_values_are_refused():
    for values, words in (
        ((1.5,), "reflectivity"),
        ((0.3, -0.1), "specular_share"),
        ((0.3, 0.5, 0.0), "specular_exponent"),
    ):
        with pytest.raises(ValueError, match=words):
            Reflector(*values)
