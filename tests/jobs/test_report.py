"""The report stands alone and shows the data it was given."""

import base64
import io
import os
import re
import subprocess
import sys

import matplotlib.image
import numpy as np
import pytest
import xarray

from aerokernels.jobs import plots
from aerokernels.jobs.page import png
from aerokernels.jobs.report import headline_rows, render_report, run_figures

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


@pytest.fixture
def page(dataset: xarray.Dataset) -> str:
    return render_report(run_figures(dataset), SUMMARY, 'name = "trial"\n[target]\ndistance = "1.5 m"')


def test_report_holds_every_picture_and_loads_nothing(page: str):
    images = re.findall(r'<img alt="([^"]+)" src="data:image/png;base64,([^"]+)"', page)
    assert len(images) == len(plots.FIGURES) == 5
    for _, data in images:
        pixels = matplotlib.image.imread(io.BytesIO(base64.b64decode(data)), format="png")
        assert pixels.shape[0] > 300 and pixels.shape[1] > 600
        colours = (255.0 * pixels[..., :3]).round().astype(int) @ [1 << 16, 1 << 8, 1]
        assert np.unique(colours).size > 20, "a blank picture"
    assert not re.search(r"(src|href)\s*=\s*['\"](?!data:)|@import|<script", page)


def test_report_shows_numbers_plan_budget_and_citation(page: str):
    for words in (
        "0.91234",
        "12.3 nm",
        "+1, -2 µrad",
        "smooth regions",
        "0.00015",
        "distance = &#34;1.5 m",
        "Missile-Borne",
    ):
        assert words in page, words
    assert "trial &lt;1&gt;" in page and "<1>" not in page


def test_a_number_is_written_with_its_error():
    errors = {"strehl": 0.0042, "opd_rms_m": None, "boresight_x_rad": 3e-8, "boresight_y_rad": 3e-8}
    reported = SUMMARY | {"errors": errors}
    rows = dict(headline_rows(reported))
    assert rows["Strehl ratio"] == "0.9123 +- 0.0042"
    assert rows["OPD, rms"] == "12.3 nm, error not known"
    assert rows["Boresight error x, y"] == "+1.000 +- 0.030, -2.000 +- 0.030 µrad"


@pytest.mark.parametrize("name", plots.FIGURES)
def test_nothing_that_is_written_is_cut_off(name: str, dataset: xarray.Dataset):
    """Panels have fixed room around them. Expected: the box of all that is drawn lies in the picture, and no formula.

    Also with large numbers on the scales, whose labels are the widest.
    """
    wide = dataset.assign(density=1234.5 * dataset["density"], echo_power=1e3 * dataset["echo_power"])
    wide = wide.assign(ray_deviation=-12.0 * dataset["ray_deviation"])
    for data in (dataset, wide):
        figure = plots.FIGURES[name][1](data)
        png(figure)
        drawn = figure.get_tightbbox()  # [in]
        width, height = figure.get_size_inches()
        assert drawn.x0 >= 0.0 and drawn.y0 >= 0.0 and drawn.x1 <= width and drawn.y1 <= height, drawn
        for axes in figure.axes:
            labels = [label.get_text() for label in (*axes.get_xticklabels(), *axes.get_yticklabels())]
            assert not any("$" in label for label in labels), labels


def test_a_users_matplotlibrc_and_backend_do_not_change_pictures(tmp_path):
    """Set-up: a file that asks for LaTeX on a machine without it, and the backend of a notebook elsewhere.

    Commands failed, or reports had no pictures. Expected: the same bytes as without.
    """
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nsavefig.bbox: tight\nfont.size: 30\n")
    (tmp_path / "latex").write_text("#!/bin/sh\nexit 1\n")
    (tmp_path / "latex").chmod(0o755)
    pictures = []
    for more in ({}, {"MATPLOTLIBRC": str(tmp_path), "MPLBACKEND": "module://matplotlib_elsewhere.backend"}):
        environment = {**os.environ, "PATH": os.pathsep.join((str(tmp_path), os.environ["PATH"])), **more}
        line = [sys.executable, "-m", "aerokernels", "schlieren", "mach3", "--pixels", "16", "--out", "out"]
        place = tmp_path / str(len(pictures))
        place.mkdir()
        done = subprocess.run(line, cwd=place, env=environment, capture_output=True, encoding="utf-8", timeout=120)
        assert done.returncode == 0, done.stderr
        pictures.append((place / "out" / "figure.png").read_bytes())
    assert pictures[0] == pictures[1]


def test_numbers_have_labels_and_what_users_wrote_is_escaped():
    """Keys of summary.json stand as words with units; a title and a scene of a stranger's stay texts."""
    summary = {
        "title": "<script>alert(1)</script>",
        "strehl": 0.9,
        "ranges_m": {"leading-edge": 1.5},
        "provenance": "<img src=x onerror=alert(1)>",
        "scene_values": {"flow": {"density": 1.0}},
        "failures": {"echo": "<b>none</b>"},
        "errors": {"strehl": 0.01},
        "version": "<i>1</i>",
    }
    page = render_report([], summary, "</pre><script>")
    assert "range by leading edge [m]" in page and "ranges_m" not in page and "scene_values" not in page
    for told in ("<script", "<img", "<b>none</b></p>", "<i>1"):
        assert told not in page


def test_a_turned_pupil_is_not_labelled_with_the_frames_axes(dataset: xarray.Dataset):
    """A pupil that looks elsewhere has axes of its own: its map, its spot and its boresight error say so."""
    own = ["the pupil's axis 1", "the pupil's axis 2"]
    for axes, words in (None, ("x", "y")), (own, own):
        shown = dataset if axes is None else dataset.assign_attrs(pupil_axes=axes)
        panel = plots.opd_figure(shown).axes[0]
        assert (panel.get_xlabel(), panel.get_ylabel()) == tuple(f"{word} [mm]" for word in words)
        assert plots.point_spread_figure(shown).axes[0].get_ylabel() == f"angle toward {words[1]} [µrad]"
    for azimuth, words in (0.0, "Boresight error x, y"), (0.3, "Boresight error along the pupil’s axes 1, 2"):
        rows = headline_rows({**SUMMARY, "scene_values": {"pupil": {"azimuth": azimuth, "elevation": 0.0}}})
        assert rows[-1][0] == words
