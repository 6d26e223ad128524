"""The linking equation of a series from its own rays, and what statistics make of it."""

import math

import numpy as np
import pytest

from aerokernels import Rectangle, flow, optical_series, statistics
from aerokernels.series.linking import linking_equation
from aerokernels.series.uncertainty import standard_errors

from .fourier import CONSTANT, WAVELENGTH, Fourier

SHAPE, SPACING, ORIGIN = (17, 19, 13), 2.5e-3, (-0.02, -0.0225, 0.0)
ALONG = np.array([0.1, -0.05, 1.0]) / math.sqrt(1.0125)


def moving(count: int) -> flow.Series:
    """Modes that are carried past."""
    field = Fourier.random(3, amplitude=0.01)
    field.mean = 1.0
    arrays = [field.on_grid(ORIGIN, SPACING, SHAPE, k * 2e-5) for k in range(count)]
    return flow.open_series(
        arrays,
        time=2e-5 * np.arange(count),
        geometry="volume",
        origin=ORIGIN,
        spacing=[SPACING] * 3,
        ambient_density=0.9,
    )


@pytest.mark.parametrize("count", [1, 2, 5])
@pytest.mark.parametrize("remove", [("piston",), ("piston", "tilt"), ()])
def test_statistics_add_back_what_was_removed_from_the_maps(count: int, remove: tuple[str, ...]):
    """The variance in time at a point, of maps with their means and tilts; from two snapshots on."""
    series = moving(count)
    options = {"direction": ALONG, "pixel_count": 8, "method": "linear", "constant": CONSTANT, "wavelength": WAVELENGTH}
    pupil = Rectangle(0.012, 0.009, (1e-3, -1e-3, 2e-3))
    maps = optical_series(series, pupil, remove=remove, **options)
    found = statistics(maps, series=series)
    if count == 1:
        assert "opd_rms_linking" not in found and "at least two snapshots" in found.attrs["skipped"]
        return
    whole = optical_series(series, pupil, remove=(), **options)
    lit = maps.weight.values > 0.0
    opd, weight = whole.opd.values[:, lit], maps.weight.values[lit] / maps.weight.values.sum()
    independent = weight @ standard_errors(opd)[1]
    point = math.sqrt(float(weight @ opd.var(axis=0)) * independent / (independent - 1.0))
    assert float(found.opd_rms_point) == pytest.approx(point, rel=1e-6, abs=0.0)
    x, y = np.meshgrid(maps.x, maps.y)
    first, second = np.reshape(maps.attrs["pupil_axes"], (2, 3))  # coordinates of maps are across the look
    start = pupil.center + x[lit][:, None] * first + y[lit][:, None] * second
    linked = linking_equation(series, start, ALONG, WAVELENGTH, constant=CONSTANT)
    for name, mean in linked.items():
        assert float(found[name]) == pytest.approx(mean.value, rel=1e-9, abs=0.0)
    assert float(found.opd_rms_path) == pytest.approx(point, rel=0.1, abs=0.0)


def test_maps_of_some_times_are_linked_with_the_snapshots_at_these_times():
    """The second half is a series of its own, and every second snapshot; another series' times are named."""
    series, pupil = moving(8), Rectangle(0.012, 0.009, (1e-3, -1e-3, 2e-3))
    options = {"direction": ALONG, "pixel_count": 8, "method": "linear", "constant": CONSTANT, "wavelength": WAVELENGTH}
    maps = optical_series(series, pupil, **options)
    for part in (slice(4, None), slice(None, None, 2)):
        fields = [series[k] for k in range(8)[part]]
        alone = flow.open_series(fields, time=np.asarray(series.time)[part])
        expected = statistics(optical_series(alone, pupil, **options), series=alone)
        found = statistics(maps.isel(time=part), series=series)
        for name in ("opd_rms_linking", "opd_rms_path", "opd_rms_point"):
            assert float(found[name]) == pytest.approx(float(expected[name]), rel=1e-6, abs=0.0)
    later = maps.isel(time=slice(4)).assign_coords(time=maps.time.values[:4] + 1.0)
    dated = maps.isel(time=slice(4, 8)).assign_coords(time=np.datetime64("2026-01-01", "ns") + np.arange(4) * 20_000)
    for part, time in ((later, "1"), (dated, "nan")):
        assert f"no snapshot at {time}" in statistics(part, series=series).attrs["skipped"]


def test_series_without_a_linking_equation_have_their_other_statistics():
    """Grids that move along with the flow, a mixture, a relation that is not linear: named in `skipped`."""
    series, pupil, options = moving(4), Rectangle(0.012, 0.009, (1e-3, -1e-3, 2e-3)), {"pixel_count": 4}
    grid = series.mesh
    fields = [
        flow.GridDensity(series.density(k), np.add(grid.origin, (1e-3 * k, 0.0, 0.0)), grid.spacing, "volume", 0.9)
        for k in range(4)
    ]
    moved = flow.open_series(fields, time_step=2e-5)
    for each, more, words in (
        (moved, {}, "snapshot 1 is elsewhere"),
        (series, {"relation": "lorentz-lorenz"}, "not linear"),
    ):
        found = statistics(optical_series(each, pupil, **options, **more), series=each)
        assert words in found.attrs["skipped"]
        assert "opd_rms_path" not in found and float(found.opd_rms) > 0.0
    blurred = optical_series(series, pupil, remove=("piston", "tilt", "focus"), **options)
    found = statistics(blurred, series=series)
    assert "opd_rms_path" in found and "opd_rms_point" not in found
