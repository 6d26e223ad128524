"""Series of a mixture: fractions of species beside the density, snapshot by snapshot."""

import numpy as np
import pytest
import xarray

from aerokernels import flow
from aerokernels.scene import Scene

WAVELENGTH = 905e-9
SPECIES = {"N2": "Y_N2", "He": "helium"}


def test_arrays_and_data_with_a_time_axis_have_no_species():
    coords = {"time": [0.0], "y": np.arange(5.0), "z": np.arange(5.0)}
    data = xarray.DataArray(np.ones((1, 5, 5)), coords, ("time", "y", "z"))
    with pytest.raises(ValueError, match="each with its composition"):
        flow.open_series(data, ambient_density=0.8, species=SPECIES)
    where = {"geometry": "planar", "origin": (0.0, 0.0), "spacing": (1e-3, 1e-3), "ambient_density": 1.0}
    with pytest.raises(ValueError, match="each with its composition"):
        flow.open_series([np.ones((5, 5))], time=[0.0], species=SPECIES, **where)


def test_a_scene_of_a_series_takes_its_species(tmp_path):
    """[flow] species and [flow.file] go to the snapshots; without a file of its own or a series they are refused."""
    from aerokernels.jobs.series_job import scene_series

    y, x = np.meshgrid(np.linspace(-0.02, 0.02, 5), np.linspace(0.0, 0.06, 7), indexing="ij")
    for number in range(2):
        own = {"N2": 0.9 - 0.1 * number + 0.0 * x, "helium": 0.1 + 0.1 * number + 0.0 * x}
        np.savez(tmp_path / f"flow_{number}.npz", x=1e3 * x, y=1e3 * y, rho=0.8 + x, **own)
    text = '[flow]\nspecies = {N2 = "N2", He = "helium"}\nfile = {length_unit = "mm"}\n'
    (tmp_path / "scene.toml").write_text(text + '[series]\nsource = "flow_*.npz"\ntime_step = "1 ms"\n')
    scene = Scene.load(tmp_path / "scene.toml")
    assert scene.flow.relation == "gladstone-dale"
    series = scene_series(scene)
    found = [one.composition.constant(WAVELENGTH, ambient=True) for one in series]
    parts = [flow.species_constant(name, WAVELENGTH) for name in SPECIES]
    assert found == pytest.approx([0.9 * parts[0] + 0.1 * parts[1], 0.8 * parts[0] + 0.2 * parts[1]], rel=1e-12)
    assert np.ptp(series.mesh.box, axis=0) == pytest.approx([0.04, 0.06])
    with pytest.raises(ValueError, match="'static' is air"):
        Scene.model_validate({"flow": {"source": "static", "species": True}})
