"""The report stands alone and shows the data it was given."""

import base64
import io
import re

import matplotlib.image
import numpy as np
import pytest
import xarray

from aerokernels.study import plots
from aerokernels.study.report import headline_rows, render_report

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
    "plan": {"skipped": ["quiet blocks"]},
    "error": {"step": 1.5e-4},
    "seconds": {"total": 1.0},
    "version": "0",
}


@pytest.fixture
def page(dataset: xarray.Dataset) -> str:
    return render_report(dataset, SUMMARY, 'name = "trial"\n[target]\ndistance = "1.5 m"')


def test_report_holds_every_picture_and_loads_nothing(page: str):
    images = re.findall(r'<img alt="([^"]+)" src="data:image/png;base64,([^"]+)"', page)
    assert len(images) == len(plots.FIGURES) == 5
    for _, data in images:
        pixels = matplotlib.image.imread(io.BytesIO(base64.b64decode(data)), format="png")
        assert pixels.shape[0] > 300 and pixels.shape[1] > 600
        assert np.unique(pixels[..., :3].reshape(-1, 3), axis=0).shape[0] > 20, "a blank picture"
    assert not re.search(r"(src|href)\s*=\s*['\"](?!data:)|@import|<script", page)


def test_report_shows_numbers_plan_budget_and_citation(page: str):
    for words in (
        "0.91234",
        "12.3 nm",
        "+1, -2 µrad",
        "quiet blocks",
        "0.00015",
        "distance = &quot;1.5 m",
        "Missile-Borne",
    ):
        assert words in page, words
    assert "trial &lt;1&gt;" in page and "<1>" not in page


def test_a_range_that_was_not_found_is_told_as_such():
    assert ("Reported range", "none") in headline_rows(SUMMARY)


@pytest.mark.parametrize("name", plots.FIGURES)
def test_pictures_carry_units(name: str, dataset: xarray.Dataset):
    figure = plots.FIGURES[name][1](dataset)
    labels = [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel()) if text]
    unit = re.compile(r"\[(mm|nm|µm|ns|V|µW|µrad|kg/m³)\]|/ undisturbed peak")
    assert labels and all(unit.search(label) for label in labels), labels


def test_the_density_picture_draws_the_data(dataset: xarray.Dataset):
    """Set-up: a blob of known cell values. Expected: those values are drawn, once above and once below the axis."""
    figure = plots.density_figure(dataset)
    drawn = [mesh.get_array() for mesh in figure.axes[0].collections if mesh.get_array() is not None]
    assert len(drawn) == 2
    for values in drawn:
        np.testing.assert_array_equal(np.asarray(values).ravel(), dataset["density"].values.ravel())


def test_a_uniform_field_and_a_flat_wavefront_can_be_drawn(dataset: xarray.Dataset):
    still = dataset.drop_vars(["body_y", "body_z"])
    still["density"] = still["density"] * 0.0 + 1.2
    still["opd"], still["opd_without_tilt"] = still["opd"] * 0.0, still["opd_without_tilt"] * 0.0
    still["echo_power"], still["echo_voltage"] = still["echo_power"] * 0.0, still["echo_voltage"] * 0.0
    still.attrs |= {"range_m": float("nan"), "geometry": "planar"}
    for _, draw in plots.FIGURES.values():
        assert plots.png(draw(still)).startswith(b"\x89PNG")
