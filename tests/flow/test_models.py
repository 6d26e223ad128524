"""Refractivity models by name, and the index fields made with them."""

import pickle

import numpy as np
import pytest

from aerokernels import Scene, flow
from aerokernels.medium import QuadMesh
from aerokernels.prepare import prepare_field

K = flow.gladstone_dale_constant(905e-9)


@pytest.fixture(scope="module")
def field() -> flow.DensityField:
    y, z = np.meshgrid(np.linspace(0.0, 0.02, 6), np.linspace(-0.03, 0.0, 7), indexing="ij")
    density = np.random.default_rng(3).uniform(0.4, 3.0, (5, 6))
    return flow.DensityField(QuadMesh.structured(y, z), density, 1.225)


def values(index) -> np.ndarray:
    return index.samples.values


def test_every_door_has_the_same_default(field):
    """Without a relation the index is Ciddor's in Python as in a scene: 0.46 % less at 905 nm than the paper's."""
    constant = flow.ciddor_constant(905e-9)
    cone = flow.cone(3.0, 0.3, length=0.02).index_field(spacing=1e-3)
    table = Scene.load("wind-tunnel-static").as_dict()["flow"]
    static = Scene(**{"flow": {"source": "static"}})
    for index in (field.index_field(), cone, prepare_field(static).field):
        assert index.ambient_index == 1.0 + constant * 1.225
    assert table["relation"] == "paper" and flow.refractivity_model().name == static.flow.relation == "auto"
    # With a constant, or a composition, it is Gladstone and Dale's, in both.
    assert field.index_field(constant=2e-4).ambient_index == 1.0 + 2e-4 * 1.225
    given = Scene(**{"flow": {"source": "static", "gladstone_dale": 2e-4}})
    assert given.flow.relation == "gladstone-dale"


def test_ciddor_in_a_field(field):
    dry = field.index_field(905e-9, "ciddor")
    constant = flow.ciddor_constant(905e-9)
    assert dry.ambient_index == 1.0 + constant * 1.225
    np.testing.assert_allclose(
        values(dry), values(field.index_field(905e-9, "paper")) * (constant / K), rtol=1e-12, atol=1e-19
    )
    moist = field.index_field(905e-9, "ciddor", composition={"H2O": 0.02, "CO2": 420e-6})
    expected = 1.0 + flow.ciddor_constant(905e-9, water=0.02, co2=420e-6) * 1.225
    assert moist.ambient_index == expected


@pytest.mark.parametrize("relation", flow.RELATIONS)
def test_a_jet_of_another_gas(field, relation):
    """Mass fractions of helium by cell, in nitrogen: n - n_ambient cell by cell; helium at air's density refracts less.

    Expected: the difference of both gases' refractivities, to rounding of 1e-16.
    """
    helium = np.linspace(0.0, 1.0, len(field.density))
    jet = flow.Composition({"He": helium, "N2": 1.0 - helium}, "mass", ambient={"N2": 1.0})
    model = flow.refractivity_model(relation, composition=jet)
    contrast = model.contrast(field.density, 1.225, 905e-9)
    for cell in (0, 7, len(helium) - 1):
        own = flow.Composition({"He": helium[cell], "N2": 1.0 - helium[cell]}, "mass").constant(905e-9, relation)
        outside = flow.species_constant("N2", 905e-9, relation)
        expected = flow.index_contrast(field.density[cell], 0.0, own, relation) - flow.index_contrast(
            1.225, 0.0, outside, relation
        )
        assert abs(contrast[cell] - expected) < 1e-18
    index = field.index_field(905e-9, relation, composition=jet)
    assert np.array_equal(values(index), values(type(index).from_mesh(field.mesh, contrast)))
    by_rows = flow.Composition({"He": helium.reshape(5, 6), "N2": 1.0 - helium.reshape(5, 6)}, "mass", {"N2": 1.0})
    assert np.array_equal(values(field.index_field(905e-9, relation, composition=by_rows)), values(index))
    with pytest.raises(ValueError, match=r"fractions of shape \(3,\)"):
        short = flow.Composition({"He": np.zeros(3), "N2": np.ones(3)}, "mass", {"N2": 1.0})
        field.index_field(905e-9, relation, composition=short)


def test_a_cone_takes_every_model():
    cone = flow.cone(3.0, 0.3, length=0.02)
    plain = cone.index_field(905e-9, "paper", spacing=1e-3)
    for relation, constant in (("paper", K), ("ciddor", flow.ciddor_constant(905e-9))):
        index = cone.index_field(905e-9, relation, spacing=1e-3)
        assert index.ambient_index == 1.0 + constant * 1.225
        np.testing.assert_allclose(index.samples.samples, plain.samples.samples * (constant / K), rtol=1e-9, atol=1e-16)
    mixed = cone.index_field(905e-9, composition={"Ar": 1.0}, spacing=1e-3)
    assert mixed.ambient_index == 1.0 + flow.species_constant("Ar", 905e-9) * 1.225


@pytest.mark.parametrize("relation", flow.MODELS)
def test_models_travel_to_a_worker(relation):
    model = flow.refractivity_model(relation)
    assert pickle.loads(pickle.dumps(model)).constant(1.5e-6) == model.constant(1.5e-6)
    mixture = flow.refractivity_model(composition={"N2": 1.0})
    assert pickle.loads(pickle.dumps(mixture)).constant(905e-9) == mixture.constant(905e-9)


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        ({"relation": "edlen"}, "choose one of paper, ciddor, gladstone-dale, lorentz-lorenz, mathar, auto"),
        ({"relation": "paper", "constant": 2e-4}, "has its own constant"),
        ({"relation": "ciddor", "constant": 2e-4}, "has its own constant"),
        ({"relation": "paper", "composition": {"N2": 1.0}}, "'paper' is for air"),
        ({"relation": "ciddor", "composition": {"He": 1.0}}, "only the mole fractions of 'H2O' and 'CO2'"),
        (
            {"relation": "ciddor", "composition": flow.Composition({"N2": 1.0})},
            "only the mole fractions of 'H2O' and 'CO2'",
        ),
        ({"relation": "ciddor", "composition": {"CO2": 450}}, "carbon dioxide must be between"),
        ({"constant": 2e-4, "composition": {"N2": 1.0}}, "either a constant or a composition"),
        ({"constant": -2e-4}, "must be positive and finite"),
        ({"composition": {"N2": 0.5}}, "add up to 0.5"),
    ],
)
def test_what_does_not_go_together_is_refused(arguments, fault):
    with pytest.raises(ValueError, match=fault):
        flow.refractivity_model(**arguments)


def test_wavelengths_out_of_a_models_range_are_refused(field):
    with pytest.raises(ValueError, match="Ciddor's"):
        field.index_field(2e-6, "ciddor")
    with pytest.raises(ValueError, match="refractivity of N2 is known"):
        field.index_field(10.6e-6, composition={"N2": 1.0})
