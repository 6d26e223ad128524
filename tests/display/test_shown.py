"""Objects show themselves in a few lines, in notebooks too; a saved trace keeps where its rays start."""

import base64
import html
import io
import re

import numpy as np
import pytest
from PIL import Image

from aerokernels import Disc, IndexField, RayBundle, Scene, flow, trace, wavefront
from aerokernels.display.shown import described


@pytest.fixture(scope="module")
def field() -> IndexField:
    z = np.linspace(0.0, 1e-2, 17)
    contrast = 1e-5 * np.ones((9, 1)) * np.sin(300.0 * z)
    return IndexField.from_samples(contrast, origin=(0, 0), spacing=(1e-3, 625e-6), geometry="axisymmetric")


def test_reprs_have_few_lines_and_units(field):
    for thing in (field, field.samples, flow.uniform_air(), RayBundle.collimated(Disc(1e-3), 64), Disc(1e-3)):
        lines = repr(thing).splitlines()
        assert lines[0] == type(thing).__name__ and 2 < len(lines) < 14 and max(map(len, lines)) < 120
    assert "  radius: 0.001 m" in repr(Disc(1e-3)) and "64 x 3, " in repr(RayBundle.collimated(Disc(1e-3), 64))
    assert described(np.full(9, np.nan)) == "9, none finite" and described("<a>") == "'<a>'"


def test_notebooks_show_the_same_and_nothing_of_it_as_html():
    assert Disc(1e-3)._repr_html_() == f"<pre>{Disc(1e-3)!r}</pre>"
    assert "<b>" not in flow.uniform_air(1.0, radius=4e-3)._repr_html_()


def picture_in(thing) -> np.ndarray | None:
    """The pixels of the picture that a notebook shows of a thing, uppermost row first; None for an SVG file."""
    kind, data = re.search(r'<img src="data:image/(png|svg)[^,]*,([^"]+)"', thing._repr_html_()).groups()
    found = base64.b64decode(data)
    if kind == "svg":
        assert found.rstrip().endswith(b"</svg>")
        return None
    return np.asarray(Image.open(io.BytesIO(found)).convert("RGB"), dtype=float)


def test_notebooks_show_one_picture_with_the_numbers(field, tmp_path):
    """Fields, wavefronts, traces and scenes: the text that is printed, then the picture."""
    rays = RayBundle.collimated(Disc(1e-3, (0.0, 0.0, -1e-3)), 64)
    wave = wavefront(field, Disc(1e-3, (0.0, 0.0, -1e-3)), pixel_count=16)
    for thing in (field, wave, trace(field, rays), flow.wedge(3.0, 0.2)):
        assert thing._repr_html_().startswith(f"<pre>{html.escape(repr(thing))}</pre><img ")
        picture_in(thing)
    assert "+-" in wave._repr_html_()
    scene = Scene.load("wind-tunnel-mach3", {"target.tilt": "0.25 rad"})
    assert "target.tilt: 0.25 rad" in scene._repr_html_() and picture_in(scene).size
    (tmp_path / "torn.vtu").write_text("no flow")
    without = Scene.load("wind-tunnel-mach3", {"flow.source": str(tmp_path / "torn.vtu")})
    assert f"flow.source: {tmp_path / 'torn.vtu'}" in without._repr_html_() and "<img" not in without._repr_html_()
    assert "<img" not in trace(field, rays, outputs=("opd",))._repr_html_()


def test_the_picture_of_a_field_is_upright():
    """Contrast in one corner only, y up and z to the right: the brightest colors are in the upper right corner."""
    contrast = np.zeros((40, 40))
    contrast[30:, 30:] = 1e-4
    field = IndexField.from_samples(contrast, origin=(0, 0), spacing=(1e-3, 1e-3), geometry="planar")
    pixels = picture_in(field)
    yellow = (pixels[..., 0] > 200) & (pixels[..., 1] > 200) & (pixels[..., 2] < 90)
    rows, columns = np.nonzero(yellow[:, : int(0.7 * pixels.shape[1])])  # without the color bar
    assert rows.size and rows.max() < 0.4 * len(pixels) and columns.min() > 0.4 * pixels.shape[1]


def test_a_run_prints_as_on_the_command_line(small_run):
    """The rows of `aerokernels run` in a terminal that is none, but for the time."""
    run, _ = small_run
    lines = repr(run).splitlines()
    assert lines[0] == run.scene.title and lines[1].split("  ")[1] == "Strehl ratio" and "+-" in lines[1]
    assert "2,000 requested" in str(run) and "µW" in str(run) and picture_in(run).size
