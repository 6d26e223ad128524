"""The group index n - lambda dn/dlambda of every refractivity model, against published formulas and the derivative."""

import numpy as np
import pytest

from aerokernels import flow

WAVES = (0.49e-6, 0.532e-6, 0.633e-6, 0.905e-6)
AIR = {"N2": 0.78079, "O2": 0.2094, "Ar": 0.00934, "CO2": 0.00045, "Ne": 2e-5}


def by_differences(value, wavelength: float) -> float:
    """Return f - lambda df/dlambda by a difference of sixth order over +-1e-3 of the wavelength.

    Error: the step to the sixth power times the derivatives, 1e-16 or so; rounding, 1e-16 / 1e-3 = 1e-13, of f.
    """
    step = 1e-3 * wavelength
    ahead, behind = ([float(value(wavelength + sign * k * step)) for k in (1, 2, 3)] for sign in (1.0, -1.0))
    change = [a - b for a, b in zip(ahead, behind, strict=True)]
    return float(value(wavelength)) - wavelength * (45.0 * change[0] - 9.0 * change[1] + change[2]) / (60.0 * step)


@pytest.mark.parametrize("nanometres", [400.0, 532.0, 633.0, 850.0, 905.0, 1064.0, 1550.0])
def test_ciddors_air_against_the_geodesists_formula(nanometres):
    """IAG Resolution 3 (1999), from Ciddor and Hill: dry air, 0 degC, 1013.25 hPa, 375 ppm of CO2, lambda in um.

    N_g = 287.6155 + 4.8866 / lambda^2 + 0.0680 / lambda^4. It was made for 0.25 ppm of a distance, which is what the
    two may differ by; the phase index, taken for the group index, is 1.6 ppm off at 1550 nm and 22 at 400 nm.
    """
    square = (1e3 / nanometres) ** 2
    published = 1e-6 * (287.6155 + 4.8866 * square + 0.0680 * square**2)
    density = flow.moist_air_density(273.15, 101325.0, co2=375e-6)
    constant = flow.ciddor_constant(nanometres * 1e-9, co2=375e-6, group=True)
    assert abs(constant * density - published) < 0.25e-6


@pytest.mark.parametrize(
    "given",
    [
        {"relation": "ciddor"},
        {"relation": "ciddor", "composition": {"H2O": 0.02, "CO2": 1e-3}},
        {"relation": "paper"},
        {"relation": "gladstone-dale", "constant": 2.24e-4},
        {"relation": "lorentz-lorenz"},
        {"relation": "lorentz-lorenz", "constant": 2.24e-4},
        {"relation": "gladstone-dale", "composition": AIR},
        {"relation": "lorentz-lorenz", "composition": AIR},
        {"relation": "lorentz-lorenz", "composition": flow.Composition({"He": 0.3, "N2": 0.7}, ambient={"N2": 1.0})},
    ],
    ids=str,
)
def test_models_against_the_derivative_of_their_own_index(given):
    """Index, ambient index and contrast of the group at up to 300 kg/m3, where Lorentz-Lorenz is far from linear.

    To 1e-10 of n - 1: the rounding of the difference, with room.
    """
    model, density = flow.refractivity_model(**given), np.array([0.1, 1.225, 300.0])
    for wavelength in (532e-9, 905e-9):
        for one in density:
            found = model.refractivity(one, wavelength, group=True)
            truth = by_differences(lambda length, one=one: model.refractivity(one, length), wavelength)
            assert found == pytest.approx(truth, rel=1e-10)
        ambient = model.ambient_index(1.225, wavelength, group=True)
        around = by_differences(lambda length: model.refractivity(1.225, length, ambient=True), wavelength)
        assert ambient - 1.0 == pytest.approx(around, rel=1e-10, abs=3e-16)
        inside = model.refractivity(density, wavelength, group=True)
        contrast = model.contrast(density, 1.225, wavelength, group=True)
        assert contrast == pytest.approx(inside - (ambient - 1.0), rel=1e-12, abs=1e-15)


def test_a_mixture_of_airs_gases_is_ciddors_air():
    """N2, O2, Ar and CO2 in air's fractions, three works' measurements: the group constants agree to 1e-4."""
    for wavelength in WAVES[1:]:
        mixed = flow.refractivity_model(composition=AIR).constant(wavelength, group=True)
        assert mixed == pytest.approx(flow.ciddor_constant(wavelength, group=True), rel=1e-4)


@pytest.mark.parametrize("wavelength", [0.4e-6, 0.532e-6, 0.633e-6, 0.905e-6, 1.064e-6, 1.55e-6])
def test_the_papers_uncertainty_covers_the_distance_to_ciddors_group_constant(wavelength):
    """Of n_g - 1 as of n - 1: a dispersion that is too steep counts three times in the group constant."""
    group = flow.uniform_air().index_field(wavelength, "paper").upstream.group
    ratio = flow.gladstone_dale_constant(wavelength, group=True) / flow.ciddor_constant(wavelength, group=True)
    assert abs(ratio - 1.0) < group.uncertainty < 1.5 * abs(ratio - 1.0) + 8e-3
