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


def test_the_last_cell_may_own_no_face(tmp_path):
    """27 cubes, the one in the middle listed last: all of its faces belong to cells of lower numbers."""
    axis = np.linspace(0.0, 0.03, 4)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)
    place, cell = np.arange(64).reshape(4, 4, 4), np.full((5, 5, 5), -1)
    cell[1:-1, 1:-1, 1:-1] = np.insert(np.arange(26), 13, 26).reshape(3, 3, 3)
    faces = []
    for along in range(3):
        step, one, other = np.roll(np.eye(3, dtype=int), along, axis=0)
        for at in map(np.array, np.ndindex(*(3 + step))):
            corners = [place[tuple(at + shift)] for shift in (0 * step, one, one + other, other)]
            ahead, behind = (int(cell[tuple(at + 1 - shift)]) for shift in (0 * step, step))
            turned = behind < 0 or 0 <= ahead < behind  # out of the owner, which has the lower number
            own, beside = (ahead, behind) if turned else (behind, ahead)
            faces.append((beside < 0, own, beside, corners[::-1] if turned else corners))
    faces.sort()
    inner = sum(not outside for outside, *_ in faces)
    mesh, result = tmp_path / "constant" / "polyMesh", tmp_path / "1"
    mesh.mkdir(parents=True)
    result.mkdir()
    boundary = f"\n1(out {{ type patch; nFaces {len(faces) - inner}; startFace {inner}; }})\n".encode()
    corners = "\n".join(f"4({' '.join(map(str, one))})" for *_, one in faces)
    density = 1.0 + np.arange(27) / 100.0
    head = b"dimensions [1 -3 0 0 0 0 0];\ninternalField nonuniform List<scalar> "
    tail = b";\nboundaryField { out { type zeroGradient; } }\n"
    for folder, name, kind, body in (
        (mesh, "points", "vectorField", writers.foam_list(points.reshape(-1, 3), False)),
        (mesh, "faces", "faceList", f"\n{len(faces)}\n(\n{corners}\n)\n".encode()),
        (mesh, "owner", "labelList", writers.foam_list(np.array([one[1] for one in faces]), False)),
        (mesh, "neighbour", "labelList", writers.foam_list(np.array([one[2] for one in faces[:inner]]), False)),
        (mesh, "boundary", "polyBoundaryMesh", boundary),
        (result, "rho", "volScalarField", head + writers.foam_list(density, False) + tail),
    ):
        (folder / name).write_bytes(writers.foam_header(kind, name, False) + body)
    field = flow.read(tmp_path, spacing=0.0025)
    found = field.index_field(905e-9, "gladstone-dale").contrast_at([[0.015, 0.015, 0.015], [0.005, 0.005, 0.025]])
    assert found[0] > found[1] + 0.1 * flow.gladstone_dale_constant(905e-9)


@pytest.mark.parametrize("name", ["processors", "processors4"])
def test_collated_fields_are_refused_as_such(tmp_path, name):
    """A folder without the number of processors, as of some versions, was answered by "no fields at any time"."""
    case = writers.foam_wedge(tmp_path / "case")
    (case / "0.5").rename(case / "unread")
    (case / name / "0.5").mkdir(parents=True)
    (case / name / "0.5" / "rho").write_text("")
    with pytest.raises(flow.ReadError, match="its fields are in the collated format, which is not read"):
        flow.read(case)


def test_a_field_that_is_code_is_refused_as_such(tmp_path):
    case = writers.foam_wedge(tmp_path / "case")
    head = writers.foam_header("volScalarField", "rho", False)
    (case / "0.5" / "rho").write_bytes(head + b"dimensions [1 -3 0 0 0 0 0];\ninternalField #codeStream\n{\n}\n")
    with pytest.raises(
        flow.ReadError, match="its internalField is code, such as #codeStream, which OpenFOAM alone runs: run"
    ):
        flow.read(case)
