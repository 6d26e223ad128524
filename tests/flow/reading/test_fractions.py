"""Species from files: the index is that of the mixture, place by place; fractions that are none are refused."""

import numpy as np
import pytest
import writers

from aerokernels import flow
from aerokernels.flow.reading.dataset import TRIANGLE, Block, Cells

WAVELENGTH = 905e-9
NAMES = {"N2": "Y_N2", "O2": "O2", "H2O": "steam"}
STATED = {"species": NAMES, "density": "rho"}


def shares(x, y):
    """Mass fractions that vary in both directions, of sum 1."""
    oxygen, water = 0.2 + 2.0 * x, 0.05 + 1.5 * y
    return {"N2": 1.0 - oxygen - water, "O2": oxygen, "H2O": water}


def mixture(density, fractions):
    """Refractivity n - 1 = rho sum Y K, K of each species."""
    return density * sum(own * flow.species_constant(name, WAVELENGTH) for name, own in fractions.items())


@pytest.fixture
def path(tmp_path):
    x, y = writers.grid()
    arrays = {NAMES[name]: own for name, own in shares(x, y).items()}
    np.savez(tmp_path / "a.npz", x=x, y=y, rho=writers.rho(x, y), **arrays)
    return tmp_path / "a.npz"


def moles(fractions):
    amount = {name: own / flow.species.molar_mass(name) for name, own in fractions.items()}
    return {name: own / sum(amount.values()) for name, own in amount.items()}


def test_the_index_of_a_plane_is_the_mixture_s(path):
    """Expected: n_ambient + contrast - 1 = rho sum Y K at every vertex, to rounding (1e-12 of it)."""
    field = flow.read(path, **STATED)
    index = field.index_field(WAVELENGTH)
    y, x = field.mesh.vertices[:, 0], -field.mesh.vertices[:, 1]  # the flow along x runs against z
    model = flow.refractivity_model("gladstone-dale", composition=field.composition)
    found = model.contrast(field.density, field.ambient_density, WAVELENGTH) + index.ambient_index - 1.0
    assert np.abs(found / mixture(field.density, shares(x, y)) - 1.0).max() < 1e-12
    assert "mixture by mass fractions of N2 from 'Y_N2', O2, H2O from 'steam'" in field.provenance
    assert field.scaled(0.5).composition is field.composition
    air = flow.read(path, density="rho")
    assert air.composition is None and air.index_field(WAVELENGTH).ambient_index != index.ambient_index
    with pytest.raises(ValueError, match="relation 'ciddor' is for air, and the flow is a mixture of N2, O2, H2O"):
        field.index_field(WAVELENGTH, "ciddor")


def test_names_formulas_and_moles(tmp_path):
    """The same mixture under its usual names, by mole fractions, and rounded to 1e-4: the same constants."""
    x, y = writers.grid()
    own = shares(x, y)
    arrays = {f"MassFraction{name}": share for name, share in own.items()}
    arrays |= {f"mole {name}": share for name, share in moles(own).items()}
    np.savez(tmp_path / "a.npz", x=x, y=y, rho=writers.rho(x, y), **arrays)
    by_mole = {name: f"mole {name}" for name in own} | {"basis": "mole"}
    constants = [
        flow.read(tmp_path / "a.npz", species=given).composition.constant(WAVELENGTH)
        for given in (True, ["O2", "H2O", "N2"], by_mole)
    ]
    assert constants[1] == pytest.approx(constants[0], rel=1e-14) and constants[2] == pytest.approx(
        constants[0], rel=1e-13
    )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"N2": "Y_N2", "O2": "O2"}, "Y_N2, O2 do not add up to a whole in 651 of 651 points.*the sum 0.9"),
        ({"N2": "Y_N2", "air": "O2"}, "species 'air' is not known: choose one of N2, O2"),
        ({"N2": "nitrogen"}, "no array 'nitrogen'.*take one of rho, Y_N2, O2, steam"),
        (["N2", "He"], "no array is known for the mass fraction of He"),
        ({"N2": "Y_N2", "basis": "volume"}, "'mass' or 'mole', got 'volume'"),
        (True, "sum 0.9"),
    ],
)
def test_what_is_no_mixture_is_refused(path, given, message):
    with pytest.raises(ValueError, match=message):
        flow.read(path, species=given)


def test_a_scene_of_a_mixture(path):
    """[flow] species: the relation is then gladstone-dale's; with ciddor's, which is air's, it is refused."""
    from aerokernels.scene import Scene, SceneError

    text = '[flow]\nsource = "a.npz"\nspecies = {N2 = "Y_N2", O2 = "O2", H2O = "steam"}\n'
    (path.parent / "scene.toml").write_text(text)
    scene = Scene.load(path.parent / "scene.toml")
    assert scene.flow.relation == "gladstone-dale"
    assert tuple(scene.density_field().composition.fractions) == ("N2", "O2", "H2O")
    with pytest.raises(SceneError, match="'ciddor' is air's"):
        Scene.load(path.parent / "scene.toml", {"flow.relation": "ciddor"})


@pytest.mark.parametrize("where", ["point", "cell"])
def test_triangles_keep_the_mixture_of_their_cells(where):
    """Triangles are cut into quadrilaterals. Expected: K of each is its cell's, or linear between points, to 1e-12."""
    axis = np.linspace(0.0, 0.08, 5)
    y, x = (own.ravel() for own in np.meshgrid(axis, axis, indexing="ij"))
    index = np.arange(25).reshape(5, 5)
    a, b, c, d = (own.ravel() for own in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    corners = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    points = np.stack([x, y, 0.0 * x], axis=1)
    at = points if where == "point" else points[corners].mean(axis=1)
    own = {NAMES[name]: share for name, share in shares(at[:, 0], at[:, 1]).items()} | {"rho": np.full(len(at), 0.8)}
    block = Block(points, Cells.of_one_type(TRIANGLE, corners), **{f"{where}_data": own})
    field = writers.field([block], density="rho", species=NAMES)
    found = field.composition.constant(WAVELENGTH)
    if where == "point":
        vertex = field.mesh.vertices
        expected = mixture(1.0, shares(-vertex[:, 1], vertex[:, 0]))
    else:
        expected = np.repeat(mixture(1.0, shares(at[:, 0], at[:, 1])), 3)
        assert np.allclose(field.mesh.corners.mean(axis=1).reshape(-1, 3, 2).mean(axis=1)[:, 0], at[:, 1], atol=0.01)
    assert np.abs(found / expected - 1.0).max() < 1e-12
