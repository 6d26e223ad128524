"""Group paths of traced rays: the integral of the group index along them, which a pulse travels."""

import pickle

import numpy as np
import pytest
from scipy.integrate import quad

from aerokernels import IndexField, Plane, RayBundle, flow, trace
from aerokernels.flow import GridDensity

WAVE = 532e-9
STOP = Plane((0.0, 0.0, 2.0), (0.0, 0.0, 1.0))


def bell(z) -> np.ndarray:
    """A layer of denser air across z [kg/m3], with values and slopes of zero at the faces of its box."""
    return 2.0 * np.where(np.abs(z) < 0.05, np.cos(np.pi * z / 0.1) ** 4, 0.0)


def layer(composition=None) -> GridDensity:
    """The layer in air of 1.225 kg/m3, planar, the same along y."""
    z = np.linspace(-0.05, 0.05, 161)
    density = np.broadcast_to(1.225 + bell(z), (5, z.size))
    given = (-0.05, -0.05), (0.025, z[1] - z[0]), "planar", 1.225
    return GridDensity(np.array(density), *given, composition=composition)


def rays() -> RayBundle:
    return RayBundle([[0.0, 0.0, -0.2], [0.0, 0.01, -0.1]], [[0.0, 0.0, 1.0], [0.0, 0.02, 1.0]])


def slanted(ambient: float, sine: np.ndarray, n) -> np.ndarray:
    """Group paths through a layer that keeps n sin(angle): integral of n_g n / sqrt(n^2 - (n0 sin)^2) dz."""
    return np.array([quad(lambda z, s=s: n(z)[1] * n(z)[0] / np.sqrt(n(z)[0] ** 2 - s**2), -0.05, 0.05,
                          epsabs=1e-15, epsrel=1e-13)[0] for s in ambient * sine])  # fmt: skip


@pytest.mark.parametrize("backend", ["warp", "opencl", "reference"])
@pytest.mark.parametrize("relation", ["ciddor", "paper", "lorentz-lorenz"])
def test_a_layer_keeps_snells_invariant(backend, relation):
    """Set-up: rays straight and at 20 mrad through a layer of 3.2 kg/m3 at most, 1.2 and 2 m of air before and behind.

    Expected: n sin(angle) is kept, so the group path is the integral of n_g n / sqrt(n^2 - (n0 sin)^2) dz. Errors: the
    spline of 161 nodes, (pi h / 0.1)^4 / 700 of 4e-5 m = 3e-11 m at most; the tolerance, 1e-4 waves or 5e-11 m; float64
    over 2 m, 1e-15. 2e-10 m; the phase path is 2e-5 m off.
    """
    if backend == "opencl":
        pytest.importorskip("pyopencl")
    model = flow.refractivity_model(relation)
    field = layer().index_field(WAVE, relation)
    given = rays()
    found = trace(field, given, until=STOP, tolerance=1e-4, backend=backend, precision="float64", outputs="group_path")

    def indices(z):
        return tuple(1.0 + float(model.refractivity(1.225 + bell(z), WAVE, group=one)) for one in (False, True))

    n0, group = indices(1.0)
    sine, cosine = given.direction[:, 1], given.direction[:, 2]
    length = (2.0 - given.position[:, 2] - 0.1) / cosine
    expected = slanted(n0, sine, indices) + group * length
    assert found.group_path == pytest.approx(expected, rel=0.0, abs=2e-10)
    assert np.abs(found.optical_path - expected).min() > 1e-5
    again = pickle.loads(pickle.dumps(found))
    assert np.array_equal(again.group_path, found.group_path)
    assert found.to_xarray()["group_path"].attrs["units"] == "m"


def test_two_gases_have_no_common_ratio():
    """A layer of helium and air in air: each gas has its own dispersion, so the group index is traced itself.

    Expected: straight along z, the integral of n_g by quadrature; errors as above, 2e-10 m. By the ratio of the ambient
    air's constants the path would be 8e-8 m off.
    """
    z = np.linspace(-0.05, 0.05, 161)
    share = np.broadcast_to(0.25 * bell(z), (5, z.size))
    helium = flow.Composition({"He": share, "N2": 1.0 - share}, "mass", ambient={"N2": 1.0})
    field = layer(helium).index_field(WAVE, "gladstone-dale")
    given = rays()[:1]

    def excess(z, group):
        own = 0.25 * bell(z)
        constant = [flow.species_constant(name, WAVE, group=group) for name in ("He", "N2")]
        return (1.225 + bell(z)) * (own * constant[0] + (1.0 - own) * constant[1])

    expected = 2.2 + sum(quad(excess, *part, (True,), epsabs=1e-15)[0] for part in ((-0.2, -0.05), (-0.05, 0.05)))
    expected += 1.95 * float(excess(1.0, True))
    for one in (field, field.resample(1.25e-3, interpolation="cubic")):
        found = trace(one, given, until=STOP, tolerance=1e-4, precision="float64", backend="reference")
        assert found.group_path[0] == pytest.approx(expected, rel=0.0, abs=1e-9)
    ratio = field.upstream.group.ratio
    by_ratio = field.upstream.group.ambient_index * 2.2 + ratio * (found.optical_path - field.ambient_index * 2.2)
    assert abs(by_ratio[0] - expected) > 2e-8


def test_raw_contrast_has_no_dispersion():
    """Without a model the group index is taken to be the index: the group path is the optical path."""
    raw = IndexField.from_samples(
        np.full((5, 5, 5), 1e-4), origin=(-0.1,) * 3, spacing=(0.05,) * 3, geometry="volume", ambient_index=1.25
    )
    found = trace(raw, rays(), until=STOP, backend="reference")
    assert np.array_equal(found.group_path, found.optical_path)
    assert trace(raw, rays(), until=STOP, backend="reference", outputs="opd").group_path is None
    with pytest.raises(ValueError, match="group_path"):
        trace(raw, rays(), until=STOP, outputs="groups")
