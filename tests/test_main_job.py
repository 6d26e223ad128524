"""The main job on the shipped flows: what the paper's readers would check first."""

import numpy as np
import pytest

from aerokernels import Disc, estimate_strehl, flow
from aerokernels.echo.simulate import echo
from aerokernels.jobs.run import scene_strehl
from aerokernels.prepare import prepare_field
from aerokernels.scene import Scene

FEW = {"strehl.ray_count": "65536"}


def test_static_scene_is_undisturbed():
    """No flow: Strehl ratio 1 within 1e-6, and 1.5 m read within 1 mm (air delays by 0.4 mm)."""
    scene = Scene.load("wind-tunnel-static", FEW)
    prepared = prepare_field(scene)
    estimate = scene_strehl(scene, prepared.field)
    assert abs(estimate.value - 1.0) < 1e-6
    result = echo(scene, field=prepared.field)
    assert abs(result.range - 1.5) < 1e-3
    assert result.peak_voltage == pytest.approx(1.994, abs=2e-3)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("wind-tunnel-mach2", 0.974),
        ("wind-tunnel-mach3", 0.977),
        ("wind-tunnel-mach4", 0.988),
        ("sea-level-mach2", 0.864),
        ("sea-level-mach3", 0.724),
        ("sea-level-mach4", 0.652),
    ],
)
def test_strehl_ratios_of_the_shipped_scenes(name, expected):
    """Plane wave looking forward from the dome over 12 mm: figures computed independently with straight rays.

    Those took cell averages as point values; treating them as averages moves the phase by about 1 %, which is 0.02
    where the Strehl ratio is 0.65 (2 x 0.01 x phase variance x Strehl ratio).
    """
    scene = Scene.load(name, FEW)
    estimate = scene_strehl(scene, prepare_field(scene).field)
    assert estimate.value == pytest.approx(expected, abs=0.015)
    assert np.hypot(*estimate.boresight) < 1e-7


@pytest.mark.parametrize("density", [None, 1.225])
def test_refining_the_grid_moves_the_answer_within_its_budget(density):
    """Halving the spacing lowers the reported resampling error; the Strehl ratio moves by less than it said."""
    density_field = flow.shipped("mach3")
    if density is not None:
        density_field = density_field.scaled(density)
    source = density_field.index_field()
    pupil = Disc(6e-3, (0.0, 0.0, -8e-3))
    estimates, errors = [], []
    for spacing in (2e-4, 1e-4, 5e-5):
        field = source.resample(spacing, region=((0.0, -9e-3), (9e-3, 6e-3)))
        errors.append(field.resampling.opd_rms)
        estimates.append(estimate_strehl(field, pupil, wavelength=905e-9, ray_count=65_536))
    for k in (0, 1):
        assert errors[k + 1] < errors[k]
        assert abs(estimates[k + 1].value - estimates[k].value) < estimates[k].error["total"]


def test_the_mesh_itself_gives_the_same_strehl_ratio():
    """No resampling at all, rays through the curvilinear mesh: within the budgets of both."""
    source = flow.shipped("mach3").index_field()
    pupil = Disc(6e-3, (0.0, 0.0, -8e-3))
    grid = source.resample(5e-5, region=((0.0, -9e-3), (9e-3, 6e-3)))
    on_grid = estimate_strehl(grid, pupil, wavelength=905e-9, ray_count=16_384)
    on_mesh = estimate_strehl(source, pupil, wavelength=905e-9, ray_count=16_384)
    assert abs(on_grid.value - on_mesh.value) < on_grid.error["total"]
