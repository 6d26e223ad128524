"""Names of arrays: which are taken for the density, the pressure and the temperature, and their units."""

import numpy as np
import pytest

from aerokernels import flow

Y, X = (axis.ravel() for axis in np.meshgrid(np.linspace(0.0, 0.8, 4), np.linspace(0.0, 1.0, 5), indexing="ij"))
RHO = 1.2 + 0.3 * X - 0.2 * Y
R = 287.0


def table(path, **columns):
    """A CSV file of the grid with further columns by name."""
    own = {"x": X, "y": Y, **columns}
    names = ",".join(f'"{name}"' for name in own)
    np.savetxt(path, np.stack([np.broadcast_to(v, X.shape) for v in own.values()], 1), "%.17g", ",", header=names,
               comments="")  # fmt: skip
    return path


@pytest.mark.parametrize("name", ["Density_avg", "Mean Density", "<rho>", "ρ", "density (static)"])
def test_spellings_of_the_density_and_its_mean(tmp_path, name):
    """Beside another quantity of the name: what is in brackets counts, unless it is a unit."""
    path = table(tmp_path / "a.csv", **{"p/rho": 9.0, "Density (solid)": 2700.0, "rho (gradient)": 5.0, name: RHO})
    assert flow.read(path).density.max() == pytest.approx(RHO.max())


@pytest.mark.parametrize("temperature", ["T", "temperature", "T (static)"])
def test_a_time_called_t_is_no_temperature(tmp_path, temperature):
    """Set-up: columns t = 0.5 s, p and T. Expected: p / (R T); the time was taken, and the density was 600 times it."""
    path = table(tmp_path / "a.csv", t=0.5, p=RHO * R * 300.0, **{temperature: 300.0})
    field = flow.read(path, gas_constant=R)
    assert np.sort(field.density.ravel()) == pytest.approx(np.sort(RHO))
    alone = table(tmp_path / "b.csv", t=0.5, p=RHO)
    with pytest.raises(flow.ReadError, match="no array is known for the density"):
        flow.read(alone)
    assert "'t'" in flow.read(table(tmp_path / "c.csv", t=300.0 + X, p=1e5)).provenance


@pytest.mark.parametrize(
    ("names", "options", "said"),
    [
        (("x", "y", "rho"), {}, "no unit is stated, taken: 'rho' in kg/m3, coordinates in m"),
        (("x [mm]", "y", "rho"), {}, "no unit is stated, taken: 'rho' in kg/m3;"),
        (("x", "y", "rho [g/L]"), {"length_unit": "mm"}, None),
        (("x", "y", "rho"), {"reference": {"density": 1.2, "length": 0.1}}, None),
        (("x", "y", "rho"), {"reference": 1.2}, "no unit is stated, taken: coordinates in m"),
    ],
)
def test_the_provenance_says_which_numbers_are_taken_in_si(tmp_path, names, options, said):
    """Expected: a word on numbers without a unit, which may be non-dimensional or in millimetres."""
    path = tmp_path / "a.csv"
    np.savetxt(path, np.stack([X, Y, RHO], 1), "%.17g", ",", header=",".join(names), comments="")
    provenance = flow.read(path, **options).provenance
    assert said in provenance if said else "no unit" not in provenance
