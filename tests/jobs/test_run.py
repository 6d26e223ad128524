"""One run in the library: stages, the views it draws, and what it keeps of the scene."""

from dataclasses import replace

import numpy as np
import pytest

from aerokernels.display.quantities import combine
from aerokernels.jobs.run import STAGES, ray_fan, scene_wavefront, simulate
from aerokernels.jobs.run_files import RunResult, scene_toml
from aerokernels.prepare import prepare_field
from aerokernels.rays import RayBundle
from aerokernels.scene import Scene, shipped_scenes
from aerokernels.tracing import Plane, trace
from aerokernels.wavefronts.terms import NUMBERS

SMALL = {"strehl.ray_count": 4096, "beam.ray_count": 64, "receiver.ray_count": 64}


@pytest.fixture(scope="module")
def still() -> RunResult:
    return simulate(Scene.load("wind-tunnel-static", SMALL))


def test_still_air_disturbs_nothing(still: RunResult):
    """Expected: Strehl ratio 1, a flat wavefront, straight rays, a range within 1 mm (the air alone makes 0.4 mm)."""
    assert still.strehl.value == pytest.approx(1.0, abs=1e-6)
    assert np.nanmax(np.abs(still.wavefront.opd)) < 1e-15
    assert np.nanmax(np.abs(still.fan.deviation)) < 1e-12
    assert abs(still.echo.range_error) < 1e-3
    dataset = still.to_xarray()
    np.testing.assert_allclose(dataset.point_spread, dataset.point_spread_perfect, atol=1e-12)


def test_an_error_beyond_the_bounds_of_a_ratio_is_limited_and_told_in_words(still: RunResult):
    """A ratio of 2e-9 whose budget has an error of 43,000: repr and summary limit it to 1 and say what it means."""
    large = dict.fromkeys(NUMBERS, combine({"step": 43000.0}))
    strehl = replace(still.strehl, value=2e-9, budgets=lambda: large)
    assert repr(strehl).startswith("StrehlEstimate 2e-09, not meaningful: its error allows any ratio from 0 to 1")
    summary = replace(still, strehl=strehl).summary
    assert summary["strehl"] == 2e-9 and summary["errors"]["strehl"] == pytest.approx(1.0)
    assert 0.0 < summary["error"]["total"] <= 1.0 and summary["error"]["step"] <= 1.0
    assert summary["verdict"] == "worthless" and "any ratio from 0 to 1" in summary["warnings"][0]


def test_progress_names_every_stage_once_and_never_goes_back():
    heard: list[tuple[str, float]] = []
    simulate(Scene.load("wind-tunnel-static", SMALL), progress=lambda stage, fraction: heard.append((stage, fraction)))
    assert heard == list(STAGES.values())
    assert [fraction for _, fraction in heard] == sorted(fraction for _, fraction in heard)


def test_every_variable_of_the_dataset_has_a_unit_and_a_meaning(still: RunResult):
    dataset = still.to_xarray()
    for name, variable in dataset.variables.items():
        assert "units" in variable.attrs, name
    assert dataset.sizes["pupil_x"] == dataset.sizes["pupil_y"] == still.wavefront.coordinate.size


@pytest.mark.parametrize("name", shipped_scenes())
def test_a_scene_as_it_was_run_loads_to_the_same_scene(name: str, tmp_path):
    scene = Scene.load(name, {"title": 'Überschall "test" \\ 100 %', "target.tilt": "5 deg"})
    (tmp_path / "again.toml").write_text(scene_toml(scene), encoding="utf-8")
    assert Scene.load(tmp_path / "again.toml") == scene


def test_the_spot_peaks_at_the_strehl_ratio_of_the_map():
    """Formula: the point spread function on the axis is |<exp(i k OPD)>|^2, over the same pixels but for rounding."""
    result = simulate(Scene.load("sea-level-mach3", SMALL), with_echo=False)
    dataset = result.to_xarray()
    middle = dataset.point_spread.sel(angle_x=0.0, angle_y=0.0)
    assert 0.5 < float(middle) < 0.9
    assert float(middle) == pytest.approx(result.wavefront.strehl(), rel=1e-9)
    assert float(dataset.point_spread_perfect.max()) == pytest.approx(1.0, rel=1e-9)


def test_the_fan_is_symmetric_and_bends_as_the_optical_path_changes():
    """Set-up: parallel rays from behind the dome through an axisymmetric flow, mirror-symmetric pairs.

    Expected: mirrored displacements; by Fermat's principle the slope of each ray beyond the flow is that of the optical
    path there, to a fifth of the greatest: the dome is of chords, whose refraction ripples about it.
    Error: float32 positions in deviation form, 1e-3 of the greatest displacement.
    """
    scene = Scene.load("sea-level-mach3")
    prepared = prepare_field(scene)
    fan = ray_fan(prepared.field, scene, prepared.front)
    greatest = np.abs(fan.deviation).max()
    assert greatest > 1e-7
    np.testing.assert_allclose(fan.deviation, -fan.deviation[::-1], atol=1e-3 * greatest)
    y, (near, far) = np.linspace(-6e-3, 6e-3, 401), fan.position[:, [-2, -1]].transpose(1, 0, 2)
    rays = RayBundle(np.c_[0.0 * y, y, np.full(y.size, fan.position[0, 0, 2])], np.tile([0.0, 0.0, 1.0], (y.size, 1)))
    end = trace(prepared.field, rays, until=Plane(far[far.shape[0] // 2], (0, 0, 1)), precision="float64")
    slope = np.interp(near[:, 1], end.position[:, 1], np.gradient(end.opd, end.position[:, 1]))
    turned = (far[:, 1] - near[:, 1]) / (far[:, 2] - near[:, 2])
    assert 6e-5 < np.abs(slope).max() and np.abs(turned - slope).max() < 0.2 * np.abs(slope).max()
    assert np.all(np.diff(fan.position[..., 2], axis=1) > 0.0)


@pytest.mark.parametrize("removed", ["piston", "piston, tilt, focus"])
def test_each_map_in_the_report_has_its_own_error(removed: str):
    """Each map has an error of its rms.

    The truth is the same map traced through the cells of the flow, which the grid of the scene was resampled from.
    """
    remove = removed.split(", ")
    scene = Scene.load("wind-tunnel-mach3", {"grid.spacing": 2e-4, "strehl.ray_count": 512, "strehl.remove": remove})
    result = simulate(scene, with_echo=False)
    dataset = result.to_xarray()
    whole = scene_wavefront(scene, result.prepared.mesh_field)
    wave = result.wavefront
    assert np.array_equal(dataset.opd_error, wave.pixel_errors, equal_nan=True)
    table = wave.zernike_table(dataset.sizes["noll_index"])
    assert [(one.value, one.error) for one in table] == list(
        zip(dataset.zernike.values, dataset.zernike_error.values, strict=True)
    )
    assert dataset.opd.attrs["peak_to_valley_error_m"] == wave.quantities["peak_to_valley"].error
    assert dataset.attrs["ray_optics"].startswith("rays are good: ")
    assert abs(dataset.attrs["ray_optics_strehl_change"]) < 0.01
    for name, terms in (("opd", ()), ("opd_without_focus", ("tilt", "focus"))):
        rms, error = (dataset[name].attrs[key] for key in ("rms_m", "rms_error_m"))
        assert abs(rms - whole.remove(*terms).rms) <= error, name
