"""What OpenFOAM holds at walls: patches' values as densities there, in the index field."""

import numpy as np
import pytest
import writers

from aerokernels import flow


def with_boundary(folder, name: str, kind: str, conditions: str, values: bytes = b"uniform 1", binary=False):
    """A field of the case at t = 0.5 with a boundaryField."""
    head = writers.foam_header(kind, name, binary)
    text = b"dimensions [0 0 0 0 0 0 0];\ninternalField " + values + b";\nboundaryField\n{\n"
    (folder / "0.5" / name).write_bytes(head + text + conditions.encode("latin-1") + b"\n}\n")


def edited(folder, conditions: bytes):
    """The case with other conditions for rho."""
    path = folder / "0.5" / "rho"
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(b"boundaryField")] + b"boundaryField\n{\n" + conditions + b"\n}\n")
    return folder


def faces() -> np.ndarray:
    """Middles of the wall's edges along x."""
    x = writers.grid()[0][0]
    return 0.5 * (x[1:] + x[:-1])


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("wedge", [False, True])
def test_a_list_of_values_is_the_density_at_the_wall(tmp_path, binary, wedge):
    """Set-up: rho with calculated values along the wall, linear in x. Expected: these at edges' middles, 1e-12.

    Between edges within 1e-5, as the wall is slightly bent; its two ends stay within the range of the faces.
    And in the index field: its contrast at the wall is theirs, while averages stay kept.
    """
    told = 2.0 + 0.5 * faces()
    values = b"body { type calculated; other nonuniform List<scalar> " + writers.foam_list(told + 7.0, binary)
    values += b"; value nonuniform List<scalar> " + writers.foam_list(told, binary)
    values += b"; } outlet { type calculated; value nonuniform 0(); }"
    case = edited(writers.foam_wedge(tmp_path / "case", binary=binary, wedge=wedge), values)
    field = flow.read(case)
    wall = field.wall
    assert wall is not None
    points, density = wall
    assert len(density) == 2 * len(told) + 1
    assert np.abs(density - (2.0 - 0.5 * points[:, 1]))[: len(told)].max() < 1e-12
    missed = np.abs(density - (2.0 - 0.5 * points[:, 1]))[len(told) :]
    assert np.sort(missed)[:-2].max() < 1e-5 and density.min() >= told.min() and density.max() <= told.max()
    index = field.index_field(constant=2e-4)
    at = np.concatenate([np.zeros((len(told), 1)), points[: len(told)]], axis=1)
    inward = at + np.array([0.0, 1e-9, 0.0])
    assert np.abs(index.contrast_at(inward) / 2e-4 + field.ambient_density - told).max() < 1e-4
    half = field.scaled(0.5 * field.ambient_density)
    assert np.abs(half.wall[1] - 0.5 * density).max() < 1e-15


def test_pressure_of_zero_gradient_and_a_given_temperature(tmp_path):
    """Set-up: p of the cells, T uniform at the wall by a pattern. Expected: rho = p / (R T) with both."""
    case = writers.foam_wedge(tmp_path / "case")
    (case / "0.5" / "rho").unlink()
    with_boundary(case, "p", "volScalarField", "body { type zeroGradient; }", b"uniform 1e5")
    with_boundary(case, "T", "volScalarField", '"(body|other)" { type fixedValue; value uniform 400; }', b"uniform 300")
    field = flow.read(case, gas_constant=287.0, length_unit=1.0, reference={"pressure": 1.0, "temperature": 1.0})
    assert np.abs(field.wall[1] - 1e5 / (287.0 * 400.0)).max() < 1e-12


@pytest.mark.parametrize(
    "conditions",
    [
        b"",
        b"body { type codedFixedValue; code #{ operator==(1.0); #}; }",
        b"body { type fixedValue; value nonuniform List<scalar> 2(1 2); }",
        b"body { type fixedValue; value uniform -4; }",
        b'"(" { type fixedValue; value uniform 3; }',
        b'"(b|b)(o|o)(d|d)(y|y)(b|o)*!" { type fixedValue; value uniform 3; }',
    ],
)
def test_what_tells_nothing_of_the_wall_is_left_out(tmp_path, conditions):
    """Expected: the field of the averages, as it was without these."""
    case = edited(writers.foam_wedge(tmp_path / "case"), conditions)
    field = flow.read(case)
    assert field.wall is None
    assert np.abs(field.density - flow.read(edited(case, b"")).density).max() == 0.0


def test_gas_that_slips_has_no_layer(tmp_path):
    """Set-up: a wall with a density of its own, along which the velocity slips. Expected: none of it."""
    case = edited(writers.foam_wedge(tmp_path / "case"), b"body { type fixedValue; value uniform 3; }")
    assert flow.read(case).wall is not None
    with_boundary(case, "U", "volVectorField", "body { type slip; }", b"uniform (1 0 0)")
    assert flow.read(case).wall is None
