"""`aerokernels series` as a user meets it: a scene with a [series] table, a NetCDF file, and what comes out."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import xarray

from aerokernels.scene import Scene, shipped_scenes, warn_of_unused
from aerokernels.series import statistics
from tests.command import command
from tests.series.fourier import Fourier

SCENE = """
title = "A frozen layer"
[series]
source = "layer.nc"
velocity = "300 m/s"
pixel_count = 12
[receiver]
diameter = "30 mm"
aperture_z = "2 mm"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene and its snapshots: 24 of them, 1 microsecond apart."""
    pytest.importorskip("zarr")
    place = tmp_path_factory.mktemp("series")
    field, origin, spacing, shape = Fourier.random(7), (-0.02, -0.02, 0.0), 2e-3, (21, 21, 16)
    time = 2e-5 * np.arange(24)
    axes = {name: (name, origin[k] + spacing * np.arange(shape[k])) for k, name in enumerate("xyz")}
    density = np.stack([field.on_grid(origin, spacing, shape, t) for t in time]).astype(np.float32)
    data = xarray.Dataset({"rho": (("time", "x", "y", "z"), density)}, {"time": time, **axes}, {"ambient_density": 0.5})
    data.to_netcdf(place / "layer.nc", engine="h5netcdf")
    (place / "layer.toml").write_text(SCENE)
    return place


def test_a_series_gives_maps_statistics_and_a_report(folder: Path):
    done = command(folder, "series", "layer.toml", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "Strehl ratio, exact mean\t" in done.stdout and " +- " in done.stdout
    said = done.stderr.splitlines()
    assert not any("disturbed air" in line for line in said)  # waves fill the box, which is the flow
    assert sum("independent snapshots (of 24)" in line for line in said) == 1
    assert all(line.startswith(("layer: ", "wrote ", "warning: ")) for line in said), done.stderr
    out = folder / "out"
    assert {path.name for path in out.iterdir()} == {
        "series.zarr",
        "statistics.nc",
        "summary.json",
        "report.html",
    }
    summary = json.loads((out / "summary.json").read_text())
    maps = xarray.open_zarr(out / "series.zarr", chunks=None)
    assert dict(maps.opd.sizes) == {"time": 24, "y": 12, "x": 12} and summary["snapshot_count"] == 24
    numbers = statistics(maps)
    assert summary["opd_rms"] == pytest.approx(float(numbers.opd_rms), rel=1e-12)
    # The error after "+-" is two standard errors.
    assert summary["errors"]["opd_rms"] == pytest.approx(2.0 * float(numbers.opd_rms_error), rel=1e-9)
    assert summary["independent_count"] == pytest.approx(numbers.attrs["independent_count"], rel=1e-9)
    assert summary["opd_error_m"] < 1e-9
    assert {"jitter_x", "strehl_large_aperture"} <= set(summary)
    with xarray.open_dataset(out / "statistics.nc", engine="h5netcdf") as found:
        assert "strouhal" in found.coords and all("units" in one.attrs for one in found.variables.values())
    page = (out / "report.html").read_text()
    panels = re.findall(r'<figure class="panel" id="([\w-]+)">', page)
    maps_and_times = ["film", "opd-mean", "opd-std", "time-opd-rms", "time-strehl"]
    assert panels[:5] == maps_and_times and panels[5:7] == ["spectrum-opd", "spectrum-tilt"] and "mode-1" in panels
    (few,) = summary["warnings"]
    assert few == numbers.attrs["warnings"]
    assert "z = 30 mm" in maps.attrs["ends"] and not maps.attrs["truncation"]
    assert "No picture" not in page and not re.search(r'(src|href)="http', page)
    data = json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page)[1])  # type: ignore[index]
    assert len(data["plots"][0]["frames"]) == len(data["plots"][0]["times"]) == 24
    before = (out / "series.zarr" / "opd" / "c" / "0" / "0" / "0").stat().st_mtime_ns
    again = command(folder, "series", "layer.toml", "--out", "out")
    assert again.returncode == 0
    assert (out / "series.zarr" / "opd" / "c" / "0" / "0" / "0").stat().st_mtime_ns == before


def test_still_air_is_said_in_words(folder: Path, command_line):
    """Set-up: the same air in all snapshots and pixels. Expected: no film, no maps, no curves."""
    with xarray.open_dataset(folder / "layer.nc", engine="h5netcdf") as data:
        still = data.load().isel(time=slice(6))
    (still.assign(rho=0.0 * still.rho + 0.5)).to_netcdf(folder / "still.nc", engine="h5netcdf")
    (folder / "still.toml").write_text(SCENE.replace("layer.nc", "still.nc"))
    done = command_line("series", folder / "still.toml", "--out", folder / "still")
    assert done.returncode == 0, done.stderr
    page = (folder / "still" / "report.html").read_text()
    assert "the same in all pixels and snapshots" in page and "0, error below rounding" in page
    assert "data-plot" not in page and page.count("but for rounding") >= 3 and "No picture" not in page


@pytest.mark.parametrize(
    ("text", "arguments", "words"),
    [
        ('[flow]\nsource = "mach3"\n', [], ("series.source", "[series]")),
        (SCENE.replace("layer.nc", "nothing.nc"), [], ("series.source", "nothing.nc", "no such file")),
        (SCENE.replace('velocity = "300 m/s"', 'velocity = "300 m"'), [], ("series.velocity", "m/s")),
        (SCENE.replace("pixel_count = 12", "pixels = 12"), [], ("series.pixels", "pixel_count")),
        (SCENE, ["--set", "receiver.aperture_z=5 m"], ("no ray of the", "metres")),
        (SCENE, ["--set", "series.density=temperature"], ("series.source", "temperature", "rho")),
        (SCENE, ["--set", "flow.file.optical=-x"], ("bad.toml: series.source", "which take no frame")),
    ],
)
def test_bad_input_ends_with_status_2_and_writes_nothing(folder: Path, text, arguments, words, command_line):
    (folder / "bad.toml").write_text(text)
    done = command_line("series", folder / "bad.toml", "--out", folder / "refused", *arguments)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and done.stderr.startswith("error: "), done.stderr
    for word in words:
        assert word in done.stderr
    assert not (folder / "refused").exists()


def test_tables_without_an_effect_are_named(folder: Path, recwarn):
    """Beside a complete [flow] they are not refused; tables at their defaults, as in shipped scenes, are not named."""
    tables = {"detector.threshold": "0.5 V", "series.source": "layer.nc", "trace.method": "paper"}
    scene = Scene.load("wind-tunnel-mach3", tables)
    told = {
        "run": "[series] has",
        "strehl": "[detector], [series] have",
        "schlieren": "[detector], [series], trace.method have",
        "series": "[detector], flow.source, trace.method have",
    }
    for job, words in told.items():
        warn_of_unused(scene, job)
        assert str(recwarn.pop().message) == f"wind-tunnel-mach3-changed: {words} no effect here"
    for name in shipped_scenes():
        warn_of_unused(Scene.load(name), "run")
        warn_of_unused(Scene.load(name), "strehl")
        warn_of_unused(Scene.load(name), "schlieren")
    assert not recwarn
