"""Dispersion of gases by species, and of mixtures."""

import math

import numpy as np
import pytest

from aerokernels import flow

# The published formulas once more, as written in the papers where that is another form than the package's: n - 1 from
# s = 1 / lambda^2 [1/um2].
PUBLISHED = {
    "N2": lambda s: 1e-8 * (6855.200 + 3243157.0 / (144.0 - s)),
    "O2": lambda s: 1e-8 * (11814.94 + 970893.1 / (75.4 - s)),
    "Ar": lambda s: 1e-8 * (6786.711 + 3018294.3 / (144.0 - s)),
    "CO2": lambda s: 1e-8 * (154.489 / (0.0584738 - s) + 8309192.7 / (210.92417 - s) + 287641.9 / (60.122959 - s)),
    "He": lambda s: 1e-8 * 1470091.0 / (423.98 - s),
    "H2": lambda s: 1e-6 * (14895.6 / (180.7 - s) + 4903.7 / (92.0 - s)),
}
SELLMEIER = {
    "Ne": ((9154.48e-8, 656.97e-6), (4018.63e-8, 5.728e-3)),
    "Kr": ((26102.88e-8, 2.01e-6), (56946.82e-8, 10.043e-3)),
    "Xe": ((103701.61e-8, 12.75e-3), (31228.61e-8, 0.561e-3)),
}


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize("micrometre", [0.5, 0.5461, 0.6328, 0.905, 1.064, 1.6])
def test_published_formulas(name, micrometre):
    """Refractivity at the reference state within 1e-5 of the paper's formula: digits that the database dropped."""
    expected = PUBLISHED[name](1.0 / micrometre**2)
    assert abs(flow.SPECIES[name].refractivity(micrometre * 1e-6) / expected - 1.0) < 1e-5


@pytest.mark.parametrize("name", SELLMEIER)
@pytest.mark.parametrize("micrometre", [0.4, 0.6328, 0.905, 1.0])
def test_sellmeier_formulas(name, micrometre):
    """n^2 - 1 = sum B lambda^2 / (lambda^2 - C) at 273 K and 1000 mbar (Borzsonyi 2008)."""
    square = 1.0 + sum(b * micrometre**2 / (micrometre**2 - c) for b, c in SELLMEIER[name])
    assert abs(flow.SPECIES[name].refractivity(micrometre * 1e-6) - (math.sqrt(square) - 1.0)) < 1e-15


@pytest.mark.parametrize(
    ("name", "expected"),
    [("N2", 1.2504), ("Ar", 1.7839), ("CO2", 1.9768), ("He", 0.17850), ("H2", 0.089885)],
)
def test_reference_densities(name, expected):
    """Densities of gases at 0 degC and 101325 Pa [kg/m3], from tables of the normal state: to 2e-4."""
    assert abs(flow.SPECIES[name].reference_density / expected - 1.0) < 2e-4


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("N2", 0.4679, 2.0587), ("O2", 0.4, 1.8), ("Ar", 0.4679, 2.0587), ("CO2", 0.480126, 1.817228),
        ("He", 0.4801, 2.0586), ("H2", 0.168, 1.6945), ("Ne", 0.4, 1.0), ("Kr", 0.4, 1.0), ("Xe", 0.4, 1.0),
    ],
)  # fmt: skip
def test_formulas_hold_in_the_range_they_were_made_for(name, low, high):
    """Both ends are in it [um], a ten thousandth beyond is not."""
    gas = flow.SPECIES[name]
    assert gas.refractivity(low * 1e-6) > gas.refractivity(high * 1e-6) > 0.0
    for beyond in (low * 0.9999e-6, high * 1.0001e-6):
        with pytest.raises(ValueError, match=f"where the refractivity of {name} is known"):
            gas.refractivity(beyond)


@pytest.mark.parametrize("wavelength", [0.5e-6, 0.6328e-6, 0.905e-6, 1.5e-6])
def test_dry_air_mixed_of_its_species_is_ciddors(wavelength):
    """N2, O2, Ar and 450 ppm CO2 in air's mole fractions against Ciddor's measured air: 1e-4, three works' errors."""
    fractions = {"N2": 0.78084, "O2": 0.20946 - 0.00003, "Ar": 0.00934, "CO2": 0.00045}
    mixed = flow.Composition(fractions).constant(wavelength)
    assert abs(mixed / flow.ciddor_constant(wavelength) - 1.0) < 1e-4


def test_mole_and_mass_fractions():
    """Half a mole each of He and Ar: mass fractions 4.0026 and 39.948 over their sum, and K the sum of w K."""
    total = 4.002602 + 39.948
    mass = {"He": 4.002602 / total, "Ar": 39.948 / total}
    by_mole, by_mass = flow.Composition({"He": 0.5, "Ar": 0.5}), flow.Composition(mass, "mass")
    expected = sum(share * flow.species_constant(name, 633e-9) for name, share in mass.items())
    assert abs(by_mole.constant(633e-9) / expected - 1.0) < 1e-14
    assert abs(by_mass.constant(633e-9) / expected - 1.0) < 1e-14


def test_refractivities_add():
    """Set-up: partial densities of N2 and CO2. Expected: n - 1 of the mixture is the sum of its parts', to rounding."""
    partial = {"N2": 0.9, "CO2": 0.4}
    mixture = flow.Composition({name: rho / 1.3 for name, rho in partial.items()}, "mass")
    parts = sum(rho * flow.species_constant(name, 905e-9) for name, rho in partial.items())
    assert abs(1.3 * mixture.constant(905e-9) / parts - 1.0) < 1e-14


def test_fractions_by_cell():
    helium = np.linspace(0.0, 1.0, 5)
    mixture = flow.Composition({"He": helium, "N2": 1.0 - helium}, "mass", ambient={"N2": 1.0})
    constant = mixture.constant(633e-9)
    low, high = flow.species_constant("N2", 633e-9), flow.species_constant("He", 633e-9)
    np.testing.assert_allclose(constant, low + (high - low) * helium, rtol=1e-14)
    assert mixture.constant(633e-9, ambient=True) == low


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (({"N3": 1.0},), r"species 'N3' is not known: choose one of N2, O2"),
        (({"N2": 0.7},), r"add up to 0\.7, not to 1"),
        (({"N2": 1.2, "O2": -0.2},), "O2 must be finite and not negative"),
        (({"N2": math.nan},), "N2 must be finite"),
        (({"N2": 1.0}, "volume"), "'mole' or 'mass'"),
        (({"N2": np.ones(3)},), "need `ambient`"),
        (({"N2": 1.0}, "mass", {"N2": np.ones(2)}), "ambient gas must be numbers"),
    ],
)
def test_bad_compositions_are_refused(arguments, fault):
    with pytest.raises(ValueError, match=fault):
        flow.Composition(*arguments)
