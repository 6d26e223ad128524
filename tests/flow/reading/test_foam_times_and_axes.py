"""OpenFOAM cases whose times or axis are stated in several places: which of them count."""

import shutil

import numpy as np
import pytest
import writers

from aerokernels import flow


def test_a_time_that_only_the_processors_have_is_the_latest(tmp_path):
    """Set-up: a case put together at t = 0.5, whose processors went on to 0.75. Expected: both times, latest 0.75."""
    case = writers.foam_wedge(tmp_path / "case", wedge=False)
    part = writers.foam_wedge(case / "processor0", wedge=False)
    (part / "0.5").rename(part / "0.75")
    field = flow.read(case)
    assert "decomposed in 1; t = 0.75" in field.provenance
    assert "decomposed" not in flow.read(case, time=0.5).provenance
    assert flow.open_series(case).time.tolist() == [0.5, 0.75]


def test_the_initial_state_of_a_collated_case_is_not_its_result(tmp_path):
    """Set-up: a case at t = 0 beside processors4, whose files hold all processors. Expected: an error, not t = 0."""
    case = writers.foam_wedge(tmp_path / "case", wedge=False)
    (case / "0.5").rename(case / "0")
    assert "t = 0" in flow.read(case).provenance
    (case / "processors4" / "0.5").mkdir(parents=True)
    with pytest.raises(ValueError, match=r"processors4: its fields are in the collated format.*run reconstructPar"):
        flow.read(case)
    shutil.copytree(case / "0", case / "0.25")
    assert "t = 0.25" in flow.read(case).provenance


@pytest.mark.parametrize("shift", [0, 1, 2], ids=["x", "y", "z"])
def test_the_axis_of_a_wedge_with_a_side_in_a_coordinate_plane(tmp_path, shift):
    """Set-up: a wedge from 0 to 0.08 rad about x, y or z: its first side lies between two coordinate axes.

    Expected: the radii, and the densities at them, are those of the wedge about its own axis.
    """
    angle = 0.04
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.roll(np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]]), shift, axis=0)
    case = writers.foam_wedge(tmp_path / "case", half_angle=angle, turn=turn)
    field = flow.read(case)
    x, r = writers.grid()
    corners = field.mesh.corners
    assert f"axisymmetric, z along -{'xyz'[shift]} of the file" in field.provenance
    assert [corners[..., 0].min(), corners[..., 0].max()] == pytest.approx([r.min() + 0.02, r.max() + 0.02])
    middle = corners.mean(axis=1)
    assert field.density == pytest.approx(writers.rho(-middle[:, 1], middle[:, 0]), abs=1e-12)
    assert np.ptp(corners[..., 1]) == pytest.approx(np.ptp(x))


def test_a_field_that_is_code_is_refused_as_such(tmp_path):
    case = writers.foam_wedge(tmp_path / "case")
    head = writers.foam_header("volScalarField", "rho", False)
    (case / "0.5" / "rho").write_bytes(head + b"dimensions [1 -3 0 0 0 0 0];\ninternalField #codeStream\n{\n}\n")
    with pytest.raises(
        flow.ReadError, match="its internalField is code, such as #codeStream, which OpenFOAM alone runs: run"
    ):
        flow.read(case)
