"""Air in the infrared: Mathar's expansion, its overlap with Ciddor's equations, and the relation that chooses."""

import numpy as np
import pytest

from aerokernels import Scene, flow, simulate

# n - 1 printed in Mathar's tables 1 to 5 for 290.65 K, 75 kPa, 10 % humidity and 370 ppm CO2, by reference wavelength.
PRINTED = {2.25e-6: 0.200192e-3, 3.4e-6: 0.200049e-3, 4.8e-6: 0.200020e-3, 10.1e-6: 0.199885e-3, 20e-6: 0.199436e-3}
STATE = {"temperature": 290.65, "pressure": 75e3, "humidity": 0.1, "co2": 370e-6}


@pytest.mark.parametrize("wavelength", PRINTED)
def test_printed_values(wavelength):
    assert flow.mathar_refractivity(wavelength, **STATE) == pytest.approx(PRINTED[wavelength], rel=1e-12)


@pytest.mark.parametrize("wavelength", [1.3e-6, 1.5e-6, 1.69e-6])
@pytest.mark.parametrize("water", [0.0, 0.01])
def test_the_two_relations_agree_where_both_hold(wavelength, water):
    """Within the sum of their stated uncertainties; of the vapour, 1 % of its share. Group constants likewise."""
    ciddor, mathar = (
        flow.refractivity_model(name, composition={"H2O": water, "CO2": 370e-6}) for name in ("ciddor", "mathar")
    )
    allowed = ciddor.uncertainty_at(wavelength) + mathar.uncertainty_at(wavelength) + 0.01 * water
    for group in (False, True):
        ratio = mathar.constant(wavelength, group=group) / ciddor.constant(wavelength, group=group)
        assert abs(ratio - 1.0) < allowed * (1 + group)


def test_carbon_dioxide_counts_as_in_ciddors_air():
    """From 370 to 1000 ppm n - 1 per molecule rises, and so does the mass: both relations change alike, to 5e-8."""
    changes = [own(1.5e-6, co2=1e-3) / own(1.5e-6, co2=370e-6) for own in (flow.ciddor_constant, flow.mathar_constant)]
    assert changes[1] == pytest.approx(changes[0], abs=5e-8) and abs(changes[0] - 1.0) > 5e-5


@pytest.mark.parametrize("wavelength", [1.5e-6, 2e-6, 4e-6, 4.8e-6, 10.6e-6, 18e-6])
def test_the_group_constant_is_the_phase_constant_s_derivative(wavelength):
    """K_g = K - lambda dK/dlambda, by central differences: to 1e-8 of K."""
    step = 1e-5 * wavelength
    above, below = (flow.mathar_constant(wavelength + sign * step) for sign in (1.0, -1.0))
    expected = flow.mathar_constant(wavelength) - wavelength * (above - below) / (2.0 * step)
    assert flow.mathar_constant(wavelength, group=True) == pytest.approx(expected, rel=1e-8)


def test_auto_is_ciddor_to_the_last_bit_and_mathar_beyond():
    model = flow.refractivity_model()
    for wavelength in (0.3e-6, 905e-9, 1.69e-6):
        assert model.constant(wavelength) == flow.ciddor_constant(wavelength)
    for wavelength in (1.7e-6, 4e-6, 10.6e-6, 20e-6):
        assert model.constant(wavelength) == flow.mathar_constant(wavelength)
    moist = flow.refractivity_model(composition={"H2O": 0.02})
    assert moist.constant(10.6e-6) == flow.mathar_constant(10.6e-6, water=0.02) < model.constant(10.6e-6)


@pytest.mark.parametrize(("relation", "words"), [("auto", "0.3 to 1.69, 1.3 to 2.5"), ("mathar", "4.35 to 5.2")])
@pytest.mark.parametrize("wavelength", [2.6e-6, 6e-6, 15e-6])
def test_between_the_bands_ranges_are_named(relation, words, wavelength):
    with pytest.raises(ValueError, match=f"outside .*{words}"):
        flow.shipped("mach3").index_field(wavelength, relation)


def test_extrapolation_is_said_with_its_size():
    with pytest.warns(UserWarning, match="extrapolated to 600 K .*would give 0.00013"):
        flow.mathar_refractivity(4e-6, 600.0, 101325.0)
    with pytest.warns(UserWarning, match="extrapolated to 10.6 um, where it is 0.1 to 0.3 % too high"):
        flow.gladstone_dale_constant(10.6e-6)


@pytest.mark.parametrize("wavelength", ["4 um", "10.6 um"])
def test_a_scene_in_the_infrared(wavelength):
    """Five lines: the strehl ratio tends to 1 as the wavelength grows, and the error contains the model's."""
    run = simulate(Scene(**{"flow": {"source": "mach3", "wavelength": wavelength}}))
    summary = run.summary
    assert 0.998 < summary["strehl"] < 1.0 and summary["error"]["refractivity"] > 0.0
    assert np.isfinite(summary["range_m"])
