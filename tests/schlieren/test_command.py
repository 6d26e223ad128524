"""`aerokernels schlieren` as a user meets it, with real files."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import xarray
from PIL import Image

from aerokernels.benches import read_picture
from aerokernels.jobs.pictures import BenchPictures, PictureOptions, picture_field, picture_scene

SMALL = ("--pixels", "160", "--spacing", "0.4 mm")


def test_pictures_of_a_shipped_flow_and_a_photograph(aerokernels, command_line, tmp_path: Path):
    """All kinds; then the schlieren picture just written serves as the photograph of the same scene."""
    extent = ("--extent", "-80 mm,5 mm,-60 mm,60 mm")
    done = aerokernels("schlieren", "mach3", "--out", "out", *SMALL, *extent, "--shock", "-60 mm,-30 mm")
    assert done.returncode == 0, done.stderr
    out = tmp_path / "out"
    assert sorted(path.name for path in out.iterdir()) == [
        "figure.png", "interferogram.png", "pictures.nc", "schlieren.png", "shadowgraph.png", "summary.json",
    ]  # fmt: skip
    summary = json.loads((out / "summary.json").read_text())
    assert math.radians(24.0) < summary["shock_angle_rad"] < math.radians(29.0)
    with xarray.open_dataset(out / "pictures.nc", engine="h5netcdf") as data:
        assert {"schlieren", "shadowgraph", "interferogram", "opd", "deflection", "blocked"} <= set(data)
        assert all("units" in variable.attrs for variable in data.variables.values())
        z, y = data["horizontal"].values, data["vertical"].values
        written = data["schlieren"].values
    pitch = z[1] - z[0]
    nose = (-z[0] / pitch, y[-1] / pitch)
    photo = read_picture(out / "schlieren.png", pixel_size=pitch, nose=nose)
    np.testing.assert_allclose(photo.intensity, written, atol=1e-5)

    photograph = ("--measured", out / "schlieren.png", "--pixel-size", f"{pitch} m", "--nose", f"{nose[0]},{nose[1]}")
    again = command_line(
        "schlieren", "wind-tunnel-mach3", "--out", "two", "--kind", "schlieren", *SMALL, *extent, *photograph
    )
    assert again.returncode == 0, again.stderr
    assert (
        json.loads((tmp_path / "two" / "summary.json").read_text())["correlation"] > 0.99
    )  # its pixels are square to 0.5 %
    assert Image.open(tmp_path / "two" / "comparison.png").size[0] > 300


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("mach9",), ("mach9", "mach3", "wind-tunnel-mach3")),
        (("mach3", "--kind", "photo"), ("photo", "shadowgraph")),
        (("mach3", "--extent", "1,2"), ("--extent", "4 values")),
        (("mach3", "--extent", "1 m,0 m,0 m,1 m"), ("extent", "increasing")),
        (("mach3", "--pixels", "0"), ("pixels = 0",)),
        (("mach3", "--knife-edge", "up"), ("--knife-edge", "angle")),
        (("mach3", "--screen", "3 kg"), ("--screen", "length")),
        (("mach3", "--cut-off", "3"), ("cut_off",)),
        (("mach3", "--shock", "2 mm,1 mm"), ("shock", "increasing")),
        (("mach3", "--set", "flow.density=-1"), ("flow.density",)),
        (("mach3", "--measured", "no.png"), ("--pixel-size",)),
        (("mach3", "--measured", "no.png", "--pixel-size", "1 mm", "--nose", "1,1"), ("no.png", "no such file")),
        (("mach3", "--nose", "1,1", "--upstream", "up"), ("--nose, --upstream", "--measured")),
        (("mach3", *SMALL, "--rays-per-pixel", "100000"), ("rays_per_pixel", "smaller")),
        (("mach3", *SMALL, "--shock", "50 mm,60 mm", "--kind", "schlieren"), ("mach3", "window")),
    ],
)
def test_bad_input_ends_with_status_2_and_one_line(command_line, tmp_path: Path, arguments: tuple, words: tuple):
    done = command_line("schlieren", *arguments, "--out", "out")
    assert done.returncode == 2, done
    *progress, last = done.stderr.splitlines()
    assert all(re.match(r"[\w-]+: [a-z' ]+$", line) for line in progress), done.stderr
    assert last.startswith("error: ") and all(word in last for word in words), done.stderr
    assert list(tmp_path.iterdir()) == []


def test_pictures_take_the_flow_s_interpolation_and_no_mesh_route():
    """A picture of Mach 3: flow.interpolation changes its field, and grid.route "mesh" is refused."""
    options = PictureOptions(pixel_count=16)
    fields = []
    for changes in ({}, {"flow.interpolation": "bilinear"}, {"flow.interpolation": "conserving"}):
        scene = picture_scene("mach3", changes)
        fields.append(np.asarray(picture_field(scene.density_field(), scene, options).samples.samples))
    assert np.array_equal(fields[0], fields[1]) and not np.array_equal(fields[0], fields[2])
    scene = picture_scene("mach3", {"grid.route": "mesh"})
    with pytest.raises(ValueError, match=r"grid\.route = 'mesh' is not for pictures"):
        picture_field(scene.density_field(), scene, options)


def test_errors_of_the_brightness_on_request(command_line, tmp_path: Path):
    """Printed, in the summary and beside the picture; what they hold is tested in test_picture_errors.py."""
    options = ("--kind", "schlieren", "--pixels", "12", "--spacing", "3 mm", "--extent", "-60 mm,5 mm,-40 mm,40 mm")
    done = command_line("schlieren", "mach3", "--out", "out", *options, "--errors")
    with xarray.open_dataset(tmp_path / "out" / "pictures.nc", engine="h5netcdf") as data:
        assert data["schlieren_error"].dims == data["schlieren"].dims and data["schlieren_error"].units == "1"
        error = data["schlieren_error"].values
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    median, greatest = np.median(error), error.max()
    assert 0.0 <= median < greatest < np.inf
    assert summary["schlieren_error_median"] == pytest.approx(median)
    assert summary["schlieren_error_greatest"] == pytest.approx(greatest)
    assert f"median {median:.2g}, greatest {greatest:.2g} of white" in done.stdout


def test_an_error_that_is_not_known_is_no_number():
    """Of kinds whose error is not known in a pixel, as on some meshes, neither median nor greatest are told."""
    errors = {"schlieren": np.array([[0.1, np.nan]]), "shadowgraph": np.array([[0.1, 0.3]])}
    made = BenchPictures(*[None] * 7, errors)  # type: ignore[arg-type]
    assert made.pixel_errors == {"schlieren": None, "shadowgraph": pytest.approx((0.2, 0.3))}
