"""The direction of a file's velocity beside the optical axis that is taken without a frame."""

import re
import warnings

import numpy as np
import pytest
import writers

from aerokernels.flow.reading.dataset import Block


def provenance(direction, *, frame=None, layers: int = 1, parts=("Velocity",), noise: float = 0.0) -> str:
    """What is said of a uniform flow along a direction of the file, in a plane or a volume."""
    axes = np.meshgrid(np.arange(4.0), np.arange(3.0), np.arange(float(layers)), indexing="ij")
    points = np.stack([own.ravel(order="F") for own in axes], axis=1)
    velocity = 600.0 * np.array(direction, float) + noise * np.random.default_rng(0).normal(size=points.shape)
    own = {parts[0]: velocity} if len(parts) == 1 else {name: velocity[:, k] for k, name in enumerate(parts)}
    block = Block(points, None, (4, 3, layers), {"rho": np.ones(len(points)), **own})
    return writers.field([block], name="file", frame=frame).provenance


NOTE = "the flow runs along {} by its {!r}, which is not against the optical axis: with flow = {!r}"


@pytest.mark.parametrize(
    ("parts", "name"),
    [(("Velocity",), "Velocity"), (("Momentum_x", "Momentum_y"), "Momentum_x"), (("u", "v", "w"), "u"),
     (("X-Velocity", "Y-Velocity"), "X-Velocity")],
)  # fmt: skip
def test_a_plane_whose_flow_runs_the_other_way_says_so(parts, name):
    """Set-up: a flow along -x, whose ambient density is then taken at its downstream end. Expected: a warning of it."""
    note = NOTE.format("-x", name, "-x")
    with pytest.warns(UserWarning, match=f"^file: {re.escape(note)}"):
        assert note in provenance((-1.0, 0.2, 0.0), parts=parts)
    assert "the flow runs" not in provenance((1.0, 0.2, 0.0), parts=parts)


def test_a_frame_and_a_flow_without_direction_need_no_word():
    assert "the flow runs" not in provenance((-1.0, 0.0, 0.0), frame={"flow": "-x"})
    assert "the flow runs" not in provenance((0.0, 0.0, 0.0), noise=100.0)
    assert "the flow runs" not in provenance((0.0, 0.0, 0.0))
    assert "the flow runs" not in provenance((-1e305, 0.0, 0.0))  # damaged numbers


def test_a_volume_whose_flow_runs_across_the_optical_axis_says_so():
    """It may be meant, and gives no warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert NOTE.format("+x", "Velocity", "+x") in provenance((1.0, 0.0, 0.0), layers=3)
    assert "the flow runs" not in provenance((0.0, 0.0, -1.0), layers=3)
