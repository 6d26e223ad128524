"""The main job in Python: any way to name a scene, and a flow of one's own in place of the scene's."""

import numpy as np
import pytest

import aerokernels as ak
from aerokernels import flow

CHANGES = {
    "strehl.ray_count": 160,
    "beam.ray_count": 25,
    "receiver.ray_count": 64,
    "grid.spacing": "0.4 mm",
}


def scene(name: str = "wind-tunnel-mach3", **changes) -> ak.Scene:
    return ak.Scene.load(name, {**CHANGES, **changes})


@pytest.fixture(scope="module")
def expected() -> ak.RunResult:
    return ak.simulate(scene())


def numbers(result: ak.RunResult) -> dict:
    """What a run found, without the times that it took."""
    kept = ("strehl", "opd_rms_m", "echo_peak_v", "range_m", "mach", "ambient_density_kg_m3", "errors", "failures")
    return {name: result.summary[name] for name in kept}


def test_a_density_field_takes_the_place_of_the_scenes(expected: ak.RunResult):
    """The Mach 3 flow given to a scene of Mach 2 is the scene of Mach 3; wavelength and relation are the scene's."""
    found = ak.simulate(scene("wind-tunnel-mach2"), field=flow.shipped("mach3"))
    assert numbers(found) == numbers(expected)
    assert found.summary["provenance"] == expected.summary["provenance"]
    # As it is: the scene's flow.density scales the scene's own flow only.
    dense = ak.simulate(scene(**{"flow.density": "sea-level"}), field=flow.shipped("mach3"))
    assert dense.strehl.value == expected.strehl.value


def test_a_flow_without_a_mesh_is_run_too():
    """A cone whose shock the pupil looks through: its index is made on the scene's grid at once, its picture drawn.

    The ratio is that of the same index field traced alone, to the last bit.
    """
    cone = flow.cone(3.0, 0.35, density=0.3, length=0.05)
    found = ak.simulate(scene(**{"grid.spacing": "0.5 mm"}), field=cone)
    assert found.prepared.field.is_uniform and found.prepared.field.spacing == pytest.approx([5e-4, 5e-4])
    alone = ak.estimate_strehl(found.prepared.field, ak.Disc(6e-3, (0.0, 0.0, -8e-3)), ray_count=160)
    assert found.strehl.value == alone.value < 0.999
    assert found.summary["mach"] == 3.0 and found.summary["ambient_density_kg_m3"] == 0.3
    density = found.to_xarray()["density"].values
    assert np.isfinite(density).all() and density.max() > 1.5 * density.min() == pytest.approx(0.45)
    with pytest.raises(ValueError, match=r"grid\.route"):
        ak.simulate(scene(**{"grid.route": "mesh"}), field=cone)


def test_what_is_no_field_or_another_wavelength_is_refused(expected: ak.RunResult):
    with pytest.raises(TypeError, match="field must be an IndexField or a DensityField, got ndarray"):
        ak.simulate(scene(), field=np.zeros((3, 3)))
    with pytest.raises(ValueError, match="wavelength"):
        ak.simulate(scene(**{"flow.wavelength": "532 nm"}), field=expected.prepared.field)
