"""Gauge pressures, and numbers without a unit that no gas has in SI."""

import warnings

import numpy as np
import pytest

from aerokernels import Scene, flow
from aerokernels.flow.gas import GAS_CONSTANT_AIR

from .fuzzing import plain

AXES = {"x": np.linspace(0.0, 0.4, 9), "y": np.linspace(-0.1, 0.1, 7)}
X, Y = np.meshgrid(*AXES.values(), indexing="ij")
DENSITY, TEMPERATURE = 1.0 + 0.2 * np.sin(9.0 * X) * np.cos(7.0 * Y), 280.0 + 20.0 * Y
PRESSURE = DENSITY * GAS_CONSTANT_AIR * TEMPERATURE


def read(folder, arrays, **options):
    np.savez(folder / "a.npz", **AXES, **arrays)
    return flow.read(folder / "a.npz", **options)


def is_exact(field) -> bool:
    # The field is over [y, z] with z = -x.
    return np.allclose(np.sort(field.density.ravel()), np.sort(DENSITY.ravel()), rtol=1e-12)


@pytest.mark.parametrize("operating", [101325.0, 60000.0])
def test_gauge_pressures(operating: float, tmp_path):
    """Set-up: pressures less an operating pressure, some or none of them negative.

    Expected: the density, once it is given, with a unit or without; the remedy where negative densities show that it
    lacks.
    """
    arrays = {"p": PRESSURE - operating, "T": TEMPERATURE}
    for given in (operating, f"{operating / 1e3} kPa"):
        field = read(tmp_path, arrays, reference={"operating_pressure": given})
        assert is_exact(field) and f"'p' + {operating:.6g} Pa and 'T'" in field.provenance
    scaled = {"p": arrays["p"] / 5e4, "T": TEMPERATURE}
    assert is_exact(read(tmp_path, scaled, reference={"operating_pressure": operating, "pressure": 5e4}))
    if (arrays["p"] < 0.0).any():
        with pytest.raises(ValueError, match="relative to an operating pressure, give it: reference = "):
            read(tmp_path, arrays)
    with pytest.raises(ValueError, match="an operating pressure is given, but the density is 'rho'"):
        read(tmp_path, arrays | {"rho": DENSITY}, reference={"operating_pressure": operating})


def test_a_scene_states_the_operating_pressure(tmp_path):
    np.savez(tmp_path / "a.npz", **AXES, p=PRESSURE - 5e4, T=TEMPERATURE)
    (tmp_path / "a.toml").write_text('[flow]\nsource = "a.npz"\nfile.operating_pressure = "0.5 bar"\n')
    table = Scene.load(tmp_path / "a.toml").flow.file
    assert is_exact(flow.read(tmp_path / "a.npz", **table.read_options()))


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        # Scaled by density, speed of sound and temperature of the free stream.
        ({"rho": DENSITY, "p": DENSITY / 1.4, "T": np.ones(X.shape)}, r"'p' / \(R 'T'\) is 0\.0025 times as much"),
        ({"rho": DENSITY, "p": PRESSURE / 1e3, "T": TEMPERATURE}, r"is 0\.001 times as much.*'density'"),
        ({"p": DENSITY / 1.4, "T": 1.0 + Y}, r"half of it is below 1 K: .*'temperature'"),
        # Without a temperature: p = 1 / 1.4 is 0.0025 K of air of 1 kg/m3; E = p / 0.4 + 3^2 / 2 at most 0.0088 K.
        ({"rho": DENSITY, "p": DENSITY / 1.4}, r"'rho' .* with 'p' half of the gas is below 0\.0025 K: .*'density'"),
        ({"rho": DENSITY, "p [bar]": DENSITY / 1e5 / 1.4}, r"with 'p \[bar\]' half of the gas is below 0\.0025 K"),
        ({"rho": DENSITY / 1e3, "p": PRESSURE}, r"with 'p' half of the gas is above 2\.8e\+05 K"),
        ({"rho": DENSITY, "Energy": DENSITY * (1 / 0.56 + 4.5)}, r"with 'Energy' .* is below 0\.009\d K: .*'density'"),
        ({"rho": DENSITY, "T": 1.0 + Y}, r"'rho' was taken in kg/m3, but of 'T' half of it is below 1 K"),
    ],
)
def test_numbers_without_a_unit_that_cannot_be_in_si(arrays, words: str, tmp_path):
    with pytest.warns(UserWarning, match=rf"a\.npz: .*{words}"):
        field = read(tmp_path, arrays)
    assert "if the file is non-dimensional, give its reference values" in field.provenance
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read(tmp_path, arrays, reference={"density": 1.2, "pressure": 1e5, "temperature": 300.0})


@pytest.mark.parametrize(
    "arrays", [{"p": PRESSURE}, {"p": PRESSURE - 1e5}, {"p [kPa]": PRESSURE / 1e3}, {"p": 14 * PRESSURE}]
)
def test_numbers_that_may_be_in_si(arrays, tmp_path):
    """Absolute and gauge pressures beside a density, those with a unit, and hydrogen's; total energies."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert is_exact(read(tmp_path, {"rho": DENSITY, "T": TEMPERATURE} | arrays))
        assert is_exact(read(tmp_path, {"rho": DENSITY} | arrays))
        for energy in (717.0 * TEMPERATURE, 717.0 * DENSITY * TEMPERATURE):
            assert is_exact(read(tmp_path, {"rho": DENSITY, "Energy": energy}))


def test_formats_and_files_that_state_it(tmp_path):
    """Plot3D's q files; a configuration of SU2 is in test_other_programs.py, CGNS in test_cgns_statements.py."""
    path = plain(tmp_path, "plot3d-plain")
    with pytest.warns(UserWarning, match=r"q files are mostly non-dimensional: .* say so by a reference of 1"):
        field = flow.read(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.array_equal(flow.read(path, reference={"density": 1.0}).density, field.density)
