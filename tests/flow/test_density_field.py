"""Density fields and what the rays get from them."""

import math
from dataclasses import replace

import numpy as np
import pytest

from aerokernels import flow
from aerokernels.medium import QuadMesh

K = flow.gladstone_dale_constant(905e-9)


@pytest.fixture
def box() -> flow.DensityField:
    """4 x 6 cells, all 1.3 kg/m3, in air of 1.225 kg/m3."""
    r, z = np.meshgrid(np.linspace(0.0, 0.02, 5), np.linspace(-0.03, 0.0, 7), indexing="ij")
    mesh = QuadMesh.structured(r, z, "axisymmetric")
    return flow.DensityField(mesh, np.full((4, 6), 1.3), 1.225, provenance="a box")


@pytest.mark.parametrize("relation", flow.RELATIONS)
def test_index_field_is_the_contrast_to_the_ambient(box, relation):
    field = box.index_field(relation=relation)
    points = np.array([[0.0, 0.0, -0.01], [0.005, 0.01, -0.02], [0.0, 0.0, 0.01]])
    expected = float(flow.index_contrast(1.3, 1.225, K, relation))
    np.testing.assert_allclose(field.contrast_at(points), [expected, expected, 0.0], rtol=1e-13, atol=0.0)
    assert field.geometry == "axisymmetric"
    assert abs(field.ambient_index - 1.0 - float(flow.index_contrast(1.225, 0.0, K, relation))) < 2.3e-16


def test_scaling_keeps_every_ratio(box):
    scaled = box.scaled(0.6)
    assert scaled.ambient_density == 0.6
    np.testing.assert_allclose(scaled.density / 0.6, box.density / 1.225, rtol=1e-15)
    assert "0.4897" in scaled.provenance and scaled.provenance.startswith("a box")
    assert scaled.mesh is box.mesh


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (math.nan, "2 of 24 densities are not finite"),
        (math.inf, "not finite"),
        (0.0, "not positive"),
        (-1.0, "not positive"),
    ],
)
def test_bad_densities_are_counted_and_the_first_is_placed(box, value, words):
    density = box.density.reshape(4, 6).copy()
    density[1, 4] = density[3, 2] = value
    with pytest.raises(ValueError, match=words) as fault:
        replace(box, density=density)
    assert "row 1, column 4" in str(fault.value) and "r, z = 0.0075, -0.0075 m" in str(fault.value)


def test_wrong_numbers_of_cells_are_refused(box):
    with pytest.raises(ValueError, match="shape \\(5, 7\\), the mesh 24 cells"):
        replace(box, density=np.ones((5, 7)))
    with pytest.raises(TypeError, match="QuadMesh"):
        replace(box, mesh=np.ones((5, 7)))
    with pytest.raises(ValueError, match="ambient_density"):
        replace(box, ambient_density=0.0)


def test_uniform_air_has_no_contrast_at_all():
    """Not small: zero, so that a static scene has exactly no aberration."""
    field = flow.uniform_air(0.9, body=flow.shipped("mach2").body).index_field(relation="lorentz-lorenz")
    points = np.random.default_rng(1).uniform(-0.05, 0.05, (500, 3))
    assert not field.contrast_at(points).any() and not field.gradient_at(points).any()
    assert field.body is not None
    assert abs(field.ambient_index - 1.0 - float(flow.index_contrast(0.9, 0.0, K, "lorentz-lorenz"))) < 2.3e-16


@pytest.mark.parametrize("arguments", [{"density": -1.0}, {"radius": 0.0}, {"z_range": (0.0, 0.0)}])
def test_uniform_air_refuses(arguments):
    with pytest.raises(ValueError, match=next(iter(arguments))):
        flow.uniform_air(**arguments)


def test_densities_at_vertices_in_another_order_are_refused():
    """An array (nj, ni) has as many entries as vertices, and put them in wrong places."""
    y, z = np.meshgrid(np.linspace(0.0, 1.0, 5), np.linspace(0.0, 1.0, 9), indexing="ij")
    mesh, density = QuadMesh.structured(y, z), 1.0 + y + 10.0 * z
    assert flow.VertexDensity(mesh, density, 1.0).density_at([[0.0, 1.0, 0.0]]) == pytest.approx([2.0])
    with pytest.raises(ValueError, match=r"give one density for each, shape \(45,\) or \(5, 9\)"):
        flow.VertexDensity(mesh, density.T, 1.0)


def test_points_that_are_not_numbers_have_no_density(box):
    grid = flow.GridDensity(np.full((5, 5, 5), 2.0), [0.0] * 3, [0.1] * 3, "volume", 1.0)
    vertices = flow.VertexDensity(box.mesh, np.full(35, 1.3), 1.225)
    for field in (box, vertices, grid, flow.wedge(3.0, 0.2, spacing=5e-3), flow.cone(3.0, 0.2)):
        assert np.isnan(field.density_at([[0.0, 0.0, np.nan]])).all()
        assert field.density_at([[0.0, 9.0, 9.0]]) == field.ambient_density


def test_fractions_in_another_order_than_the_densities_are_refused():
    share = np.linspace(0.2, 0.8, 45).reshape(9, 5)
    gas = {"ambient": {"N2": 0.8, "O2": 0.2}}
    turned = flow.Composition({"N2": share, "O2": 1.0 - share}, **gas)
    grid = flow.GridDensity(np.full((5, 9), 2.0), [0.0, 0.0], [0.1, 0.1], "planar", 1.0, composition=turned)
    with pytest.raises(ValueError, match=r"shape \(9, 5\), the density shape \(5, 9\): .* in the same order"):
        grid.index_field()
    with pytest.raises(ValueError, match=r"have the shapes \(3,\), \(4,\): give one fraction"):
        flow.Composition({"N2": np.full(3, 0.8), "O2": np.full(4, 0.2)}, **gas)
