"""What `explain` says of scenes of several kinds; options of commands, pictures and figures that are refused."""

import numpy as np
import pytest

from aerokernels import Scene, Wavefront
from aerokernels.commands._scene import parse_vary
from aerokernels.commands.hardware import parse_labels
from aerokernels.jobs.comparison import _reference
from aerokernels.jobs.explain import explanation
from aerokernels.jobs.pages.air import save_flow_figure
from aerokernels.jobs.pictures import PictureOptions

MACH3 = Scene.load("wind-tunnel-mach3")


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"receiver.return_factor": "none"}, {"rays, echo": "return path not traced (return factor none)"}),
        ({"receiver.strehl_node_count": "every"}, {"rays, echo": "at each target point"}),
        ({"grid.route": "mesh"}, {"grid": "none: the index is interpolated on the flow's mesh, bilinear"}),
    ],
)
def test_explain_says_how_a_scene_goes(settings, told):
    found = dict(explanation(Scene.load("wind-tunnel-mach3", settings)))
    for key, words in told.items():
        assert words in found[key]
    assert "cells, axisymmetric" in found["flow mesh"] or "nodes" in found["flow mesh"]


def test_a_figure_of_a_flow_has_a_known_format(tmp_path):
    density = MACH3.density_field()
    with pytest.raises(ValueError, match=r"'\.xyz' is not a picture format: use \.png"):
        save_flow_figure(density, tmp_path / "a.xyz")


@pytest.mark.parametrize(
    ("made", "told"),
    [
        (lambda: PictureOptions(kinds=("schlieren",), spacing=-1.0), r"spacing = -1\.0: give a positive length"),
        (lambda: PictureOptions(kinds=("shadowgraph",), shock_window=(0.0, 1.0)), "request that kind too"),
        (lambda: PictureOptions(kinds=()), "picture none is not known"),
        (lambda: parse_vary(["target.tilt=1", "target.tilt=2"]), "--vary target.tilt is given twice"),
        (lambda: parse_vary(["target.tilt=1 deg:1 deg:5"]), "write LOW:HIGH:COUNT with two quantities"),
        (lambda: parse_vary(["target.tilt=0 deg:1 deg:1"]), "write LOW:HIGH:COUNT with two quantities"),
        (lambda: parse_labels(["mach=3", "mach=4"]), "'mach' is given twice; give each key once"),
        (lambda: _reference("mach=3", {}), "align mach=3: 0 labels with a run have it"),
        (lambda: Wavefront(np.zeros((4, 4)), np.ones((4, 4)), 0.0, 1e-6), "pixel must be positive and finite"),
        (lambda: Wavefront(np.zeros((4, 4)), -np.ones((4, 4)), 1.0, 1e-6), "weights must be finite, not negative"),
        (lambda: Wavefront(np.zeros((4, 4)), np.ones((4, 4)), 1.0, 1e-6, radius=-1.0), "radius must be positive"),
        (lambda: Wavefront(np.zeros((4, 4)), np.ones((4, 4)), 1.0, 1e-6, intensity=np.zeros((4, 4))),
         "nowhere below their square"),
    ],
)  # fmt: skip
def test_options(made, told):
    with pytest.raises(ValueError, match=told):
        made()
