"""Series of a mixture: fractions of species beside the density, snapshot by snapshot."""

import numpy as np
import pytest
import xarray

from aerokernels import flow
from aerokernels.scene import Scene

WAVELENGTH = 905e-9
SPECIES = {"N2": "Y_N2", "He": "helium"}


def dataset():
    """Density that is even, and helium that grows with y and in time."""
    y, z, time = np.linspace(-0.02, 0.02, 5), np.linspace(-0.03, 0.03, 7), np.array([0.0, 1e-3])
    helium = 0.1 + 2.0 * y[None, :, None] + 100.0 * time[:, None, None] + 0.0 * z
    axes = ("time", "y", "z")
    return xarray.Dataset(
        {"rho": (axes, np.full(helium.shape, 0.8)), "Y_N2": (axes, 1.0 - helium), "helium": (axes, helium)},
        coords={"time": time, "y": y, "z": z},
    )


def test_each_snapshot_is_its_own_mixture():
    """Formula: K = sum Y K of the species, node by node. Tolerance 1e-12."""
    data = dataset()
    series = flow.open_series(data, ambient_density=0.8, species=SPECIES)
    assert "mixture by mass fractions of N2 from 'Y_N2', He from 'helium'" in series.provenance
    parts = {name: flow.species_constant(name, WAVELENGTH) for name in SPECIES}
    for number in range(2):
        helium = data["helium"].values[number]
        found = series[number].composition
        assert (
            np.abs(found.constant(WAVELENGTH) / ((1.0 - helium) * parts["N2"] + helium * parts["He"]) - 1.0).max()
            < 1e-12
        )
        around = helium[:, -1].mean()
        assert found.constant(WAVELENGTH, ambient=True) == pytest.approx(
            (1 - around) * parts["N2"] + around * parts["He"]
        )
    assert series[1].index_field(WAVELENGTH).ambient_index != series[0].index_field(WAVELENGTH).ambient_index


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data.assign(helium=data["helium"] + 0.1), "do not add up to a whole in 35 of 35 nodes"),
        (lambda data: data.assign(helium=data["helium"].isel(z=0)), "helium has axes time, y, the density time, y, z"),
        (lambda data: data["rho"], "a single array has no species"),
    ],
)
def test_what_is_no_mixture_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        flow.open_series(change(dataset()), ambient_density=0.8, species=SPECIES)[0]


def test_bare_arrays_have_no_species():
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
