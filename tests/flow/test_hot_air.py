"""Hot, reacting and ionised gas: constants of species, polarisabilities with temperature, air in equilibrium."""

import math

import numpy as np
import pytest

from aerokernels import flow

# Mass fractions of air (0.78084 N2, 0.20946 O2, 0.00934 Ar, 0.00036 inert CO2) in equilibrium, by Cantera 3.2 with the
# same Gibbs energies (NASA/TP-2002-211556) at a standard pressure of 1 bar.
CANTERA = [
    (
        {"density": 1.0, "temperature": 2500.0},
        {
            "N2": 0.7445316,
            "O2": 0.217894,
            "NO": 0.02281931,
            "N": 4.624294e-08,
            "O": 0.001326139,
            "NO+": 1.683e-10,
            "N+": 8.870124e-26,
            "Ar": 0.01288188,
            "CO2": 0.000546965,
        },
    ),
    (
        {"density": 0.01, "temperature": 4000.0},
        {
            "N2": 0.7422694,
            "O2": 0.008350599,
            "NO": 0.02290861,
            "N": 0.002217133,
            "O": 0.210818,
            "NO+": 7.416608e-06,
            "N+": 1.931473e-12,
            "Ar": 0.01288188,
            "CO2": 0.000546965,
        },
    ),
    (
        {"density": 0.01, "temperature": 9000.0},
        {
            "N2": 0.01209164,
            "O2": 3.996334e-06,
            "NO": 0.0002726023,
            "N": 0.7334406,
            "O": 0.2290438,
            "NO+": 0.0002565099,
            "N+": 0.009326403,
            "Ar": 0.01288188,
            "CO2": 0.000546965,
        },
    ),
    (
        {"pressure": 10000.0, "temperature": 3000.0},
        {
            "N2": 0.7375853,
            "O2": 0.1389523,
            "NO": 0.03765868,
            "N": 1.917701e-05,
            "O": 0.07235558,
            "NO+": 8.454545e-08,
            "N+": 6.805773e-19,
            "Ar": 0.01288188,
            "CO2": 0.000546965,
        },
    ),
    (
        {"pressure": 100000.0, "temperature": 6000.0},
        {
            "N2": 0.6427143,
            "O2": 0.0003605135,
            "NO": 0.01071006,
            "N": 0.1073377,
            "O": 0.2251646,
            "NO+": 0.0002779761,
            "N+": 1.271258e-06,
            "Ar": 0.01288188,
            "CO2": 0.000546965,
        },
    ),
    (
        {"pressure": 1000.0, "temperature": 12000.0},
        {
            "N2": 1.965942e-07,
            "O2": 7.871158e-10,
            "NO": 2.073047e-08,
            "N": 0.1639475,
            "O": 0.0736974,
            "NO+": 1.066884e-06,
            "N+": 0.5912118,
            "Ar": 0.01288188,
            "CO2": 0.000546965,
        },
    ),
]


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [("O", 1.82e-4, 1.90e-4), ("N", 2.97e-4, 3.01e-4), ("NO", 2.14e-4, 2.21e-4), ("N2", 2.33e-4, 2.40e-4)],
)
def test_constants_of_atoms_lie_between_the_published_ones(name, low, high):
    """Karl 2003, Alpher and White 1959, and polarisabilities of the CRC Handbook."""
    gas = flow.SPECIES[name]
    assert low < gas.constant(633e-9) < high
    assert (1.0 + gas.uncertainty) * gas.constant(633e-9) > high * 0.995 or name == "N2"


def test_dissociation_at_constant_mass_raises_the_refractivity_by_the_ratio_of_constants():
    molecules, atoms = flow.Composition({"N2": 1.0}), flow.Composition({"N": 1.0})
    ratio = atoms.constant(905e-9) / molecules.constant(905e-9)
    assert ratio == pytest.approx(flow.species_constant("N", 905e-9) / flow.species_constant("N2", 905e-9), rel=1e-14)
    assert 1.2 < ratio < 1.3


@pytest.mark.parametrize("wavelength", [532e-9, 905e-9, 10.6e-6])
def test_electrons_are_a_cold_plasma(wavelength):
    """The index sqrt(1 - wp^2 / w^2) at 1e20 electrons per m3, to the next term; the group index is its inverse."""
    number, mass = 1e20, 5.48579909e-4 / 6.02214076e23 * 1e-3
    critical = math.pi / (2.8179403e-15 * wavelength**2)
    share = number / critical
    index = math.sqrt(1.0 - share) - 1.0
    constant = flow.species_constant("e-", wavelength)
    assert constant * number * mass == pytest.approx(index, rel=share)
    assert flow.species_constant("e-", wavelength, group=True) == -constant


@pytest.mark.parametrize("name", ["N2", "O2"])
@pytest.mark.parametrize("temperature", [300.0, 600.0, 1000.0])
def test_polarisability_rises_with_temperature(name, temperature):
    """Kerl's alpha0 (1 + b T + c T^2) / (1 - w^2 / w0^2): absolutely to 1.5e-3, from 300 K on to rounding."""
    alpha, resonance, b, c = {"N2": (1.7406, 2.6049e16, 1.8e-6, 0.0), "O2": (1.5658, 2.1801e16, -2.369e-6, 8.687e-9)}[
        name
    ]

    def kerl(heat):
        square = (2.0 * math.pi * 299792458.0 / 633e-9 / resonance) ** 2
        polarisability = alpha * 1e-30 * (1.0 + b * heat + c * heat**2) / (1.0 - square)
        return 2.0 * math.pi * polarisability * 6.02214076e23 / flow.SPECIES[name].molar_mass

    constant, cool = (flow.Composition({name: 1.0}, temperature=t).constant(633e-9) for t in (temperature, 300.0))
    assert constant == pytest.approx(kerl(temperature), rel=1.5e-3)
    assert constant / cool == pytest.approx(kerl(temperature) / kerl(300.0), rel=1e-12)


def test_above_a_thousand_kelvin_the_polynomials_are_not_continued():
    with pytest.warns(UserWarning, match="known to 1000 K .*up to 5000 K.*would change n - 1"):
        hot = flow.Composition({"O2": 1.0}, temperature=5000.0)
    assert hot.constant(905e-9) == flow.Composition({"O2": 1.0}, temperature=1000.0).constant(905e-9)


@pytest.mark.parametrize("row", CANTERA, ids=str)
def test_air_in_equilibrium(row):
    """Mass fractions to 2e-5: atomic masses of two tables."""
    state, expected = row
    fractions = flow.equilibrium_air(**state).fractions
    assert sum(fractions.values()) == pytest.approx(1.0, abs=1e-12)
    assert {name: fractions[name] for name in expected} == pytest.approx(expected, abs=2e-5)


def test_cold_air_is_ciddors_and_hot_air_refracts_more():
    """At 300 K within 5e-5 of Ciddor's dry air; at 0.01 kg/m3, dissociated, more."""
    cold, hot = (flow.equilibrium_air(0.01, heat) for heat in (300.0, 6000.0))
    assert cold.constant(905e-9) == pytest.approx(flow.ciddor_constant(905e-9), rel=5e-5)
    assert hot.constant(905e-9) > 1.03 * cold.constant(905e-9)


def test_a_field_of_hot_air():
    """An array of states makes the composition of a field; its errors contain those of the species."""
    heat = np.linspace(300.0, 9000.0, 8 * 8).reshape(8, 8)
    density = 0.05 * np.ones((8, 8))
    field = flow.DensityField.from_samples(
        density, origin=(0.0, 0.0), spacing=(1e-3, 1e-3), geometry="planar", ambient_density=0.05
    )
    index = field.index_field(905e-9, composition=flow.equilibrium_air(density, heat))
    constant = flow.equilibrium_air(density, heat).constant(905e-9)
    outside = 0.05 * flow.equilibrium_air(0.05, 293.15).constant(905e-9)
    np.testing.assert_allclose(index.samples.samples, 0.05 * constant - outside, atol=1e-12)
    assert 1e-3 < index.upstream.refractivity < 3e-2


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        ({"temperature": 3000.0}, "either density .* or pressure"),
        ({"density": 1.0}, "needs the temperature"),
        ({"density": 1.0, "temperature": 2e4}, "20000 K is outside 200 to 15000 K"),
        ({"density": -1.0, "temperature": 3e3}, "density must be positive"),
        ({"pressure": np.ones(3), "temperature": np.ones(2) * 3e3}, "one for each place"),
    ],
)
def test_states_that_are_none_are_refused(arguments, fault):
    with pytest.raises((TypeError, ValueError), match=fault):
        flow.equilibrium_air(**arguments)
