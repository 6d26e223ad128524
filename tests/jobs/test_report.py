"""Figures of a run, and its main numbers as they are written."""

import base64
import io
import os

import matplotlib.image
import numpy as np
import pytest
import xarray

from aerokernels import DensityField
from aerokernels.jobs.numbers import headline_rows
from aerokernels.jobs.pages.air import Air, AirView, density_variables
from aerokernels.jobs.pages.front import Front

SUMMARY = {
    "scene": "trial <1>",
    "strehl": 0.91234,
    "strehl_marechal": 0.9,
    "opd_rms_m": 12.3e-9,
    "boresight_rad": 5.0**0.5 * 1e-6,
    "boresight_x_rad": 1e-6,
    "boresight_y_rad": -2e-6,
    "echo_peak_w": 2e-6,
    "echo_peak_v": 0.2,
    "range_m": None,
    "range_error_m": None,
    "backend": "reference",
    "device": "cpu",
    "precision": "float64",
    "plan": {"skipped": ["smooth regions"]},
    "error": {"step": 1.5e-4},
    "seconds": {"total": 1.0},
    "version": "0",
}


def test_a_number_is_written_with_its_error():
    errors = {"strehl": 0.0042, "opd_rms_m": None, "boresight_x_rad": 3e-8, "boresight_y_rad": 3e-8}
    reported = SUMMARY | {"errors": errors}
    rows = dict(headline_rows(reported))
    assert rows["Strehl ratio"] == "0.9123 +- 0.0042"
    assert rows["OPD, rms"] == "12.3 nm, error not known"
    assert rows["Boresight error x, y"] == "+1.000 +- 0.030, -2.000 +- 0.030 µrad"


def test_nothing_that_is_drawn_is_cut_off_and_no_picture_is_blank(dataset: xarray.Dataset):
    """Static figures of a run: labels inside the picture, more than a few colors, no formula."""
    from matplotlib.figure import Figure

    air = Air(dataset)
    assert air.near is not None
    with AirView(air, air.near, with_rays=True).figure() as figure:
        assert isinstance(figure, Figure)
        figure.canvas.draw()
        box = figure.get_tightbbox()
        width, height = figure.get_size_inches()
        assert min(box.x0, box.y0) >= 0.0 and box.x1 <= width and box.y1 <= height, box
    front = Front(dataset, 1e-10)
    for picture in (front.map("opd"), front.panels()[3].shown):
        data = base64.b64decode(picture.static().partition(",")[2])
        pixels = matplotlib.image.imread(io.BytesIO(data), format="png")
        colors = (255.0 * pixels[..., :3]).round().astype(int) @ [1 << 16, 1 << 8, 1]
        assert np.unique(colors).size > 20


def test_a_users_matplotlibrc_and_backend_do_not_change_pictures(tmp_path, aerokernels, monkeypatch):
    """Set-up: a file that asks for LaTeX on a machine without it, and the backend of a notebook elsewhere.

    Commands failed, or reports had no pictures. Expected: the same bytes as without.
    """
    np.savez(tmp_path / "flow.npz", x=np.arange(5.0), y=np.arange(4.0), rho=1.0 + np.arange(20.0).reshape(5, 4))
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nsavefig.bbox: tight\nfont.size: 30\n")
    (tmp_path / "latex").write_text("#!/bin/sh\nexit 1\n")
    (tmp_path / "latex").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    assert aerokernels("fields", "flow.npz", "--picture", "usual.png").returncode == 0
    monkeypatch.setenv("MATPLOTLIBRC", str(tmp_path))
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_elsewhere.backend")
    done = aerokernels("fields", "flow.npz", "--picture", "same.png")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "same.png").read_bytes() == (tmp_path / "usual.png").read_bytes()


def test_a_turned_pupil_is_not_labelled_with_the_frames_axes(dataset: xarray.Dataset):
    """A pupil that looks elsewhere has axes of its own: its map, its cuts and its boresight error say so."""
    own = ["the pupil's axis 1", "the pupil's axis 2"]
    for axes, words in (None, ("x", "y")), (own, own):
        front = Front(dataset if axes is None else dataset.assign_attrs(pupil_axes=axes), 1e-10)
        assert [axis.label for axis in (front.map("opd").x, front.map("opd").y)] == [f"{word} [mm]" for word in words]
    for azimuth, words in (0.0, "Boresight error x, y"), (0.3, "Boresight error along the pupil’s axes 1, 2"):
        rows = headline_rows({**SUMMARY, "scene_values": {"pupil": {"azimuth": azimuth, "elevation": 0.0}}})
        assert rows[-1][0] == words


def test_a_volume_beside_the_axis_is_shown_in_its_middle():
    """A dense core in the middle of a box from x = 0.5 m on; the plane x = 0 would show the ambient air."""
    samples = np.ones((6, 8, 9))
    samples[:, 3:5, 4:6] = 2.0
    grid = {"origin": (0.5, -0.1, 0.0), "spacing": (0.1, 0.03, 0.02), "geometry": "volume"}
    shown = density_variables(DensityField.from_samples(samples, **grid, ambient_density=1.0))
    assert shown["density"][1].max() == pytest.approx(2.0) and "x = 0.75 m" in shown["density"][2]["long_name"]
