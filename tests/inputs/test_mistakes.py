"""Mistakes of newcomers: each is answered by one sentence that says what to write, before anything is traced."""

import re

import numpy as np
import pytest

import aerokernels as ak

FIELD = ak.IndexField.from_samples(np.zeros((8,) * 3), origin=(-4e-3,) * 3, spacing=(1e-3,) * 3, geometry="volume")
PUPIL = ak.Disc(2e-3)
NAMES = {name: getattr(ak, name) for name in ak.__all__} | {
    "ak": ak,
    "np": np,
    "AIR": ak.flow.shipped("mach3"),
    "FIELD": FIELD,
    "PUPIL": PUPIL,
    "RAYS": ak.RayBundle.collimated(PUPIL, 10),
    "SCENE": "wind-tunnel-mach3",
    "WHERE": {"origin": (0, 0, 0), "spacing": (1e-3,) * 3, "geometry": "volume"},
}
# What is typed, and what its answer says.
MISTAKES = r"""
estimate_strehl("mach3", PUPIL) -> flow\.shipped\('mach3'\)
estimate_strehl(np.zeros((8, 8, 8)), PUPIL) -> IndexField\.from_samples
estimate_strehl(AIR, PUPIL) -> call \.index_field\(wavelength\) of it
estimate_strehl(Scene.load(SCENE), PUPIL) -> call \.density_field\(\)\.index_field\(wavelength\)
estimate_strehl(PUPIL, FIELD) -> the field comes first
estimate_strehl(FIELD) -> needs pupil, such as pupil=Disc\(radius=6e-3\)
estimate_strehl(FIELD, 6e-3) -> write Disc\(radius=0\.006\)
estimate_strehl(FIELD, np.ones((8, 8))) -> Mask\(weights, pixel\)
estimate_strehl(FIELD, RAYS) -> the number of rays as ray_count
estimate_strehl(FIELD, PUPIL, 905e-9) -> give all others by name
estimate_strehl(FIELD, PUPIL, wl=905e-9) -> did you mean wavelength
estimate_strehl(FIELD, PUPIL, wavelength=905) -> 9\.05e-07 for 905 nm
estimate_strehl(FIELD, PUPIL, wavelength="905 nm") -> give 9\.05e-07
estimate_strehl(FIELD, PUPIL, wavelength=np.nan) -> give metres, 905e-9 for 905 nm
estimate_strehl(FIELD, PUPIL, n_rays=1000) -> did you mean ray_count
estimate_strehl(FIELD, PUPIL, ray_count=1e12) -> from 16 to 2147483647
estimate_strehl(FIELD, PUPIL, tolerance=np.nan) -> must be positive and finite \[waves\]
estimate_strehl(FIELD, PUPIL, dtype="float64") -> did you mean precision
estimate_strehl(FIELD, PUPIL, precision="double") -> choose 'float32' or 'float64'
estimate_strehl(FIELD, PUPIL, direction=(0, 0)) -> three finite numbers
estimate_strehl(FIELD, PUPIL, remove="tilt,piston") -> write \('tilt', 'piston'\)
trace(FIELD) -> needs rays, such as rays=RayBundle\.collimated
trace(FIELD, PUPIL) -> RayBundle\.collimated\(pupil, 10_000\)
trace(FIELD, 10_000) -> RayBundle\.collimated\(pupil, 10000\)
trace(RAYS, FIELD) -> the field comes first
trace(FIELD, [[0, 0, 0]]) -> RayBundle\(position, direction\)
trace(FIELD, RAYS, until=5e-3) -> Plane\(\(0, 0, 0\.005\), \(0, 0, 1\)\) or ArcLength\(0\.005\)
trace(FIELD, RAYS, until=(0, 0, 1e-2)) -> Plane\(point, normal\)
trace(FIELD, RAYS, method="fixed") -> needs step, a positive length
trace(FIELD, RAYS, method="fixed", step="1 mm") -> give 0\.001
RayBundle.collimated(10_000, PUPIL) -> the pupil comes first
RayBundle(np.zeros((5, 3))) -> needs direction, such as direction=\(0, 0, 1\)
RayBundle(np.zeros((5, 2)), np.ones((5, 2))) -> must have shape \(ray_count, 3\)
RayBundle(np.full((5, 3), np.nan), np.ones((5, 3))) -> not finite, the first is ray 0
Disc() -> needs radius, such as radius=6e-3
Disc("6 mm") -> give 0\.006
Disc(diameter=12e-3) -> give radius, half of it
Annulus(3e-3, 6e-3) -> below its radius of 0\.003 m
Rectangle(6e-3) -> needs height
Plane((0, 0, 1e-2)) -> needs normal, such as normal=\(0, 0, 1\)
ArcLength("1 cm") -> give 0\.01
flow.shipped() -> needs name \("mach2"
flow.shipped("Mach3") -> choose one of mach2, mach3
flow.wedge(3, 15) -> np\.radians\(15\)
flow.cone(15, 3) -> the Mach number comes first
flow.tunnel_conditions(3) -> needs stagnation_pressure .* and stagnation_temperature
flow.tunnel_conditions(3, 0.63, 300) -> 630e3 for 0\.63 MPa
AIR.scaled("1.225 kg/m3") -> give 1\.225
AIR.index_field(905e-9, relation="edlen") -> choose one of paper, ciddor
FIELD.resample("50 um") -> give 5e-05
FIELD.resample(1e-12) -> give a greater spacing or a smaller region
IndexField.from_samples("map.npy", **WHERE) -> np\.load\('map\.npy'\)
IndexField.from_samples(np.zeros((8,) * 3), origin=(0, 0, 0), dx=1e-3, geometry="volume") -> did you mean spacing
wavefront(FIELD, PUPIL, resolution=64) -> did you mean pixel_count
wavefront(FIELD, PUPIL, pixel_count=1e9) -> pixels along one side, .* at most: take a smaller one
strehl(np.zeros(5)) -> needs wavelength, such as wavelength=905e-9
strehl(905e-9, np.zeros(5)) -> wavelength must be a number of metres
strehl(np.full(5, np.nan), 905e-9) -> must be finite
strehl_marechal(np.zeros(5), 905) -> 9\.05e-07 for 905 nm
look_map(AIR, [0], [0]) -> needs pupil, such as
look_map(AIR, "0 deg", [0], PUPIL) -> got '0 deg': give 0
look_map(AIR, [10], [0], PUPIL) -> np\.radians converts degrees
schlieren(AIR) -> call \.index_field\(wavelength\) of it
shadowgraph(FIELD, 1.0) -> give all others by name
shadowgraph(FIELD) -> needs distance
interferogram(FIELD, fringe_spacing="2 mm") -> give 0\.002
simulate(AIR) -> give a scene, .* and this as field=
simulate(SCENE, rays=1e5) -> Scene\.load\(name, \{'strehl\.ray_count'
simulate("mach3") -> the name of a flow, not of a scene
echo(SCENE) -> Scene\.load\('wind-tunnel-mach3'\) makes one
optical_series("snap_*.vtu", PUPIL) -> flow\.open_series\('snap_\*\.vtu'\)
sweep(SCENE) -> needs vary
sweep(SCENE, {"target.tilt": "10 deg"}) -> write \['10 deg'\]
sweep(SCENE, {"target.tilt": [np.radians(400)]}, out="none") -> \(400 deg\) must be below .* \(89\.99 deg\)
Scene.load(SCENE, {"target.tilt": "400 deg"}) -> must be below 89\.99 deg
Scene.load(SCENE, {"target.distance": "12 in"}) -> write '0\.3048 m'
Scene.load(SCENE, {"tilt": "10 deg"}) -> did you mean target\.tilt
estimate_range(np.arange(9.0), np.ones(9), "centroid") -> give seconds, 1e-9 for 1 ns
ak.Wavefont -> did you mean Wavefront
"""


@pytest.mark.parametrize("line", MISTAKES.strip("\n").splitlines())
def test_each_mistake_gets_one_sentence_with_the_remedy(line, monkeypatch, tmp_path):
    """Expected: a TypeError, ValueError or AttributeError of one line, with what to write; no kernel starts."""
    monkeypatch.chdir(tmp_path)
    typed, _, answer = line.partition(" -> ")
    with pytest.raises((TypeError, ValueError, AttributeError)) as caught:
        eval(typed, dict(NAMES))
    said = str(caught.value)
    assert re.search(answer, said) and "\n" not in said and len(said) < 400, said
    assert "GiB" not in said and "positional argument:" not in said, said
